"""The candidates of a search as a picture: where they are, why they were left out, their costs by feature."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..explain import CHOSEN, PLAYING, Candidate, Explanation
from ..layers import colours
from ..panel import fitting
from ..scene import Theme, colour

Image = NDArray[np.uint8]

_ROW, _LETTERS = 15, 11  # pixels
NONE = "no search that could be explained: of a run that takes\nthe database that it was recorded with"


def drawn(explanation: Explanation | None, theme: Theme, size: tuple[int, int], scale: float = 1.0) -> Image:
    """A picture of a size (width, height), uint8 [H, W, 3]; as many candidates as there is room for.

    Of each: what became of it, its clip and time there, its cost, the reason; below that its cost by feature,
    green where it is nothing, red where it is the dearest of all.
    """
    from PIL import Image as pillow
    from PIL import ImageDraw, ImageFont

    width, height = size
    row, font = round(_ROW * scale), ImageFont.load_default(_LETTERS * scale)
    bold = ImageFont.load_default(1.15 * _LETTERS * scale)
    canvas = pillow.new("RGB", size, _bytes(colour(theme.floor)))
    draw, ink = ImageDraw.Draw(canvas), _bytes(colour(theme.ink))
    if explanation is None:
        draw.text((6, 6), NONE, font=font, fill=ink)
        return np.asarray(canvas)
    rows = [*explanation.candidates, *([explanation.answer] if explanation.answer else [])]
    top = max((float(each.costs.max()) for each in rows), default=0.0) or 1.0
    playing = f"to play on costs {explanation.playing_cost:.3g}; others must be below {explanation.bound:.3g}"
    draw.text((6, 3), playing, font=bold, fill=ink)
    cells = np.linspace(6, width - 6, len(explanation.features) + 1)
    y = row + 6
    for k, name in enumerate(explanation.features):
        words = fitting(name.replace("_", " "), font, 2 * (cells[k + 1] - cells[k]) - 4)
        left = min(cells[k], width - 6 - draw.textlength(words, font))
        draw.text((left, y + (k % 3) * row), words, font=font, fill=ink)
    y += 3 * row + 4
    for each in rows:
        if y + 2 * row + 4 > height:
            break
        _candidate(draw, each, (y, row, width), cells, top, font, ink)
        y += 2 * row + 8
    return np.asarray(canvas)


def _candidate(
    draw: Any, each: Candidate, place: tuple, cells: NDArray, top: float, font: Any, ink: tuple
) -> None:
    y, row, width = place
    shade = {CHOSEN: colours.SOUGHT, PLAYING: colours.MATCHED}.get(each.verdict)
    where = f"{each.clip}{' mirrored' if each.mirrored else ''} {each.seconds:.2f} s" if each.clip else ""
    words = f"{each.cost:7.3g}  {each.verdict}  {where}: {each.reason}"
    fill = ink if shade is None else _bytes((shade + np.array(ink) / 255) / 2)
    draw.text((6, y), fitting(words, font, width - 12), font=font, fill=fill)
    for k, (cost, colour_of) in enumerate(zip(each.costs, colours.graded(each.costs / top), strict=True)):
        box = (cells[k], y + row, cells[k + 1] - 2, y + 2 * row)
        draw.rectangle(box, fill=_bytes(colour_of))
        draw.text((box[0] + 2, y + row + 1), f"{cost:.2f}", font=font, fill=(0, 0, 0))


def _bytes(shade: NDArray) -> tuple[int, ...]:
    return tuple(np.round(255 * np.asarray(shade)).astype(int).tolist())
