"""What is given to be shown: clips, databases, models and recorded runs, told apart by what files hold."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.terrain import Ground
from lmm import models, pretrained
from lmm import run as of_models
from lmm.mixtures import COMBINATIONS, LETTERS
from lmm.model import Model
from lmm.models import AnyModel
from mm import recording
from mm import run as of_databases
from mm.build import build
from mm.codecs import compressed
from mm.codecs.compressed import Compressed
from mm.control import System
from mm.database import KIND, Database
from mm.grounded import on_ground
from mm.recording import Recording
from mm.runs import Driven
from motion import dancecard, files, sources
from motion.console import silent
from motion.dancecard import clips as dancecard_clips
from motion.errors import UserError

from . import shows
from .shows import Recorded

Data = Database | Compressed
BUILT_IN = "dancecard"


@dataclass(frozen=True, eq=False)
class Part:
    """A system that can be shown.

    Attributes
    ----------
    name : such as mm, lmm or lmm-D.
    driven : what it is made by.
    data : the database that its searches are explained by; None without one.
    learned : whether networks do any of it.
    """

    name: str
    driven: Driven
    data: Data | None = None
    learned: bool = True

    def make(self, settings: Any = None, *, ground: Ground | None = None, **options: Any) -> System:
        """The system, of one character, on a ground if there is one; settings are of the class that `driven`
        names."""
        settings = self.driven.settings() if settings is None else settings
        make = partial(self.driven.controller, count=1, settings=settings, **options)
        made: System = on_ground(make, ground, sees=self.driven.sees_ground)
        return made


@dataclass(eq=False)
class Sources:
    """What was given, by name: files' stems, models' those of their systems (lmm, pfnn, mann)."""

    clips: dict[str, Recorded] = field(default_factory=dict)
    runs: dict[str, Recording] = field(default_factory=dict)
    databases: dict[str, Data] = field(default_factory=dict)
    models: dict[str, AnyModel] = field(default_factory=dict)

    def parts(self, names: Sequence[str] | None = None) -> dict[str, Part]:
        """Systems by name: of each database and model its own, or those asked for.

        lmm-D and so on are mixtures with the model's database: letters name the stages that networks do. An
        unknown name, and a mixture without its database, is a UserError.
        """
        own, mixtures = self._own(), self._mixtures()
        if names is not None and not names:
            raise UserError("no systems are named", remedy=f"choose from {', '.join(own)}" if own else None)
        found = {}
        for name in own if names is None else dict.fromkeys(names):
            make = own.get(name) or mixtures.get(name)
            if make is None:
                several = f"; with its database also {', '.join(mixtures)}" if mixtures else ""
                remedy = f"choose from {', '.join(own)}{several}" if own else "give a database or a model"
                raise UserError(f"no system {name!r}", remedy=remedy)
            found[name] = make()
        return found

    def data_of(self, run: Recording) -> Data | None:
        """The database that a run was made from, of those given: that which it names, or one that a network
        of what it names was trained from but for rounding (`Model.check`): one given, or one that ships."""
        named = run.database
        same = next((data for data in self.databases.values() if origin(data) == named), None)
        if same is not None or not named or not self.databases:
            return same
        for model in [*self.models.values(), models.load(BUILT_IN)]:
            if isinstance(model, Model) and model.description.fingerprint == named:
                return self._data_for(model)
        return None

    def _own(self) -> dict[str, Callable[[], Part]]:
        several = len(self.databases) > 1
        makers: dict[str, Callable[[], Part]] = {}
        for stem, data in self.databases.items():
            name = f"mm-{stem}" if several else "mm"
            makers[name] = partial(_classical, name, data)
        for name, model in self.models.items():
            makers[name] = partial(_learned, name, model, "PSD", self._data_for(model))
        return makers

    def _mixtures(self) -> dict[str, Callable[[], Part]]:
        return {
            f"{name}-{letters}": partial(_learned, f"{name}-{letters}", model, letters, self._data_for(model))
            for name, model in self.models.items()
            if isinstance(model, Model)
            for letters in COMBINATIONS
            if 0 < len(letters) < len(LETTERS)
        }

    def _data_for(self, model: AnyModel) -> Data | None:
        return next((data for data in self.databases.values() if _fits(model, data)), None)


def _classical(name: str, data: Data) -> Part:
    return Part(name, of_databases.of_data(data), data, learned=False)


def _learned(name: str, model: AnyModel, letters: str, data: Data | None) -> Part:
    """A model's own system, or one of which only stages of some letters are networks."""
    if not isinstance(model, Model):
        return Part(name, of_models.of_network(model))
    if letters == LETTERS:
        return Part(name, of_models.of_stages(model), data)
    if not isinstance(data, Database):
        what = f"{name} has stages that are not learned, and its database is not given"
        remedy = "give the database that the model was trained from" + ", not compressed" * (data is not None)
        raise UserError(what, remedy=remedy)
    return Part(name, of_models.of_stages(model, letters, data), data)


def read(paths: Sequence[str | os.PathLike[str]], *, skinned: bool = True) -> Sources:
    """All that files hold; folders are searched for clips. No path: the networks that ship.

    skinned : whether clips of glTF files wear the meshes of these.

    UserErrors: what is no such file, or is given twice; a model that is of none of the databases given; a run
    that none of them made.
    """
    found = Sources()
    known = [os.path.realpath(path) for path in paths]
    for path, real in zip(paths, known, strict=True):
        if known.count(real) > 1:
            raise UserError("it is given twice", path=path, remedy="name it once")
    if not paths:
        found.models = {models.kind_of(name): models.load(name) for name in pretrained.names()}
        return found
    where: dict[int, str] = {}
    for path in [os.fspath(path) for path in paths]:
        for kind, name, thing in _read(path, skinned):
            into: dict[str, Any] = getattr(found, kind)
            if name in into:
                name = f"{name}-{Path(path).stem if kind == 'models' else Path(path).resolve().parent.name}"
            if name in into:
                raise UserError(
                    f"two of what is given are called {name}", path=path, remedy="rename one file"
                )
            into[name] = thing
            where[id(thing)] = path
    _check(found, where)
    return found


def built_in(
    *, folder: str | os.PathLike[str] | None = None, progress: Callable[..., Iterator[Any]] = silent
) -> Database:
    """The database of the built-in data, which the networks that ship were trained from.

    It is made once, in ten seconds or so, and then kept in a folder of the user's cache ($XDG_CACHE_HOME, or
    ~/.cache), where that can be written. progress wraps the loops, as `motion.console.progress` does.
    """
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    kept = Path(folder or Path(cache) / "motion-matching", f"{BUILT_IN}.mmdb")
    shipped = models.load(BUILT_IN)
    try:
        database = Database.load(kept)
        if _fits(shipped, database):  # its fingerprint may be another one: machines differ in rounding
            return database
    except UserError:  # absent, or of another version
        pass
    with tempfile.TemporaryDirectory() as scratch:
        clips = dancecard_clips.write(Path(scratch), dancecard.dances())
        for _ in progress(clips, label="making the built-in data, once", unit="clips"):
            pass
        database = build(scratch, tags=Path(scratch, "tags.csv"), jobs=1, progress=progress)
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        database.save(kept)
    except (OSError, UserError):
        return database
    return Database.load(kept)


def _read(path: str, skinned: bool) -> Iterator[tuple[str, str, Any]]:
    """What a file holds: where it belongs, its name, itself."""
    stem = Path(path).stem
    found = files.kind(path)
    if found is None and path in pretrained.names():
        yield "models", models.kind_of(path), models.load(path)
    elif found == "folder" or sources.split(path)[0].suffix.lower() in sources.FORMATS:
        for one in sources.find([path]):
            show = shows.load(one, skinned=skinned)
            yield "clips", show.name, show
    elif found is None:
        ships = ", ".join(pretrained.names())
        remedy = f"check the path, or name a model that ships: {ships}"
        raise UserError("no such file", path=path, remedy=remedy)
    else:
        kind = files.format_of(path)
        if kind == recording.KIND:
            run = Recording.load(path)
            if not len(run):
                raise UserError("a run of no frames", path=path, remedy="record it again")
            yield "runs", stem, run
        elif kind in (KIND, compressed.KIND):
            yield "databases", stem, of_databases.load(path)
        elif kind in models.FORMATS:
            yield "models", models.FORMATS[kind], models.load(path)
        else:
            what = f"a {kind}, which is nothing to show" if kind else "nothing that can be shown"
            remedy = "give motion files, a database, a model or a recorded run"
            raise UserError(what, path=path, remedy=remedy)


def _check(found: Sources, where: Mapping[int, str]) -> None:
    """A UserError where models or runs are not of the databases given."""
    if not found.databases:
        return
    for model in found.models.values():
        if not any(_fits(model, data) for data in found.databases.values()):
            _check_model(model, next(iter(found.databases.values())), where[id(model)])
    for run in found.runs.values():
        if run.database and found.data_of(run) is None:
            remedy = "give the database that it was made from, or the run alone"
            raise UserError("the run was not made from this database", path=where[id(run)], remedy=remedy)


def origin(data: Data) -> str:
    """The fingerprint that runs on a database bear, be it compressed or not."""
    return data.fingerprint if isinstance(data, Database) else data.description.fingerprint


def offset_and_scale(data: Data) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """By which a database's features are normalised, [F] each."""
    of = data if isinstance(data, Database) else data.description
    return of.offset, of.scale


def _fits(model: AnyModel, data: Data) -> bool:
    try:
        _check_model(model, data, None)
    except UserError:
        return False
    return True


def _check_model(model: AnyModel, data: Data, path: str | None) -> None:
    """A UserError unless a model is of a database; of a compressed one, of that which it was made from."""
    if isinstance(data, Database):
        model.check(data, path=path)
    elif model.description.fingerprint != origin(data):
        remedy = "give the database that it was trained from"
        raise UserError("the model is not of this database", path=path, remedy=remedy)
