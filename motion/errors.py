"""The one exception family for faults of the user's making."""

from __future__ import annotations

import os


class UserError(Exception):
    """A fault in what the user gave: says what, where and what to do.

    Commands print it as one line, ``error: PATH:LINE: what; remedy``, and exit with 2.

    Parameters
    ----------
    what : what is wrong, without a full stop.
    path : the file it is about.
    line : 1-based line number in that file.
    remedy : what the user can do about it.
    """

    def __init__(
        self,
        what: str,
        *,
        path: str | os.PathLike[str] | None = None,
        line: int | None = None,
        remedy: str | None = None,
    ) -> None:
        super().__init__(what)
        self.what = what
        self.path = None if path is None else os.fspath(path)
        self.line = line
        self.remedy = remedy

    def __str__(self) -> str:
        where = "" if self.path is None else f"{self.path}: "
        if self.path is not None and self.line is not None:
            where = f"{self.path}:{self.line}: "
        return where + self.what + (f"; {self.remedy}" if self.remedy else "")


class NotFinite(UserError):
    """A command or a query that is no number: the character that it is of is lost."""


class Note(UserWarning):
    """A remark about what the user gave, which commands print as ``note: ...``, each once."""
