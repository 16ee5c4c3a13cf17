"""The candidates of a search as a picture: where they are, why they were left out, their costs by feature."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..explain import CHOSEN, PLAYING, Candidate, Explanation
from ..layers import colours
from ..panel import fitting
from ..scene import Theme, colour

Image = NDArray[np.uint8]

_ROW, _LETTERS = 15, 11  # pixels
NONE = (
    "no search that could be explained: some networks make none,\n"
    "and a run's take the database that it was recorded with"
)


def drawn(
    explanation: Explanation | None,
    theme: Theme,
    size: tuple[int, int],
    scale: float = 1.0,
    *,
    name: str = "",
) -> Image:
    """A picture of a size (width, height), uint8 [H, W, 3]; as many candidates as there is room for.

    name : whose search it is, where that is to be said.

    Of each: what became of it, its clip and time there, its cost, the reason, on a line of its own where it
    is long; below that its cost by feature, green where it is nothing, red where it is the dearest of all.
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
    playing = f"{name}: {playing}" if name else playing
    large = bold if draw.textlength(playing, bold) <= width - 12 else font
    draw.text((6, 3), fitting(playing, large, width - 12), font=large, fill=ink)
    cells = np.linspace(6, width - 6, len(explanation.features) + 1)
    y = row + 6
    for k, name in enumerate(explanation.features):
        words = fitting(name.replace("_", " "), font, 2 * (cells[k + 1] - cells[k]) - 4)
        left = min(cells[k], width - 6 - draw.textlength(words, font))
        draw.text((left, y + (k % 3) * row), words, font=font, fill=ink)
    y += 3 * row + 4
    for each in rows:
        lines = _told(each, lambda words: bool(draw.textlength(words, font) <= width - 12))
        if y + (len(lines) + 1) * row + 4 > height:
            break
        shade = {CHOSEN: colours.SOUGHT, PLAYING: colours.MATCHED}.get(each.verdict)
        fill = ink if shade is None else _bytes((shade + np.array(ink) / 255) / 2)
        for line in lines:
            draw.text((6, y), fitting(line, font, width - 12), font=font, fill=fill)
            y += row
        for k, (cost, colour_of) in enumerate(zip(each.costs, colours.graded(each.costs / top), strict=True)):
            draw.rectangle((cells[k], y, cells[k + 1] - 2, y + row), fill=_bytes(colour_of))
            told = f"{cost:.2f}" if cost >= 0.1 else f"{round(float(cost), 4):.1g}"
            draw.text((cells[k] + 2, y + 1), told, font=font, fill=(0, 0, 0))
        y += row + 8
    return np.asarray(canvas)


def _told(each: Candidate, fits: Callable[[str], bool]) -> list[str]:
    """What is told of a candidate, on a line where it fits, else the reason on another one."""
    where = f"{each.clip}{' mirrored' if each.mirrored else ''} {each.seconds:.2f} s" if each.clip else ""
    head = f"{each.cost:7.3g}  {each.verdict}  {where}"
    whole = f"{head}: {each.reason}"
    return [whole] if fits(whole) else [head, f"          {each.reason}"]


def _bytes(shade: NDArray) -> tuple[int, ...]:
    return tuple(np.round(255 * np.asarray(shade)).astype(int).tolist())
