"""``python -m mm``: build, look at, import and export motion databases."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from motion import console
from motion.options import ROLES

from . import options
from .codecs.cli import compress
from .run import courses, run, settings

if TYPE_CHECKING:
    from .database import Database
    from .intake import Report


@console.group(
    "mm", "Motion databases: build them from clips, look at them, exchange them, drive characters."
)
def main() -> None:
    pass


OUTPUT = click.option(
    "-o", "--output", required=True, type=click.Path(), metavar="DB", help="Database to write."
)


@main.command(
    epilog="Example: python -m mm build clips -o walk.mmdb --skeleton clips/walk.bvh --tags tags.csv"
)
@click.argument("sources", nargs=-1, required=True, type=click.Path())
@OUTPUT
@options.building
@console.json_option
def build(sources: tuple[str, ...], output: str, as_json: bool, **chosen: Any) -> None:
    """Build a database from clips (BVH, AMC, NPZ, glTF) and folders.

    Clips of several skeletons, rates and units go into one database with --skeleton. Captures that `python -m
    motion check` finds bad are cut out, and you are told which and why.

    \b
    An example of a file for --tags, which tags clips by name or frames of them (counted as in the file):
      tag,clips,start,stop
      run,run*,,
      turn,walk_07,120,240

    \b
    An example of a file for --clips (clips.toml in a folder of clips is found by itself):
      [[clips]]
      files = "old/*"
      fps = 60
      unit = "inch"

    Its keys are fps, unit, up, forward, handedness, roles, start, stop (frames as read), keep_lead_in,
    check, exclude.
    """
    begun = time.perf_counter()
    from motion import files

    from . import build as building
    from .intake import Report

    files.check_output(output, inputs=options.inputs(chosen, sources))
    report = Report()
    db = building.build(sources, **chosen, report=report, note=_note, progress=console.progress)
    db.save(output)
    took = time.perf_counter() - begun
    if as_json:
        console.print_json(_facts(db, output, report, took))
        return
    clips = int((~db.mirrored).sum())
    seconds = _seconds(db)
    copies = " with their mirrored copies" * bool(db.mirrored.any())
    print(
        f"{output}: {clips} clip{'s' * (clips != 1)}, {seconds / 60:.1f} minutes, "
        f"{len(db):,} frames{copies} at {db.fps:g} fps, {Path(output).stat().st_size / 1e6:.1f} MB, "
        f"built in {took:.1f} s, {seconds / took:,.0f} times real time{_left_out(report)}"
    )


@main.command(epilog="Example: python -m mm info walk.mmdb --json")
@click.argument("db", type=click.Path())
@console.json_option
def info(db: str, as_json: bool) -> None:
    """Describe a database, or a compressed one."""
    from . import summary
    from .codecs import summary as coded
    from .database import Database
    from .run import load

    data = load(db)
    if isinstance(data, Database):
        facts, show = summary.describe(data, db), summary.show
    else:
        facts = summary.describe(data.decoded(), db) | coded.describe(data, db)
        show = coded.show_with_database
    if as_json:
        console.print_json(facts)
    else:
        show(facts)


@main.command("import", epilog="Example: python -m mm import reference/resources -o reference.mmdb")
@click.argument("directory", type=click.Path())
@OUTPUT
@options.schema_option("lmm27")
@ROLES
@click.option(
    "--names", type=click.Path(), metavar="FILE", help="Text file with the joints' names, one a line."
)
@click.option("--fps", type=console.RATE, default=60.0, show_default=True, help="Frame rate of the files.")
def import_(
    directory: str, output: str, schema: str, roles: str | None, names: str | None, fps: float
) -> None:
    """Turn the public reference's binary files into a database.

    DIRECTORY must hold database.bin; features.bin is used if it is there, and else computed.

    The files hold no joint names. The reference's own skeleton of 23 joints is known; for another one give
    the names by --names, or --roles for joints called joint_0, joint_1 and so on.
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
@click.option(
    "-o", "--output", required=True, type=click.Path(), metavar="FOLDER", help="Folder to write into."
)
def export(db: str, output: str) -> None:
    """Write a database in the public reference's binary format.

    That is database.bin and features.bin, which hold no names, roles or tags.
    """
    from motion import files

    from . import interchange
    from .database import Database

    for name in ("database.bin", "features.bin"):
        files.check_output(Path(output, name), inputs=[db])
    for path in interchange.export_directory(Database.load(db), output):
        print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


@main.command(epilog="Example: python -m mm enlarge walk.mmdb -o ava.mmdb")
@click.argument("db", type=click.Path())
@OUTPUT
@click.option(
    "--joints",
    type=click.IntRange(1, 10_000),
    default=192,
    show_default=True,
    help="Number of joints in all, the ground root among them.",
)
def enlarge(db: str, output: str, joints: int) -> None:
    """Add fingers, a face and helper joints to a database's skeleton, as production rigs have them.

    The motion stays as it is, the new joints do not move against their parents: use it to see what a network
    for a large rig costs, and how well it does. Each joint takes 52 bytes a frame.
    """
    from motion import files

    from .database import Database
    from .enlarged import enlarged

    files.check_output(output, inputs=[db])
    large = enlarged(Database.load(db), joints)
    large.save(output)
    print(_wrote(output, large))


main.add_command(compress)
main.add_command(run)
main.add_command(courses)
main.add_command(settings)


def _wrote(output: str, db: Database) -> str:
    size = Path(output).stat().st_size / 1e6
    return (
        f"{output}: {len(db.starts)} ranges, {len(db):,} frames, {db.seconds / 60:.1f} minutes, {size:.1f} MB"
    )


def _seconds(db: Database) -> float:
    """How long its clips last, without their mirrored copies."""
    return float((db.stops - db.starts)[~db.mirrored].sum()) / db.fps


def _left_out(report: Report) -> str:
    """The end of the last line: how much of the files is left out."""
    found = report.summary()
    gone, cut = found["files_left_out"], found["files_cut"]
    if not gone and not cut:
        return ""
    whole = f"{gone} of {found['files']} files" if gone else ""
    parts = f"parts of {cut}" if cut else ""
    return (
        f"; left out: {' and '.join(filter(None, (whole, parts)))}, "
        f"{found['seconds_left_out']:.1f} of {found['seconds']:.1f} s"
    )


def _facts(db: Database, output: str, report: Report, took: float) -> dict[str, Any]:
    """What was built, found and left out, as plain data."""
    return {
        "path": output,
        "fingerprint": db.fingerprint,
        "clips": int((~db.mirrored).sum()),
        "frames": len(db),
        "fps": db.fps,
        "joints": len(db.skeleton),
        "minutes_without_mirrored": round(_seconds(db) / 60, 3),
        "seconds_to_build": round(took, 3),
        **report.to_json(),
    }


def _check_output(output: str, schema: str, *inputs: str | Path | None) -> None:
    """A UserError where the database cannot be written, or would be written over what it is made from."""
    from features import presets
    from motion import files

    files.check_output(output, inputs=[None if schema in presets.names() else schema, *inputs])


def _note(line: str) -> None:
    print(f"note: {line}", file=sys.stderr)
