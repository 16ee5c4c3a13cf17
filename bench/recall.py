"""``python -m bench search``: recall, cost and time of the search indexes, as a table and as a picture."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np

from motion import console, files

from .options import Listed, check_outputs, load

FILES = ("search.csv", "search.json", "search.png")
MARKERS = ("o", "s", "D", "^", "v", "P", "X", "<", ">")


@click.command(epilog="Example: python -m bench search walk.mmdb --indexes exact,faiss-ivf -o out/search")
@click.argument("db", type=click.Path())
@click.option("--queries", type=click.IntRange(1), default=1000, show_default=True, help="How many at least.")
@click.option("--indexes", type=Listed(), metavar="A,B", help="Which indexes.  [default: all]")
@click.option("--k", type=click.IntRange(1, 1000), default=1, show_default=True, help="Answers per query.")
@click.option("--repeats", type=click.IntRange(1), default=3, show_default=True, help="Timed passes.")
@click.option(
    "--sweep", is_flag=True, help="Approximate indexes in all ways to trade recall for time.  [with -o: on]"
)
@click.option("-o", "--output", type=click.Path(), metavar="FOLDER", help="Write table and plot there.")
@console.json_option
def search(
    db: str,
    queries: int,
    indexes: tuple[str, ...] | None,
    k: int,
    repeats: int,
    sweep: bool,
    output: str | None,
    as_json: bool,
) -> None:
    """Recall, cost and time of the search indexes.

    The queries are those that a controller makes on this database while a random user drives it, with the
    bound and the exclusions that it gives them. Times, of building too, are those of one pinned thread. With
    -o the folder gets search.csv, search.json and search.png, recall against time.
    """
    from . import queries as recorded
    from . import timing

    folder = None if output is None else Path(output)
    if folder is not None:
        check_outputs(folder, FILES)
    database = load(db)
    rows = recorded.table(
        database,
        count=queries,
        indexes=indexes,
        k=k,
        repeats=repeats,
        sweep=sweep or folder is not None,
        progress=console.progress,
    )
    if as_json:
        console.print_json(rows)
    else:
        console.print_table(rows, title=f"{db}: {queries} queries of a driven controller")
    if folder is not None:
        facts = {
            "command": shlex.join(["python", "-m", "bench", *sys.argv[1:]]),
            "database": {"name": db, "fingerprint": database.fingerprint, "frames": len(database)},
            "machine": timing.machine(),
            "rows": rows,
        }
        for path in save(rows, folder, facts, f"{db}: {len(database):,} frames, {queries:,} queries"):
            print(f"wrote {path}", file=sys.stderr)


def save(rows: list[dict[str, Any]], folder: Path, facts: dict[str, Any], title: str) -> list[Path]:
    """Write the table, its JSON and the plot, all of them or none."""
    import pandas as pd

    from motion import figures

    from .tables import written

    with figures.style("search"):
        picture = figures.png(figure(rows, title))
    contents = written({"search": pd.DataFrame(rows)}) | {
        "search.json": json.dumps(facts, indent=1, allow_nan=False) + "\n",
        "search.png": picture,
    }
    return files.write_together(folder, contents)


def figure(rows: list[dict[str, Any]], title: str) -> Any:
    """Recall, and what answers cost more than the best, against microseconds; a line an index that is swept.

    A full mark is the index as it comes.
    """
    from bench.plots import logarithmic
    from motion.figures import COLOURS
    from motion.figures import figure as empty

    picture, panels = empty(11, 4.4, 2)
    names = list(dict.fromkeys(row["index"] for row in rows))
    for axes, column, label in zip(
        panels, ("recall", "cost_regret"), ("recall", "cost above the best, %"), strict=True
    ):
        for i, name in enumerate(names):
            own = sorted((row for row in rows if row["index"] == name), key=lambda row: row["median_us"])
            x = [row["median_us"] for row in own]
            y = np.array([row[column] for row in own]) * (100 if column == "cost_regret" else 1)
            style = {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)], "markersize": 5}
            axes.plot(x, y, linewidth=0.8, fillstyle="none", zorder=2, **style)
            for row, at, value in zip(own, x, y, strict=True):
                if row.get("value") is None:
                    axes.plot(at, value, linewidth=0, zorder=3, label=name, **style)
                elif column == "recall":
                    axes.annotate(
                        f"{row['value']:g}", (at, value), (3, -7), textcoords="offset points", fontsize=5.5
                    )
        logarithmic(axes, "x")
        axes.set_xlabel("median of a search, µs (logarithmic), one thread")
        axes.set_ylabel(label)
        axes.grid(True)
    options = dict.fromkeys(f"{row['index']}: {row['option']}" for row in rows if row.get("option"))
    panels[0].set_title(f"numbers along lines are {', '.join(options)}" if options else "", fontsize=6)
    picture.suptitle(title, fontsize=9)
    picture.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=7)
    return picture
