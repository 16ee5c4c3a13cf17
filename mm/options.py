"""Options that commands share: how a database is built from clips, and what characters walk on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from motion import console
from motion import options as reading

if TYPE_CHECKING:
    from features.terrain import Heightmap


def schema_option(default: str) -> Callable[[Any], Any]:
    """``--schema`` with this default."""
    return click.option(
        "--schema",
        default=default,
        show_default=True,
        metavar="NAME|FILE",
        help="Features that a frame is searched by: a name (`python -m features list`), or a TOML file.",
    )


def building(command: Callable) -> Callable:
    """Decorator: the options of `mm.build.build`, by the names of its parameters."""
    for option in (
        console.exclude_option,
        click.option(
            "--skip-bad", is_flag=True, help="Leave clips out that cannot be read, instead of stopping."
        ),
        click.option("--folder-tags", is_flag=True, help="Tag every clip with the name of its folder."),
        click.option(
            "--tags",
            type=click.Path(),
            metavar="FILE",
            help="CSV or TOML file that gives tags to clips or to some of their frames.",
        ),
        reading.source_axes,
        reading.SOURCE_UNIT,
        reading.SOURCE_FPS,
        reading.ROLES,
        click.option(
            "--clips",
            type=click.Path(),
            metavar="FILE",
            help="TOML file with rate, unit, axes, roles or cuts of some of the clips.",
        ),
        click.option(
            "--check/--no-check",
            default=True,
            show_default=True,
            help="Cut out captures that `python -m motion check` finds bad.",
        ),
        click.option(
            "--roles-only",
            is_flag=True,
            help="Keep only the joints that the schema needs; skeletons may then differ.",
        ),
        click.option(
            "--retarget/--no-retarget",
            default=True,
            show_default=True,
            help="Retarget clips of other skeletons to the chosen one, or leave them out.",
        ),
        click.option(
            "--skeleton",
            type=click.Path(),
            metavar="FILE|NAME",
            help="Skeleton to put all clips on: that of a motion file, or dancecard.  [default: their own]",
        ),
        click.option(
            "--jobs", type=click.IntRange(1), help="Number of threads.  [default: one for each core]"
        ),
        click.option(
            "--mirror/--no-mirror", default=True, show_default=True, help="Add a mirrored copy of every clip."
        ),
        click.option(
            "--fps",
            type=console.RATE,
            default=60.0,
            show_default=True,
            help="Frame rate of the database.",
        ),
        schema_option("mm27"),
    ):
        command = option(command)
    return command


def on_heights(command: Callable) -> Callable:
    """Decorator: options of a command whose characters walk on a heightmap; `heightmap` takes them."""
    for option in (
        click.option(
            "--heights-spacing",
            type=console.SIZE,
            metavar="M",
            help="Metres between neighbouring numbers of that file.  [default: 0.0394, as in published ones]",
        ),
        click.option(
            "--heights",
            type=click.Path(),
            metavar="FILE",
            help="Walk on the uneven ground of this heightmap (`python -m features heightmap` makes one).",
        ),
    ):
        command = option(command)
    return command


def heightmap(heights: str | None, heights_spacing: float | None) -> Heightmap | None:
    """The ground that options `on_heights` name, if they do."""
    from features import terrain

    if heights is None:
        if heights_spacing is not None:
            raise click.UsageError("--heights-spacing is that of a heightmap: give --heights FILE too")
        return None
    return terrain.load(heights, spacing=heights_spacing or terrain.SPACING)


def inputs(options: Mapping[str, Any], sources: Sequence[str] = ()) -> list[str | Path]:
    """The files that sources and options of `building` name: nothing may be written over them."""
    from features import presets
    from motion import facts
    from motion import sources as motion_files

    from .skeletons import BUILT_IN

    names = filter(None, (options.get(name) for name in ("roles", "skeleton", "tags", "schema")))
    known = {*BUILT_IN, *presets.names()}
    rules = [] if options.get("clips") is None else [options["clips"]]
    clips = []
    if sources:
        clips = motion_files.inputs(sources)
        rules += facts.found(clips, sources)
    return [*clips, *facts.inputs(rules), *(name for name in names if name not in known)]
