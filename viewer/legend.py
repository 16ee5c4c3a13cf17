"""What colours mean in a picture, and when it is: a line at its bottom."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .layers import colours, ghost
from .raster import text
from .raster.renderer import STANDARD
from .scene import Floats, Theme, colour, levels

Image = NDArray[np.uint8]


class Key(NamedTuple):
    """A colour, as ``#rrggbb``, and what it is of."""

    shade: str
    words: str


def _key(shade: Floats, words: str) -> Key:
    return Key("#" + bytes(levels(shade)).hex(), words)


_CHEAP, _DEAR = colours.graded(0.0), colours.graded(1.0)
KEYS: dict[str, Sequence[Key]] = {
    "trajectory": (_key(colours.ASKED, "asked"), _key(colours.PREDICTED, "predicted")),
    "match": (_key(colours.MATCHED, "frame that plays"),),
    "features": (_key(colours.SOUGHT, "query"), _key(colours.MATCHED, "what answered it")),
    "contacts": (_key(colours.TOUCHING, "touches"), _key(colours.HELD, "held")),
    "candidates": (_key(_CHEAP, "cheapest"), _key(_DEAR, "three times as dear")),
    "boxes": (_key(_CHEAP, "cheapest"), _key(_DEAR, "three times as dear")),
    "samples": (_key(colours.GROUND, "heights asked for"),),
    "ghost": (_key(_CHEAP, "as one"), _key(_DEAR, f"{100 * ghost.FAR:.0f} cm apart")),
}
_LETTERS = 15  # pixels of a picture 720 high


def of(names: Iterable[str]) -> list[Key]:
    """The keys of what is drawn, each once."""
    found = {key.words: key for name in names for key in KEYS.get(name, ())}
    return list(found.values())


def on(
    pictures: Iterable[Image], times: Iterable[float], keys: Sequence[Key], theme: Theme
) -> Iterator[Image]:
    """Pictures with the keys at the left, as many as there is room for, and the time at the right."""
    for picture, time in zip(pictures, times, strict=True):
        height, width = picture.shape[:2]
        size = max(6, round(_LETTERS * height / STANDARD))
        top = height - round(2.2 * size)
        moment = _line((), f"{time:.2f} s", size, theme)
        right = width - size // 2 - moment.shape[1]
        put(picture, keys, theme, size, room=right, top=top)
        text.put(picture, moment, right, top)
        yield picture


def put(
    picture: Image, keys: Sequence[Key], theme: Theme, size: int, *, room: int | None = None, top: int = 0
) -> None:
    """Lay keys in letters of a size (pixels) over a picture, as many as there is room for from the left."""
    room = picture.shape[1] if room is None else room
    while (line := _line(tuple(keys), "", size, theme)).shape[1] > room and keys:
        keys = keys[:-1]
    text.put(picture, line, size // 2, top)


@functools.lru_cache(maxsize=64)
def _line(keys: tuple[Key, ...], words: str, size: int, theme: Theme) -> Image:
    """Keys and words on one line of 2 letters' height, as a picture with cover uint8 [h, w, 4]."""
    from PIL import Image as pillow
    from PIL import ImageDraw, ImageFont

    font, edge = ImageFont.load_default(size), max(1, round(0.14 * size))
    widths = [font.getlength(key.words) for key in keys]
    whole = sum(widths) + 2.8 * size * len(keys) + font.getlength(words) + size
    canvas = pillow.new("RGBA", (round(whole), 2 * size), (*levels(colour(theme.halo)), 0))
    draw = ImageDraw.Draw(canvas)
    ink, halo, base = (*levels(colour(theme.ink)), 255), (*levels(colour(theme.halo)), 190), 1.45 * size

    def put(left: float, said: str) -> None:
        draw.text((left, base), said, font=font, fill=halo, anchor="ls", stroke_width=edge, stroke_fill=halo)
        draw.text((left, base), said, font=font, fill=ink, anchor="ls")

    left = 0.5 * size
    for key, width in zip(keys, widths, strict=True):
        draw.ellipse((left, base - 0.8 * size, left + 0.85 * size, base + 0.05 * size), fill=key.shade)
        put(left + 1.3 * size, key.words)
        left += 2.8 * size + width
    put(left, words)
    return np.asarray(canvas)
