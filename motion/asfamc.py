"""Acclaim ASF skeletons and AMC motion, as the CMU library has them.

A bone b turns in its own axis frame C_b by its angles M_b. In frames that are parallel at rest, that is

    R_b = C_b M_b C_b^-1,

and the bone points along ``direction``, so a joint stands where its bone begins, the offset of a child is
the vector of its parent's bone, and the bones of leaves end in end sites. Angles named in an order X Y Z turn
about fixed axes: M = R_z R_y R_x.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from . import digits, euler, files, quat, text
from .clip import Clip
from .errors import UserError
from .skeleton import Skeleton, sort_topologically

FPS = 120.0  # of the CMU library; an AMC file does not say
INCH = 0.0254
ROOT = "hips"  # a file's own name for it, root, would be taken for the ground root

MOST_BONES = 1_000
_DOF = ("tx", "ty", "tz", "rx", "ry", "rz")


@dataclass
class _Bone:
    name: str
    line: int
    direction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    length: float = 0.0
    axis: tuple[float, float, float] = (0.0, 0.0, 0.0)
    order: str = "xyz"
    dof: tuple[str, ...] = ()
    parent: str = ""


@dataclass
class Asf:
    """An ASF file in its own units: bones, the root first (whose `direction` is its position).

    degrees says whether angles are in degrees; length is that of the units section, if there is one.
    """

    bones: list[_Bone] = field(default_factory=list)
    degrees: bool = True
    length: float | None = None


def read_asf(path: str | os.PathLike[str]) -> Asf:
    """Read an ASF skeleton; anything amiss is a UserError with its line."""
    asf = Asf([_Bone("root", 1, dof=("tx", "ty", "tz", "rx", "ry", "rz"))])
    root = asf.bones[0]
    section, bone, names, line = "", None, {"root": root}, 0

    def fault(what: str, remedy: str = text.WHOLE_COPY) -> UserError:
        return UserError(what, path=path, line=line or None, remedy=remedy)

    def numbers(words: list[str], count: int) -> tuple[float, ...]:
        try:
            values = tuple(float(word) for word in words[:count])
        except ValueError:
            values = ()
        if len(values) != count or not all(abs(value) <= digits.LIMIT for value in values):
            raise fault(f"expected {count} finite numbers, found {text.shown(' '.join(words))}")
        return values

    def order(words: list[str]) -> str:
        axes = "".join(words).lower()
        if sorted(axes) != ["x", "y", "z"]:
            raise fault(f"axis order {text.shown(axes)}", "an order names X, Y and Z once each")
        return axes

    def dof(words: list[str]) -> tuple[str, ...]:
        found = tuple(word.lower() for word in words)
        for word in found:
            if word not in _DOF or found.count(word) > 1:
                raise fault(
                    f"degree of freedom {text.shown(word)}", f"supported are {' '.join(_DOF)}, once each"
                )
        return found

    data = text.read_bytes(path)
    if b":bonedata" not in data.lower():
        raise fault("not an ASF file, or cut short", "an ASF file has a :bonedata section")
    for line, content in enumerate(text.lines(text.decode(data)), 1):
        words = content.partition("#")[0].split()
        if not words:
            continue
        key = words[0].lower()
        if key.startswith(":"):
            section, bone = key, None
        elif section == ":units":
            if key == "length":
                (asf.length,) = numbers(words[1:], 1)
                if not asf.length > 0:
                    raise fault("the unit of length is not positive")
            elif key == "angle" and len(words) > 1:
                asf.degrees = words[1].lower().startswith("deg")
        elif section == ":root":
            if key == "order":
                root.dof = dof(words[1:])
            elif key == "axis":
                root.order = order(words[1:])
            elif key == "position":
                root.direction = numbers(words[1:], 3)  # type: ignore[assignment]
            elif key == "orientation":
                root.axis = numbers(words[1:], 3)  # type: ignore[assignment]
        elif section == ":bonedata":
            if key == "begin":
                bone = _Bone("", line)
            elif key == "end":
                if bone is None or not bone.name or bone.name in names:
                    raise fault("a bone without a name of its own")
                if len(names) > MOST_BONES:
                    raise fault(f"more than {MOST_BONES} bones", "no body has such a skeleton")
                asf.bones.append(bone)
                names[bone.name], bone = bone, None
            elif bone is None:
                raise fault(f"{text.shown(words[0])} outside of a bone")
            elif key == "name":
                bone.name = " ".join(words[1:])
            elif key == "direction":
                bone.direction = numbers(words[1:], 3)  # type: ignore[assignment]
            elif key == "length":
                (bone.length,) = numbers(words[1:], 1)
            elif key == "axis":
                bone.axis, bone.order = numbers(words[1:], 3), order(words[4:])  # type: ignore[assignment]
            elif key == "dof":
                bone.dof = dof(words[1:])
        elif section == ":hierarchy" and key not in ("begin", "end"):
            for name in words:
                if name not in names:
                    raise fault(f"no bone {text.shown(name)} in :bonedata")
            for name in words[1:]:
                if names[name].parent or name == "root":
                    raise fault(f"bone {text.shown(name)} has two parents")
                names[name].parent = words[0]
    if bone is not None:
        raise fault("the last bone has no 'end': the file is cut short")
    for loose in asf.bones[1:]:
        if not _reaches_root(loose, names):
            line = loose.line
            raise fault(f"bone {text.shown(loose.name)} hangs on nothing", "list it in :hierarchy")
    return asf


def _reaches_root(bone: _Bone, names: dict[str, _Bone]) -> bool:
    for _ in range(len(names)):
        if bone.parent in ("", "root"):
            return bone.parent == "root"
        bone = names[bone.parent]
    return False


STRAY, MISSING, EXTRA, TWICE = 11, 12, 13, 14


@numba.njit(cache=True, nogil=True)
def _scan_frames(data, names, ends, firsts, out, doubts, state):
    """Fill out [T, C] from the lines of an AMC file.

    Bone b is called names[ends[b]:ends[b + 1]] and owns the columns firsts[b] to firsts[b + 1]. state holds
    byte, line, frame, bones seen in it and the bone expected next, and gets the number of doubts noted.
    Returns a status.
    """
    n, bones = len(data), len(firsts) - 1
    i, line, frame, seen, turn, noted = state[0], state[1], state[2], state[3], state[4], 0
    status = digits.DONE
    marks = np.full(bones, -1, np.int64)
    last, last_line = i, line
    while i < n:
        while i < n and digits.is_space(data[i]):
            line += data[i] == 10
            i += 1
        if i == n:
            break
        last, last_line = i, line
        if data[i] == 35 or data[i] == 58:  # a comment, or a keyword such as :DEGREES
            while i < n and data[i] != 10:
                i += 1
            continue
        end = i
        others = np.int64(0)
        while end < n and not digits.is_space(data[end]):
            others += np.int64(np.uint8(data[end] - 48) > 9)
            end += 1
        if others == 0:
            if frame >= 0 and seen < bones:
                status = MISSING
                break
            if noted + firsts[bones] > len(doubts):
                status = digits.FULL
                break
            frame += 1
            seen = 0
            turn = 0
            i = end
            if frame == len(out):
                status = digits.TOO_MANY
                break
            continue
        if frame < 0:
            status = STRAY
            break
        bone = -1
        for k in range(bones):  # the bones come in one order in all frames, so the first guess holds
            b = (turn + k) % bones
            if ends[b + 1] - ends[b] == end - i:
                same = True
                for c in range(end - i):
                    if data[i + c] != names[ends[b] + c]:
                        same = False
                        break
                if same:
                    bone = b
                    break
        if bone < 0:
            status = STRAY
            break
        if marks[bone] == frame:
            status = TWICE
            break
        marks[bone] = frame
        turn = bone + 1
        i = end
        for column in range(firsts[bone], firsts[bone + 1]):
            while i < n and data[i] != 10 and digits.is_space(data[i]):
                i += 1
            if i == n or data[i] == 10:
                status = digits.SHORT
                break
            end, kind, value = digits.scan(data, i, n)
            if kind == digits.OK and abs(value) <= digits.LIMIT:
                out[frame, column] = value
            elif kind == digits.IN_DOUBT:
                doubts[noted, 0], doubts[noted, 1], doubts[noted, 2] = frame, column, line
                doubts[noted, 3], doubts[noted, 4] = i, end
                noted += 1
            else:
                status = digits.BAD
                break
            i = end
        if status != digits.DONE:
            break
        while i < n and data[i] != 10 and digits.is_space(data[i]):
            i += 1
        if i < n and data[i] != 10:
            status = EXTRA
            break
        seen += 1
    if status == digits.DONE and frame >= 0 and seen < bones:
        status = MISSING
        i, line = last, last_line
    state[0], state[1], state[2], state[3], state[4], state[5] = i, line, frame, seen, turn, noted
    return status


def read(
    path: str | os.PathLike[str],
    asf_path: str | os.PathLike[str] | None = None,
    *,
    fps: float = FPS,
    unit_to_m: float | None = None,
) -> Clip:
    """Read an AMC motion with its ASF skeleton as a clip in metres, rotations unrolled.

    asf_path defaults to the skeleton that `find_asf` finds; unit_to_m to what its units section says (an inch
    over ``length``). Anything amiss is a UserError with its line.
    """
    path = Path(path)
    asf_path = find_asf(path) if asf_path is None else Path(asf_path)
    asf = read_asf(asf_path)
    if unit_to_m is None:
        unit_to_m = INCH / (asf.length or 1.0)
    bones = _depth_first(asf.bones)
    values, degrees = _read_amc(path, bones)
    index = {bone.name: j for j, bone in enumerate(bones)}
    parents = np.array([-1, *(index[bone.parent] for bone in bones[1:])], np.int32)
    vectors = np.array([np.multiply(bone.direction, bone.length) for bone in bones])
    vectors[0] = 0  # what hangs on the root begins where the root is
    offsets = vectors[parents]
    offsets[0] = bones[0].direction
    has_child = np.isin(np.arange(len(bones)), parents)
    skeleton = Skeleton(
        (ROOT, *(bone.name for bone in bones[1:])),
        parents,
        offsets * unit_to_m,
        end_sites={j: vectors[j] * unit_to_m for j in np.flatnonzero(~has_child).tolist()},
    )
    frames = _axis_frames(bones, asf.degrees)
    positions = np.repeat(offsets[None], len(values), axis=0)
    columns, axes = np.full((2, len(bones), 3), -1, np.int64)
    column = 0
    for j, bone in enumerate(bones):
        turns = [k for k, dof in enumerate(bone.dof) if dof[0] == "r"][
            ::-1
        ]  # fixed axes: the last is outermost
        columns[j, : len(turns)] = [column + k for k in turns]
        axes[j, : len(turns)] = ["xyz".index(bone.dof[k][1]) for k in turns]
        for k, dof in enumerate(bone.dof):
            if dof[0] == "t":
                along = np.eye(3)["xyz".index(dof[1])]
                along = quat.rotate(frames[j], along) if j else along
                positions[:, j] += values[:, column + k, None] * along
        column += len(bone.dof)
    if not (asf.degrees if degrees is None else degrees):
        values = np.degrees(values)
    turned = euler.unrolled(values, columns, axes)
    rotations = np.asarray(quat.mul(frames, quat.mul(turned, quat.inv(frames))), np.float64)
    return Clip(path.stem, skeleton, float(fps), positions * unit_to_m, rotations, unit_to_m, path)


def find_asf(path: str | os.PathLike[str]) -> Path:
    """The skeleton of an AMC file: its subject's (the name up to an underscore), or the folder's only one.

    A subject's skeleton is also found in a folder beside the motion's. None, or several, is a UserError.
    """
    path = Path(path)
    subjects = list(dict.fromkeys([path.stem, path.stem.rsplit("_", 1)[0], path.stem.split("_", 1)[0]]))
    remedy = f"put {subjects[-1]}.asf beside it"
    if files.kind(path) is None:
        raise UserError("no such file", path=path, remedy="check the path")
    here = sorted(p for p in path.parent.iterdir() if p.suffix.lower() == ".asf")
    for subject in subjects:
        for candidate in here:
            if candidate.stem.lower() == subject.lower():
                return candidate
    if len(here) == 1:
        return here[0]
    if len(here) > 1:
        raise UserError("which of the folder's skeletons (.asf) moves is unclear", path=path, remedy=remedy)
    for subject in subjects:
        around = path.resolve().parent.parent
        near = [p for p in around.glob(f"*/{subject}.asf")] + [
            p for p in around.glob(f"*/{subject}/{subject}.asf")
        ]
        if len(near) == 1:
            return near[0]
    raise UserError("no skeleton (.asf) for this motion", path=path, remedy=remedy)


def _axis_frames(bones: list[_Bone], degrees: bool) -> NDArray[np.float64]:
    """Rotations C [J, 4] of the bones' axis frames."""
    angles = np.array([bone.axis for bone in bones]).reshape(1, -1)
    columns = np.array([[3 * j + 2, 3 * j + 1, 3 * j] for j in range(len(bones))])
    axes = np.array([["xyz".index(axis) for axis in bone.order[::-1]] for bone in bones])
    return euler.unrolled(angles if degrees else np.degrees(angles), columns, axes)[0]


def _depth_first(bones: list[_Bone]) -> list[_Bone]:
    index = {bone.name: j for j, bone in enumerate(bones)}
    order = sort_topologically([-1, *(index[bone.parent] for bone in bones[1:])])
    return [bones[j] for j in order.tolist()]


def _read_amc(path: Path, bones: list[_Bone]) -> tuple[NDArray[np.float64], bool | None]:
    """Values [T, C], a column for each degree of freedom of each bone; whether the file says degrees."""
    data = text.read_bytes(path)
    head = data[:4096].lower()
    degrees = True if b":degrees" in head else False if b":radians" in head else None
    moving = [bone for bone in bones if bone.dof]
    names = [bone.name.encode() for bone in moving]
    ends = np.cumsum([0, *map(len, names)])
    firsts = np.cumsum([0, *(len(bone.dof) for bone in moving)])
    array = np.frombuffer(data, np.uint8)
    out = np.empty((data.count(b"\n") // (len(moving) + 1) + 1, int(firsts[-1])))
    doubts = np.empty((4096 + out.shape[1], 5), np.int64)
    state = np.array([0, 1, -1, 0, 0, 0])
    joined = np.frombuffer(b"".join(names), np.uint8)
    view = memoryview(data)

    def fault(what: str, line: int, remedy: str = text.WHOLE_COPY) -> UserError:
        return UserError(what, path=path, line=line or None, remedy=remedy)

    while True:
        status = _scan_frames(array, joined, ends, firsts, out, doubts, state)
        for frame, column, line, at, end in doubts[: state[5]].tolist():
            value = float(view[at:end]) if end - at < 4096 else math.inf
            if not abs(value) <= digits.LIMIT:
                raise fault(f"no finite number: {text.shown(digits.token_at(array, at))}", line)
            out[frame, column] = value
        if status != digits.FULL:
            break
    i, line, frame = state[:3].tolist()
    token = text.shown(digits.token_at(array, i))
    if status in (MISSING, digits.TOO_MANY):
        raise fault(f"frame {frame + 1} lacks some of the {len(moving)} bones that move", line)
    if status == STRAY and frame < 0:
        raise fault(f"{token} before the first frame's number", line, "an AMC file numbers its frames")
    if status == STRAY:
        raise fault(f"the skeleton has no moving bone {token}", line, "use the skeleton of this subject")
    if status == TWICE:
        raise fault(f"bone {token} twice in frame {frame + 1}", line)
    if status == digits.SHORT:
        raise fault(f"too few values for this bone in frame {frame + 1}", line)
    if status == EXTRA:
        raise fault(
            f"more values than the bone has degrees of freedom: {token}", line, "use its own skeleton"
        )
    if status == digits.BAD:
        raise fault(f"no finite number: {token}", line)
    if frame < 0:
        raise fault("no frames", line)
    return out[: frame + 1], degrees
