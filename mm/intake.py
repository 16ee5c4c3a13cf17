"""What of files goes into a database: read, checked, cut into what is good; and what is left out and why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from motion import facts, leadin, resample
from motion.check import Finding, check, good_spans
from motion.clip import Clip
from motion.errors import UserError
from motion.facts import Facts

from .work import Work

MINIMUM_FRAMES = 3  # a velocity by central differences needs three
SHORTEST = 0.5  # seconds; what is good between two cuts and shorter leads nowhere that a search could go
SKIP = "repair or remove it, or leave such clips out with --skip-bad"


@dataclass(frozen=True)
class Loss:
    """Frames of a file that are left out.

    Attributes
    ----------
    path : the file.
    kind : of the finding (`motion.check.KINDS`), or ``unreadable``, ``skeleton``, ``short``.
    start, stop, frames : which frames, as read, of how many; all 0 for a file that was not read.
    seconds : how long they last.
    what : the reason, a line for a person; remedy : what can be done about it, if anything.
    """

    path: Path
    kind: str
    start: int
    stop: int
    frames: int
    seconds: float
    what: str
    remedy: str | None = None

    def __str__(self) -> str:
        if self.frames == 0:
            return f"left out: {self.what}"
        few = f"frame {self.start}" if self.stop == self.start + 1 else f"frames {self.start}-{self.stop - 1}"
        which = f"all {self.frames} frames" if self.whole else f"{few} of {self.frames}"
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"left out: {self.path}: {which} ({self.seconds:.2f} s): {self.kind}: {self.what}{remedy}"

    @property
    def whole(self) -> bool:
        """Whether it is all of the file."""
        return self.stop - self.start == self.frames


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of a file that is used.

    Attributes
    ----------
    clip : it, as a clip of its own.
    start, stop, frames : which frames of the file, of how many.
    posed : the whole clip, where it begins with a rest pose that was cut off: that tells how the body stands.
    """

    clip: Clip
    start: int
    stop: int
    frames: int
    posed: Clip | None = None

    @property
    def path(self) -> Path:
        """The file."""
        return _path(self.clip)


@dataclass
class Report:
    """What became of every file.

    Attributes
    ----------
    findings : path to what the check found, fatal or not, for clips with findings.
    losses : what is left out.
    gone : the files of which nothing is used.
    files, seconds : how many were read, and how long they last.
    """

    findings: dict[Path, list[Finding]] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)
    gone: set[Path] = field(default_factory=set)
    files: int = 0
    seconds: float = 0.0

    def leave_out(self, pieces: Sequence[Piece], kind: str, what: str) -> None:
        """Files of which nothing is used after all."""
        for piece in pieces:
            self.losses.append(_loss(piece.clip, kind, piece.start, piece.stop, piece.frames, what))
            self.gone.add(piece.path)

    def summary(self) -> dict[str, Any]:
        """Counts: files read, those left out whole and in part, and for how long."""
        touched = {loss.path for loss in self.losses}
        return {
            "files": self.files,
            "files_left_out": len(self.gone),
            "files_cut": len(touched - self.gone),
            "seconds": round(self.seconds, 3),
            "seconds_left_out": round(sum(map(self._seconds, touched)), 3),
        }

    def to_json(self) -> dict[str, Any]:
        """The summary, what is left out, and every finding, those that are but remarks too."""
        return {
            "read": self.summary(),
            "left_out": [asdict(loss) for loss in self.losses],
            "findings": [
                {"path": path, **asdict(finding)}
                for path, found in self.findings.items()
                for finding in found
            ],
        }

    def _seconds(self, path: Path) -> float:
        """Seconds of a file that are left out; frames left out for two reasons count once."""
        losses = [loss for loss in self.losses if loss.path == path]
        gone = np.zeros(max(loss.frames for loss in losses), bool)
        for loss in losses:
            gone[loss.start : loss.stop] = True
        frames = sum(loss.stop - loss.start for loss in losses)
        return float(gone.sum()) * sum(loss.seconds for loss in losses) / max(frames, 1)


@dataclass(frozen=True)
class _Taken:
    clip: Clip
    pieces: list[Piece]
    findings: list[Finding]
    losses: list[Loss]


def take(
    paths: Sequence[Path],
    book: facts.Book,
    *,
    fps: float,
    checked: bool,
    skip_bad: bool,
    work: Work,
    report: Report,
) -> list[Piece]:
    """What is used of files, in their order; the rest is noted, and goes into the report.

    Parameters
    ----------
    book : what is known of the files.
    fps : the database's rate; a clip must have three frames at it.
    checked : whether `motion.check` may leave frames out. Rest poses before a capture always are.
    skip_bad : whether files that cannot be read or used are left out, too, instead of ending in a UserError.

    Where nothing remains, a UserError says why the first file is left out.
    """

    def read(path: Path) -> _Taken:
        return _take(path, book.of(path), fps, checked)

    pieces: list[Piece] = []
    unusable: list[UserError] = []
    for taken in work.map(read, paths, label="read", keep=unusable.append if skip_bad else None):
        path = _path(taken.clip)
        report.files += 1
        report.seconds += taken.clip.seconds
        if taken.findings:
            report.findings[path] = taken.findings
        report.losses += taken.losses
        if not taken.pieces:
            report.gone.add(path)
        pieces += taken.pieces
    for error in unusable:
        report.losses.append(Loss(Path(error.path or ""), "unreadable", 0, 0, 0, 0.0, str(error)))
        report.files += 1
        report.gone.add(report.losses[-1].path)
    posed = {loss.path for loss in report.losses if _leads_in(loss)}
    for loss in report.losses:
        if not _leads_in(loss):
            work.note(str(loss))
    if not pieces:
        first = str(report.losses[0]).removeprefix("left out: ")
        raise UserError(f"no clip of {len(paths)} can be used; the first: {first}")
    if posed:
        what = f"{len(posed)} of {len(paths)} clips begin with a rest pose that is no capture"
        work.note(f"{what}; its frames were dropped")
    return pieces


def _leads_in(loss: Loss) -> bool:
    """Whether it is a rest pose before the capture, which many files of a set have: told in one line."""
    return loss.kind == "rest pose" and loss.start == 0 and not loss.whole


def _take(path: Path, known: Facts, fps: float, checked: bool) -> _Taken:
    clip = facts.read(path, known)
    _require_length(clip, fps)
    begin, end = known.start or 0, len(clip) if known.stop is None else known.stop
    findings = check(clip) if checked and known.check is not False else _lead_in(clip)
    fatal = [f for f in findings if f.fatal and f.start < end and f.stop > begin]
    if known.keep_lead_in:
        fatal = [f for f in fatal if not (f.kind == "rest pose" and f.start == 0)]
    spans = [(max(a, begin), min(b, end)) for a, b in good_spans(len(clip), fatal) if a < end and b > begin]
    # Where all of a clip is bad, what is worse in parts of it does not matter.
    told = [f for f in fatal if f.start == 0 and f.stop == len(clip)] or fatal
    losses = [_loss(clip, f.kind, f.start, f.stop, len(clip), f.what) for f in told]
    least = math.ceil(max(SHORTEST, MINIMUM_FRAMES / fps) * clip.fps) + 1
    good = []
    for start, stop in spans:
        if stop - start >= least or not fatal:
            good.append((start, stop))
        else:
            what = f"only {(stop - start) / clip.fps:.2f} s beside what is left out"
            losses.append(_loss(clip, "short", start, stop, len(clip), what))
    posed = next((clip for f in fatal if f.kind == "rest pose" and f.start == 0), None)
    pieces = []
    for start, stop in good:
        piece = resample.crop(clip, start, stop)
        _require_length(piece, fps)
        _require_finite(piece, start)
        pieces.append(Piece(piece, start, stop, len(clip), posed))
    return _Taken(clip, pieces, findings, sorted(losses, key=lambda loss: loss.start))


def _path(clip: Clip) -> Path:
    return clip.source or Path(clip.name)


def _lead_in(clip: Clip) -> list[Finding]:
    count = leadin.lead_in(clip)
    return [Finding("rest pose", 0, count, "a rest pose before the capture", fatal=True)] if count else []


def _loss(clip: Clip, kind: str, start: int, stop: int, frames: int, what: str) -> Loss:
    remedy = None
    if kind == "rate":
        remedy = f"give the right one: --source-fps, or fps in {facts.NAME} (check = false keeps this one)"
    elif kind == "ground" and stop - start == frames:
        remedy = f"if unit or axes are other ones: --source-unit, --source-up, or unit, up in {facts.NAME}"
    return Loss(_path(clip), kind, start, stop, frames, (stop - start) / clip.fps, what, remedy)


def _require_length(clip: Clip, fps: float) -> None:
    """A clip too short, or too long at the database's rate, is a UserError that names its file."""
    after = int(np.floor((len(clip) - 1) / clip.fps * fps + 1e-6)) + 1
    if min(len(clip), after) < MINIMUM_FRAMES:
        count = "1 frame" if len(clip) == 1 else f"{len(clip)} frames"
        what = f"a clip of {count} at {clip.fps:g} fps, at least {MINIMUM_FRAMES} at {fps:g} fps are needed"
        raise UserError(what, path=clip.source, remedy=SKIP)
    if after > resample.MOST_FRAMES:
        what = f"{len(clip)} frames at {clip.fps:g} fps are {after:,} at {fps:g} fps"
        remedy = f"at most {resample.MOST_FRAMES:,} fit; is the file's rate right (--source-fps)?"
        raise UserError(what, path=clip.source, remedy=remedy)


def _require_finite(clip: Clip, before: int) -> None:
    """Values that are no numbers are a UserError that names file, frame and joint."""
    for what, values in (("positions", clip.positions), ("rotations", clip.rotations)):
        if not np.isfinite(np.sum(values)):
            frame, joint = np.argwhere(~np.isfinite(values).all(axis=-1))[0]
            where = f"at frame {before + frame}, joint {clip.skeleton.names[joint]}"
            raise UserError(f"{what} are not finite {where}", path=clip.source, remedy=SKIP)
