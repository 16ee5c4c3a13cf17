"""``python -m mm``: build, look at, import and export motion databases."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from motion import console

from .run import courses, run, settings

if TYPE_CHECKING:
    from .database import Database


@console.group(
    "mm", "Motion databases: build them from clips, look at them, exchange them, drive characters."
)
def main() -> None:
    pass


def schema_option(default: str) -> Callable[[Any], Any]:
    """``--schema`` with this default."""
    return click.option(
        "--schema",
        default=default,
        show_default=True,
        metavar="NAME|FILE",
        help="Features of a frame: one of `python -m features list`, or a TOML file.",
    )


ROLES = click.option(
    "--roles", type=click.Path(), metavar="FILE", help="TOML file: which joint plays which role."
)
OUTPUT = click.option(
    "-o", "--output", required=True, type=click.Path(), metavar="DB", help="Database to write."
)


@main.command(epilog="Example: python -m mm build clips/walk clips/run -o walk.mmdb --tags tags.csv")
@click.argument("sources", nargs=-1, required=True, type=click.Path())
@OUTPUT
@schema_option("mm27")
@click.option(
    "--fps", type=console.RATE, default=60.0, show_default=True, help="Frames per second of the database."
)
@click.option(
    "--mirror/--no-mirror", default=True, show_default=True, help="Add a mirrored copy of every clip."
)
@click.option("--jobs", type=click.IntRange(1), help="Threads.  [default: one a core]")
@click.option(
    "--skeleton", type=click.Path(), metavar="FILE", help="Use this clip's skeleton and leave others out."
)
@click.option(
    "--roles-only", is_flag=True, help="Keep only the schema's joints, so that skeletons may differ."
)
@ROLES
@click.option("--source-fps", type=console.RATE, help="The clips' rate, where their files state a wrong one.")
@click.option(
    "--tags", type=click.Path(), metavar="FILE", help="CSV or TOML file of tags for clips or their frames."
)
@click.option("--folder-tags", is_flag=True, help="Tag every clip with the name of its folder.")
@click.option("--skip-bad", is_flag=True, help="Leave clips out that cannot be used, instead of failing.")
@console.exclude_option
def build(sources: tuple[str, ...], output: str, **options: Any) -> None:
    """Build a database from clips (BVH, AMC, NPZ, glTF) and folders.

    \b
    A file of tags, for clips by name and for frames of them as read:
      tag,clips,start,stop
      run,run*,,
      turn,walk_07,120,240
    """
    start = time.perf_counter()
    from motion.sources import inputs

    from . import build as building

    others = (options[name] for name in ("roles", "skeleton", "tags"))
    _check_output(output, options["schema"], *others, *inputs(sources))
    db = building.build(sources, **options, note=_note, progress=console.progress)
    db.save(output)
    took = time.perf_counter() - start
    clips = int((~db.mirrored).sum())
    seconds = float((db.stops - db.starts)[~db.mirrored].sum()) / db.fps
    copies = " with their mirrored copies" * bool(db.mirrored.any())
    print(
        f"{output}: {clips} clip{'s' * (clips != 1)}, {seconds / 60:.1f} minutes, "
        f"{len(db):,} frames{copies} at {db.fps:g} fps, {Path(output).stat().st_size / 1e6:.1f} MB, "
        f"built in {took:.1f} s, {seconds / took:,.0f} times real time"
    )


@main.command(epilog="Example: python -m mm info walk.mmdb --json")
@click.argument("db", type=click.Path())
@console.json_option
def info(db: str, as_json: bool) -> None:
    """Describe a database."""
    from . import summary
    from .database import Database

    facts = summary.describe(Database.load(db), db)
    if as_json:
        console.print_json(facts)
    else:
        summary.show(facts)


@main.command("import", epilog="Example: python -m mm import reference/resources -o reference.mmdb")
@click.argument("directory", type=click.Path())
@OUTPUT
@schema_option("lmm27")
@ROLES
@click.option(
    "--names", type=click.Path(), metavar="FILE", help="Text file with the joints' names, one a line."
)
@click.option(
    "--fps", type=console.RATE, default=60.0, show_default=True, help="Frames per second of the files."
)
def import_(
    directory: str, output: str, schema: str, roles: str | None, names: str | None, fps: float
) -> None:
    """Read the public reference's binary files.

    DIRECTORY holds its database.bin and, if there, features.bin.

    The files hold no joint names. Its own skeleton of 23 joints is known; another one needs --roles for
    joints named joint_0, joint_1, ..., or --names. Features are computed when there is no features.bin.
    """
    from . import interchange

    binaries = (Path(directory, name) for name in ("database.bin", "features.bin"))
    _check_output(output, schema, roles, names, *binaries)
    db = interchange.import_directory(
        directory, schema=schema, roles=roles, names=interchange.load_names(names) if names else None, fps=fps
    )
    db.save(output)
    print(_wrote(output, db))


@main.command(epilog="Example: python -m mm export walk.mmdb -o resources")
@click.argument("db", type=click.Path())
@click.option("-o", "--output", required=True, type=click.Path(), metavar="DIR", help="Folder to write into.")
def export(db: str, output: str) -> None:
    """Write the public reference's binary files.

    The database DB becomes database.bin and features.bin; names, roles and tags have no place in them.
    """
    from motion import files

    from . import interchange
    from .database import Database

    for name in ("database.bin", "features.bin"):
        files.check_output(Path(output, name), inputs=[db])
    for path in interchange.export_directory(Database.load(db), output):
        print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


main.add_command(run)
main.add_command(courses)
main.add_command(settings)


def _wrote(output: str, db: Database) -> str:
    size = Path(output).stat().st_size / 1e6
    return (
        f"{output}: {len(db.starts)} ranges, {len(db):,} frames, {db.seconds / 60:.1f} minutes, {size:.1f} MB"
    )


def _check_output(output: str, schema: str, *inputs: str | Path | None) -> None:
    """A UserError where the database cannot be written, or would be written over what it is made from."""
    from features import presets
    from motion import files

    files.check_output(output, inputs=[None if schema in presets.names() else schema, *inputs])


def _note(line: str) -> None:
    print(f"note: {line}", file=sys.stderr)
