"""How far decompressed poses are from the true ones: the losses of Compressor and Decompressor."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lmm.layout import Layout
from motion.skeleton import Skeleton

from . import pose_kernels
from .pose_kernels import TERMS
from .rotations import ForwardKinematics, orthonormal

# REFERENCE 3.2, in the order of TERMS.
PUBLISHED = (75.0, 10.0, 10.0, 1.25, 2.0, 2.0, 2.0, 15.0, 5.0, 2.0, 0.75, 10.0, 1.75, 2.0, 0.75)
AT_LEAST = 32  # windows a thread


def joints(parents: NDArray[np.int32], vectors: NDArray[np.float32]) -> tuple[NDArray[np.float32], ...]:
    """Of vectors [N, D] the joints in the root's space: positions [N, J, 3], rotations [N, J, 3, 3],
    velocities and angular velocities [N, J, 3]."""
    shape = len(vectors), len(parents)
    x, v, w = (np.empty((*shape, 3), np.float32) for _ in range(3))
    r = np.empty((*shape, 3, 3), np.float32)
    pose_kernels.forward(parents, np.ascontiguousarray(vectors, np.float32), x, r, v, w)
    return x, r, v, w


class PoseLoss:
    """Mean absolute differences of local and character-space joints, of their rates over a window, of the
    root's motion and of contacts (REFERENCE 3.2).

    Parameters
    ----------
    skeleton, contacts, fps : of the data; contacts are counted.
    truth : float32 [T, D], vectors of all frames (`lmm.layout.Layout`).
    weights : one a term, in the order of TERMS.
    threads : that the compiled pass may use.
    device : where `plain` computes.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        contacts: int,
        fps: float,
        truth: NDArray[np.float32],
        *,
        weights: Sequence[float] = PUBLISHED,
        threads: int = 1,
        device: str = "cpu",
    ) -> None:
        self._layout, self._fps, self._weights = Layout(len(skeleton), contacts), fps, tuple(weights)
        self.parents = np.ascontiguousarray(skeleton.parents, np.int32)
        self._kinematics = ForwardKinematics(skeleton, device)
        self._truth, self._threads = truth, threads

    def coefficients(self, windows: int, window: int) -> NDArray[np.float32]:
        """Weight of each term's sum, so that it becomes a mean, and differences become rates per second."""
        n, contacts = self._layout.joints - 1, self._layout.contacts
        per_frame = np.array([3, 6, 3, 3, 3 / n, 3 / n, contacts / n, 3, 9, 3, 3, 3, 6, 3, 9], np.float64) * n
        frames = np.array([window] * 11 + [max(window - 1, 1)] * 4) * windows
        rate = np.array([1.0] * 11 + [self._fps] * 4)
        return (np.array(self._weights) * rate / np.maximum(per_frame * frames, 1)).astype(np.float32)

    def compiled(self, vectors: Tensor, first: NDArray[np.int64], window: int) -> dict[str, Tensor]:
        """Terms, weighted, of predicted vectors [B window, D] for windows that begin at frames first [B]."""
        terms = _Compiled.apply(vectors, self, first, window)
        return dict(zip(TERMS, terms, strict=True))

    def plain(self, vectors: Tensor, first: NDArray[np.int64], window: int) -> dict[str, Tensor]:
        """The obvious twin of `compiled`, by autograd."""
        truth = torch.from_numpy(self._true(first, window)).to(vectors.device)
        found, goal = self._parts(vectors, window), self._parts(truth, window)
        # The root's motion and contacts have neither place in the hierarchy nor rates.
        mine, theirs = self._blocks(vectors), self._blocks(truth)
        out = {}
        for term, weight in zip(TERMS, self._weights, strict=True):
            name = term.removesuffix(" rate")
            if term in ("root velocity", "root angular velocity", "contact"):
                difference = mine[term] - theirs[term]
            else:
                difference = found[name] - goal[name]
            if term.endswith(" rate"):
                difference = (difference[:, 1:] - difference[:, :-1]) * self._fps
            out[term] = weight * difference.abs().mean() if difference.numel() else vectors.sum() * 0
        return out

    def _true(self, first: NDArray[np.int64], window: int) -> NDArray[np.float32]:
        """The true vectors [B window, D] of windows."""
        return np.ascontiguousarray(self._truth[(first[:, None] + np.arange(window)).reshape(-1)])

    def _blocks(self, vectors: Tensor) -> dict[str, Tensor]:
        parts = self._layout.slices
        return {
            "root velocity": vectors[:, parts["root_velocity"]],
            "root angular velocity": vectors[:, parts["root_angular_velocity"]],
            "contact": vectors[:, parts["contacts"]],
        }

    def _parts(self, vectors: Tensor, window: int) -> dict[str, Tensor]:
        """Joints by term, each [B, window, J-1, ..]."""
        parts, n = self._layout.slices, self._layout.joints - 1
        local: dict[str, Any] = {
            "position": vectors[:, parts["positions"]].reshape(-1, n, 3),
            "rotation": vectors[:, parts["rotations"]].reshape(-1, n, 3, 2),
            "velocity": vectors[:, parts["velocities"]].reshape(-1, n, 3),
            "angular velocity": vectors[:, parts["angular_velocities"]].reshape(-1, n, 3),
        }
        x, r, v, w = self._kinematics(
            local["position"], orthonormal(local["rotation"]), local["velocity"], local["angular velocity"]
        )
        space = {"position": x, "rotation": r, "velocity": v, "angular velocity": w}
        every = local | {f"character {name}": value for name, value in space.items()}
        return {name: value.unflatten(0, (-1, window)) for name, value in every.items()}


class _Compiled(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, vectors: Tensor, loss: PoseLoss, first: NDArray[np.int64], window: int) -> Any:
        values = np.ascontiguousarray(vectors.detach().numpy(), np.float32)
        gradients = np.empty_like(values)
        coefficients = loss.coefficients(len(first), window)
        pieces = max(1, min(loss._threads, len(first) // AT_LEAST))
        cuts = np.linspace(0, len(first), pieces + 1).astype(int)

        def part(start: int, stop: int) -> NDArray[np.float64]:
            rows, terms = slice(start * window, stop * window), np.empty(len(TERMS))
            truth = loss._true(first[start:stop], window)
            begins = np.arange(0, len(truth), window)
            pose_kernels.pose_loss(  # type: ignore[call-arg]
                loss.parents, np.float32(loss._fps), coefficients, begins, window, values[rows],
                truth, *joints(loss.parents, truth), gradients[rows], terms,
            )  # fmt: skip
            return terms

        # Threads begin and end here: that takes a hundredth of the time, and none is left behind.
        with ThreadPoolExecutor(pieces) as pool:
            jobs = [pool.submit(part, a, b) for a, b in pairwise(cuts[1:])]
            terms = part(cuts[0], cuts[1])
            for job in jobs:
                terms = terms + job.result()
        ctx.save_for_backward(torch.from_numpy(gradients))
        return tuple(torch.from_numpy(terms.astype(np.float32)).unbind())

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> Any:
        # The terms are only ever summed, so the slope by each is the same.
        (gradients,) = ctx.saved_tensors
        return gradients * slopes[0], None, None, None
