"""Reading: which arrays a file has, and the clip that they make."""

from __future__ import annotations

import fnmatch
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import axes, kinematics, quat, text, units
from ..bvh import frame_rate
from ..clip import Clip
from ..errors import UserError
from ..lengths import LENGTHS
from ..skeleton import Skeleton, distinct, sort_topologically
from . import directions, smpl
from .archive import Archive
from .turns import FORMATS, rotations

Array = NDArray[np.float64]

MOST_JOINTS = 1_000

FPS = "fps framerate frame_rate mocap_framerate mocap_frame_rate mocap_fps".split()
FRAME_TIME = "frame_time frametime dt".split()
NAMES = "names joint_names bone_names joints".split()
PARENTS = "parents parent parent_indices hierarchy kintree_table".split()
OFFSETS = "offsets rest_offsets bone_offsets".split()
REST = "rest_positions rest_joints j joints".split()
WORLD = "positions world_positions global_positions joint_positions xyz joints".split()
LOCAL = "local_positions local_translations".split()
ROOT = "root_positions root_position root_pos root_translation trans transl translation".split()
LOCAL_TURNS = {
    **dict.fromkeys("rotations local_rotations quaternions quats".split(), ""),
    **dict.fromkeys("axis_angle rotvec poses".split(), "axis_angle"),
    **dict.fromkeys("euler eulers euler_angles".split(), "euler"),
    **dict.fromkeys("rotmats matrices rotation_matrices".split(), "matrix"),
    **dict.fromkeys("rot6d rotations_6d".split(), "6d"),
}
WORLD_TURNS = dict.fromkeys("world_rotations global_rotations".split(), "")
ORDER = "euler_order rotation_order order".split()
NEEDED = (
    "needed are SMPL poses and trans; or parents and either positions [T, J, 3], or rotations with "
    "local_positions, positions, or offsets and root_positions; `pydoc motion.npz` lists the keys"
)


def read(path: str | os.PathLike[str], *, fps: float | None = None) -> Clip:
    """Read an ``.npz`` file as a clip in metres, Y up, named after it.

    fps, if given, replaces the file's frame rate, which may be missing then. See `motion.npz` for the keys
    that are understood. Anything else, and numbers that are not finite, are UserErrors.
    """
    path = Path(path)
    archive = Archive(path)
    rate = float(fps) if fps is not None else _rate(archive)
    found = smpl.poses(archive)
    clip = _plain(archive, path, rate) if found is None else _smpl(archive, path, rate, *found)
    if not (np.isfinite(clip.positions).all() and np.isfinite(clip.rotations).all()):
        raise archive.fault("its numbers are too large for a motion")
    return clip


def _rate(archive: Archive) -> float:
    key, slow = archive.first(FPS), archive.first(FRAME_TIME)
    if key is None and slow is None:
        if any(fnmatch.fnmatchcase(archive.path.name, pattern) for pattern in smpl.NOT_CLIPS):
            raise archive.fault(
                "a shape or rest pose, not a motion", "name motion files, or leave it out with --exclude"
            )
        raise archive.fault(
            f"no frame rate; the file has {archive.listing()}", "add the key fps, or give the rate with --fps"
        )
    value = archive.numbers(key or slow or "")
    seconds = float(value.reshape(-1)[0]) if value.size == 1 else -1.0
    if not 1e-6 < seconds < 1e6:
        raise archive.fault(f"{key or slow} is {value.tolist()!r:.60}", "give one positive number")
    return seconds if key else frame_rate(repr(seconds))


# SMPL


def _smpl(archive: Archive, path: Path, fps: float, names: tuple[str, ...], poses: Array) -> Clip:
    frames = len(poses)
    if frames == 0:
        raise archive.fault("no frames", "give a file with at least one")
    root = _array(archive, ROOT, (frames, 3))
    if root is None:
        raise archive.fault(
            f"no root positions; the file has {archive.listing()}", "add the key trans [frames, 3]"
        )
    turns = quat.exp(poses)
    z_up = _word(archive, "up", ("y", "z"), "z" if smpl.is_z_up(turns[:, 0]) else "y") == "z"
    # Only the world is turned: the body's own frames stand Y up at rest in all SMPL files.
    stand = axes.basis("z", "-y").T if z_up else np.eye(3)
    turns[:, 0] = quat.mul(quat.from_matrix(stand), turns[:, 0])
    skeleton = _smpl_rest(archive, path, names)
    unit = _unit(archive) or 1.0
    if skeleton is None:
        skeleton = smpl.approximate(names, turns, unit * root @ stand.T)
        skeleton = replace(skeleton, offsets=skeleton.offsets / unit)
    positions = np.repeat(skeleton.offsets[None], frames, axis=0)
    positions[:, 0] = (root + skeleton.offsets[0]) @ stand.T
    clip = Clip(path.stem, skeleton, fps, positions, kinematics.unroll(turns), source=path)
    return units.to_metres(clip, unit)


def _smpl_rest(archive: Archive, path: Path, names: tuple[str, ...]) -> Skeleton | None:
    """The skeleton of an SMPL file by its own rest pose or the `smpl.skeleton_file`'s."""
    other = smpl.skeleton_file(path)
    for source in (archive, None if other is None else Archive(other)):
        if source is None:
            continue
        rest, known = _rest_pose(source, smpl.parents(names), names)
        if rest is not None:
            return Skeleton(names, smpl.parents(names), rest)
        if known:
            raise source.fault(
                f"its rest pose lacks some of the {len(names)} joints of {path.name}", "add them"
            )
        if source is not archive:
            raise source.fault(
                f"no rest pose in it; the file has {source.listing()}", "add the key J [joints, 3]"
            )
    return None


def _rest_pose(
    archive: Archive, parents: NDArray[np.int32], names: Sequence[str]
) -> tuple[Array | None, bool]:
    """Offsets [J, 3] of SMPL joints, by their names or the first so many; whether there was a rest pose."""
    for keys, places in ((OFFSETS, False), (REST, True)):
        key = next((k for k in keys if len(_shape(archive, k)) == 2 and _shape(archive, k)[1] == 3), None)
        if key is None:
            continue
        values = archive.numbers(key)
        order = list(range(len(names)))
        named = archive.first(NAMES)
        if named is not None and archive.headers[named].dtype.kind in "US":
            known = {name.lower(): j for j, name in enumerate(archive.strings(named))}
            order = [known.get(name, len(values)) for name in names]
        if max(order) >= len(values):
            return None, True
        values = values[order]
        if places:
            values = np.concatenate([values[:1], values[1:] - values[parents[1:]]])
        else:
            values[0] = 0  # a skeleton's place, not that of the pelvis in the body model
        return values, True
    return None, False


# Plain files


@dataclass(frozen=True, eq=False)
class _Order:
    """Joints with parents before children: which of the file's stands where."""

    joints: NDArray[np.int64]
    parents: NDArray[np.int32]


def _plain(archive: Archive, path: Path, fps: float) -> Clip:
    parent_key = archive.first(PARENTS)
    if parent_key is None:
        raise archive.fault(f"no motion that can be told; the file has {archive.listing()}", NEEDED)
    order = _hierarchy(archive, parent_key)
    count = len(order.joints)
    names = _names(archive, count)
    bare = Skeleton(tuple(names[j] for j in order.joints), order.parents, np.zeros((count, 3)))

    world = _motion(archive, WORLD, order)
    local = _motion(archive, LOCAL, order)
    local_turns, world_turns = (_turns(archive, keys, order) for keys in (LOCAL_TURNS, WORLD_TURNS))
    offsets = _offsets(archive, order)
    root = _array(archive, ROOT, (None, 3))
    lengths = {len(a) for a in (world, local, local_turns, world_turns, root) if a is not None}
    if len(lengths) > 1 or 0 in lengths:
        counts = ", ".join(map(str, sorted(lengths)))
        raise archive.fault(
            f"arrays of {counts} frames; the file has {archive.listing()}", "give each the same number"
        )

    if local_turns is None and world_turns is not None:
        places = np.zeros((*world_turns.shape[:2], 3))
        local_turns = kinematics.unroll(kinematics.local(bare, places, world_turns)[1])
    if local_turns is not None:
        positions = _positions(archive, bare, local_turns, world, local, offsets, root)
        turns = local_turns
    elif world is not None:
        rest = directions.rest_offsets(order.parents, world) if offsets is None else offsets
        positions, turns = directions.recover(replace(bare, offsets=rest), world)
        offsets = rest
    else:
        raise archive.fault(f"no motion that can be told; the file has {archive.listing()}", NEEDED)
    if offsets is None:
        offsets = np.median(positions, axis=0)
    place = np.argsort(order.joints)
    skeleton = replace(bare, offsets=offsets, roles=_roles(archive, place), end_sites=_ends(archive, place))
    return _ours(archive, Clip(path.stem, skeleton, fps, positions, kinematics.unroll(turns), source=path))


def _positions(
    archive: Archive,
    bare: Skeleton,
    turns: Array,
    world: Array | None,
    local: Array | None,
    offsets: Array | None,
    root: Array | None,
) -> Array:
    """Places [T, J, 3] of joints in their parents, for rotations [T, J, 4]."""
    if local is not None:
        return local
    if world is not None:
        turned = kinematics.forward(bare, np.zeros((*turns.shape[:2], 3)), turns)[1]
        return np.asarray(kinematics.local(bare, world, turned)[0], np.float64)
    if offsets is None or root is None:
        lacking = "rest pose" if offsets is None else "root positions"
        raise archive.fault(f"rotations, but no {lacking}; the file has {archive.listing()}", NEEDED)
    positions = np.repeat(offsets[None], len(turns), axis=0)
    positions[:, 0] = root
    return positions


def _hierarchy(archive: Archive, key: str) -> _Order:
    values = archive.numbers(key)
    if key == "kintree_table" and values.ndim == 2:
        values = values[0]
    count = values.size
    if values.ndim != 1 or not 1 <= count <= MOST_JOINTS or (values != np.round(values)).any():
        raise archive.fault(
            f"{key} is {archive.headers[key]}, expected 1 to {MOST_JOINTS} whole numbers",
            "give one parent a joint",
        )
    parents = np.where((values == 2**32 - 1) | (values == np.arange(count)), -1, values)
    if ((parents < -1) | (parents >= count)).any():
        worst = int(np.argmax((parents < -1) | (parents >= count)))
        raise archive.fault(
            f"{key}: joint {worst} hangs on joint {values[worst]:.0f}, of {count}", "correct it"
        )
    joints = sort_topologically(parents.astype(int).tolist())
    if len(joints) < count or (parents == -1).sum() != 1:
        what = "it has several roots" if (parents == -1).sum() > 1 else "joints hang on one another in a ring"
        raise archive.fault(f"{key}: {what}", "give one root, with parent -1, and all others below it")
    place = np.argsort(joints)
    above = np.where(parents[joints] < 0, -1, place[parents[joints].astype(int)])
    return _Order(joints, above.astype(np.int32))


def _names(archive: Archive, count: int) -> tuple[str, ...]:
    key = next((k for k in NAMES if k in archive.headers and archive.headers[k].dtype.kind in "US"), None)
    if key is None:
        return tuple(f"joint_{j}" for j in range(count))
    names = archive.strings(key)
    if len(names) != count:
        raise archive.fault(f"{key} has {len(names)} names for {count} joints", "give one a joint")
    return distinct([" ".join(name.split()) or f"joint_{j}" for j, name in enumerate(names)])


def _shape(archive: Archive, key: str) -> tuple[int, ...]:
    header = archive.headers.get(key)
    return () if header is None or header.dtype.kind not in "fiu" else header.shape


def _array(archive: Archive, keys: Sequence[str], shape: tuple[int | None, ...]) -> Array | None:
    """The first of some keys, which must have this shape; None stands for any side."""
    key = archive.first(keys)
    if key is None:
        return None
    header = archive.headers[key]
    if len(header.shape) != len(shape) or any(
        side not in (None, found) for side, found in zip(shape, header.shape, strict=True)
    ):
        sides = ", ".join("T" if side is None else str(side) for side in shape)
        raise archive.fault(f"{key} is {header}, expected [{sides}]", "reshape it")
    return archive.numbers(key)


def _motion(archive: Archive, keys: Sequence[str], order: _Order) -> Array | None:
    """Places [T, J, 3] by joint; ``joints`` counts only where it has three axes."""
    keys = [k for k in keys if k != "joints" or len(_shape(archive, k)) == 3]
    values = _array(archive, keys, (None, len(order.joints), 3))
    return None if values is None else np.ascontiguousarray(values[:, order.joints])


def _turns(archive: Archive, keys: dict[str, str], order: _Order) -> Array | None:
    key = archive.first(keys)
    if key is None:
        return None
    form = keys[key]
    if not form and "rotation_format" in archive.headers:
        form = _word(archive, "rotation_format", FORMATS, "")
    euler_order = archive.first(ORDER)
    degrees = _word(archive, "angle_unit", ("radians", "degrees"), "radians") == "degrees"
    spelled = None if euler_order is None else archive.string(euler_order)
    try:
        found = rotations(archive.numbers(key), len(order.joints), form, spelled, degrees)
    except ValueError as error:
        raise archive.fault(f"{key} is {archive.headers[key]}: {error}", NEEDED) from error
    return np.ascontiguousarray(found[:, order.joints])


def _offsets(archive: Archive, order: _Order) -> Array | None:
    count = len(order.joints)
    offsets = _array(archive, OFFSETS, (count, 3))
    if offsets is not None:
        return offsets[order.joints]
    rest = _array(archive, [k for k in REST if k != "joints" or len(_shape(archive, k)) == 2], (count, 3))
    if rest is None:
        return None
    rest = rest[order.joints]
    return np.concatenate([rest[:1], rest[1:] - rest[order.parents[1:]]])


def _roles(archive: Archive, place: NDArray[np.int64]) -> dict[str, int]:
    """Roles that the file tells; they were ours, and others are passed over."""
    from ..roles import ROLES

    if not {"roles", "role_joints"} <= archive.headers.keys():
        return {}
    names, joints = archive.strings("roles"), _indices(archive, "role_joints", len(place))
    if len(names) != len(joints) or not set(names) <= set(ROLES):
        raise archive.fault(
            "roles and role_joints do not belong together", "leave them out to have them guessed"
        )
    return {name: int(place[j]) for name, j in zip(names, joints, strict=True)}


def _ends(archive: Archive, place: NDArray[np.int64]) -> dict[int, Array]:
    if not {"end_site_joints", "end_site_offsets"} <= archive.headers.keys():
        return {}
    joints = _indices(archive, "end_site_joints", len(place))
    offsets = _array(archive, ["end_site_offsets"], (len(joints), 3))
    assert offsets is not None
    return {int(place[j]): offset for j, offset in zip(joints, offsets, strict=True)}


def _indices(archive: Archive, key: str, count: int) -> list[int]:
    values = archive.numbers(key)
    if values.ndim != 1 or ((values != np.round(values)) | (values < 0) | (values >= count)).any():
        raise archive.fault(f"{key} names joints that the file does not have", f"it has {count}")
    return [int(v) for v in values]


def _ours(archive: Archive, clip: Clip) -> Clip:
    """The clip in our axes and metres."""
    directions_known = ("x", "y", "z", "-x", "-y", "-z")
    up = _word(archive, "up", directions_known, "y")
    forward = _word(archive, "forward", directions_known, "-y" if up.endswith("z") else "z")
    handedness = _word(archive, "handedness", axes.HANDEDNESS, "right")
    if (up, forward, handedness) != ("y", "z", "right"):
        try:
            clip = axes.convert(clip, up=up, forward=forward, handedness=handedness, inverse=True)
        except UserError as error:
            raise archive.fault(error.what, error.remedy or "") from error
    unit = _unit(archive)
    if unit is None:
        unit = units.guess(clip.skeleton, clip.positions[len(clip) // 2])
    return units.to_metres(clip, unit)


def _unit(archive: Archive) -> float | None:
    """Metres a unit, if the file says so."""
    if "unit_to_m" in archive.headers:
        values = archive.numbers("unit_to_m")
        if values.size != 1 or not 0 < float(values.reshape(-1)[0]) < math.inf:
            raise archive.fault("unit_to_m is no positive number", "give the metres a unit")
        return float(values.reshape(-1)[0])
    return LENGTHS[_word(archive, "unit", tuple(LENGTHS), "m")] if "unit" in archive.headers else None


def _word(archive: Archive, key: str, choices: Sequence[str], default: str) -> str:
    """A string of the file that is one of some, in any case."""
    if key not in archive.headers:
        return default
    word = archive.string(key).strip().lower()
    if word not in choices:
        raise archive.fault(f"{key} is {text.shown(word)}", f"choose {', '.join(choices)}")
    return word
