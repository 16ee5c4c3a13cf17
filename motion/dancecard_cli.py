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
    from . import files
    from .dancecard import FPS, clips, dances, names

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
    spent: list[float] = []
    passages = clips.write(folder, _timed(dances(60 * minutes, seed=seed), spent), labels=not no_labels)
    for target, passage in console.progress(passages, label="dancing", unit="clips"):
        rows.append(
            {"file": os.fspath(target), "frames": len(passage.clip), "seconds": len(passage.clip) / FPS}
        )
    if as_json:
        console.print_json(rows)
    else:
        danced = sum(row["seconds"] for row in rows)
        click.echo(
            f"wrote {len(rows)} clips, {danced / 60:.1f} minutes, to {folder}; "
            f"generated in {sum(spent):.2f} s, {danced / sum(spent):,.0f} times real time",
            err=True,
        )


def _timed(items: Iterator[T], spent: list[float]) -> Iterator[T]:
    """The items; the seconds that each took to come go into spent."""
    while True:
        start = time.perf_counter()
        try:
            item = next(items)
        except StopIteration:
            return
        spent.append(time.perf_counter() - start)
        yield item
