"""Figures of one style: as inline SVG that takes the page's text colour, or as PNG on white."""

from __future__ import annotations

import contextlib
import html
import io
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import marks

INK = "#0f0e0d"  # stands for the page's text colour in what matplotlib draws
COLOURS = (
    *("#2e86ab", "#d1495b", "#3c9d57", "#e09f3e", "#8e5fbf", "#17a2a2"),
    *("#c86f98", "#8a8d3f", "#7a8288", "#a05a2c", "#4f6fd0"),
)
DRAWN_POINTS = 400
PIXELS = 125  # of a page for an inch of a figure, at most: letters are of one size in all figures


@contextlib.contextmanager
def style(salt: str) -> Iterator[None]:
    """Matplotlib settings of all figures; salt makes the ids of one page's figures differ."""
    import matplotlib
    from cycler import cycler

    ink = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")
    settings: Any = dict.fromkeys(ink, INK) | {
        "svg.fonttype": "none",
        "path.simplify": False,  # a page finds points of a line by their number
        "svg.hashsalt": salt,
        "font.family": ["sans-serif"],
        "font.size": 8,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.facecolor": "none",
        "figure.facecolor": "none",
        "savefig.facecolor": "none",
        "legend.frameon": False,
        "legend.labelcolor": INK,
        "grid.color": "#8884",
        "axes.prop_cycle": cycler(color=COLOURS),
    }
    with matplotlib.rc_context(settings):
        yield


def figure(width: float, height: float, columns: int = 1, rows: int = 1) -> tuple[Any, NDArray]:
    """An empty figure (inches) and its axes, row by row."""
    from matplotlib.figure import Figure

    picture = Figure(figsize=(width, height), layout="constrained")
    return picture, np.ravel(picture.subplots(rows, columns))


def svg(picture: Any, label: str = "figure") -> str:
    """A figure as an SVG element for a page, with the marks of its parts; label: for who does not see it."""
    marks.mark_named(picture)
    text = io.StringIO()
    picture.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    body = text.getvalue()
    body = body[body.index("<svg") :].replace(INK, "currentColor")
    body = re.sub(r"<metadata>.*?</metadata>", "", body, count=1, flags=re.DOTALL)
    # Fonts are the page's own, sizes scale with the page, a hundredth of a point is not seen.
    body = re.sub(r"font: ([\d.]+px) [^;\"]*", r"font-size: \1", body)
    body = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+|\n", r"\1", path[0]), body)
    body = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", body, count=1)
    body = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", body, count=1)
    width = f"max-width: {round(PIXELS * picture.get_size_inches()[0])}px"
    body = body.replace("<svg ", f'<svg role="img" aria-label="{html.escape(label)}" style="{width}" ', 1)
    return marks.shown(_joined(body), picture)


def _joined(body: str) -> str:
    """Lines of one style that follow each other as one element: a film strip has a thousand bones."""
    out: list[str] = []
    last = ""
    for line in body.split("\n"):
        found = re.fullmatch(r'\s*<path d="([^"]*)"([^>]*style="fill: none[^>]*/>)', line)
        if found and found[2] == last:
            out[-1] = out[-1].removesuffix('"' + last) + found[1] + '"' + last
        else:
            out.append(line)
        last = found[2] if found else ""
    return "\n".join(out)


def thin(values: NDArray, points: int = DRAWN_POINTS) -> NDArray:
    """At most so many of the values, evenly."""
    return values[:: max(1, -(-len(values) // points))]


def png(picture: Any) -> bytes:
    """A figure as a PNG on white, to look at."""
    data = io.BytesIO()
    picture.savefig(data, format="png", dpi=110, facecolor="white")
    return data.getvalue()
