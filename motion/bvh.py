"""BVH files: read and written, as documents (exactly what the file says) and as clips.

A joint's position channels replace its OFFSET, whichever joint it is; rotation channels are applied in the
order in which the joint lists them, R = R_first R_second R_third.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import digits, euler, files, quat, text, units
from .clip import Clip
from .errors import UserError
from .skeleton import Skeleton, sort_topologically

MOST_JOINTS, MOST_DEPTH = 1_000, 1_000
CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")
_CANONICAL = {name.lower(): name for name in CHANNELS}

_MOTION = re.compile(rb"^[ \t]*MOTION\b", re.IGNORECASE | re.MULTILINE)
_FRAMES = re.compile(rb"\s*frames\s*:?\s*(\S+)\s*$", re.IGNORECASE)
_FRAME_TIME = re.compile(rb"\s*frame\s*time\s*:?\s*(\S+)\s*$", re.IGNORECASE)
_NAMED = re.compile(r"(ROOT|JOINT)\b\s*([^{]*)(.*)", re.IGNORECASE)

_COMMON_RATES = (
    10,
    12,
    15,
    20,
    24,
    25,
    30,
    48,
    50,
    60,
    72,
    75,
    90,
    96,
    100,
    120,
    144,
    150,
    180,
    200,
    240,
    250,
    300,
    480,
    500,
)
_BROADCAST_RATES = tuple(n * 1000 / 1001 for n in (24, 30, 60, 120, 240))


@dataclass(eq=False)
class BvhDocument:
    """What a BVH file says, in its own units and degrees.

    Attributes
    ----------
    names : J joint names, in file order (depth first).
    parents : int32 [J], -1 for the root, joint 0.
    offsets : float64 [J, 3].
    end_sites : per joint, the offsets of its end sites.
    channels : per joint, its channels in file order, spelled as in `CHANNELS`.
    frame_time : seconds per frame, as printed.
    values : float64 [T, C], C the number of all channels.
    """

    names: tuple[str, ...]
    parents: NDArray[np.int32]
    offsets: NDArray[np.float64]
    end_sites: tuple[tuple[NDArray[np.float64], ...], ...]
    channels: tuple[tuple[str, ...], ...]
    frame_time: str
    values: NDArray[np.float64]

    @property
    def fps(self) -> float:
        """Frames per second, see `frame_rate`."""
        return frame_rate(self.frame_time)


def frame_rate(printed: str) -> float:
    """The frame rate behind a printed frame time.

    Frame times are rounded (0.008333) or cut (0.06666666) decimals, so the rate is one that the printed
    digits can stand for: a common one, a broadcast one (29.97 is 30000/1001), a whole one, else the plain
    reciprocal.
    """
    seconds = float(printed)
    mantissa, _, power = printed.lower().partition("e")
    step = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
    rates: list[tuple[float, ...]] = [_COMMON_RATES] if step < seconds / 2 else []
    if step < seconds / 100:
        rates += [_BROADCAST_RATES, (float(round(1 / seconds)),) if seconds < 1 else ()]
    for choices in rates:
        rate = min(choices, key=lambda r: abs(math.log(r * seconds)), default=0.0)
        if rate and -0.5000001 < (1 / rate - seconds) / step < 1:
            return float(rate)
    return 1 / seconds


# Reading

MakeFault = Callable[..., UserError]


@dataclass
class _Joint:
    name: str
    parent: int
    line: int
    offset: list[float] | None = None
    ends: list[list[float]] = field(default_factory=list)
    channels: tuple[str, ...] | None = None


def parse(path: str | os.PathLike[str]) -> BvhDocument:
    """Read a BVH file exactly.

    Keywords and channels may be in any case and order, separated by any white space; blank lines and lines
    that begin with ``#`` or ``//`` are skipped. A file may hold one row fewer than ``Frames:`` says, as some
    exporters count one too many. Anything else amiss is a UserError with its line.
    """
    data = text.read_bytes(path)
    start = _MOTION.search(data)
    if start is None:
        head = data[:4096]
        if b"HIERARCHY" in head.upper() and b"\0" not in head:
            raise UserError(
                "no MOTION section: the file is cut short",
                path=path,
                line=data.count(b"\n") + 1,
                remedy=text.WHOLE_COPY,
            )
        raise UserError("not a BVH file", path=path, line=1, remedy="a BVH file begins with HIERARCHY")
    joints = _hierarchy(text.decode(data[: start.start()]), path)
    columns = sum(len(joint.channels or ()) for joint in joints)
    if columns == 0:
        raise UserError("no joint has channels", path=path, remedy=text.WHOLE_COPY)
    frames, frame_time, at, line, frames_line = _motion_head(data, start.end(), path)
    values = _rows(data, at, line, columns, frames, frames_line, path)
    return BvhDocument(
        names=tuple(joint.name for joint in joints),
        parents=np.array([joint.parent for joint in joints], np.int32),
        offsets=np.array([joint.offset for joint in joints], np.float64),
        end_sites=tuple(tuple(np.array(end) for end in joint.ends) for joint in joints),
        channels=tuple(joint.channels or () for joint in joints),
        frame_time=frame_time,
        values=values,
    )


def _hierarchy(header: str, path: str | os.PathLike[str]) -> list[_Joint]:
    """The joints of the text before MOTION."""
    joints: list[_Joint] = []
    blocks: list[tuple[int, bool]] = []  # open blocks: joint, whether it is an end site of that joint
    announced: tuple[int, bool] | None = None  # by ROOT, JOINT or End, before its "{"
    line = 0

    def fault(what: str, remedy: str = text.WHOLE_COPY) -> UserError:
        return UserError(what, path=path, line=line, remedy=remedy)

    for line, rest in enumerate(header.split("\n"), 1):
        rest = rest.strip()
        while rest and not rest.startswith(("#", "//")):
            if rest[0] == "{":
                if announced is None:
                    raise fault("'{' without ROOT, JOINT or End Site before it")
                blocks.append(announced)
                announced, rest = None, rest[1:].lstrip()
                if len(blocks) > MOST_DEPTH:
                    raise fault(f"joints nested more than {MOST_DEPTH} deep", "no body has such a skeleton")
                continue
            if announced is not None:
                raise fault(f"expected '{{', found {text.shown(rest)}")
            if rest[0] == "}":
                if not blocks:
                    raise fault("'}' without its '{'")
                blocks.pop()
                rest = rest[1:].lstrip()
                continue
            word, *tail = rest.split(None, 1)
            keyword, rest = word.upper(), tail[0] if tail else ""
            named = _NAMED.match(f"{word} {rest}") if keyword.startswith(("ROOT", "JOINT")) else None
            if named is not None:
                _check_place(named[1].upper(), blocks, joints, fault)
                name = named[2].strip()
                if not name:
                    raise fault("a joint without a name", "write one behind " + named[1])
                joints.append(_Joint(name, blocks[-1][0] if blocks else -1, line))
                if len(joints) > MOST_JOINTS:
                    raise fault(f"more than {MOST_JOINTS} joints", "no body has such a skeleton")
                announced, rest = (len(joints) - 1, False), named[3]
            elif keyword == "END":
                if not blocks or blocks[-1][1]:
                    raise fault("End Site outside of a joint")
                announced, rest = (blocks[-1][0], True), "{" + rest.partition("{")[2] if "{" in rest else ""
            elif keyword == "OFFSET":
                if not blocks:
                    raise fault("OFFSET outside of a joint")
                words = rest.split(None, 3)
                offset, rest = _numbers(words[:3], fault), words[3] if len(words) > 3 else ""
                joint, is_end = joints[blocks[-1][0]], blocks[-1][1]
                if is_end:
                    joint.ends.append(offset)
                elif joint.offset is not None:
                    raise fault(f"a second OFFSET in joint {text.shown(joint.name)}")
                else:
                    joint.offset = offset
            elif keyword == "CHANNELS":
                if not blocks or blocks[-1][1] or joints[blocks[-1][0]].channels is not None:
                    raise fault("CHANNELS outside of a joint, or a second time")
                joints[blocks[-1][0]].channels, rest = _channel_list(rest, fault)
            elif keyword != "HIERARCHY":
                raise fault(f"unexpected {text.shown(word)} in the hierarchy")
    if announced is not None or blocks:
        open_joint = joints[(announced or blocks[-1])[0]]
        raise fault(f"the hierarchy ends inside joint {text.shown(open_joint.name)}: '}}' is missing")
    if not joints:
        raise fault("no ROOT joint")
    for joint in joints:
        if joint.offset is None:
            line = joint.line
            raise fault(f"joint {text.shown(joint.name)} has no OFFSET")
    return joints


def _check_place(
    keyword: str, blocks: list[tuple[int, bool]], joints: list[_Joint], fault: MakeFault
) -> None:
    if blocks and blocks[-1][1]:
        raise fault(f"{keyword} inside an End Site")
    if keyword == "ROOT" and blocks:
        raise fault("ROOT inside a joint", "write JOINT there")
    if keyword == "JOINT" and not blocks:
        raise fault("JOINT outside of a joint", "write ROOT for the first one")
    if keyword == "ROOT" and joints:
        raise fault("a second ROOT", "put each character into its own file")


def _numbers(words: list[str], fault: MakeFault) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != 3 or not all(abs(value) <= digits.LIMIT for value in values):
        raise fault(f"OFFSET needs three finite numbers, found {text.shown(' '.join(words))}")
    return values


def _channel_list(rest: str, fault: MakeFault) -> tuple[tuple[str, ...], str]:
    """The channels behind CHANNELS, and what follows them on the line."""
    count, *words = rest.split(None, 7) or [""]
    if not count.isdecimal() or int(count) > 6:
        raise fault(f"CHANNELS needs a count of 0 to 6, found {text.shown(count)}")
    found = words[: int(count)]
    if len(found) < int(count):
        raise fault(f"CHANNELS {count} lists only {len(found)}")
    channels = tuple(_CANONICAL.get(word.lower(), "") for word in found)
    if "" in channels:
        unknown = found[channels.index("")]
        raise fault(f"unknown channel {text.shown(unknown)}", f"the channels are {', '.join(CHANNELS)}")
    if len(set(channels)) < len(channels):
        raise fault("a channel is listed twice", "each joint may have each channel once")
    return channels, " ".join(words[int(count) :])


def _motion_head(data: bytes, at: int, path: str | os.PathLike[str]) -> tuple[int, str, int, int, int]:
    """Frames and frame time from byte `at` on; byte and line of the rows; the line of ``Frames:``."""
    line = data.count(b"\n", 0, at) + 1
    frames = frame_time = None
    frames_line = line
    at, line = data.find(b"\n", at) + 1 or len(data), line + 1
    while frames is None or frame_time is None:
        if at >= len(data):
            missing = "Frames:" if frames is None else "Frame Time:"
            raise UserError(
                f"no '{missing}': the file is cut short", path=path, line=line, remedy=text.WHOLE_COPY
            )
        stop = data.find(b"\n", at)
        stop = len(data) if stop < 0 else stop
        content = data[at : min(stop, at + 200)]
        if match := _FRAME_TIME.match(content):
            frame_time = match[1].decode("ascii", "replace")
            if not _is_frame_time(frame_time):
                raise UserError(
                    f"Frame Time {text.shown(frame_time)} is no positive number of seconds",
                    path=path,
                    line=line,
                    remedy="write the seconds per frame, for example 0.0333333",
                )
        elif match := _FRAMES.match(content):
            frames_line = line
            if not match[1].isdigit() or int(match[1]) == 0:
                raise UserError(
                    f"Frames: {text.shown(match[1].decode('ascii', 'replace'))} is no positive count",
                    path=path,
                    line=line,
                    remedy="write the number of rows that follow",
                )
            frames = int(match[1])
        elif content.strip() and not content.lstrip().startswith((b"#", b"//")):
            raise UserError(
                f"expected 'Frames:' and 'Frame Time:', found {text.shown(text.decode(content).strip())}",
                path=path,
                line=line,
                remedy=text.WHOLE_COPY,
            )
        at, line = stop + 1, line + 1
    return frames, frame_time, at, line, frames_line


def _is_frame_time(printed: str) -> bool:
    try:
        return 1e-6 <= float(printed) <= 1e6 and "_" not in printed
    except ValueError:
        return False


def _rows(
    data: bytes, at: int, line: int, columns: int, frames: int, frames_line: int, path: str | os.PathLike[str]
) -> NDArray[np.float64]:
    """The rows of numbers from byte `at`, which is on `line`."""
    values, fault = digits.read_table(np.frombuffer(data, np.uint8)[at:], columns, frames)
    found = len(values)
    if fault is None:
        if found == frames or (found == frames - 1 and found > 0 and data[-1:].isspace()):
            return values
        raise UserError(
            f"'Frames:' says {frames} but {found} rows follow: the file is cut short",
            path=path,
            line=data.count(b"\n", 0, len(data.rstrip())) + 1,
            remedy=f"{text.WHOLE_COPY}, or write {found} on line {frames_line}",
        )
    remedy = text.WHOLE_COPY
    if fault.kind == digits.SHORT:
        what = f"frame {fault.row + 1} has {fault.column} values, expected {columns}"
    elif fault.kind == digits.LONG:
        what = f"frame {fault.row + 1} has more than the {columns} values of the hierarchy's channels"
    elif fault.kind == digits.TOO_MANY:
        what = f"'Frames:' says {frames} but more rows follow"
        remedy = f"write their number on line {frames_line}"
    else:
        where = f"value {fault.column + 1} of frame {fault.row + 1}"
        what = f"{where} is no finite number: {text.shown(fault.token)}"
        remedy = f"{text.WHOLE_COPY}, or cut the frame out"
    raise UserError(what, path=path, line=line + fault.line, remedy=remedy)


def to_clip(document: BvhDocument, *, name: str, unit_to_m: float = 1.0, source: Path | None = None) -> Clip:
    """The clip of a document: lengths times unit_to_m, degrees to unrolled quaternions.

    Joints of the same name are told apart by a number behind the later ones.
    """
    frames, joints = len(document.values), len(document.names)
    positions = np.repeat(document.offsets[None], frames, axis=0)
    columns, axes = np.full((2, joints, 3), -1, np.int64)
    column = 0
    for j, channels in enumerate(document.channels):
        turns = 0
        for channel in channels:
            axis = "XYZ".index(channel[0])
            if channel.endswith("position"):
                positions[:, j, axis] = document.values[:, column]
            else:
                columns[j, turns], axes[j, turns] = column, axis
                turns += 1
            column += 1
    rotations = euler.unrolled(document.values, columns, axes)
    ends = {j: sites[0] for j, sites in enumerate(document.end_sites) if sites}
    skeleton = Skeleton(_distinct(document.names), document.parents, document.offsets, end_sites=ends)
    clip = Clip(name, skeleton, document.fps, positions, rotations, source=source)
    return clip if unit_to_m == 1 else units.to_metres(clip, unit_to_m)


def _distinct(names: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(names)) == len(names):
        return names
    taken, out = set(names), []
    seen: dict[str, int] = {}
    for name in names:
        found = name
        if name in seen:
            number = seen[name] + 1
            while (found := f"{name} {number}") in taken:
                number += 1
            seen[name] = number
            taken.add(found)
        else:
            seen[name] = 1
        out.append(found)
    return tuple(out)


def read(path: str | os.PathLike[str], *, fps: float | None = None, unit_to_m: float = 1.0) -> Clip:
    """Read a BVH file as a clip named after it.

    Lengths are multiplied by unit_to_m; fps, if given, replaces the file's rate.
    """
    clip = to_clip(parse(path), name=Path(path).stem, unit_to_m=unit_to_m, source=Path(path))
    return clip if fps is None else clip.replace(fps=float(fps))


# Writing


def serialise(document: BvhDocument, *, decimals: int | None = None) -> bytes:
    """Text of a document; None decimals prints the fewest digits that read back as the same doubles."""
    children: list[list[int]] = [[] for _ in document.names]
    for j, parent in enumerate(document.parents.tolist()):
        if parent >= 0:
            children[parent].append(j)

    def offset(value: NDArray[np.float64]) -> str:
        return "OFFSET " + digits.write_table(np.asarray(value)[None], decimals).decode()

    lines = ["HIERARCHY\n"]
    stack: list[tuple[int, int, bool]] = [(0, 0, True)]
    while stack:
        j, depth, opening = stack.pop()
        tabs = "\t" * depth
        if not opening:
            lines.append(f"{tabs}}}\n")
            continue
        lines.append(f"{tabs}{'JOINT' if depth else 'ROOT'} {document.names[j]}\n{tabs}{{\n")
        lines.append(f"{tabs}\t{offset(document.offsets[j])}")
        lines.append(
            " ".join([f"{tabs}\tCHANNELS {len(document.channels[j])}", *document.channels[j]]) + "\n"
        )
        for end in document.end_sites[j]:
            lines.append(f"{tabs}\tEnd Site\n{tabs}\t{{\n{tabs}\t\t{offset(end)}{tabs}\t}}\n")
        stack.append((j, depth, False))
        stack.extend((child, depth + 1, True) for child in reversed(children[j]))
    lines.append(f"MOTION\nFrames: {len(document.values)}\nFrame Time: {document.frame_time}\n")
    return "".join(lines).encode() + digits.write_table(document.values, decimals)


def from_clip(
    clip: Clip, *, unit_to_m: float | None = None, order: str = "zxy", decimals: int = 6
) -> BvhDocument:
    """The document of a clip, its lengths divided by unit_to_m (the clip's own unless given).

    The root gets six channels, and so does every joint whose position moves by more than the decimals hide;
    the others get their constant position as OFFSET.
    """
    unit = clip.unit_to_m if unit_to_m is None else unit_to_m
    if sorted(order.lower()) != ["x", "y", "z"]:
        raise UserError(
            f"rotation order {order!r}", remedy="an order names x, y and z once each, as zxy does"
        )
    skeleton = clip.skeleton
    if len(clip) == 0:
        raise UserError(f"clip {clip.name!r} has no frames", remedy="a file holds at least one")
    if not (np.isfinite(clip.positions).all() and np.isfinite(clip.rotations).all()):
        raise UserError(f"clip {clip.name!r} has values that are not finite", remedy="cut those frames out")
    joints = sort_topologically(skeleton.parents.tolist())
    place = np.empty(len(joints), np.int64)
    place[joints] = np.arange(len(joints))
    positions = clip.positions[:, joints] / unit
    angles = np.degrees(quat.to_euler(clip.rotations[:, joints], order.lower()))
    moving = np.ptp(positions, axis=0).max(axis=-1) > 0.5 * 10.0**-decimals
    moving[0] = True
    turns = tuple(f"{axis.upper()}rotation" for axis in order)
    blocks = []
    for j in range(len(joints)):
        blocks += [positions[:, j], angles[:, j]] if moving[j] else [angles[:, j]]
    has_child = np.isin(np.arange(len(joints)), skeleton.parents)
    ends = [
        (skeleton.end_sites[j] / unit,) if j in skeleton.end_sites else () if has_child[j] else (np.zeros(3),)
        for j in joints.tolist()
    ]
    return BvhDocument(
        names=tuple(" ".join(re.sub(r"[{}]", "_", skeleton.names[j]).split()) for j in joints),
        parents=np.array([-1, *place[skeleton.parents[joints[1:]]]], np.int32),
        offsets=np.where(moving[:, None], skeleton.offsets[joints] / unit, positions[0]),
        end_sites=tuple(ends),
        channels=tuple((*CHANNELS[:3], *turns) if moves else turns for moves in moving),
        frame_time=f"{1 / clip.fps:.10f}",
        values=np.concatenate(blocks, axis=1),
    )


def write(
    path: str | os.PathLike[str],
    clip: Clip,
    *,
    unit_to_m: float | None = None,
    order: str = "zxy",
    decimals: int = 6,
) -> None:
    """Write a clip as BVH, whole or not at all; see `from_clip`."""
    content = serialise(
        from_clip(clip, unit_to_m=unit_to_m, order=order, decimals=decimals), decimals=decimals
    )
    with files.atomic(path) as stream:
        stream.write(content)
