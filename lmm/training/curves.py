"""Error against minutes of training, drawn from logs."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from motion import figures, files
from motion.errors import UserError

from . import log
from .log import Record

PARTS: dict[str, Any] = {
    "held_out": "-",
    "training": (0, (3, 2)),
}  # how the line of each part of the data is drawn
LABELS = {"error_cm": "error, cm"}
WIDE = 3.0  # times the smallest of an axis is the largest from which on the axis is logarithmic


def check_output(path: str | os.PathLike[str], *, inputs: Sequence[str]) -> None:
    """A UserError unless path can be written and its name says in which form."""
    if Path(path).suffix.lower() not in (".png", ".svg"):
        raise UserError("unknown form of picture", path=path, remedy="name a .png or a .svg")
    files.check_output(path, inputs=inputs)


def save(path: str | os.PathLike[str], logs: Sequence[str], names: Sequence[str]) -> None:
    """Draw logs, each under a name, into a .png or .svg file."""
    records = [log.read(one) for one in logs]
    with figures.style("curves"):
        picture = draw(records, names)
        # On white: a file of its own has no page to take its colours from.
        data = figures.png(picture) if Path(path).suffix.lower() == ".png" else _svg(picture)
    with files.atomic(path) as stream:
        stream.write(data)


def _svg(picture: Any) -> bytes:
    import io

    data = io.BytesIO()
    picture.savefig(data, format="svg", metadata={"Date": None, "Creator": None}, facecolor="white")
    return data.getvalue()


def draw(logs: Sequence[Sequence[Record]], names: Sequence[str]) -> Any:
    """A matplotlib figure: a panel a stage, a colour a log, a line a part of the data.

    Time is the stage's own, minutes. The error is ``error_cm`` where the stage has it, else its first. An
    arrow shows how much sooner a log comes to the last one's end (see `races`). Axes are logarithmic where
    numbers differ much.
    """
    stages = _stages(logs)
    picture, panels = figures.figure(3.4 * len(stages) + 0.6, 3.2, len(stages))
    for axes, stage in zip(panels, stages, strict=True):
        which = _error(logs, stage)
        drawn: list[tuple[list[float], list[float]]] = []
        for colour, records in zip(_colours(len(logs)), logs, strict=True):
            for part, line in PARTS.items():
                minutes, errors = series(records, stage, part, which)
                drawn.append((minutes, errors))
                axes.plot(
                    minutes,
                    errors,
                    color=colour,
                    linestyle=line,
                    linewidth=1.2,
                    marker="." * (len(minutes) < 2),
                )
        having = [name for name, one in zip(names, logs, strict=True) if stage in _stages([one])]
        only = f" (only {', '.join(having)})" if len(having) < len(names) else ""
        axes.set_title(_plain(stage.replace("_", " ") + only), fontsize=9)
        axes.set_xlabel("minutes of training")
        axes.set_ylabel(LABELS.get(which, which.replace("_", " ")))
        for place, axis in enumerate((axes.xaxis, axes.yaxis)):
            numbers = [number for pair in drawn for number in pair[place]]
            ratio = max(numbers) / min(numbers) if numbers else 1
            if ratio > WIDE:
                (axes.set_yscale if place else axes.set_xscale)("log")
                axis.set_minor_formatter(partial(_sparse, digits="235" if ratio < 60 else "3"))
            else:
                axis.get_major_locator().set_params(nbins=5)
            axis.set_major_formatter("{x:g}")
        axes.grid(True, which="both", linewidth=0.5)
        for race in races(logs, names):
            if race.stage == stage and race.minutes is not None:
                _mark(axes, race, race.minutes)
    picture.legend(
        handles=_legend(names), loc="outside lower left", ncols=len(names) + len(PARTS), fontsize=8
    )
    return picture


def series(records: Sequence[Record], stage: str, part: str, error: str) -> tuple[list[float], list[float]]:
    """Minutes of a stage's own training, and an error on a part of the data at each; both above 0."""
    begun = 0.0
    minutes: list[float] = []
    errors: list[float] = []
    for record in records:
        if record["stage"] != stage:
            if not minutes:
                begun = record["seconds"]
            continue
        value = record["errors"].get(part, {}).get(error)
        if value is not None and value > 0 and record["seconds"] > begun:
            minutes.append((record["seconds"] - begun) / 60)
            errors.append(value)
    return minutes, errors


@dataclass(frozen=True)
class Race:
    """How soon a log comes to the error that another one ends with.

    Attributes
    ----------
    stage, part, error : of what: stage, part of the data, name of the error.
    name, other : what the logs are called.
    value : the other's last error.
    minutes, other_minutes : of the stage's training until the error is that small for the first time; None
        where it never is.
    first : whether that is the log's first evaluation, so that it may have been there before.
    last, last_minutes : the log's own last error, and when that was.
    """

    stage: str
    part: str
    error: str
    name: str
    other: str
    value: float
    minutes: float | None
    other_minutes: float
    first: bool
    last: float
    last_minutes: float

    @property
    def sooner(self) -> str:
        """Words for the ratio of both times."""
        if not self.minutes:
            return ""
        return _ratio(self.minutes, self.other_minutes, first=self.first)

    def told(self) -> str:
        """All of it on a line."""
        unit = " cm" if self.error.endswith("_cm") else ""
        what = f"{self.part.replace('_', '-')} {self.error.removesuffix('_cm').replace('_', ' ')}"
        goal = f"{self.other}'s last {what} of {self.value:.3g}{unit}"
        stage = self.stage.replace("_", " ")
        if self.minutes is None:
            own = f"in {self.last_minutes:.3g} minutes it comes to {self.last:.3g}{unit}"
            return f"{stage}: {self.name} does not reach {goal}: {own}"
        before = ", its first evaluation" if self.first else ""
        took = f"after {self.minutes:.3g} minutes{before}; {self.other} after {self.other_minutes:.3g}"
        return f"{stage}: {self.name} reaches {goal} {took}: {self.sooner}"


def _ratio(minutes: float, other_minutes: float, *, first: bool = False) -> str:
    """How much sooner the first time is; at least so much where it may have been sooner still."""
    times = other_minutes / minutes
    if 0.95 < times < 1.05:
        return "as soon"
    if times > 1:
        return f"{'at least ' * first}{times:.1f} times sooner"
    return f"{'at most ' * first}{1 / times:.1f} times later"


def told(found: Sequence[Race]) -> list[str]:
    """Lines of races; one more for each log that came to the end of several stages."""
    lines = [race.told() for race in found]
    for name in dict.fromkeys(race.name for race in found):
        own = [race for race in found if race.name == name]
        took = [race.minutes for race in own if race.minutes is not None]
        if len(own) == len(took) > 1:
            theirs = sum(race.other_minutes for race in own)
            ratio = _ratio(sum(took), theirs, first=any(race.first for race in own))
            lines.append(
                f"these {len(own)} stages: {name} after {sum(took):.3g} minutes, "
                f"{own[0].other} after {theirs:.3g}: {ratio}"
            )
    return lines


def races(logs: Sequence[Sequence[Record]], names: Sequence[str]) -> list[Race]:
    """Every log held against the last one, stage by stage, on held-out clips where both have some."""
    *others, reference = logs
    found = []
    for stage in _stages([reference]):
        which = _error(logs, stage)
        for records, name in zip(others, names, strict=False):
            for part in PARTS:
                minutes, errors = series(records, stage, part, which)
                other_minutes, other_errors = series(reference, stage, part, which)
                if errors and other_errors:
                    value = other_errors[-1]
                    ours, theirs = _first(minutes, errors, value), _first(other_minutes, other_errors, value)
                    found.append(
                        Race(
                            *(stage, part, which, name, names[-1], value, ours, theirs or other_minutes[-1]),
                            ours == minutes[0],
                            *(errors[-1], minutes[-1]),
                        )
                    )
                    break
    return found


def _first(minutes: Sequence[float], errors: Sequence[float], value: float) -> float | None:
    return next((at for at, error in zip(minutes, errors, strict=True) if error <= value), None)


def _mark(axes: Any, race: Race, minutes: float) -> None:
    """An arrow from when the other log came to an error to when this one did, and how much sooner that is."""
    far = {"arrowstyle": "->", "color": figures.INK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
    arrow = axes.annotate("", (minutes, race.value), (race.other_minutes, race.value), arrowprops=far)
    ends = (minutes, race.value), (race.other_minutes, race.value)
    (left, y), (right, _) = axes.transData.transform(ends)
    x, y = axes.transAxes.inverted().transform(((left + right) / 2, y))
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0}
    place = {"transform": axes.transAxes, "ha": "center", "va": "bottom", "bbox": box}
    words = axes.text(x, y + 0.015, race.sooner, fontsize=7, **place)
    for one in (arrow, words):
        one.set_in_layout(False)


def _stages(logs: Sequence[Sequence[Record]]) -> list[str]:
    """Of all logs, in their order."""
    return list(dict.fromkeys(record["stage"] for records in logs for record in records))


def _error(logs: Sequence[Sequence[Record]], stage: str) -> str:
    """The error of a stage that counts."""
    of_stage = [record for records in logs for record in records if record["stage"] == stage]
    found = dict.fromkeys(name for r in of_stage for errors in r["errors"].values() for name in errors)
    return "error_cm" if "error_cm" in found or not found else next(iter(found))


def _colours(count: int) -> list[str]:
    return [figures.COLOURS[i % len(figures.COLOURS)] for i in range(count)]


def _legend(names: Sequence[str]) -> list[Any]:
    from matplotlib.lines import Line2D

    colours = _colours(len(names))
    handles = [Line2D([], [], color=c, label=_plain(n)) for n, c in zip(names, colours, strict=True)]
    styles = [
        Line2D([], [], color=figures.INK, linestyle=line, label=part.replace("_", " "))
        for part, line in PARTS.items()
    ]
    return handles + styles


def _plain(text: str) -> str:
    """Text that holds no formulas."""
    return text.replace("$", r"\$")


def _sparse(value: float, place: int, digits: str) -> str:
    """Labels of a logarithmic axis between its powers of ten: those that begin with some digits only."""
    first = f"{value:e}"[0] if value > 0 and math.isfinite(value) else ""
    return f"{value:g}" if first and first in digits else ""
