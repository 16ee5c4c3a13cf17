"""What a picture says of a character beside showing it: numbers with their last seconds, a phase, shares."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from features.terrain import flat
from lmm.locomotion.window import GAITS

from . import curves
from .cast import Member
from .layers import colours
from .layers.moment import Moment
from .raster import text
from .raster.renderer import STANDARD
from .scene import Floats, Theme, colour, levels

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

PARTS = {
    "panel": "name, cost, speed walked and asked, skate, time of a step, phase, gait",
    "costs": "of the frame that plays, for the last query, by feature",
}
HISTORY = 4.0  # seconds of a plot
LEAST = 0.02  # share below which an expert or a gait has no bar
MOST_BARS = 8
_WIDTH, _ROW, _LETTERS, _PAD = 268, 22, 15, 9  # pixels of a picture 720 high
_COVER = 205  # of 255: how much of the picture it hides
_BODY = 0.55  # of a picture's height: how wide a body is in it
_MOST_HIDDEN, _LOOKS = 0.5, 8  # the share that panels may take; instants at which one looks how high they are
# Lines of plots are no lower than these at their top, so that standing looks like standing.
_TOPS = {"cost": 1.0, "speed": 2.0, "skate": 10.0, "step": 1.0}


class Row(NamedTuple):
    """A number: its name, itself with its unit, its last seconds [T], and what is told beside them [T]."""

    name: str
    value: str
    history: NDArray[np.floating]
    beside: NDArray[np.floating] | None = None
    top: float = 1.0


class Bar(NamedTuple):
    """A share, 0 to 1, with its name, value and colour."""

    name: str
    share: float
    value: str
    shade: Floats


@dataclass(frozen=True, eq=False)
class Told:
    """All that a panel says: its name, rows, bars, and the angle of its dial, radians, or None."""

    name: str
    rows: Sequence[Row] = ()
    bars: Sequence[Bar] = ()
    phase: float | None = None


class Gauge:
    """Tells what a member's panel says at times from a step on; parts are some of `PARTS`."""

    def __init__(self, member: Member, parts: Sequence[str] = ("panel",), *, since: int = 0) -> None:
        self.member, self.parts = member, parts
        self._timeline = member.timeline.held(since=since)
        self._curves = curves.of(self._timeline, contact_roles=member.contact_roles)
        self._tops = {
            name: max(top, float(np.nanquantile(self._curves[name], 0.99)))
            for name, top in _TOPS.items()
            if np.isfinite(self._curves[name]).any()
        }

    def at(self, time: float) -> Told:
        """What there is to say at a time, seconds."""
        moment = Moment(self.member, time)
        several = f", the first of {self.member.show.count}" if self.member.show.count > 1 else ""
        told = Told(self.member.name + several)
        if "panel" in self.parts:
            phase = moment.record.get("phase")
            told = Told(told.name, self._rows(time), _shares(moment), None if phase is None else float(phase))
        if "costs" in self.parts:
            told = Told(told.name, told.rows, [*told.bars, *_costs(moment)], told.phase)
        return told

    def _rows(self, time: float) -> list[Row]:
        timeline, found = self._timeline, list[Row]()
        now = timeline.step_at(time) - timeline.first
        past = slice(max(0, now + 1 - round(HISTORY * timeline.fps)), now + 1)
        for name, decimals in (("cost", 2), ("speed", 2), ("skate", 1), ("step", 2)):
            values = self._curves[name]
            # How feet skate is told by how high they are above level ground.
            if name not in self._tops or (name == "skate" and self.member.ground is not flat):
                continue
            asked = self._curves["asked"] if name == "speed" else np.full(1, np.nan)
            value = f"{values[now]:.{decimals}f}" if np.isfinite(values[now]) else "-"
            if np.isfinite(asked).any():
                value += f" of {asked[now]:.{decimals}f}"
            beside = asked[past] if np.isfinite(asked).any() else None
            value = f"{value} {curves.UNITS[name]}".strip()
            found.append(Row(name, value, values[past], beside, self._tops[name]))
        return found


def _shares(moment: Moment) -> list[Bar]:
    """Gaits and experts that count."""
    found = []
    for key, names in (("gait", GAITS), ("experts", None)):
        for k, share in enumerate(np.atleast_1d(moment.record.get(key, np.zeros(0)))):
            if share >= LEAST:
                name = names[k] if names is not None else f"expert {k + 1}"
                shade = colours.PREDICTED if names is not None else colours.GROUND
                found.append(Bar(name, float(share), f"{share:.0%}", shade))
    return found


def _costs(moment: Moment) -> list[Bar]:
    """What the frame that plays costs by feature, dearest first; all the width is half of the whole cost."""
    costs, schema = moment.record.get("feature_costs"), moment.schema
    if costs is None or schema is None or not np.isfinite(costs).all():
        return []
    total = max(float(costs.sum()), 1e-6)
    order = np.argsort(-costs, kind="stable")[:MOST_BARS]
    shares = np.minimum(2 * costs / total, 1)
    return [
        Bar(
            schema.features[k].name.replace("_", " "),
            float(shares[k]),
            f"{costs[k]:.2f}",
            colours.graded(shares[k]),
        )
        for k in order
    ]


def covers(count: int, size: tuple[int, int], *, apart: bool, bodies: int) -> bool:
    """Whether so many panels would hide some of the bodies in a picture, or in their parts of it."""
    if not count:
        return False
    each, shown = (size[0] / count, 1) if apart else (size[0], bodies)
    beside = (each - shown * _BODY * size[1]) / 2
    return (count > 2 and not apart) or _WIDTH * _scale(size, count) > beside


def share(
    gauges: Sequence[Gauge], times: Sequence[float], size: tuple[int, int], *, apart: bool = False
) -> float:
    """The share of a picture's height that panels take at these times."""
    scale = _scale(size, len(gauges))
    some = np.unique(np.linspace(times[0], times[-1], min(len(times), _LOOKS)))
    high = max(_height(gauge.at(time), scale) for gauge in gauges for time in some)
    return min((high + 10 * scale) / size[1], _MOST_HIDDEN)


def _scale(size: tuple[int, int], count: int) -> float:
    return float(min(size[1] / STANDARD, 0.94 * size[0] / count / _WIDTH))


def on(
    pictures: Iterable[Image],
    times: Iterable[float],
    gauges: Sequence[Gauge],
    theme: Theme,
    *,
    apart: bool = False,
) -> Iterator[Image]:
    """Pictures with the panels of those in them, side by side in their order.

    apart : whether each has an equal part of the picture; else panels keep to the picture's edges.
    """
    for picture, time in zip(pictures, times, strict=True):
        wide = picture.shape[1] / len(gauges)
        scale = _scale((picture.shape[1], len(picture)), len(gauges))
        edge = round(10 * scale)
        for i, gauge in enumerate(gauges):
            stamp = drawn(gauge.at(time), theme, scale)
            room = picture.shape[1] - 2 * edge - stamp.shape[1]
            left = edge + round(i * wide if apart else i * room / max(len(gauges) - 1, 1))
            text.put(picture, stamp, left, edge)
        yield picture


def drawn(told: Told, theme: Theme, scale: float = 1.0) -> Image:
    """A panel as a picture with cover, uint8 [h, w, 4]; scale 1 is for pictures 720 pixels high."""
    from PIL import Image as pillow
    from PIL import ImageDraw, ImageFont

    width, row, pad = (max(1, round(n * scale)) for n in (_WIDTH, _ROW, _PAD))
    small, large = (ImageFont.load_default(max(6, round(n * scale))) for n in (_LETTERS, 1.3 * _LETTERS))
    height = _height(told, scale)
    ink, back = levels(colour(theme.ink)), levels(colour(theme.halo))
    faint: Colour = tuple((3 * b + i) // 4 for b, i in zip(back, ink, strict=True))  # type: ignore[assignment]
    canvas = pillow.new("RGBA", (width, height), (*back, _COVER))
    draw = ImageDraw.Draw(canvas)
    draw.text((pad, pad), told.name, font=large, fill=(*ink, 255))
    if told.phase is not None:
        _dial(draw, told.phase, (width - pad - 0.7 * row, pad + 0.6 * row), 0.65 * row, ink, faint, scale)
    y = pad + round(1.5 * row)
    for line in told.rows:
        draw.text((pad, y), line.name, font=small, fill=(*ink, 255))
        draw.text((pad + 2.2 * row, y), line.value, font=small, fill=(*ink, 255))
        box = (width - pad - 2.9 * row, y + 2 * scale, width - pad, y + row - 3 * scale)
        draw.line([(box[0], box[3]), (box[2], box[3])], fill=(*faint, 255))
        for values, shade in ((line.beside, colours.ASKED), (line.history, colours.PREDICTED)):
            if values is not None:
                _plot(draw, values, line.top, box, levels(shade), scale)
        y += row
    for bar in told.bars:
        box = (width - pad - 2.9 * row, y + 0.28 * row, width - pad, y + 0.72 * row)
        draw.text((pad, y), fitting(bar.name, small, box[0] - 3.1 * row), font=small, fill=(*ink, 255))
        value = (box[0] - 0.3 * row, y)
        draw.text(value, bar.value, font=small, fill=(*ink, 255), anchor="ra")
        draw.rectangle(box, fill=(*faint, 255))
        end = box[0] + (box[2] - box[0]) * float(np.clip(bar.share, 0, 1))
        draw.rectangle((box[0], box[1], end, box[3]), fill=(*levels(bar.shade), 255))
        y += row
    return np.asarray(canvas)


def fitted(told: Sequence[Told], size: tuple[int, int]) -> float:
    """The scale at which panels, one below the other, fit into a size (width, height)."""
    return min(size[0] / _WIDTH, size[1] / sum(_height(each, 1.0) for each in told))


def _height(told: Told, scale: float) -> int:
    row, pad = (max(1, round(n * scale)) for n in (_ROW, _PAD))
    return round(1.5 * row) + row * (len(told.rows) + len(told.bars)) + 2 * pad


def _plot(draw: Any, values: NDArray, top: float, box: tuple, shade: Colour, scale: float) -> None:
    """A line through values, the last one at the right edge; gaps where they are no numbers."""
    left, above, right, below = box
    x = right - (right - left) * np.arange(len(values))[::-1] / max(len(values) - 1, 1)
    y = below - (below - above) * np.clip(np.asarray(values, np.float64) / top, 0, 1)
    width = max(1, round(1.6 * scale))
    known = np.isfinite(y)
    for part in np.split(np.flatnonzero(known), np.flatnonzero(np.diff(np.flatnonzero(known)) > 1) + 1):
        if len(part) > 1:
            draw.line(list(zip(x[part], y[part], strict=True)), fill=(*shade, 255), width=width)


def _dial(
    draw: Any,
    phase: float,
    middle: tuple[float, float],
    radius: float,
    ink: Colour,
    faint: Colour,
    scale: float,
) -> None:
    """A phase, 0 at the top, clockwise: the right foot touches there, the left one at the bottom."""
    x, y = middle
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=(*faint, 255))
    hand = (x + radius * np.sin(phase), y - radius * np.cos(phase))
    draw.line([middle, hand], fill=(*levels(colours.ASKED), 255), width=max(2, round(3.5 * scale)))
    for at, foot in ((-1, "R"), (1, "L")):
        draw.text(
            (x - 1.15 * radius, y + at * 0.6 * radius),
            foot,
            fill=(*ink, 255),
            anchor="rm",
            font_size=max(6, 11 * scale),
        )


def fitting(words: str, font: Any, width: float) -> str:
    """As much of a text as there is room for."""
    if font.getlength(words) <= width:
        return words
    while words and font.getlength(words + "..") > width:
        words = words[:-1]
    return words + ".."
