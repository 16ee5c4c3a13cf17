"""The motion database: every frame's pose, contacts, features and tags, in one memory-mapped file."""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from features.schema import Schema
from motion import files
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton

KIND, VERSION = "motion database", 1


def _refuse_clips(path: str | os.PathLike[str]) -> None:
    """A UserError that says how to build a database, where path is what one is built from."""
    from motion.sources import FORMATS

    if files.kind(path) == "folder" or (files.kind(path) and Path(path).suffix.lower() in FORMATS):
        remedy = f"build a database of it: python -m mm build {shlex.quote(os.fspath(path))} -o walk.mmdb"
        raise UserError("clips, expected a motion database", path=path, remedy=remedy)


@dataclass(eq=False, repr=False)
class Database:
    """T frames in R ranges (clips, mirrored copies included), at one frame rate, on one skeleton.

    Attributes
    ----------
    skeleton : J joints, joint 0 the ground root.
    fps : frames per second.
    schema : what the feature columns are.
    poses : [T, J, ...]; joint 0 is the ground root in the clip's world.
    contacts : uint8 [T, C], 1 where the joint of contact_roles touches the ground.
    contact_roles : C roles, left before right.
    features : float32 [T, F], normalised and weighted: (raw - offset) / scale.
    offset, scale : float32 [F].
    starts, stops : int32 [R], first frame of each range and one past its last.
    names : R clip names; a mirrored copy bears its original's name.
    mirrored : bool [R].
    tags : uint32 [T], bit b set where the frame bears tag_names[b].
    tag_names : at most 32 names.
    fingerprint : hash of all of it, as stored.
    """

    skeleton: Skeleton
    fps: float
    schema: Schema
    poses: Poses
    contacts: NDArray[np.uint8]
    contact_roles: tuple[str, ...]
    features: NDArray[np.float32]
    offset: NDArray[np.float32]
    scale: NDArray[np.float32]
    starts: NDArray[np.int32]
    stops: NDArray[np.int32]
    names: tuple[str, ...]
    mirrored: NDArray[np.bool_]
    tags: NDArray[np.uint32]
    tag_names: tuple[str, ...] = ()
    fingerprint: str = field(default="")

    def __repr__(self) -> str:
        size = f"{len(self)} frames in {len(self.starts)} ranges at {self.fps:g} fps"
        return f"Database({size}, {len(self.skeleton)} joints, schema {self.schema.name!r})"

    def __len__(self) -> int:
        return len(self.features)

    @property
    def seconds(self) -> float:
        return len(self) / self.fps

    def ranges(self) -> NDArray[np.int32]:
        """Range index of every frame, int32 [T]."""
        return np.repeat(np.arange(len(self.starts), dtype=np.int32), self.stops - self.starts)

    def tag_mask(self, names: tuple[str, ...] | list[str]) -> int:
        """Bit mask of tag names; an unknown one is a UserError that lists those known."""
        return tag_mask(self.tag_names, names)

    def memory(self) -> dict[str, int]:
        """Bytes by part."""
        parts = {name: array.nbytes for name, array in self.poses.arrays().items()}
        return parts | {
            "contacts": self.contacts.nbytes,
            "features": self.features.nbytes + self.offset.nbytes + self.scale.nbytes,
            "ranges": self.starts.nbytes + self.stops.nbytes,
            "tags": self.tags.nbytes,
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write atomically; sets and stores the fingerprint."""
        metadata = {
            "skeleton": self.skeleton.to_json(),
            "fps": self.fps,
            "schema": self.schema.to_dict(),
            "contact_roles": list(self.contact_roles),
            "names": list(self.names),
            "tag_names": list(self.tag_names),
        }
        arrays: dict[str, NDArray] = {**self.poses.arrays()} | {
            "contacts": self.contacts,
            "features": self.features,
            "offset": self.offset,
            "scale": self.scale,
            "starts": self.starts,
            "stops": self.stops,
            "mirrored": self.mirrored,
            "tags": self.tags,
        }
        self.fingerprint = files.save(path, KIND, VERSION, metadata, arrays)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Database:
        """Read a database, memory-mapped and read-only.

        Clips that no database was built from yet are a UserError. Others: see `motion.files.load`.
        """
        try:
            metadata, arrays, fingerprint = files.load(path, KIND, VERSION)
        except UserError:
            _refuse_clips(path)
            raise
        with files.content_of(path, KIND):
            database = Database(
                skeleton=Skeleton.from_json(metadata["skeleton"]),
                fps=metadata["fps"],
                schema=Schema.from_dict(metadata["schema"]),
                poses=Poses(*(arrays.pop(name) for name in Poses.empty(0, 1).arrays())),
                contact_roles=tuple(metadata["contact_roles"]),
                names=tuple(metadata["names"]),
                tag_names=tuple(metadata["tag_names"]),
                fingerprint=fingerprint,
                **arrays,
            )
            database.validate()
        return database

    def validate(self) -> None:
        """A ValueError unless types, shapes and ranges agree with each other."""
        frames, joints, ranges, columns = len(self), len(self.skeleton), len(self.starts), self.schema.size
        arrays = vars(self) | self.poses.arrays()
        shapes = {name: ("float32", (frames, joints, 3)) for name in self.poses.arrays()}
        files.check_shapes(
            arrays,
            {
                **shapes,
                "rotations": ("float32", (frames, joints, 4)),
                "contacts": ("uint8", (frames, len(self.contact_roles))),
                "features": ("float32", (frames, columns)),
                "offset": ("float32", (columns,)),
                "scale": ("float32", (columns,)),
                "starts": ("int32", (ranges,)),
                "stops": ("int32", (ranges,)),
                "mirrored": ("bool", (ranges,)),
                "tags": ("uint32", (frames,)),
            },
        )
        edges = np.append(self.starts, frames)
        if not frames or edges[0] != 0 or np.any(np.diff(edges) <= 0) or np.any(edges[1:] != self.stops):
            raise ValueError(f"its ranges do not cover its {frames} frames one after another")
        if len(self.names) != ranges or len(self.tag_names) > 32:
            raise ValueError(f"{len(self.names)} names of {ranges} ranges, {len(self.tag_names)} tags")
        if not 0 < self.fps <= 10_000:
            raise ValueError(f"{self.fps} frames per second")


def tag_mask(known: tuple[str, ...], names: tuple[str, ...] | list[str]) -> int:
    """Bit mask of names among known tags, bit b for known[b]; an unknown one is a UserError."""
    mask = 0
    for name in names:
        if name not in known:
            remedy = f"the database's tags are {', '.join(known) or 'none'}"
            raise UserError(f"no tag {name!r}", remedy=remedy)
        mask |= 1 << known.index(name)
    return mask
