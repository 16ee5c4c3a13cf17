"""What a controller must know of the data that it plays: enough to drive characters without the data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from features.schema import Schema
from motion import files, quat
from motion.anatomy import Anatomy, anatomy
from motion.clip import Clip
from motion.errors import UserError
from motion.skeleton import Skeleton

from . import speeds
from .database import Database, tag_mask
from .feet import Legs, find_legs, joints_of_legs

Found = TypeVar("Found")

_LEGS = ("joints", "points", "hinges", "heights", "needed")
_ANATOMY = ("bones", "rest", "frames", "known")


@dataclass(frozen=True, eq=False, repr=False)
class Description:
    """A database without its frames: what learned stages and those around them need, a few kilobytes.

    Attributes
    ----------
    skeleton, fps, schema, contact_roles, tag_names : the database's (see `mm.database.Database`).
    offset, scale : float32 [F], of the normalised features.
    legs : what foot locking needs, heights those of the data; None where a leg is not whole.
    anatomy : how the joints sit in the body, for rigs; None where it was not asked for or cannot be told.
    crouch_tag : bit of the tag "crouch" if some frames bear it and others do not, else 0.
    walk_mps, run_mps : typical speeds, m/s (`mm.speeds.of_database`).
    fingerprint : the database's.
    """

    skeleton: Skeleton
    fps: float
    schema: Schema
    offset: NDArray[np.float32]
    scale: NDArray[np.float32]
    contact_roles: tuple[str, ...]
    legs: Legs | None
    anatomy: Anatomy | None
    tag_names: tuple[str, ...]
    crouch_tag: int
    walk_mps: float
    run_mps: float
    fingerprint: str = ""

    def __repr__(self) -> str:
        size = f"{len(self.skeleton)} joints at {self.fps:g} fps"
        return f"Description({size}, schema {self.schema.name!r}, database {self.fingerprint[:8]!r})"

    @staticmethod
    def of(database: Database, *, rigs: bool = True) -> Description:
        """The description of a database; without rigs the anatomy, which takes longest, is left out."""
        walk, run = speeds.of_database(database)
        return Description(
            skeleton=database.skeleton,
            fps=database.fps,
            schema=database.schema,
            offset=_kept(database.offset),
            scale=_kept(database.scale),
            contact_roles=database.contact_roles,
            legs=_or_none(find_legs, database),
            anatomy=_or_none(anatomy_of, database) if rigs else None,
            tag_names=database.tag_names,
            crouch_tag=_dividing_tag(database, "crouch"),
            walk_mps=walk,
            run_mps=run,
            fingerprint=database.fingerprint,
        )

    def feet(self, height: float | None = None) -> Legs:
        """The legs, which lock at the height of the data or at another one, metres; a UserError without."""
        if self.legs is None:
            joints_of_legs(self.skeleton, self.contact_roles)  # says which leg is not whole
            raise UserError("no legs are known", remedy="turn foot locking off")
        if height is None:
            return self.legs
        return replace(self.legs, heights=np.full_like(self.legs.heights, height))

    def tag_mask(self, names: tuple[str, ...] | list[str]) -> int:
        """Bit mask of tag names; an unknown one is a UserError that lists those known."""
        return tag_mask(self.tag_names, names)

    def tags_of(self, mask: int) -> list[str]:
        """Names of the tags in a bit mask."""
        return [name for bit, name in enumerate(self.tag_names) if mask >> bit & 1]

    def to_parts(self) -> tuple[dict[str, Any], dict[str, NDArray]]:
        """JSON-able metadata and named arrays, for the files that hold a description; see `from_parts`."""
        metadata: dict[str, Any] = {
            "skeleton": self.skeleton.to_json(),
            "fps": self.fps,
            "schema": self.schema.to_dict(),
            "contact_roles": list(self.contact_roles),
            "tag_names": list(self.tag_names),
            "crouch_tag": self.crouch_tag,
            "walk_mps": self.walk_mps,
            "run_mps": self.run_mps,
            "fingerprint": self.fingerprint,
            "legs": self.legs is not None,
            "anatomy": None,
        }
        arrays: dict[str, NDArray] = {"offset": self.offset, "scale": self.scale}
        if self.legs is not None:
            arrays |= {f"legs_{name}": getattr(self.legs, name) for name in _LEGS}
        if self.anatomy is not None:
            arrays |= {f"anatomy_{name}": getattr(self.anatomy, name) for name in _ANATOMY}
            sole = float(self.anatomy.sole)
            metadata["anatomy"] = {
                "sole": sole if np.isfinite(sole) else None,
                "on_all_fours": bool(self.anatomy.on_all_fours),
            }
        return metadata, arrays

    @staticmethod
    def from_parts(metadata: Mapping[str, Any], arrays: Mapping[str, NDArray]) -> Description:
        """The description of `to_parts`; what is missing or does not fit is a KeyError or a ValueError."""
        skeleton = Skeleton.from_json(metadata["skeleton"])
        schema = Schema.from_dict(metadata["schema"])
        roles = tuple(metadata["contact_roles"])
        _check(arrays, metadata, len(skeleton), schema.size, len(roles))
        arrays = {name: np.array(array) for name, array in arrays.items()}  # which hold on to no file
        legs, body = None, None
        if metadata["legs"]:
            legs = Legs(**{name: arrays[f"legs_{name}"] for name in _LEGS})
        if (known := metadata["anatomy"]) is not None:
            sole = np.nan if known["sole"] is None else float(known["sole"])
            parts = {name: arrays[f"anatomy_{name}"] for name in _ANATOMY}
            body = Anatomy(skeleton, **parts, sole=sole, on_all_fours=bool(known["on_all_fours"]))
        return Description(
            skeleton=skeleton,
            fps=float(metadata["fps"]),
            schema=schema,
            offset=arrays["offset"],
            scale=arrays["scale"],
            contact_roles=roles,
            legs=legs,
            anatomy=body,
            tag_names=tuple(metadata["tag_names"]),
            crouch_tag=int(metadata["crouch_tag"]),
            walk_mps=float(metadata["walk_mps"]),
            run_mps=float(metadata["run_mps"]),
            fingerprint=str(metadata["fingerprint"]),
        )


def anatomy_of(database: Database, ranges: int = 40) -> Anatomy:
    """The anatomy of a database's skeleton, as some of its ranges show it."""
    chosen = range(0, len(database.starts), 1 + len(database.starts) // ranges)
    return anatomy(database.skeleton, [_clip(database, i) for i in chosen])


def _clip(database: Database, i: int) -> Clip:
    poses = database.poses[slice(int(database.starts[i]), int(database.stops[i]))]
    rotations = quat.normalize(poses.rotations.astype(np.float64))
    positions = poses.positions.astype(np.float64)
    return Clip(database.names[i], database.skeleton, database.fps, positions, rotations)


def _or_none(find: Callable[[Database], Found], database: Database) -> Found | None:
    """What is found, or None where the skeleton does not have what it needs."""
    try:
        return find(database)
    except UserError:
        return None


def _kept(array: NDArray[np.float32]) -> NDArray[np.float32]:
    """A copy of a row of numbers: it must not hold on to the file that a database is mapped from."""
    return np.array(array, np.float32)


def _dividing_tag(database: Database, name: str) -> int:
    """The bit of a tag that some frames bear and others do not; 0 where there is no such tag."""
    if name not in database.tag_names:
        return 0
    tag = database.tag_mask([name])
    bear = (database.tags & np.uint32(tag)) != 0
    return tag if bear.any() and not bear.all() else 0


def _check(
    arrays: Mapping[str, NDArray], metadata: Mapping[str, Any], joints: int, columns: int, feet: int
) -> None:
    """A ValueError unless arrays and numbers agree with each other."""
    expected: dict[str, tuple[str, tuple[int, ...]]] = {
        "offset": ("float32", (columns,)),
        "scale": ("float32", (columns,)),
    }
    if metadata["legs"]:
        expected |= {
            "legs_joints": ("int64", (feet, 4)),
            "legs_points": ("float32", (feet, 3)),
            "legs_hinges": ("float32", (feet, 3)),
            "legs_heights": ("float32", (feet, 2)),
            "legs_needed": ("int64", (len(arrays["legs_needed"]),)),
        }
    if metadata["anatomy"] is not None:
        expected |= {
            "anatomy_bones": ("float64", (joints, 3)),
            "anatomy_rest": ("float64", (joints, 4)),
            "anatomy_frames": ("float64", (joints, 4)),
            "anatomy_known": ("bool", (joints,)),
        }
    files.check_shapes(arrays, expected)
    for name in ("legs_joints", "legs_needed"):
        if name in expected and not np.all((arrays[name] >= 0) & (arrays[name] < joints)):
            raise ValueError("legs of joints that the skeleton does not have")
    if not 0 < metadata["fps"] <= 10_000:
        raise ValueError(f"{metadata['fps']} frames per second")
    if len(metadata["tag_names"]) > 32:
        raise ValueError(f"{len(metadata['tag_names'])} tags")
