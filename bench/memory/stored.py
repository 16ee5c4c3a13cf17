"""The files that systems are read from, and what they hold by part."""

from __future__ import annotations

import fnmatch
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.entry import Entry
from bench.learned import ENDINGS
from mm.database import Database
from motion import files

from .resident import Subject

if TYPE_CHECKING:
    from lmm.models import AnyModel

# Part by the arrays' names, the first that fits.
PARTS = (
    ("poses.rates", "velocities"),
    ("poses.half_rates", "velocities"),
    ("poses.*root*", "root motion"),
    ("poses.contacts", "contacts"),
    ("poses.starts", "clips"),
    ("poses.stops", "clips"),
    ("poses.*", "poses"),
    ("positions", "poses"),
    ("rotations", "poses"),
    ("*velocities", "velocities"),
    ("features*", "features"),
    ("stored_latents", "latents"),
    ("starts", "clips"),
    ("stops", "clips"),
    ("mirrored", "clips"),
    ("origins", "clips"),
    ("description.*", "description"),
    ("offset", "description"),
    ("scale", "description"),
    ("state_*", "statistics"),
)


class Files:
    """The files that systems are read from; those of a codec or of other weights are made for the while."""

    def __init__(self, database: Database, path: str, models: Mapping[str, AnyModel], folder: Path) -> None:
        self._database, self._path, self._models, self._folder = database, path, models, folder
        self._made: tuple[Any, ...] = ()

    def subject(self, entry: Entry) -> Subject:
        """What a process of its own needs to make a system: the files, and its name there."""
        if not entry.source:
            return Subject(entry.name, self._path)
        made = self._file(entry)
        free = "" if entry.locked else "-free"
        if entry.source not in self._models:
            index = entry.name.split("-", 2)[1]
            return Subject(f"mm-{index}-{made.stem}{free}", codecs=[str(made)])
        kind = made.suffix.removeprefix(".")
        ending = ENDINGS[entry.weights] if entry.weights == "bfloat16" else ""
        database = None if entry.alone else self._path
        return Subject(f"{kind}-{entry.way}{ending}{free}", database, [str(made)])

    def _file(self, entry: Entry) -> Path:
        """A codec's file, or a model's, its weights as they are held, without what it needs no more."""
        from lmm.model import Model
        from lmm.models import kind_of, with_weights
        from mm.codecs.compressed import compress

        if entry.source not in self._models and files.kind(entry.source) == "file":
            return Path(entry.source)
        model = self._models.get(entry.source)
        key = entry.source, entry.weights, entry.alone
        path = self._folder / ("small.mmdb" if model is None else f"model.{kind_of(model)}")
        if self._made != key:
            self._made = key
            if model is None:
                compress(self._database, entry.source, rigs=False).save(path)
            else:
                held, _ = with_weights(model, entry.weights)
                (held.without_latents() if entry.alone and isinstance(held, Model) else held).save(path)
        return path


def sizes(subject: Subject) -> dict[str, float]:
    """stored_mb, that of the files that a system is made of, and stored_PART_mb."""
    out: dict[str, float] = {}
    for path in (*subject.models, *subject.codecs, *filter(None, [subject.database])):
        for part, size in parts(path).items():
            name = f"stored_{part.replace(' ', '_')}_mb"
            out[name] = out.get(name, 0) + size / 1e6
    return {"stored_mb": sum(out.values())} | out


def parts(path: str | os.PathLike[str]) -> dict[str, int]:
    """Bytes of a file by part, those of its header and of what describes the data as "description".

    A network goes by its name. The sum is the file's size.
    """
    out: dict[str, int] = {}
    for name, size in files.array_sizes(path).items():
        part = next((part for pattern, part in PARTS if fnmatch.fnmatchcase(name, pattern)), None)
        part = part or name.split(".", 1)[0]
        out[part] = out.get(part, 0) + size
    rest = Path(path).stat().st_size - sum(out.values())
    return out | {"description": out.get("description", 0) + rest}
