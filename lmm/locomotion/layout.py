"""A frame as vectors: what the layouts of networks that a trajectory drives have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .window import GAITS, SIDES, samples, size

Array = NDArray[np.float32]

# Blocks that hold one component of all samples after the other, and how many components.
BY_COMPONENT = {"path": 2, "facing": 2, "going": 2, "gaits": len(GAITS), "heights": SIDES}
JOINTS = ("positions", "rotations", "velocities")
RATES = ("turn_rate", "phase_rate")  # one number a frame


@dataclass(frozen=True)
class BlockLayout:
    """The vectors of a skeleton with so many joints, the ground root not counted, and so many contacts.

    A network's own are the blocks, the types of the parts that they are packed of, whose attributes have the
    blocks' names, and how rotations are written.
    """

    joints: int
    contacts: int = 0

    input_type: ClassVar[Any]
    output_type: ClassVar[Any]

    @property
    def inputs(self) -> Mapping[str, slice]:
        """Columns by block, in order."""
        raise NotImplementedError

    @property
    def outputs(self) -> Mapping[str, slice]:
        """Columns by block, in order."""
        raise NotImplementedError

    def written(self, rotations: Array) -> NDArray:
        """Rotations [..., 4] as numbers [..., R]."""
        raise NotImplementedError

    def turned(self, numbers: Array) -> NDArray:
        """Rotations [..., 4] of numbers [..., R]."""
        raise NotImplementedError

    @property
    def input_size(self) -> int:
        return size(self.inputs)

    @property
    def output_size(self) -> int:
        return size(self.outputs)

    def pack_inputs(self, parts: Any) -> Array:
        """Vectors [N, I]."""
        return self._pack(parts, self.inputs)

    def pack_outputs(self, parts: Any) -> Array:
        """Vectors [N, O]."""
        return self._pack(parts, self.outputs)

    def unpack_inputs(self, vectors: Array) -> Any:
        """The parts of vectors [N, I]."""
        return self.input_type(**self._unpack(vectors, self.inputs))

    def unpack_outputs(self, vectors: Array) -> Any:
        """The parts of vectors [N, O]; directions are made unit."""
        found = self._unpack(vectors, self.outputs)
        length = np.linalg.norm(found["facing"], axis=-1, keepdims=True)
        return self.output_type(**found | {"facing": found["facing"] / np.maximum(length, 1e-8)})

    def _pack(self, parts: Any, columns: Mapping[str, slice]) -> Array:
        count = len(parts.path)
        out = np.empty((count, size(columns)), np.float32)
        for name, part in columns.items():
            block = getattr(parts, name)
            if name == "rotations":
                block = self.written(block)
            out[:, part] = (np.swapaxes(block, 1, 2) if name in BY_COMPONENT else block).reshape(count, -1)
        return out

    def _unpack(self, vectors: Array, columns: Mapping[str, slice]) -> dict[str, Array]:
        found = {name: vectors[:, part] for name, part in columns.items()}
        for name, block in found.items():
            if name in BY_COMPONENT:
                found[name] = samples(block, BY_COMPONENT[name])
            elif name in JOINTS:
                found[name] = block.reshape(len(block), self.joints, -1)
            elif name in RATES:
                found[name] = block[:, 0]
        if "rotations" in found:
            found["rotations"] = self.turned(found["rotations"])
        return found
