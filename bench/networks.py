"""What networks cost at run time and lose by compact weights: ours beside NumPy and a plain compiled loop."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numba
import numpy as np
from numpy.typing import NDArray

from lmm.evaluator import Evaluator, Products, products_here
from lmm.interchange import RUNTIME, import_directory, read_network
from lmm.model import Model
from lmm.network import Network, WeightType
from mm import quality
from mm.database import Database
from motion import console, files
from motion.errors import UserError

from . import timing

Array = NDArray[np.float32]
KERNELS = ("ours", "numpy", "loop")
PAIRED = ("bfloat16", "bfloat16x2")
WEIGHTS = (*get_args(WeightType), *PAIRED)
INTERVAL = 6  # frames from projection to projection
SAMPLE = 2048  # inputs that errors are measured on
LEAST = 0.05  # seconds of measuring each number
BARELY = 1e-4  # outputs that vary by less than this part of the most varying one drown in rounding


@dataclass(eq=False)
class Subject:
    """Networks by name, inputs of each [SAMPLE, I], and the model that they are of, where there is one."""

    networks: dict[str, Network]
    inputs: dict[str, Array]
    model: Model | None


def load(path: str | os.PathLike[str], database: Database | None = None) -> Subject:
    """A model file, or a folder of networks in the public reference's format (REFERENCE 2.7).

    With the database inputs are what it holds; without it they are as spread as the networks' own.
    """
    model = None
    if files.kind(path) != "folder":
        model = Model.load(path)
    elif database is not None:
        model = import_directory(path, database)
    networks = (
        model.networks if model else {name: read_network(Path(path) / f"{name}.bin") for name in RUNTIME}
    )
    rng = np.random.default_rng(0)
    inputs = {
        name: network.input_mean
        + network.input_std * rng.standard_normal((SAMPLE, network.sizes[0]), np.float32)
        for name, network in networks.items()
    }
    if model is not None and database is not None:
        model.check(database, path)
        frames = rng.integers(0, len(database), SAMPLE)
        width = model.F
        for name in RUNTIME:
            inputs[name][:, :width] = database.features[frames]
        if model.knows_latents:
            latents = model.latents(database)[frames]
            inputs["decompressor"][:, width:] = inputs["stepper"][:, width:] = latents
    return Subject(networks, inputs, model)


def measure(
    subject: Subject,
    *,
    counts: Sequence[int] = (1, 16, 256, 1024),
    weights: Sequence[str] | None = None,
    repeats: int = 5,
    progress: bool = False,
) -> list[dict[str, Any]]:
    """Rows of each network, and of all of them in a frame with a projection in every six; one pinned thread.

    kernel: ours (`lmm.evaluator`), numpy (its twin) or loop (compiled as the public reference's C++ is
    written, one character at a time). weights: how they are stored, or products that stages take for
    bfloat16 (decompressors bfloat16x2, the others bfloat16), None for all that this processor can. mb as it
    stands in memory; error_max and error_mean against float32,
    in standard deviations of the outputs; error_cm and error_max_cm of joints after forward
    kinematics, for decompressors whose skeleton is known. us_N: microseconds a character among N, the best
    of repeats; of_loop_N, of_numpy_N: the share of what theirs take for float32 weights.

    NumPy takes as many threads as its library is told to: set OPENBLAS_NUM_THREADS=1 to compare.
    """
    if weights is None:
        weights = [name for name in WEIGHTS if name not in PAIRED or name in products_here()]
    unknown = [name for name in weights if name not in WEIGHTS]
    if unknown:
        raise UserError(f"no weights of type {unknown[0]!r}", remedy=f"choose of {', '.join(WEIGHTS)}")
    kinds = [("ours", name) for name in weights] + [("numpy", "float32"), ("loop", "float32")]
    jobs = [(name, *kind) for name in subject.networks for kind in kinds]
    rows = []
    with timing.single_thread():
        for job in console.progress(jobs, label="networks", unit="networks") if progress else jobs:
            rows.append(_row(subject, *job, counts, repeats))
    rows += [_frame([row for row in rows if (row["kernel"], row["weights"]) == kind]) for kind in kinds]
    base = {(row["network"], row["kernel"]): row for row in rows if row["weights"] == "float32"}
    for row in rows:
        for other in KERNELS[1:]:
            for count in counts:
                theirs = base[row["network"], other][f"us_{count}"]
                row[f"of_{other}_{count}"] = row[f"us_{count}"] / theirs
    return rows


def brief(rows: Sequence[dict[str, Any]], counts: Sequence[int]) -> list[dict[str, Any]]:
    """What fits a terminal: the shares for the fewest and the most characters only."""
    ends = sorted({min(counts), max(counts)})
    names = ["network", "kernel", "weights", "mb", "error_max", "error_cm"]
    names += [f"us_{count}" for count in counts]
    names += [f"of_{other}_{count}" for other in KERNELS[1:] for count in ends]
    return [{name: row[name] for name in names} for row in rows]


def _row(
    subject: Subject, name: str, kernel: str, weights: Any, counts: Sequence[int], repeats: int
) -> dict[str, Any]:
    exact = subject.networks[name].as_type("float32")
    network = exact if weights in PAIRED else subject.networks[name].as_type(weights)
    run, size = _runner(network, kernel, weights if weights in PAIRED else "float32")
    x = np.ascontiguousarray(np.resize(subject.inputs[name], (max(*counts, SAMPLE), network.sizes[0])))
    expected, found = exact.evaluate(x[:SAMPLE]), run(x[:SAMPLE]).copy()
    columns = exact.output_std > BARELY * exact.output_std.max()
    apart = np.abs(found - expected)[:, columns] / exact.output_std[columns]
    row: dict[str, Any] = {
        "network": name,
        "sizes": "-".join(map(str, network.sizes)),
        "kernel": kernel,
        "weights": weights,
        "mb": size / 1e6,
        "error_max": float(apart.max()),
        "error_mean": float(apart.mean()),
        "error_cm": None,
        "error_max_cm": None,
    }
    if name == "decompressor" and subject.model is not None:
        centimetres = _centimetres(subject.model, expected, found)
        row |= {"error_cm": float(centimetres.mean()), "error_max_cm": float(centimetres.max())}
    for count in counts:
        part = x[:count]
        best = min(timing.best_of(lambda part=part: run(part), repeats=repeats, least=LEAST))  # type: ignore[misc]
        row[f"us_{count}"] = 1e6 * best / count
    return row


def _centimetres(model: Model, expected: Array, found: Array) -> NDArray[np.float64]:
    """How far apart the joints [N, J-1] of two poses are, in the root's space."""
    skeleton = model.description.skeleton
    poses = [model.layout.unpack(vectors, model.description.fps)[0] for vectors in (expected, found)]
    one, other = (quality.in_root_space(skeleton, p.positions, p.rotations) for p in poses)
    return 100 * np.linalg.norm(other - one, axis=-1)


def _frame(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """All networks of a kind, as a frame needs them: the projector in one of so many."""
    shares = [1 / INTERVAL if row["network"] == "projector" else 1.0 for row in rows]
    total: dict[str, Any] = {
        "network": "frame",
        "sizes": "",
        "kernel": rows[0]["kernel"],
        "weights": rows[0]["weights"],
        "mb": sum(row["mb"] for row in rows),
    }
    for name in ("error_max", "error_mean", "error_cm", "error_max_cm"):
        total[name] = None
    for name in (name for name in rows[0] if name.startswith("us_")):
        total[name] = sum(share * row[name] for share, row in zip(shares, rows, strict=True))
    return total


def _runner(network: Network, kernel: str, products: Products) -> tuple[Callable[[Array], Array], int]:
    """What evaluates a batch, and the bytes that it reads of the network."""
    if kernel == "numpy":
        return network.evaluate, network.nbytes
    if kernel == "loop":
        return Loop(network).evaluate, network.nbytes
    evaluator = Evaluator(network, products=products, count=SAMPLE)
    return evaluator.evaluate, evaluator.nbytes


class Loop:
    """A network as the public reference's C++ evaluates it: one row after the other, layer by layer, inputs
    that are 0 skipped, and whatever the compiler makes of that."""

    def __init__(self, network: Network) -> None:
        ends = network.input_mean, network.input_std, network.output_mean, network.output_std
        weights = [network.weight(layer) for layer in range(len(network.weights))]
        between = [np.zeros(size, np.float32) for size in network.sizes]
        self._network = tuple(
            tuple(np.array(array, np.float32) for array in arrays)
            for arrays in (weights, network.biases, ends, between)
        )
        self._elu = network.activation == "elu"
        self._out = np.zeros((0, network.sizes[-1]), np.float32)

    def evaluate(self, x: Array) -> Array:
        """Outputs [N, O] of inputs [N, I]; valid until the next call."""
        if len(x) > len(self._out):
            self._out = np.zeros((len(x), self._out.shape[1]), np.float32)
        out = self._out[: len(x)]
        loop(x, *self._network, self._elu, out)
        return out


_jit: Any = numba.njit(cache=True, nogil=True, error_model="numpy")  # its type knows no *arguments


@_jit
def loop(x, weights, biases, ends, between, elu, out):
    """Write a network's outputs of x [N, I] to out [N, O]; ends are its four arrays of normalisation, between
    one row for the inputs of each layer and the outputs of the last."""
    input_mean, input_std, output_mean, output_std = ends
    for n in range(len(x)):
        for i in range(x.shape[1]):
            between[0][i] = (x[n, i] - input_mean[i]) / input_std[i]
        for layer in range(len(weights)):
            weight, bias, h, y = weights[layer], biases[layer], between[layer], between[layer + 1]
            for j in range(len(y)):
                y[j] = bias[j]
            for i in range(len(h)):
                if h[i] != 0:
                    for j in range(len(y)):
                        y[j] += h[i] * weight[i, j]
            if layer < len(weights) - 1:
                for j in range(len(y)):
                    if y[j] < 0:
                        y[j] = math.expm1(y[j]) if elu else 0
        y = between[len(weights)]
        for j in range(len(y)):
            out[n, j] = y[j] * output_std[j] + output_mean[j]
