"""A BVH file as a document: the hierarchy, then the rows of numbers behind MOTION."""

from __future__ import annotations

import os
import re

import numpy as np
from numpy.typing import NDArray

from .. import digits, text
from ..errors import UserError
from .document import SCALES, BvhDocument
from .hierarchy import Joint, read_hierarchy

_MOTION = re.compile(rb"(?:^|(?<=\}))[ \t]*MOTION\b", re.IGNORECASE | re.MULTILINE)
_FRAMES = re.compile(rb"frames\s*:?\s*(\S+)$", re.IGNORECASE)
_FRAME_TIME = re.compile(rb"frame\s*time\s*:?\s*(\S+)$", re.IGNORECASE)


def parse(path: str | os.PathLike[str]) -> BvhDocument:
    """Read a BVH file exactly.

    Keywords and channels may be in any case and order, separated by any white space; blank lines and lines
    that begin with ``#`` or ``//`` are skipped. A file may hold one row fewer than ``Frames:`` says, as some
    exporters count one too many. Scale channels may stand among the others as long as they say 1. Anything
    else amiss is a UserError with its line.
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
    joints = read_hierarchy(text.decode(data[: start.start()]), path)
    columns = sum(len(joint.channels or ()) for joint in joints)
    if columns == 0:
        raise UserError("no joint has channels", path=path, remedy=text.WHOLE_COPY)
    frames, frame_time, at, line, frames_line = _motion_head(data, start.end(), path)
    values = _rows(data, at, line, columns, frames, frames_line, path)
    _check_scales(joints, values, path)
    return BvhDocument(
        names=tuple(joint.name for joint in joints),
        parents=np.array([joint.parent for joint in joints], np.int32),
        offsets=np.array([joint.offset for joint in joints], np.float64),
        end_sites=tuple(tuple(np.array(end) for end in joint.ends) for joint in joints),
        channels=tuple(joint.channels or () for joint in joints),
        frame_time=frame_time,
        values=values,
    )


def _check_scales(joints: list[Joint], values: NDArray[np.float64], path: str | os.PathLike[str]) -> None:
    column = 0
    for joint in joints:
        for channel in joint.channels or ():
            if channel in SCALES and np.abs(values[:, column] - 1).max() > 1e-3:
                raise UserError(
                    f"joint {text.shown(joint.name)} is scaled by its channel {channel}",
                    path=path,
                    line=joint.line,
                    remedy="export it with positions in place of scales",
                )
            column += 1


def _motion_head(data: bytes, at: int, path: str | os.PathLike[str]) -> tuple[int, str, int, int, int]:
    """Frames and frame time from byte `at` on; byte and line of the rows; the line of ``Frames:``."""
    line = data.count(b"\n", 0, at) + 1
    frames = frame_time = None
    frames_line = line
    while frames is None or frame_time is None:
        if at >= len(data):
            missing = "Frames:" if frames is None else "Frame Time:"
            raise UserError(
                f"no '{missing}': the file is cut short", path=path, line=line, remedy=text.WHOLE_COPY
            )
        stop = data.find(b"\n", at)
        stop = len(data) if stop < 0 else stop
        content = data[at:stop].strip()
        if len(content) > 200:
            content = content[:200] + b" ..."  # neither of the two
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
        elif content and not content.startswith((b"#", b"//")):
            raise UserError(
                f"expected 'Frames:' and 'Frame Time:', found {text.shown(text.decode(content))}",
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
        if "," in fault.token:
            remedy = "write numbers with a decimal point and blanks between them"
    raise UserError(what, path=path, line=line + fault.line, remedy=remedy)
