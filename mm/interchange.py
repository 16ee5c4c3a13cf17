"""The public reference's binary files (REFERENCE 2.7): little-endian arrays one after another, no header.

An array is its size (int32 n, or int32 rows and columns, counted in elements) and then its elements;
a vector is 3 float32, a quaternion 4.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from motion import files, kinematics
from motion.clip import Clip
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton

if TYPE_CHECKING:
    from features.schema import Schema

    from .database import Database

MOST_JOINTS = 1_000
PathLike = str | os.PathLike[str]

# The skeleton of the reference's own database. Its file holds no names, only this hierarchy.
REFERENCE_SKELETON = (
    ("root", -1),
    ("Hips", 0),
    ("LeftUpLeg", 1),
    ("LeftLeg", 2),
    ("LeftFoot", 3),
    ("LeftToe", 4),
    ("RightUpLeg", 1),
    ("RightLeg", 6),
    ("RightFoot", 7),
    ("RightToe", 8),
    ("Spine", 1),
    ("Spine1", 10),
    ("Spine2", 11),
    ("Neck", 12),
    ("Head", 13),
    ("LeftShoulder", 12),
    ("LeftArm", 15),
    ("LeftForeArm", 16),
    ("LeftHand", 17),
    ("RightShoulder", 12),
    ("RightArm", 19),
    ("RightForeArm", 20),
    ("RightHand", 21),
)


@dataclass(eq=False)
class Raw:
    """What a ``database.bin`` holds.

    Attributes
    ----------
    positions, rotations : float32 [T, J, 3 and 4], metres and quaternions, in the parent's frame.
    parents : int32 [J], root -1.
    starts, stops : int32 [R], stops exclusive.
    velocities, angular_velocities : float32 [T, J, 3], m/s and rad/s; None in the short layout.
    contacts : uint8 [T, 2]; None in the short layout.
    """

    positions: NDArray[np.float32]
    rotations: NDArray[np.float32]
    parents: NDArray[np.int32]
    starts: NDArray[np.int32]
    stops: NDArray[np.int32]
    velocities: NDArray[np.float32] | None = None
    angular_velocities: NDArray[np.float32] | None = None
    contacts: NDArray[np.uint8] | None = None


class Misfit(Exception):
    """The bytes are not the layout that was tried."""


class Cursor:
    """Takes arrays off the front of a file's bytes; a `Misfit` where they are not such arrays."""

    def __init__(self, path: PathLike) -> None:
        files.check_input(path)
        try:
            self.data = np.fromfile(path, np.uint8)
        except OSError as error:
            raise UserError(
                f"cannot read: {error.strerror}", path=path, remedy="check its permissions"
            ) from error
        self.at = 0

    def take(self, what: str, dimensions: int, elements: int = 1, dtype: str = "<f4") -> NDArray:
        """[n] or [rows, columns], with a last axis where an element is several numbers."""
        shape = [int(n) for n in self._numbers(what, "<i4", dimensions)]
        if min(shape) < 0:
            raise Misfit(f"the size of its {what} is {' x '.join(map(str, shape))}")
        flat = self._numbers(what, dtype, int(np.prod(shape, dtype=object)) * elements)
        return flat.reshape(*shape, elements) if elements > 1 else flat.reshape(shape)

    def _numbers(self, what: str, dtype: str, count: int) -> NDArray:
        size = np.dtype(dtype).itemsize * count
        if size > len(self.data) - self.at:
            raise Misfit(f"it ends within its {what} (byte {self.at:,} + {size:,} of {len(self.data):,})")
        self.at += size
        return self.data[self.at - size : self.at].view(dtype)

    def number(self, what: str) -> int:
        return int(self._numbers(what, "<i4", 1)[0])

    def end(self) -> None:
        """Nothing may follow."""
        if self.at != len(self.data):
            raise Misfit(f"{len(self.data) - self.at:,} bytes follow its last array")


def read_database(path: PathLike) -> Raw:
    """Read ``database.bin``, in the reference's layout or in the short one without velocities and contacts.

    A missing, cut, foreign or inconsistent file is a UserError.
    """
    cursor = Cursor(path)
    try:
        raw = _full(cursor)
    except Misfit as misfit:
        cursor.at = 0
        try:
            raw = _short(cursor)
        except Misfit:
            raise refuse(path, "motion-matching database", misfit) from misfit
    _check(raw, path)
    return raw


def _full(cursor: Cursor) -> Raw:
    positions = cursor.take("positions", 2, 3)
    velocities = cursor.take("velocities", 2, 3)
    rotations = cursor.take("rotations", 2, 4)
    angular = cursor.take("angular velocities", 2, 3)
    parents, starts, stops = _skeleton_and_ranges(cursor)
    contacts = cursor.take("contacts", 2, dtype="u1")
    cursor.end()
    return Raw(positions, rotations, parents, starts, stops, velocities, angular, contacts)


def _short(cursor: Cursor) -> Raw:
    positions = cursor.take("positions", 2, 3)
    rotations = cursor.take("rotations", 2, 4)
    parents, starts, stops = _skeleton_and_ranges(cursor)
    raw = Raw(positions, rotations, parents, starts, stops)
    cursor.end()
    return raw


def _skeleton_and_ranges(cursor: Cursor) -> list[NDArray[np.int32]]:
    return [cursor.take(what, 1, dtype="<i4") for what in ("parents", "range starts", "range stops")]


def refuse(path: PathLike, what: str, why: object) -> UserError:
    """The error of a file that is not what it should be."""
    return UserError(
        f"not the public reference's {what}, or cut short: {why}",
        path=path,
        remedy="give a whole file as the reference writes it",
    )


def check_finite(path: PathLike, *arrays: NDArray) -> None:
    """A UserError unless all numbers of a file's arrays are finite."""
    if not all(np.isfinite(array).all() for array in arrays):
        raise UserError("its numbers are not all finite", path=path, remedy="make the file again")


def _check(raw: Raw, path: PathLike) -> None:
    """A UserError unless sizes, hierarchy, ranges and numbers of a database make sense."""
    frames, joints = raw.positions.shape[:2]
    arrays = {
        "velocities": raw.velocities,
        "rotations": raw.rotations,
        "angular velocities": raw.angular_velocities,
    }
    why = ""
    for name, array in arrays.items():
        if array is not None and array.shape[:2] != (frames, joints):
            why = f"{name} are {array.shape[0]} x {array.shape[1]}, positions {frames} x {joints}"
    parents, starts, stops = raw.parents, raw.starts, raw.stops
    if why:
        pass
    elif not frames or not joints or len(parents) != joints:
        why = f"{frames} frames of {joints} joints with {len(parents)} parents"
    elif joints > MOST_JOINTS:
        why = f"{joints} joints, at most {MOST_JOINTS} are read"
    elif parents[0] != -1 or np.any(parents[1:] < 0) or np.any(parents >= np.arange(joints)):
        why = "its parents are no tree with joint 0 as the root and parents before children"
    elif len(starts) != len(stops) or not len(starts):
        why = f"{len(starts)} range starts and {len(stops)} stops"
    elif starts[0] != 0 or stops[-1] != frames or np.any(starts[1:] != stops[:-1]) or np.any(stops <= starts):
        why = f"its ranges do not cover its {frames} frames one after another"
    elif raw.contacts is not None and (len(raw.contacts) != frames or raw.contacts.max(initial=0) > 1):
        why = "its contacts are not a 0 or 1 for every frame"
    elif np.any(np.abs(_norms(raw.rotations) - 1) > 0.01):
        why = "its rotations are not unit quaternions"
    if why:
        raise refuse(path, "motion-matching database", why)
    for name, array in {"positions": raw.positions, **arrays}.items():
        if array is not None and not np.isfinite(array).all():
            frame = int(np.flatnonzero(~np.isfinite(array).all(axis=(1, 2)))[0])
            raise UserError(
                f"its {name} are not finite at frame {frame}", path=path, remedy="make the file again"
            )


def _norms(array: NDArray) -> NDArray:
    """Norms of the last axis, without a warning where numbers are no numbers or too large for their type."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.linalg.norm(array, axis=-1)


def write_database(path: PathLike, raw: Raw) -> None:
    """Write ``database.bin``, atomically; in the short layout if raw has no velocities and contacts."""
    with files.atomic(path) as stream:
        put(stream, raw.positions, 2)
        if raw.velocities is not None:
            put(stream, raw.velocities, 2)
        put(stream, raw.rotations, 2)
        if raw.angular_velocities is not None:
            put(stream, raw.angular_velocities, 2)
        for array in (raw.parents, raw.starts, raw.stops):
            put(stream, array, 1, "<i4")
        if raw.contacts is not None:
            put(stream, raw.contacts, 2, "u1")


def put(stream: IO[Any], array: NDArray, dimensions: int, dtype: str = "<f4") -> None:
    """Write an array of one or two dimensions: its size, then its elements, which may be several numbers."""
    stream.write(np.array(array.shape[:dimensions], "<i4").tobytes())
    stream.write(np.ascontiguousarray(array, dtype).reshape(-1).view(np.uint8).data)


def read_features(path: PathLike) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Read ``features.bin``: features [T, F], normalised and weighted, offset [F], scale [F]."""
    cursor = Cursor(path)
    try:
        features = cursor.take("features", 2)
        offset, scale = cursor.take("offset", 1), cursor.take("scale", 1)
        cursor.end()
        if not len(offset) == len(scale) == features.shape[1]:
            raise Misfit(f"{features.shape[1]} columns, {len(offset)} offsets, {len(scale)} scales")
    except Misfit as misfit:
        raise refuse(path, "features", misfit) from misfit
    check_finite(path, features, offset, scale)
    return features, offset, scale


def write_features(
    path: PathLike,
    features: NDArray[np.float32],
    offset: NDArray[np.float32],
    scale: NDArray[np.float32],
) -> None:
    """Write ``features.bin``, atomically."""
    with files.atomic(path) as stream:
        _put_features(stream, features, offset, scale)


def _put_features(stream: IO[Any], features: NDArray, offset: NDArray, scale: NDArray) -> None:
    put(stream, features, 2)
    put(stream, offset, 1)
    put(stream, scale, 1)
    stream.flush()


def read_latent(path: PathLike) -> NDArray[np.float32]:
    """Read ``latent.bin``: latents [T, L]."""
    cursor = Cursor(path)
    try:
        latent = cursor.take("latents", 2)
        cursor.end()
    except Misfit as misfit:
        raise refuse(path, "latents", misfit) from misfit
    check_finite(path, latent)
    return latent


def write_latent(path: PathLike, latent: NDArray[np.float32]) -> None:
    """Write ``latent.bin``, atomically."""
    with files.atomic(path) as stream:
        put(stream, latent, 2)


def import_directory(
    directory: PathLike,
    *,
    schema: str | Schema = "lmm27",
    names: Sequence[str] | None = None,
    roles: Mapping[str, str] | PathLike | None = None,
    fps: float = 60.0,
) -> Database:
    """A database from a folder of the public reference's files.

    ``features.bin`` is taken as it is when it is there, else features are computed from ``database.bin``.
    The files hold no joint names, clip names, roles or frame rate.

    Parameters
    ----------
    schema : what the columns of the features are: a ready-made schema's name, a file, or a Schema.
    names : J joint names; default: the reference's for its hierarchy of 23 joints, else joint_0, joint_1, ...
    roles : role to joint name, or a TOML file of them; needed for joints that the names do not tell.
    fps : the frame rate of the frames.
    """
    from features import presets
    from features.schema import Schema

    from . import parts
    from .database import Database

    if not 1 <= fps <= 1000:
        raise UserError(f"{fps:g} frames per second", remedy="give a rate between 1 and 1000")
    folder = Path(directory)
    if files.kind(folder / "database.bin") != "file":
        raise UserError(
            "no database.bin in this folder",
            path=folder,
            remedy="give a folder of the public reference's files: database.bin and, if there, features.bin",
        )
    raw = read_database(folder / "database.bin")
    if not isinstance(schema, Schema):
        schema = presets.load(schema)
    skeleton = _skeleton(raw, names, roles, folder / "database.bin")
    parts.check_roles(schema, skeleton, folder / "database.bin")
    poses, contacts, contact_roles = _motion(raw, skeleton, fps)

    if files.kind(folder / "features.bin"):
        features, offset, scale = read_features(folder / "features.bin")
        if features.shape != (len(poses), schema.size):
            raise UserError(
                f"features of {features.shape[0]} frames x {features.shape[1]} columns; database.bin has "
                f"{len(poses)} frames and the schema {schema.name!r} {schema.size} columns",
                path=folder / "features.bin",
                remedy="name the schema that made them, or remove the file and they are computed",
            )
    else:
        features, offset, scale = parts.compute_features(schema, skeleton, fps, poses, raw.starts, raw.stops)

    clip_names, mirrored = _name_ranges(raw)
    return Database(
        skeleton=skeleton,
        fps=fps,
        schema=schema,
        poses=poses,
        contacts=contacts,
        contact_roles=contact_roles,
        features=features,
        offset=offset,
        scale=scale,
        starts=raw.starts,
        stops=raw.stops,
        names=clip_names,
        mirrored=mirrored,
        tags=np.zeros(len(poses), np.uint32),
    )


def export_directory(db: Database, directory: PathLike) -> list[Path]:
    """Write ``database.bin`` and ``features.bin`` into a folder; returns their paths.

    Joint and clip names, roles, tags and the frame rate have no place in these files and are left out.
    """
    folder = Path(directory)
    raw = Raw(
        positions=db.poses.positions,
        rotations=db.poses.rotations,
        parents=db.skeleton.parents,
        starts=db.starts,
        stops=db.stops,
        velocities=db.poses.velocities,
        angular_velocities=db.poses.angular_velocities,
        contacts=db.contacts,
    )
    with files.atomic(folder / "features.bin") as stream:
        _put_features(stream, db.features, db.offset, db.scale)
        write_database(folder / "database.bin", raw)  # where it fails the folder gets neither
    return [folder / "database.bin", folder / "features.bin"]


def _skeleton(
    raw: Raw,
    names: Sequence[str] | None,
    roles: Mapping[str, str] | PathLike | None,
    path: Path,
) -> Skeleton:
    from motion import roles as role_maps

    joints = raw.positions.shape[1]
    if names is None:
        known = raw.parents.tolist() == [parent for _, parent in REFERENCE_SKELETON]
        names = [name for name, _ in REFERENCE_SKELETON] if known else [f"joint_{j}" for j in range(joints)]
    if len(names) != joints or len(set(names)) != joints:
        raise UserError(
            f"{joints} joints, but {len(set(names))} different names were given",
            path=path,
            remedy="give one name a joint, in the file's order",
        )
    offsets = raw.positions.mean(axis=0, dtype=np.float64)
    offsets[0] = 0  # the root travels, it has no rest position
    skeleton = Skeleton(tuple(names), raw.parents, offsets)
    overrides = role_maps.load_overrides(roles) if isinstance(roles, str | os.PathLike) else roles
    middle = len(raw.positions) // 2
    pose, _ = kinematics.forward(skeleton, raw.positions[middle], raw.rotations[middle])
    skeleton = skeleton.with_roles({**role_maps.guess(skeleton, pose), "root": 0})
    return role_maps.apply(skeleton, overrides) if overrides else skeleton


def _motion(raw: Raw, skeleton: Skeleton, fps: float) -> tuple[Poses, NDArray[np.uint8], tuple[str, ...]]:
    """Poses, contacts [T, C] and their roles; what the file lacks of them is computed."""
    from . import parts

    sample = np.linspace(0, len(raw.positions) - 1, 200).astype(int)
    pose, _ = kinematics.forward(skeleton, raw.positions[sample], raw.rotations[sample])
    roles = parts.contact_roles(skeleton, pose)
    if raw.velocities is not None and raw.angular_velocities is not None and raw.contacts is not None:
        if raw.contacts.shape[1] == 2 < len(roles):
            roles = roles[:2]
        if raw.contacts.shape[1] != len(roles):
            roles = tuple(f"contact_{c}" for c in range(raw.contacts.shape[1]))
        return (
            Poses(raw.positions, raw.rotations, raw.velocities, raw.angular_velocities),
            raw.contacts,
            roles,
        )
    from motion import contacts as contact_detection

    poses = Poses.empty(len(raw.positions), len(skeleton))
    contacts = np.zeros((len(poses), len(roles)), np.uint8)
    for start, stop in zip(raw.starts, raw.stops, strict=True):
        piece = slice(start, stop)
        positions, rotations = (a[piece].astype(np.float64) for a in (raw.positions, raw.rotations))
        clip = Clip("", skeleton, fps, positions, rotations)
        poses[piece] = Poses.of_clip(clip)
        contacts[piece] = contact_detection.contacts(clip, roles=roles)
    return poses, contacts, roles


def _name_ranges(raw: Raw) -> tuple[tuple[str, ...], NDArray[np.bool_]]:
    """Names of the ranges; one that mirrors the range before it bears that one's name."""
    width = len(str(len(raw.starts) - 1))
    names, mirrored = [f"range_{r:0{width}}" for r in range(len(raw.starts))], [False] * len(raw.starts)
    pieces = [slice(start, stop) for start, stop in zip(raw.starts, raw.stops, strict=True)]
    for r in range(1, len(pieces)):
        if not mirrored[r - 1] and _mirrors(raw, pieces[r - 1], pieces[r]):
            names[r], mirrored[r] = names[r - 1], True
    return tuple(names), np.array(mirrored, bool)


def _mirrors(raw: Raw, one: slice, other: slice) -> bool:
    """Whether the root of a range repeats another one with x negated, and the feet with sides exchanged."""
    here, there = raw.positions[one, 0], raw.positions[other, 0]
    if len(here) != len(there) or not np.allclose(
        there, here * np.array([-1, 1, 1], np.float32), rtol=0, atol=1e-3
    ):
        return False
    if raw.contacts is None:
        return bool(np.ptp(here[:, 0]) > 0.01)
    columns = np.arange(raw.contacts.shape[1])
    if len(columns) % 2 == 0:
        columns ^= 1  # left and right stand in pairs
    feet, swapped = raw.contacts[one], raw.contacts[other][:, columns]
    sided = np.ptp(here[:, 0]) > 0.01 or np.any(feet != feet[:, columns])
    return bool(sided and np.mean(feet == swapped) > 0.95)


def load_names(path: PathLike) -> list[str]:
    """Joint names of a text file, one a line; blank lines are skipped."""
    text = files.read_text(path, remedy="write one joint name a line")
    return [line.strip() for line in text.splitlines() if line.strip()]
