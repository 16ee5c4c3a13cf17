"""Which systems are compared: a registry by name, filled by whoever has a system to compare."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from mm.control import System
from mm.database import Database
from mm.feet import joints_of_legs
from motion.errors import UserError

from .entry import Entry, Factory, called
from .learned import learned
from .small import compressed

if TYPE_CHECKING:
    from lmm.models import AnyModel

_REGISTERED: dict[str, Entry] = {}


def register(name: str, make: Factory, about: str = "") -> None:
    """Add a system, or replace the one of that name."""
    _REGISTERED[name] = Entry(name, make, about)


def without_legs(database: Database) -> UserError | None:
    """Why feet cannot be held on a database; None where they can."""
    try:
        joints_of_legs(database.skeleton, database.contact_roles)
    except UserError as error:
        return error
    return None


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
            called(f"mm-{index}", locked),
            partial(_controller, index, locked, shared),
            f"motion matching, index {index}, feet {'locked' if locked else 'as they come'}",
            locked,
            made_of="",
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

    name, settings = called(f"mm-{index}", locked), Settings(foot_lock=locked)
    key = (id(database), index)
    if key not in shared:
        # The last one only: it serves the pair with and without locking, all of them would fill the memory.
        shared.clear()
        shared[key] = build_index(database, index, settings)
    return Controller(
        database, count=count, settings=settings, index=shared[key], obstacles=obstacles, name=name
    )


def load_models(paths: Sequence[str]) -> dict[str, AnyModel]:
    """Models by the name that their systems begin with: lmm, pfnn or mann, or lmm-FILE of several such."""
    from lmm.models import kind_of, load

    kinds = [kind_of(path) for path in paths]
    models: dict[str, AnyModel] = {}
    for path, kind in zip(paths, kinds, strict=True):
        name = kind if kinds.count(kind) == 1 else f"{kind}-{Path(path).stem}"
        if name in models:
            raise UserError(f"two models are called {Path(path).stem!r}", path=path, remedy="rename one file")
        models[name] = load(path)
    return models


def entries(
    indexes: Iterable[str] | None = None,
    models: Mapping[str, AnyModel] | None = None,
    codecs: Sequence[str] = (),
) -> list[Entry]:
    """All systems there are; indexes limits those of motion matching, codecs are some besides `CODECS`."""
    small = compressed(codecs)
    small += [entry for entry in compressed() if entry.name not in {one.name for one in small}]
    return [*motion_matching(indexes), *small, *learned(models or {}), *_REGISTERED.values()]


def choose(
    patterns: Sequence[str] | None = None,
    *,
    indexes: Iterable[str] | None = None,
    models: Mapping[str, AnyModel] | None = None,
    codecs: Sequence[str] = (),
    legs: bool = True,
) -> list[Entry]:
    """Systems by name, by family ("mm") or by pattern ("mm-*-free"), in the registry's order; all when None.

    models are those that systems are made of, by name (see `learned`), codecs those of databases (see
    `compressed`). Where legs are not whole families and patterns leave out who needs them. A pattern is of
    systems that have to be asked for where it fits no others. One that fits nothing is a UserError that lists
    the choices.
    """
    known = entries(indexes, models, codecs)
    usual = [e for e in known if not e.asked and not (e.spare if legs else e.locked)]
    if patterns is None:
        return usual
    fits = [e for e in known if legs or not e.locked]
    groups = [e for e in fits if not e.asked], [e for e in fits if e.asked and not (legs and e.spare)]
    chosen = []
    for pattern in patterns:
        fitting = [e for e in usual if e.family == pattern] or [e for e in known if e.name == pattern]
        for group in groups:
            fitting = fitting or [e for e in group if fnmatch.fnmatchcase(e.name, pattern)]
        if not fitting and _lacks_model(pattern, models or {}):
            raise UserError(f"no system {pattern!r} without a model", remedy="give one that lmm train wrote")
        if not fitting:
            names = [e.name for e in known]
            held = [n for n in names if not (n.endswith("-free") and n.removesuffix("-free") in names)]
            remedy = f"choose from {', '.join(held)}{', or those names and -free' * (held != names)}"
            raise UserError(f"no system {pattern!r}", remedy=remedy)
        chosen += fitting
    return [e for e in known if e in chosen]


def _lacks_model(pattern: str, models: Iterable[str]) -> bool:
    """Whether systems of a pattern are made of models, and there is none of that kind."""
    from lmm.models import TYPES

    kinds = [kind for kind in TYPES if pattern.startswith(kind)]
    return bool(kinds) and not any(name.startswith(kinds[0]) for name in models)
