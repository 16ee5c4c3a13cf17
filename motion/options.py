"""Options that commands about motion files share, and the clips that they name."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from . import console
from .errors import UserError

if TYPE_CHECKING:
    from .clip import Clip

LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "foot": 0.3048}
"""Metres in a unit of length, by the name that options take."""


class Length(click.ParamType):
    """A unit by name, or its size in metres."""

    name = "unit"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            metres = LENGTHS[value] if value in LENGTHS else float(value)
        except ValueError:
            metres = -1.0
        if not 0 < metres < 1e6:
            self.fail(f"{value!r} is no unit; give {', '.join(LENGTHS)} or metres a unit", param, ctx)
        return metres


ROLES = click.option(
    "--roles", type=click.Path(), metavar="FILE", help="TOML file: which joint plays which role."
)
SOURCE_UNIT = click.option(
    "--source-unit", type=Length(), metavar="UNIT", help="Unit of the files' lengths.  [default: guessed]"
)
AXIS = click.Choice(["x", "y", "z", "-x", "-y", "-z"])
TIME = console.Number(0, 1e5)
HAND = click.Choice(["right", "left"])
FORWARD = "[default: z, or -y where z is up]"


def source_axes(command: Callable) -> Callable:
    """Decorator: options for the axes of the files read."""
    for option in (
        click.option(
            "--source-handedness", type=HAND, default="right", show_default=True, help="Their handedness."
        ),
        click.option("--source-forward", type=AXIS, help=f"Axis they face.  {FORWARD}"),
        click.option("--source-up", type=AXIS, default="y", show_default=True, help="The files' up axis."),
    ):
        command = option(command)
    return command


def clips(
    files: tuple[str, ...],
    *,
    label: str,
    fps: float | None = None,
    unit_to_m: float | None = None,
    roles: str | None = None,
) -> Iterator[tuple[Path, Clip]]:
    """The clips of files and folders, with a progress bar, roles from a file if given."""
    from . import roles as role_files
    from . import sources

    overrides = {} if roles is None else role_files.load_overrides(roles)
    for path in console.progress(sources.find(files), label=label, unit="files"):
        clip = sources.load(path, fps=fps, unit_to_m=unit_to_m)
        yield path, clip.replace(skeleton=role_files.apply(clip.skeleton, overrides)) if overrides else clip


def system(up: str, forward: str | None, handedness: str) -> tuple[str, str, str]:
    """Axes that belong together, forward filled in."""
    from . import axes

    forward = forward or ("-y" if up.endswith("z") else "z")
    axes.basis(up, forward, handedness)
    return up, forward, handedness


@contextlib.contextmanager
def about(path: Path) -> Iterator[None]:
    """A user error inside that names no file is about path."""
    try:
        yield
    except UserError as error:
        if error.path is not None:
            raise
        raise UserError(error.what, path=path, remedy=error.remedy) from error
