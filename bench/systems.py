"""Which systems are compared: a registry by name, filled by whoever has a system to compare."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from numpy.typing import ArrayLike

from mm.control import System
from mm.database import Database
from mm.feet import joints_of_legs
from motion.errors import UserError

if TYPE_CHECKING:
    from lmm.evaluator import Products
    from lmm.locomotion.model import LocomotionModel
    from lmm.model import Model
    from lmm.models import AnyModel


class Factory(Protocol):
    """Builds a system of count characters that keep off obstacles [M, 5] (see `mm.controller`)."""

    def __call__(self, database: Database, count: int, *, obstacles: ArrayLike = ()) -> System: ...


@dataclass(frozen=True)
class Entry:
    """A named way to make a system of N characters from a database; family: the name up to the first dash.

    locked : whether it holds the feet, which takes whole legs. spare : whether it stands for a locked one
    where legs are not whole, and elsewhere comes by its name or a pattern alone. asked : whether it comes by
    its name or a pattern alone everywhere.
    """

    name: str
    make: Factory
    about: str = ""
    locked: bool = False
    spare: bool = False
    asked: bool = False

    @property
    def family(self) -> str:
        return self.name.split("-", 1)[0]


ENDINGS: dict[Products, str] = {"float32": "", "bfloat16": "-bf16"}  # of names, by what is multiplied
STAGES = {"P": "projection", "S": "stepping", "D": "decompression"}

_REGISTERED: dict[str, Entry] = {}


def register(name: str, make: Factory, about: str = "") -> None:
    """Add a system, or replace the one of that name."""
    _REGISTERED[name] = Entry(name, make, about)


def called(name: str, locked: bool) -> str:
    """The name of a system that holds the feet, or of the same one that does not."""
    return name if locked else f"{name}-free"


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


def learned(models: Mapping[str, AnyModel]) -> list[Entry]:
    """All systems that models make, whose names begin with those of the models.

    Learned motion matching runs in all ways in which networks take the place of stages: NAME-PSD is learned
    motion matching itself. P is projection, S stepping, D decompression: NAME-D is the decompressor alone, on
    an exact search. None of them learned is mm-exact. A phase-functioned network is NAME-cubic, NAME-linear
    and NAME-constant, a mode-adaptive one of four experts NAME-4.

    NAME-D-free does not hold the feet; it comes by its name or a pattern, or where legs are not whole.
    NAME-PSD-bf16, NAME-cubic-bf16 and so on multiply bfloat16 numbers, where the processor can, which pays in
    crowds (see `bench.crowd`); they come by their names or a pattern, to show what that costs in quality.
    """
    from lmm.models import Model

    out = []
    for name, model in models.items():
        ways = _mixtures(model) if isinstance(model, Model) else _networks(model)
        for (way, about, make), (products, ending), locked in product(ways, ENDINGS.items(), (True, False)):
            if ending and isinstance(model, Model) and way != "PSD":
                continue
            about += f", products of {products} numbers" * bool(ending) + ", feet as they come" * (not locked)
            title = called(f"{name}-{way}{ending}", locked)
            made = partial(make, title, products, locked)
            out.append(Entry(title, made, about, locked, not locked and not ending, bool(ending)))
    return out


def _mixtures(model: Model) -> list[tuple[str, str, Callable[..., System]]]:
    """Of each way to mix learned stages with others its letters, what it is, and what makes it."""
    from lmm.mixtures import COMBINATIONS

    shared: dict[str, Any] = {}
    out: list[tuple[str, str, Callable[..., System]]] = []
    for letters in filter(None, reversed(COMBINATIONS)):
        networks = " and ".join(word for letter, word in STAGES.items() if letter in letters)
        out.append((letters, f"{networks} by networks", partial(_learned, model, letters, shared)))
    return out


def _networks(model: LocomotionModel) -> list[tuple[str, str, Callable[..., System]]]:
    """Of each way to run a network of locomotion how its name ends, what it is, and what makes it."""
    from lmm.models import controllers

    return [
        (way, f"{model.kind}, {way}", partial(_network, model, make))
        for way, make in controllers(model).items()
    ]


def _network(
    model: LocomotionModel,
    make: Callable[..., System],
    name: str,
    products: Products,
    locked: bool,
    database: Database,
    count: int,
    *,
    obstacles: ArrayLike = (),
) -> System:
    from lmm.locomotion.settings import LocomotionSettings

    model.check(database)
    settings = LocomotionSettings(foot_lock=locked)
    return make(count=count, settings=settings, obstacles=obstacles, products=products, name=name)


def _learned(
    model: Model,
    letters: str,
    shared: dict[str, Any],
    name: str,
    products: Products,
    locked: bool,
    database: Database,
    count: int,
    *,
    obstacles: ArrayLike = (),
) -> System:
    from lmm.controller import controller
    from mm.controller import build_index
    from mm.settings import Settings

    model.check(database)
    settings = Settings(foot_lock=locked)
    needed: dict[str, Any] = {}
    if letters != "PSD":  # one index and the latents serve all that need them
        if shared.get("of") is not database:
            shared |= {"of": database, "latents": model.latents(database)}
            shared["index"] = build_index(database, "exact", settings)
        needed = {"database": database, "latents": shared["latents"], "index": shared["index"]}
    return controller(
        model,
        learned=letters,
        settings=settings,
        count=count,
        obstacles=obstacles,
        products=products,
        name=name,
        **needed,
    )


def entries(
    indexes: Iterable[str] | None = None, models: Mapping[str, AnyModel] | None = None
) -> list[Entry]:
    """All systems there are; indexes limits those of motion matching."""
    return [*motion_matching(indexes), *learned(models or {}), *_REGISTERED.values()]


def choose(
    patterns: Sequence[str] | None = None,
    *,
    indexes: Iterable[str] | None = None,
    models: Mapping[str, AnyModel] | None = None,
    legs: bool = True,
) -> list[Entry]:
    """Systems by name, by family ("mm") or by pattern ("mm-*-free"), in the registry's order; all when None.

    models are those that systems are made of, by name (see `learned`). Where legs are not whole families and
    patterns leave out who needs them. A pattern that fits nothing is a UserError that lists the choices.
    """
    known = entries(indexes, models)
    usual = [e for e in known if not e.asked and not (e.spare if legs else e.locked)]
    if patterns is None:
        return usual
    chosen = []
    for pattern in patterns:
        fitting = [e for e in usual if e.family == pattern] or [e for e in known if e.name == pattern]
        fitting = fitting or [
            e for e in known if fnmatch.fnmatchcase(e.name, pattern) and (legs or not e.locked)
        ]
        if not fitting and _lacks_model(pattern, models or {}):
            raise UserError(f"no system {pattern!r} without a model", remedy="give one that lmm train wrote")
        if not fitting:
            names = ", ".join(e.name for e in known)
            raise UserError(f"no system {pattern!r}", remedy=f"choose from {names}")
        chosen += fitting
    return [e for e in known if e in chosen]


def _lacks_model(pattern: str, models: Iterable[str]) -> bool:
    """Whether systems of a pattern are made of models, and there is none of that kind."""
    from lmm.models import TYPES

    kinds = [kind for kind in TYPES if pattern.startswith(kind)]
    return bool(kinds) and not any(name.startswith(kinds[0]) for name in models)
