"""Pictures and films without a window: members on stages, with what is drawn about them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from features.terrain import Ground, flat

from . import layers, legend, panel, scene, views
from .cast import Member
from .layers import Moment, ghost, terrain
from .scene import Layer, Theme
from .stage import Marks, Stage
from .views import View

Image = NDArray[np.uint8]

DRAWABLE = {**{name: about for name, (about, _) in layers.DRAWN.items()}, **panel.PARTS}


@dataclass(frozen=True)
class Look:
    """How members are shown.

    Attributes
    ----------
    shown : of `DRAWABLE`, by name.
    names : whether names stand above them.
    apart : each in a picture of its own, side by side; otherwise all in one.
    ghost : the second one stands in the first one's place, clear.
    """

    theme: Theme = scene.LIGHT
    shown: Sequence[str] = ()
    names: bool = False
    apart: bool = False
    ghost: bool = False


def stages(members: Sequence[Member], look: Look) -> list[Stage]:
    """The stages that members stand on, each with those of its picture."""
    if look.ghost:
        first, second = members
        return [_stage([first], look, over=second)]
    return [_stage([each], look) for each in members] if look.apart else [_stage(members, look)]


def _stage(members: Sequence[Member], look: Look, over: Member | None = None) -> Stage:
    marks = [marks_of(each, look.shown, over=over) for each in members]
    stage = Stage([each.show for each in members], theme=look.theme, names=look.names, marks=marks)
    for i, each in enumerate(members):
        if each.ground is not flat:
            stage.lay(i, _terrain(each, each.ground))
    return stage


def marks_of(member: Member, shown: Sequence[str], *, over: Member | None = None) -> Marks:
    """What is drawn about a member at a time; over is another one that stands in its place, clear."""
    drawing = layers.Drawing([name for name in shown if name in layers.DRAWN])

    def marks(time: float) -> Mapping[str, Layer]:
        moment = Moment(member, time)
        found = drawing.at(moment)
        if over is not None:
            found |= {
                f"ghost {name}": layer for name, layer in ghost.over(moment, Moment(over, time)).items()
            }
        return found

    return marks


def _terrain(member: Member, ground: Ground) -> scene.Surface:
    """As much of a ground as a member walks on."""
    roots = member.timeline.stack("positions")[:, 0, [0, 2]].astype(np.float64)
    return terrain.surface(ground, np.nanmin(roots, axis=0), np.nanmax(roots, axis=0))


def filmed(
    members: Sequence[Member], look: Look, times: Sequence[float], size: tuple[int, int], view: View
) -> Iterator[Image]:
    """Pictures [H, W, 3] at rising times, all members at the same ones."""
    on = stages(members, look)
    told = [name for name in look.shown if name in panel.PARTS]
    gauges = [panel.Gauge(each, told) for each in members] if told else []
    if panel.covers(len(gauges), size, apart=look.apart, bodies=1 if look.ghost else len(members)):
        view = replace(view, above=panel.share(gauges, times, size, apart=look.apart))
    pictures = views.film(on[0], times, size, view) if len(on) == 1 else views.beside(on, times, size, view)
    if gauges:
        pictures = panel.on(pictures, times, gauges, look.theme, apart=look.apart)
    if look.shown or look.ghost:
        pictures = legend.on(pictures, times, _keys(look), look.theme)
    return pictures


def strip(
    members: Sequence[Member], look: Look, times: Sequence[float], size: tuple[int, int], view: View
) -> Iterator[Image]:
    """Parts of a picture, side by side: poses at each of the times; members apart stand in rows."""
    on = stages(members, look)
    edges = np.round(np.linspace(0, size[1], len(on) + 1)).astype(int)
    rows = [
        views.strip(stage, times, (size[0], int(high)), view)
        for stage, high in zip(on, np.diff(edges), strict=True)
    ]
    for cells in zip(*rows, strict=True):
        yield np.concatenate(cells, axis=0)


def joined(cells: Iterable[Image], look: Look) -> Image:
    """The parts of a strip as one picture, with its legend."""
    whole = views.joined(cells)
    legend.put(whole, _keys(look), look.theme, max(12, round(0.01 * whole.shape[1])))
    return whole


def _keys(look: Look) -> list[legend.Key]:
    return legend.of([*look.shown, *["ghost"] * look.ghost])
