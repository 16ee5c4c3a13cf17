"""Courses by name, and from files of any kind."""

from __future__ import annotations

import os
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from motion import config, files
from motion.errors import UserError

from .. import recorded
from ..course import Course


def names() -> list[str]:
    """The ready-made courses."""
    return sorted(Path(entry.name).stem for entry in _folder().iterdir() if entry.name.endswith(".toml"))


def load(name_or_path: str | os.PathLike[str]) -> Course:
    """A ready-made course by name, one from a TOML file, or one that a user took before (`mm.recorded`).

    An unknown name is a UserError that lists the names; so is a fault in the file, with file and line.
    """
    text = os.fspath(name_or_path)
    if text in names():
        with resources.as_file(_folder() / f"{text}.toml") as path:
            return _named(config.load(Course, path), text)
    suffix = Path(text).suffix.lower()
    if suffix in recorded.FORMATS:
        return _named(recorded.read(text), Path(text).stem)
    if suffix != ".toml" and files.kind(text) is None:
        raise UserError(f"no course {text!r}", remedy=f"give a TOML file or choose from {', '.join(names())}")
    return _named(config.load(Course, text), Path(text).stem)


def _folder() -> Any:
    return resources.files(__package__)


def _named(course: Course, name: str) -> Course:
    return course if course.name else replace(course, name=name)
