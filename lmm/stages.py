"""The learned stages: Projector, Stepper and Decompressor, on a batch of characters.

    query - Projector - state - Stepper - state - Decompressor - pose

A learned state is a feature and a latent vector. How they mix with the classical ones: `lmm.mixtures`.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from features import normalise
from mm.settings import Settings
from mm.stages import NOBODY
from motion.errors import UserError
from motion.pose import Poses

from . import kernels, kernels_numpy
from .evaluator import Evaluator, Products
from .frames import projector_inputs
from .model import Model

ARRAYS = ("values", "asked", "near", "since", "moved", "landed", "age")  # of a learned state
SAME = 0.3  # root mean square of deviations: answers nearer to each other are the same


@dataclass(eq=False)
class LatentState:
    """Learned states: features and latents, side by side.

    Attributes
    ----------
    values : float32 [N, F + L], normalised features, then latents.
    width : F.
    asked : uint32 [N], tags of what was found, or asked for, at the last projection; of the frame near it
        where states come from a database's frames.
    near : int32 [N], the frame found by the last lookup plus the steps since; -1 where there was none.
    since : int32 [N], those steps.
    moved : bool [N], whether a lookup has just left the frame that was shown for another one.
    landed : float32 [N, F + L], what the last projection answered.
    age : int32 [N], steps since then.
    """

    values: NDArray[np.float32]
    width: int
    asked: NDArray[np.uint32]
    near: NDArray[np.int32]
    since: NDArray[np.int32] = field(init=False)
    moved: NDArray[np.bool_] = field(init=False)
    landed: NDArray[np.float32] = field(init=False)
    age: NDArray[np.int32] = field(init=False)

    def __post_init__(self) -> None:
        self.since, self.moved = np.zeros(len(self), np.int32), np.zeros(len(self), np.bool_)
        self.landed, self.age = self.values.copy(), np.zeros(len(self), np.int32)

    @staticmethod
    def of(values: NDArray[np.float32], width: int) -> LatentState:
        """States of values [N, F + L] that nothing else is known of."""
        count = len(values)
        return LatentState(values, width, np.zeros(count, np.uint32), np.full(count, -1, np.int32))

    @property
    def nbytes(self) -> int:
        return sum(getattr(self, name).nbytes for name in ARRAYS)

    def __len__(self) -> int:
        return len(self.values)

    def features(self) -> NDArray[np.float32]:
        return np.ascontiguousarray(self.values[:, : self.width])

    def latents(self) -> NDArray[np.float32]:
        """Latents [N, L]."""
        return self.values[:, self.width :]

    def frames(self) -> NDArray[np.int32]:
        return np.full(len(self), -1, np.int32)

    def origins(self) -> NDArray[np.int32]:
        return self.near

    def tags(self) -> NDArray[np.uint32]:
        return self.asked

    def ended(self, out: NDArray[np.bool_]) -> None:
        out[:] = False

    def jumped(self) -> NDArray[np.int64]:
        return np.flatnonzero(self.moved) if self.moved.any() else NOBODY

    def take(self, who: NDArray[np.int64]) -> LatentState:
        taken = copy(self)
        for name in ARRAYS:
            setattr(taken, name, getattr(self, name)[who])
        return taken

    def put(self, who: NDArray[np.int64], other: LatentState) -> None:
        for name in ARRAYS:
            getattr(self, name)[who] = getattr(other, name)


class ProjectorProjection:
    """The Projector: a network's guess at the nearest state. It costs what its features differ by.

    As in motion matching a guess is taken where it is cheaper than playing on; both costs are the schema's,
    in the database's normalised space. Of tags it knows "crouch" alone, and that where its data divides.

    Motion matching leaves out the frames around the one that plays, or a character to whom nothing fits well
    would go back to the same frame over and over, and stand and glide. A learned state is no frame; for it,
    that is to be answered what was answered last, less than ignore_radius steps ago.
    """

    def __init__(
        self,
        model: Model,
        *,
        ignore_radius: int = 0,
        products: Products = "float32",
        compiled: bool = True,
    ) -> None:
        description = model.description
        self.width, self.schema = model.F, description.schema
        self._radius = ignore_radius
        std = model.state_std.astype(np.float64)  # whose squares hold those of states that run away
        self._scale = np.where(std > 0, 1 / np.where(std > 0, std, 1), 0)
        self._crouch = np.uint32(description.crouch_tag)
        self._names = description.tag_names
        self._network = Evaluator(model.projector, products=products, compiled=compiled)
        self._root_mean_square = (kernels if compiled else kernels_numpy).root_mean_square

    def guess(self, queries: NDArray[np.float32], required_tags: NDArray[np.uint32]) -> NDArray[np.float32]:
        """What the network answers [M, F + L] to queries [M, F]; a copy."""
        return self._network.evaluate(projector_inputs(queries, int(self._crouch), required_tags)).copy()

    def project(self, queries, state, bound, required_tags, forbidden_tags):
        self.check_tags(required_tags, forbidden_tags)
        values = self.guess(queries, required_tags)
        guessed = LatentState.of(values, self.width)
        guessed.asked = required_tags
        found_costs = normalise.total_costs(self.schema, queries, values[:, : self.width])
        found = found_costs < bound
        if self._radius:
            again = (state.age < self._radius) & (self._apart(values, state.landed) < SAME)
            found &= ~again | np.isinf(bound)
        return guessed, found_costs, found

    def _apart(self, a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.floating]:
        """How far states [M, F + L] lie from others: root mean square over columns, in deviations."""
        out = np.empty(len(a))
        self._root_mean_square(a, b, self._scale, out)
        return out

    def retune(self, settings: Settings, fps: float) -> None:
        self._radius = round(settings.ignore_radius * fps)

    def possible(self, required_tags: int, forbidden_tags: int) -> bool:
        return not (required_tags | forbidden_tags) & ~int(self._crouch) and not (
            required_tags & forbidden_tags
        )

    def check_tags(self, required: NDArray[np.uint32], forbidden: NDArray[np.uint32]) -> None:
        """A UserError for tags that the network does not know."""
        unknown = np.bitwise_or.reduce(required | forbidden, initial=0) & ~self._crouch
        if unknown:
            names = [name for bit, name in enumerate(self._names) if unknown >> bit & 1]
            raise UserError(
                f"a projector is asked for tags that it does not know: {', '.join(names) or unknown}",
                remedy="ask for no tags"
                if not self._crouch
                else "ask for crouching alone, or search the database",
            )

    def memory(self) -> dict[str, int]:
        return {
            "projector": self._network.nbytes + self._scale.nbytes,
            "workspace": self._network.workspace,
        }


class StepperStepping:
    """The Stepper: a state moves by its rates of change, for a frame. Nothing keeps it in the data's range.

    last [T], the last frame of each one's range, where states are looked up in a database; tags [T] where
    they come from its frames: a state bears the tags of the frame that it has come to.
    """

    def __init__(
        self,
        model: Model,
        *,
        last: NDArray[np.int32] | None = None,
        tags: NDArray[np.uint32] | None = None,
        products: Products = "float32",
        compiled: bool = True,
    ) -> None:
        self._width, self._fps = model.F, model.description.fps
        self._middle = np.array(model.stepper.input_mean)  # a view would hold the model's file
        self._network = Evaluator(model.stepper, products=products, compiled=compiled)
        twin = kernels if compiled else kernels_numpy
        self._advance, self._follow = twin.advance, twin.follow
        self._last, self._tags = last, tags

    def start(self, count: int) -> LatentState:
        """The mean of what the stepper was trained on."""
        return LatentState.of(np.tile(self._middle, (count, 1)), self._width)

    def step(self, state: LatentState) -> None:
        self._advance(state.values, self._network.evaluate(state.values), self._fps)
        state.age += 1
        if self._last is not None:
            state.since += 1
            self._follow(state.near, self._last, self._tags, state.asked)

    def memory(self) -> dict[str, int]:
        found = {"stepper": self._network.nbytes, "workspace": self._network.workspace}
        for name, array in (("ranges", self._last), ("tags", self._tags)):
            if array is not None:
                found[name] = array.nbytes
        return found


class DecompressorDecompression:
    """The Decompressor: the pose that belongs to features and latents.

    With bfloat16 products it takes inputs of two such numbers: rounded to one, joints tremble by 0.2 mm.
    """

    def __init__(self, model: Model, *, products: Products = "float32", compiled: bool = True) -> None:
        self._fps = model.description.fps
        of_two: Products = "bfloat16x2" if products == "bfloat16" else products
        self._network = Evaluator(model.decompressor, products=of_two, compiled=compiled)
        self._unpack = (kernels if compiled else kernels_numpy).unpack

    def decompress(self, state: LatentState, poses: Poses, contacts: NDArray[np.uint8]) -> None:
        self.decode(state.values, poses, contacts)

    def decode(self, values: NDArray[np.float32], poses: Poses, contacts: NDArray[np.uint8]) -> None:
        """Write the poses [N, J, ..] and contacts [N, C] of features and latents [N, F + L]."""
        vectors = self._network.evaluate(values)
        self._unpack(
            vectors, self._fps, poses.positions, poses.rotations, poses.velocities, poses.angular_velocities,
            contacts,
        )  # fmt: skip

    def memory(self) -> dict[str, int]:
        return {"decompressor": self._network.nbytes, "workspace": self._network.workspace}
