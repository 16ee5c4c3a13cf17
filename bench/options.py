"""Options and checks that commands of ``python -m bench`` share."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from motion import console, files
from motion.errors import UserError

if TYPE_CHECKING:
    from lmm.models import AnyModel
    from mm.database import Database

CLIPS = (".bvh", ".amc", ".asf", ".npz", ".gltf", ".glb")


MODELS = click.option(
    "--model",
    "models",
    multiple=True,
    type=click.Path(),
    metavar="MODEL",
    help="A model of any kind that `lmm train` made from this database.  [repeatable]",
)


class Listed(click.ParamType):
    """Comma-separated values."""

    name = "a,b"

    def __init__(self, kind: type = str) -> None:
        self.kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple:
        if isinstance(value, tuple):
            return value
        try:
            found = tuple(self.kind(part.strip()) for part in value.split(",") if part.strip())
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers, as 1,16,256 is", param, ctx)
        if not found:
            self.fail("an empty list", param, ctx)
        if self.kind is int:
            found = tuple(console.COUNT.convert(number, param, ctx) for number in found)
        return found


CODECS = click.option(
    "--codecs",
    type=Listed(),
    default=(),
    metavar="A,B",
    help="Compressed databases, too: codecs as `mm compress` names them, chained by +, or files it wrote.",
)


def open_database(
    sources: tuple[str, ...], output: Path | None, chosen: dict[str, Any]
) -> tuple[Database, str]:
    """The database that sources name, or one built from clips (and kept as output); and what to call it."""
    from mm import build as building

    names = ", ".join(sources)
    first = Path(sources[0])
    if len(sources) == 1 and files.kind(first) == "file" and first.suffix.lower() not in CLIPS:
        for flag in given(set(chosen) - {"jobs"}):
            raise UserError("this database is built already", path=first, remedy=f"leave out {flag}")
        return load(sources[0]), names
    database = building.build(sources, **chosen, note=note, progress=console.progress)
    if output is not None:
        database.save(output)
        return load(str(output)), names
    return database, names


def given(names: set[str]) -> Iterator[str]:
    """The flags of options of these names that stand on the command line."""
    context = click.get_current_context()
    for option in context.command.params:
        if option.name in names:
            source = context.get_parameter_source(option.name)
            if source is click.core.ParameterSource.COMMANDLINE:
                off = option.secondary_opts and context.params[option.name] is False
                yield (option.secondary_opts if off else option.opts)[0]


def check_outputs(folder: Path, names: Iterable[str]) -> None:
    """A UserError unless files of these names can be written into a folder."""
    if files.kind(folder) not in (None, "folder"):
        raise UserError("cannot write: it is a file", path=folder, remedy="name a folder")
    for name in names:
        files.check_output(folder / name)


def check_models(learned: Mapping[str, AnyModel], paths: Iterable[str], database: Database) -> None:
    """A UserError unless models are of a database."""
    for model, path in zip(learned.values(), paths, strict=True):
        model.check(database, path)


def load(path: str) -> Database:
    from mm.database import Database

    if files.kind(path) == "folder":
        raise UserError("a folder, expected a database", path=path, remedy="make one with python -m mm build")
    return Database.load(path)


def note(line: str) -> None:
    print(f"note: {line}", file=sys.stderr)
