"""Labels as text that people can correct: CSV with a line a frame.

    frame,left_heel,left_toe,right_heel,right_toe,phase,gait
    0,1,1,1,1,0.02094,stand
    1,1,1,0,1,0.06283,stand 0.8 walk 0.2

A gait is a name, or names with their weights. Without the column phase there is none. Files that the
generator of the built-in data writes read so, too.
"""

from __future__ import annotations

import math
import os

import numpy as np

from motion import files
from motion.config import shown
from motion.errors import UserError

from .labels import GAITS, PARTS, Labels, wrapped

_HEADER = "write frame, pairs of contacts such as left_heel,right_heel, then phase (or none) and gait"
_GAIT = f"write one of {', '.join(GAITS)}, or weights such as walk 0.7 jog 0.3"
ROUNDING = 1e-4  # radians by which printed phases may exceed 2 pi
SUM = 0.05  # by which weights of gaits may miss 1


def write(path: str | os.PathLike[str], labels: Labels) -> None:
    """Write labels as CSV, whole or not at all."""
    has_phase = labels.phase is not None
    lines = [",".join(("frame", *labels.names, *["phase"] * has_phase, "gait"))]
    phase = labels.phase.tolist() if labels.phase is not None else []
    for frame, (contacts, weights) in enumerate(
        zip(labels.contacts.tolist(), labels.gait.tolist(), strict=True)
    ):
        cells = [str(frame), *map(str, contacts)]
        if has_phase:
            cells.append(f"{phase[frame]:.5f}")
        lines.append(",".join([*cells, _gait_text(weights)]))
    with files.atomic(path) as stream:
        stream.write(("\n".join(lines) + "\n").encode())


def read(path: str | os.PathLike[str], *, frames: int | None = None) -> Labels:
    """Read labels; frames is how many the clip has.

    Other columns, cells that are no numbers or no gait, a phase out of range and another number of frames
    are a UserError each, which names the line. Empty lines at the end, as spreadsheets write them, are none.
    """
    lines = files.read_text(path, remedy="write CSV with a line a frame").splitlines()
    while lines and not lines[-1].strip(" ,"):
        lines.pop()
    rows = [[cell.strip() for cell in line.split(",")] for line in lines]
    try:
        names, has_phase = _columns([cell.lower() for cell in rows[0]] if rows else [""])
    except ValueError as error:
        raise UserError(str(error), path=path, line=1, remedy=_HEADER) from error
    table = []
    for number, cells in enumerate(rows[1:]):
        try:
            if len(cells) != len(rows[0]):
                raise ValueError(f"{len(cells)} columns, the header has {len(rows[0])}")
            table.append(_values(cells, number, len(names), has_phase))
        except ValueError as error:
            raise UserError(str(error), path=path, line=number + 2, remedy=_remedy(error)) from error
    if not table or (frames is not None and len(table) != frames):
        what = f"labels of {len(table)} frames" + ("" if frames is None else f", but the clip has {frames}")
        raise UserError(what, path=path, remedy="write a line for each frame of the clip, at the clip's rate")
    contacts, phase, gait = (np.array(column) for column in zip(*table, strict=True))
    return Labels(
        names,
        contacts.astype(np.uint8).reshape(len(table), len(names)),
        wrapped(phase) if has_phase else None,
        gait.astype(np.float32),
    )


class _NoGait(ValueError):
    """What stands under gait is none."""


def _remedy(error: ValueError) -> str:
    return _GAIT if isinstance(error, _NoGait) else "correct the line, or write the labels anew"


def _columns(header: list[str]) -> tuple[tuple[str, ...], bool]:
    """The names of the contacts, and whether there is a phase; a ValueError says what is wrong."""
    if any(";" in cell for cell in header):
        raise ValueError("columns apart by semicolons, expected commas")
    has_phase = header[-2:-1] == ["phase"]
    names = tuple(header[1 : -2 if has_phase else -1])
    known = set(names) <= set(PARTS) and len(names) > 0
    if header[0] != "frame" or header[-1] != "gait" or not known:
        raise ValueError(f"header {shown(','.join(header))}")
    Labels(names, np.zeros((0, len(names)), np.uint8), None, np.zeros((0, len(GAITS)), np.float32))
    return names, has_phase


def _values(
    cells: list[str], number: int, count: int, has_phase: bool
) -> tuple[list[float], float, list[float]]:
    """Contacts, phase (0 for none) and weights of the gaits of a line; a ValueError says what is wrong."""
    if _number(cells[0], "frame") != number:
        raise ValueError(f"frame {shown(cells[0])}, expected {number}: lines are in order, none left out")
    contacts = [_number(cell, "contact") for cell in cells[1 : count + 1]]
    if not set(contacts) <= {0, 1}:
        raise ValueError(f"contacts {shown(','.join(cells[1 : count + 1]))}, expected 0 or 1 each")
    phase = _number(cells[-2], "phase") if has_phase else 0.0
    if not 0 <= phase <= 2 * np.pi + ROUNDING:
        raise ValueError(f"phase {phase:g}, expected radians from 0 to 6.28319")
    return contacts, min(phase, 2 * np.pi), _weights(cells[-1])


def _number(cell: str, what: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{what} {shown(cell)} is not a number")
    return value


def _weights(cell: str) -> list[float]:
    """Weights of `GAITS` of a text such as "walk", or "walk 0.7 jog 0.3"."""
    words = cell.lower().split()
    pairs = [(words[0], "1")] if len(words) == 1 else list(zip(words[::2], words[1::2], strict=False))
    names = [name for name, _ in pairs]
    odd = len(words) > 1 and len(words) % 2
    if not pairs or odd or not set(names) <= set(GAITS) or len(set(names)) < len(names):
        raise _NoGait(f"gait {shown(cell)}")
    found = dict.fromkeys(GAITS, 0.0) | {name: _number(value, "weight") for name, value in pairs}
    total = sum(found.values())
    if min(found.values()) < 0 or abs(total - 1) > SUM:
        raise _NoGait(f"gait {shown(cell)}: weights from 0 to 1 that sum to 1 are needed")
    return [value / total for value in found.values()]


def _gait_text(weights: list[float]) -> str:
    """A text that `_weights` reads."""
    named = [(name, round(weight, 3)) for name, weight in zip(GAITS, weights, strict=True)]
    kept = [(name, weight) for name, weight in named if weight > 0]
    return kept[0][0] if len(kept) == 1 else " ".join(f"{name} {weight:g}" for name, weight in kept)
