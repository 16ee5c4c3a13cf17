"""``python -m motion dancecard``: write the built-in data as files."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import click

from . import console
from .errors import UserError

T = TypeVar("T")

MINUTES = console.Number(0, 1e5, above_0=True)


@click.command(epilog="Example: python -m motion dancecard -o out/dancecard --minutes 10")
@click.option("-o", "--output", required=True, type=click.Path(), metavar="FOLDER", help="Where to write.")
@click.option("--minutes", type=MINUTES, default=10.0, show_default=True, help="How much motion.")
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Another seed, other motion."
)
@click.option("--no-labels", is_flag=True, help="Write the motion only.")
@console.json_option
def dancecard(output: str, minutes: float, seed: int, no_labels: bool, as_json: bool) -> None:
    """Generate human locomotion: half-minute BVH clips of 31 joints at 60 Hz, in centimetres.

    One round of ten minutes covers standing, walking (0.5 to 2 m/s), jogging (2.5 to 4.5 m/s), crouching,
    steps to eight sides, curves, turns on the spot, pivots, starts, stops and changes of gait; every further
    round is another dancer's. Beside NAME.bvh, NAME.labels.csv has exact foot contacts, phase and gait of
    every frame, and tags.csv the crouched frames for --tags of the commands that build a database: so tagged,
    motion matching crouches where it is asked to, and nowhere else. Less than about seven minutes may have no
    crouching; tags.csv then is a header alone.
    """
    from . import bvh, files
    from .dancecard import FPS, GAITS, dances, names
    from .dancecard import labels as label_files

    folder = Path(output)
    if files.kind(folder) not in ("folder", None):
        raise UserError("not a folder", path=folder, remedy="name a folder to write to")
    files.check_output(folder / "tags.csv")
    known = set(names(60 * minutes, seed=seed))
    others = sorted(path.name for path in folder.glob("*.bvh") if path.stem not in known)
    if others:
        what = f"holds other clips, such as {others[0]}"
        raise UserError(what, path=folder, remedy="name an empty folder")
    rows: list[dict[str, Any]] = []
    tags: list[str] = []
    spent = 0.0
    for passage, seconds in console.progress(
        _timed(dances(60 * minutes, seed=seed)), label="dancing", unit="clips"
    ):
        spent += seconds
        target = folder / f"{passage.name}.bvh"
        bvh.write(target, passage.clip, unit_to_m=0.01)
        if not no_labels:
            label_files.write(target.with_suffix(".labels.csv"), passage.labels)
            crouched = passage.labels.gait == GAITS.index("crouch")
            tags += [f"crouch,{passage.name},{a},{b}" for a, b in label_files.spans(crouched)]
        rows.append(
            {"file": os.fspath(target), "frames": len(passage.clip), "seconds": len(passage.clip) / FPS}
        )
    if not no_labels:
        with files.atomic(folder / "tags.csv") as stream:
            stream.write("\n".join(["tag,clips,start,stop", *tags, ""]).encode())
    if as_json:
        console.print_json(rows)
    else:
        danced = sum(row["seconds"] for row in rows)
        click.echo(
            f"wrote {len(rows)} clips, {danced / 60:.1f} minutes, to {folder}; "
            f"generated in {spent:.2f} s, {danced / spent:,.0f} times real time",
            err=True,
        )


def _timed(items: Iterator[T]) -> Iterator[tuple[T, float]]:
    """Each item and the seconds that it took to come."""
    while True:
        start = time.perf_counter()
        try:
            item = next(items)
        except StopIteration:
            return
        yield item, time.perf_counter() - start
