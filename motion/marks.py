"""What the parts of a figure are, said to the script of the page that shows it.

An artist of matplotlib hands its `gid` on to SVG as the id of its element. Facts travel there as JSON, and
become attributes `data-..` of the element: what is drawn needs no second description beside it.
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote, unquote

PREFIX = "mark:"


def mark(artist: Any, *of: str, **facts: Any) -> None:
    """Tell a page's script which names an artist shows (a system, a part), and

    say : what a reader is told of it; a line tells its own numbers. always : whether it stays as it is where
    others are looked at. step : seconds from one point of a line
    to the next. Of axes: zoom, "x" or "xy", along which the reader may; cursor, a name that axes share whose
    readers point at one time, and seconds, of a unit along x (1).
    """
    _write(artist, {"of": of} | facts if of else facts)


def mark_named(picture: Any) -> None:
    """Mark what has a label with it, entries of legends with what they stand for, axes and notes as such."""
    from matplotlib.container import BarContainer
    from matplotlib.lines import Line2D

    known: dict[str, list[str]] = {}
    for number, axes in enumerate(picture.axes):
        _write(axes, _read(axes) | {"axes": number})
        for bars in axes.containers:
            if isinstance(bars, BarContainer):
                _mark_bars(axes, bars)
        for artist in (*axes.lines, *axes.collections, *axes.patches, *axes.containers):
            label, facts = str(artist.get_label()), {}
            if not isinstance(artist, BarContainer):
                facts = _read(artist)
                if "of" not in facts and not label.startswith("_"):
                    facts["of"] = [label]
                if isinstance(artist, Line2D) and "of" in facts and "say" not in facts:
                    facts["line"] = True
                if facts:
                    _write(artist, facts)
            names = known.setdefault(label, [])
            names += [name for name in facts.get("of", [label]) if name not in names]
        for text in axes.texts:
            _write(text, _read(text) | {"note": True})
    for legend in (*picture.legends, *filter(None, (axes.get_legend() for axes in picture.axes))):
        for text, handle in zip(legend.get_texts(), legend.legend_handles, strict=True):
            for artist in (text, handle) if text.get_text() in known else ():
                _write(artist, {"of": known[text.get_text()], "entry": True})


def _mark_bars(axes: Any, bars: Any) -> None:
    """Bars that have a name or say nothing yet say their values."""
    label = str(bars.get_label())
    unit = (axes.get_ylabel if bars.orientation == "vertical" else axes.get_xlabel)()
    for bar, value in zip(bars.patches, bars.datavalues, strict=True):
        facts = _read(bar)
        own = [] if label.startswith("_") else [label]
        of = list(dict.fromkeys([*facts.get("of", ()), *own]))
        if of:
            _write(bar, {"say": f"{value:.4g} {unit}".strip()} | facts | {"of": of})


def shown(body: str, picture: Any) -> str:
    """SVG of a figure as matplotlib wrote it, with what its parts bear as attributes.

    Axes tell where they stand and what they span, in units of the SVG; ticks are of class xtick and ytick.
    Ids are left that something refers to: others are the same in every figure.
    """
    used = set(re.findall(r'(?:url\(|href=")#([^")]+)', body))

    def attributes(found: re.Match[str]) -> str:
        name = found[1]
        if name.startswith(PREFIX):
            facts = _decoded(name)
            if "axes" in facts:
                facts |= _place(picture.axes[facts["axes"]])
            return _attributes(facts)
        if name.startswith(("xtick_", "ytick_")):
            return f'class="{name[:5]}"'
        return found[0] if name in used else ""

    return re.sub(r'\bid="([^"]*)"', attributes, body)


def _write(artist: Any, facts: Mapping[str, Any]) -> None:
    artist.set_gid(PREFIX + quote(json.dumps(facts)))


def _read(artist: Any) -> dict[str, Any]:
    gid = artist.get_gid() or ""
    return _decoded(gid) if gid.startswith(PREFIX) else {}


def _decoded(gid: str) -> dict[str, Any]:
    facts: dict[str, Any] = json.loads(unquote(gid.removeprefix(PREFIX)))
    return facts


def _attributes(facts: Mapping[str, Any]) -> str:
    """Text as it is, all else as JSON."""
    texts = {k: v if isinstance(v, str) else json.dumps(v, ensure_ascii=False) for k, v in facts.items()}
    return " ".join(f'data-{k}="{html.escape(v)}"' for k, v in texts.items())


def _place(axes: Any) -> dict[str, Any]:
    """Where axes stand in a figure that was drawn, [left, top, right, bottom], and what they span."""
    width, height = 72 * axes.figure.get_size_inches()
    at = axes.get_position()
    edges = (at.x0 * width, (1 - at.y1) * height, at.x1 * width, (1 - at.y0) * height)
    out: dict[str, Any] = {"box": [round(float(edge), 2) for edge in edges]}
    for name, axis, limits in (("x", axes.xaxis, axes.get_xlim()), ("y", axes.yaxis, axes.get_ylim())):
        if axis.get_scale() in ("linear", "log"):
            out[name] = [float(limit) for limit in limits]
            shared = getattr(axes, f"get_shared_{name}_axes")().get_siblings(axes)
            labels = [getattr(one, f"get_{name}label")() for one in (axes, *shared)]
            out[f"{name}scale"] = axis.get_scale()
            out[f"{name}label"] = next(filter(None, labels), "")
    return out
