"""Tags: names given to frames by a file, as bits that a search can ask for or avoid."""

from __future__ import annotations

import csv
import fnmatch
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motion import config, files
from motion.errors import Note, UserError

LIMIT = 32  # bits of a mask
_EXAMPLE = "a line such as run,run*,, or turn,walk_07,120,240 under the header tag,clips,start,stop"


@dataclass(frozen=True)
class Rule:
    """Gives a tag to the clips whose name matches a shell pattern, or to some of their frames.

    Attributes
    ----------
    tag : the tag's name.
    clips : pattern of clip names, such as ``run*``; ``*`` and ``?`` stand for any letters.
    start, stop : first frame and one past the last, in the clip's frames as read; stop None: its end.
    """

    tag: str
    clips: str
    start: int = 0
    stop: int | None = None

    def __post_init__(self) -> None:
        config.validate(self)
        if not self.tag:
            raise config.ConfigError("tag", "a tag needs a name")
        if self.start < 0 or (self.stop is not None and self.stop <= self.start):
            raise config.ConfigError("stop", f"frames {self.start} to {self.stop} are none")


@dataclass(frozen=True)
class _File:
    tags: tuple[Rule, ...]


def load(path: str | os.PathLike[str]) -> tuple[Rule, ...]:
    """Rules of a file: CSV with the header ``tag,clips,start,stop``, or TOML with tables ``[[tags]]``.

    A missing or malformed file or an unknown key is a UserError. One without rules, such as the built-in data
    has where nobody crouches, gives none, and a note.
    """
    rules = _load_csv(Path(path)) if str(path).lower().endswith(".csv") else config.load(_File, path).tags
    if not rules:
        warnings.warn(f"{os.fspath(path)}: no tags in this file", Note, stacklevel=2)
    return rules


def names(rules: Sequence[Rule]) -> tuple[str, ...]:
    """The tags in the order of their first rule."""
    return tuple(dict.fromkeys(rule.tag for rule in rules))


def _load_csv(path: Path) -> tuple[Rule, ...]:
    text = files.read_text(path, remedy=f"write {_EXAMPLE}")
    reader = csv.DictReader(text.split("\n"), skipinitialspace=True, strict=True)
    try:
        return _rules(reader, path)
    except csv.Error as error:
        what = f"not CSV: {error}"
        raise UserError(
            what, path=path, line=reader.reader.line_num or None, remedy=f"write {_EXAMPLE}"
        ) from error


def _rules(reader: csv.DictReader, path: Path) -> tuple[Rule, ...]:
    header = [key.strip() for key in reader.fieldnames or ()]
    known = {"tag", "clips"} <= set(header) <= {"tag", "clips", "start", "stop"}
    if not known or len(set(header)) < len(header):
        raise UserError(
            f"header {config.shown(','.join(header))}", path=path, line=1, remedy=f"write {_EXAMPLE}"
        )
    reader.fieldnames = header
    rules = []
    for row in reader:
        try:
            if None in row:
                raise ValueError(f"more than {len(header)} columns")
            start, stop = (row.get("start") or "").strip(), (row.get("stop") or "").strip()
            rules.append(
                Rule(
                    row["tag"].strip(),
                    (row["clips"] or "").strip(),
                    int(start) if start else 0,
                    int(stop) if stop else None,
                )
            )
        except (ValueError, config.ConfigError, AttributeError) as error:
            what = f"not a tag: {error}"
            raise UserError(what, path=path, line=reader.line_num, remedy=f"write {_EXAMPLE}") from error
    return tuple(rules)


def check(
    rules: Sequence[Rule], clips: Sequence[tuple[str, str]], path: str | os.PathLike[str] | None = None
) -> None:
    """More than 32 tags, or a rule that matches no clip (it would silently tag nothing), is a UserError.

    clips are names by which rules may call each: its own and its file's, see `mark`.
    """
    if len(names(rules)) > LIMIT:
        what = f"{len(names(rules))} different tags, at most {LIMIT} fit"
        raise UserError(what, path=path, remedy="name fewer tags")
    for rule in rules:
        if not any(_matches(rule, clip) for clip in clips):
            some = ", ".join(file for _, file in clips[:5]) + ", ..." * (len(clips) > 5)
            what = f"tag {rule.tag!r}: no clip is named like {rule.clips!r}"
            raise UserError(what, path=path, remedy=f"the clips are {some}")


@dataclass(frozen=True)
class Cut:
    """What of a file became a clip: its frames per second, frames [start, stop), and how many it has."""

    fps: float
    start: int
    stop: int
    frames: int


def mark(
    rules: Sequence[Rule], clip: tuple[str, str], cut: Cut, frames: int, fps: float
) -> NDArray[np.uint32]:
    """Tag bits [frames] of a clip that is at fps now; cut says what it was as read.

    clip are its own name and its file's, which differ where a file was cut into several. A rule's frames
    beyond the end of the file are a UserError.
    """
    order = names(rules)
    bits = np.zeros(frames, np.uint32)
    for rule in rules:
        if not _matches(rule, clip):
            continue
        stop = cut.frames if rule.stop is None else rule.stop
        if max(rule.start + 1, stop) > cut.frames:
            what = (
                f"tag {rule.tag!r}: frames {rule.start} to {stop} of clip {clip[1]!r}, which has {cut.frames}"
            )
            raise UserError(what, remedy="correct the tags file")
        first, last = (max(0, round((at - cut.start) * fps / cut.fps)) for at in (rule.start, stop))
        bits[first : frames if stop >= cut.stop else last] |= np.uint32(1 << order.index(rule.tag))
    return bits


def _matches(rule: Rule, clip: tuple[str, str]) -> bool:
    return any(fnmatch.fnmatchcase(name, rule.clips) for name in clip)
