"""Labels corrected by hand, in place of those that would be found: a folder of files, by names of clips."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from features import label_files
from features.gait import OTHER
from features.label_cli import SUFFIX
from features.labels import Labels
from mm.database import Database
from motion import files, resample
from motion.errors import UserError

# Frames a second that clips are captured at; a file of labels says nothing of its own.
RATES = (24, 25, 30, 48, 50, 60, 72, 75, 90, 100, 120, 144, 150, 180, 200, 240, 250, 300, 360, 480, 500, 1000)
NTSC = 1.001  # by which rates of television are lower
_PIECE = re.compile(r"(?P<file>.+)@(?P<start>\d+)-(?P<stop>\d+)")  # of a file, see `mm.build.build`
_REMEDY = "write a line for each frame of the clip, at the clip's rate or the database's"


def read(folder: str | os.PathLike[str], database: Database) -> Mapping[str, Labels]:
    """Labels of clips of a database at its rate, by name, of the NAME.labels.csv in a folder and below.

    They are as `features label` writes them: of the clip's file, at its rate, from which clips that were cut
    out of it take their frames; or of a clip as the database has it. Rest poses before a capture, which
    databases leave out, may stand at the beginning, of the gait "other". Faults are UserErrors: a folder
    without such files, one for no clip, two for one, a file of another length or of other parts of the body.
    """
    if files.kind(folder) != "folder":
        raise UserError("not a folder", path=folder, remedy=f"name one that holds NAME{SUFFIX}")
    names = list(dict.fromkeys(database.names))
    paths: dict[str, Path] = {}
    for path in sorted(Path(folder).rglob(f"*{SUFFIX}")):
        for name in _clips(path, Path(folder), names):
            if name in paths:
                raise UserError(f"the clip {name} has labels in {paths[name]}, too", path=path)
            paths[name] = path
    if not paths:
        raise UserError(f"no labels (NAME{SUFFIX}) of any clip", path=folder)
    return {name: _of_clip(path, name, database) for name, path in paths.items()}


def _clips(path: Path, folder: Path, names: Sequence[str]) -> list[str]:
    """The clips that a file is for, at least one; of the same names, folders tell them apart."""
    stem = path.relative_to(folder).as_posix().removesuffix(SUFFIX)
    found = [name for name in names if _ends_in(stem, name)]
    found = found or [name for name in names if (m := _PIECE.fullmatch(name)) and _ends_in(stem, m["file"])]
    if not found:
        few = ", ".join(names[:3]) + ", .." * (len(names) > 3)
        raise UserError("labels for no clip of the database", path=path, remedy=f"its clips are {few}")
    return found


def _ends_in(stem: str, name: str) -> bool:
    return f"/{stem}".endswith(f"/{name}")


def _of_clip(path: Path, name: str, database: Database) -> Labels:
    labels, r = label_files.read(path), database.names.index(name)
    frames = int(database.stops[r] - database.starts[r])
    piece = _PIECE.fullmatch(name)
    whole = piece is None or path.name == Path(name).name + SUFFIX
    if piece is not None and not whole:
        start, stop = int(piece["start"]), int(piece["stop"])
        if len(labels) < stop:
            raise UserError(f"labels of {len(labels)} frames, but {name} is cut from more", path=path)
        labels = labels[slice(start, stop)]
    fitted = next(_fitted(labels, frames, database.fps), None)
    if fitted is None:
        what = f"labels of {len(labels)} frames, but {name} has {frames} at {database.fps:g} a second"
        raise UserError(what, path=path, remedy=_REMEDY)
    try:
        fitted.of_parts(database.contact_roles)
    except UserError as error:
        raise UserError(error.what, path=path, remedy="name what touches the ground") from error
    return fitted


def _fitted(labels: Labels, frames: int, fps: float) -> Iterator[Labels]:
    """Labels of so many frames a second, of those that some rate and no or some rest poses before make so."""
    still = (labels.gait[:, OTHER] == 1) & (labels.contacts == labels.contacts[:1]).all(axis=1)
    for rest in range(int(np.argmin(np.append(still, False))) + 1):
        for rate in (fps, *RATES, *(rate / NTSC for rate in RATES)):
            step = resample.frame_step(rate, fps)
            if resample.frames_after(len(labels) - rest, step) == frames:
                own = labels[slice(rest, len(labels))]
                yield own if step == 1 else own.at(resample.sample_times(len(own), step))
