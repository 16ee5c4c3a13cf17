"""What a search might have chosen: the ways of its candidates, and the boxes that it tells them apart by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features import normalise
from features.trajectory import points_to_world
from mm.search.aabb import SMALL

from ..explain import Candidate
from ..scene import Floats, Labels, Layer, Lines
from ..sources import offset_and_scale
from . import colours
from .moment import Moment, Root

Array = NDArray[np.floating]


def ways(moment: Moment) -> dict[str, Layer]:
    """The ways of the best frames, green to red by cost; that of the one that plays on is broad."""
    shown = _shown(moment)
    if not shown:
        return {}
    assert moment.search is not None
    root, shades = moment.search[1], _shades([each for each, _ in shown])
    lines = [moment.on_ground(moment.way(features, root)[0], 0.02) for _, features in shown]
    playing = int(moment.search[0]["frame"])
    found: dict[str, Layer] = {"ways": _lines(lines, shades, 2.0)}
    for (each, _), line, shade in zip(shown, lines, shades, strict=True):
        if each.frame == playing:
            found["playing"] = _lines([line], shade[None], 6.0)
            found["cost"] = Labels(texts=[f"{each.cost:.3g}"], positions=line[-1:], colours=shade, size=16.0)
    return found


def boxes(moment: Moment) -> dict[str, Layer]:
    """Around each candidate's samples those of its 16 frames, which the published index bounds at once.

    They are rectangles as the character faced; a feature's box has more sides than can be drawn.
    """
    shown, data, schema = _shown(moment), moment.member.data, moment.schema
    if not shown or data is None or schema is None:
        return {}
    assert moment.search is not None
    columns = schema.trajectory().position_columns
    columns = columns[columns >= 0]
    rectangles, shades = [], []
    for (each, _), shade in zip(shown, _shades([each for each, _ in shown]), strict=True):
        first = each.frame // SMALL * SMALL
        rows = normalise.denormalise(data.features[first : first + SMALL], *offset_and_scale(data))
        for column in columns:
            low, high = (bound(rows[:, column : column + 2], axis=0) for bound in (np.min, np.max))
            corners = np.array([low, (high[0], low[1]), high, (low[0], high[1]), low])
            rectangles.append(moment.on_ground(_placed(corners, moment.search[1]), 0.02))
            shades.append(shade)
    return {"small": _lines(rectangles, np.array(shades), 1.5)}


def _shown(moment: Moment) -> list[tuple[Candidate, Array]]:
    """Candidates of the last search with their features, dearest first, so that the best are drawn last."""
    explanation = moment.explanation
    if explanation is None or moment.schema is None or not len(moment.schema.trajectory()):
        return []
    found = [(each, moment.features(each.frame)) for each in reversed(explanation.candidates)]
    return [(each, features) for each, features in found if features is not None]


def _shades(candidates: list[Candidate]) -> Floats:
    """Green for the cheapest one, red for what costs three times as much."""
    costs = np.array([each.cost for each in candidates])
    return colours.graded((costs / max(costs.min(), 1e-9) - 1) / 2)


def _lines(lines: list[Array], shades: Floats, width: float) -> Lines:
    counts = [len(line) for line in lines]
    return Lines(
        points=np.concatenate(lines),
        starts=np.cumsum([0, *counts[:-1]]),
        colours=np.repeat(shades, counts, axis=0),
        width=width,
        through=0.3,
    )


def _placed(points: Array, root: Root) -> Array:
    return points_to_world(points, root.position, np.array(root.yaw))
