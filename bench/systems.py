"""Which systems are compared: a registry by name, filled by whoever has a system to compare."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from numpy.typing import ArrayLike

from mm.control import System
from mm.database import Database
from motion.errors import UserError


class Factory(Protocol):
    """Builds a system of count characters that keep off obstacles [M, 5] (see `mm.controller`)."""

    def __call__(self, database: Database, count: int, *, obstacles: ArrayLike = ()) -> System: ...


@dataclass(frozen=True)
class Entry:
    """A named way to make a system of N characters from a database; family: the name up to the first dash."""

    name: str
    make: Factory
    about: str = ""

    @property
    def family(self) -> str:
        return self.name.split("-", 1)[0]


_REGISTERED: dict[str, Entry] = {}


def register(name: str, make: Factory, about: str = "") -> None:
    """Add a system, or replace the one of that name."""
    _REGISTERED[name] = Entry(name, make, about)


def motion_matching(indexes: Iterable[str] | None = None) -> list[Entry]:
    """Motion matching with each search index (all of them when None), with foot locking and without."""
    from mm import search

    known = search.names()
    chosen = list(known if indexes is None else indexes)
    for index in chosen:
        if index not in known:
            raise UserError(f"no search index {index!r}", remedy=f"choose from {', '.join(known)}")
    shared: dict[tuple[int, str], Any] = {}
    return [
        Entry(
            f"mm-{index}{'' if locked else '-free'}",
            partial(_controller, index, locked, shared),
            f"motion matching, index {index}, feet {'locked' if locked else 'as they come'}",
        )
        for index in chosen
        for locked in (True, False)
    ]


def _controller(
    index: str,
    locked: bool,
    shared: dict[tuple[int, str], Any],
    database: Database,
    count: int,
    *,
    obstacles: ArrayLike = (),
) -> System:
    from mm.controller import Controller, build_index
    from mm.settings import Settings

    name, settings = f"mm-{index}{'' if locked else '-free'}", Settings(foot_lock=locked)
    key = (id(database), index)
    if key not in shared:
        # The last one only: it serves the pair with and without locking, all of them would fill the memory.
        shared.clear()
        shared[key] = build_index(database, index, settings)
    return Controller(
        database, count=count, settings=settings, index=shared[key], obstacles=obstacles, name=name
    )


def entries(indexes: Iterable[str] | None = None) -> list[Entry]:
    """All systems there are; indexes limits those of motion matching."""
    return [*motion_matching(indexes), *_REGISTERED.values()]


def choose(patterns: Sequence[str] | None = None, *, indexes: Iterable[str] | None = None) -> list[Entry]:
    """Systems by name, by family ("mm") or by pattern ("mm-*-free"), in the registry's order; all when None.

    A pattern that fits nothing is a UserError that lists the choices.
    """
    known = entries(indexes)
    if patterns is None:
        return known
    chosen = []
    for pattern in patterns:
        fitting = [e for e in known if e.family == pattern or fnmatch.fnmatchcase(e.name, pattern)]
        if not fitting:
            names = ", ".join(e.name for e in known)
            raise UserError(f"no system {pattern!r}", remedy=f"choose from {names}")
        chosen += fitting
    return [e for e in known if e in chosen]
