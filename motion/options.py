"""Options that commands about motion files share, and the clips that they name."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from . import console
from .errors import UserError
from .lengths import LENGTHS

if TYPE_CHECKING:
    from .axes import Convention
    from .clip import Clip


class Length(click.ParamType):
    """A unit by name, or its size in metres."""

    name = "unit"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            metres = LENGTHS[value] if value in LENGTHS else float(value)
        except ValueError:
            metres = -1.0
        if not 1e-6 <= metres <= 1e6:
            self.fail(f"{value!r} is no unit; give {', '.join(LENGTHS)} or metres a unit", param, ctx)
        return metres


ROLES = click.option(
    "--roles",
    type=click.Path(),
    metavar="FILE",
    help="TOML file that says which joint plays which role (see `python -m motion roles`).",
)
RATE = "Frame rate of the files read, where they state a wrong one."
SOURCE_FPS = click.option("--source-fps", type=console.RATE, help=RATE)
FPS = click.option("--source-fps", "--fps", "fps", type=console.RATE, help=RATE)
SOURCE_UNIT = click.option(
    "--source-unit",
    type=Length(),
    metavar="UNIT",
    help="Unit of lengths in the files read: m, cm, mm, inch, foot, or metres.  [default: guessed]",
)
AXIS = click.Choice(["x", "y", "z", "-x", "-y", "-z"])
TIME = console.Number(0, 1e5)
HAND = click.Choice(["right", "left"])
FORWARD = "[default: z, or -y where z is up]"


def source_axes(command: Callable) -> Callable:
    """Decorator: options for the axes of the files read."""
    for option in (
        click.option(
            "--source-handedness",
            type=HAND,
            default="right",
            show_default=True,
            help="Handedness of the files read.",
        ),
        click.option(
            "--source-forward", type=AXIS, help=f"Axis that characters face in the files read.  {FORWARD}"
        ),
        click.option(
            "--source-up", type=AXIS, default="y", show_default=True, help="Up axis of the files read."
        ),
    ):
        command = option(command)
    return command


def rig_axes(prefix: str) -> Callable[[Callable], Callable]:
    """Decorator: options for the unit and axes of the one file that an option names, its values in a dict.

    The command gets them as one argument, for `model`, named by the prefix and ``_file``.
    """

    def decorate(command: Callable) -> Callable:
        keys = {name: f"{prefix}_{name}" for name in ("unit", "up", "forward", "handedness")}

        @functools.wraps(command)
        def inner(**chosen: Any) -> Any:
            own = {name: chosen.pop(key) for name, key in keys.items()}
            return command(**chosen, **{f"{prefix}_file": own})

        hand, ahead, above, unit = (f"--{prefix}-{word}" for word in ("handedness", "forward", "up", "unit"))
        for option in (
            click.option(
                hand, type=HAND, default="right", show_default=True, help="Handedness of that file."
            ),
            click.option(ahead, type=AXIS, help=f"Axis that the character faces in it.  {FORWARD}"),
            click.option(above, type=AXIS, default="y", show_default=True, help="Up axis of that file."),
            click.option(
                unit, type=Length(), metavar="UNIT", help="Unit of lengths in that file.  [default: guessed]"
            ),
        ):
            inner = option(inner)
        return inner

    return decorate


def model(
    file: str,
    *,
    unit: float | None = None,
    up: str = "y",
    forward: str | None = None,
    handedness: str = "right",
    roles: str | None = None,
) -> tuple[Clip, Convention]:
    """The clip, in our axes, of a file that is given for its skeleton, and the file's axes.

    Of several animations, which share their skeleton, the first. A folder is a UserError.
    """
    from .axes import Convention, system
    from .files import kind

    if kind(file) == "folder":
        raise UserError("it is a folder", path=file, remedy="name one motion file, for its skeleton")
    above, ahead, hand = system(up, forward, handedness)
    convention = Convention(up=above, forward=ahead, handedness=hand)
    _, clip = next(clips((file,), label="reading", unit_to_m=unit, roles=roles))
    return convention.clip_from(clip), convention


def clips(
    files: tuple[str, ...],
    *,
    label: str,
    roots: tuple[str, ...] | None = None,
    fps: float | None = None,
    unit_to_m: float | None = None,
    axes: tuple[str, str | None, str] = ("y", None, "right"),
    roles: str | None = None,
) -> Iterator[tuple[Path, Clip]]:
    """The clips of files and folders in our axes, with a progress bar.

    What is said here of all of them gives way to the rules of a clips.toml in the folders searched (of roots,
    where files were found in them before). forward None is what up tells.
    """
    from . import facts, sources

    up, forward, handedness = axes
    told = facts.of_all(fps=fps, unit=unit_to_m, up=up, forward=forward, handedness=handedness, roles=roles)
    paths = sources.find(files)
    book = facts.book(paths, roots or files, common=told)
    for note in book.notes:
        click.echo(f"note: {note}", err=True)
    for path in console.progress(paths, label=label, unit="files"):
        yield path, facts.read(path, book.of(path))


@contextlib.contextmanager
def about(path: Path) -> Iterator[None]:
    """A user error inside that names no file is about path."""
    try:
        yield
    except UserError as error:
        if error.path is not None:
            raise
        raise UserError(error.what, path=path, remedy=error.remedy) from error
