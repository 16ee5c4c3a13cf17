"""Words as pictures, kept for the next frame."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

_EDGE = 0.14  # width of the halo, in parts of the letters' size


@functools.lru_cache(maxsize=256)
def picture(text: str, size: int, ink: tuple[int, int, int], halo: tuple[int, int, int]) -> NDArray[np.uint8]:
    """A text in letters of a size (pixels) with a halo: uint8 [h, w, 4], red, green, blue and cover."""
    from PIL import Image, ImageDraw, ImageFont

    font, edge = ImageFont.load_default(size), max(1, round(_EDGE * size))
    left, top, right, bottom = font.getbbox(text, stroke_width=edge)
    canvas = Image.new("RGBA", (max(1, round(right - left)), max(1, round(bottom - top))), (*halo, 0))
    draw = ImageDraw.Draw(canvas)
    place = (-left, -top)
    draw.text(place, text, font=font, fill=(*halo, 190), stroke_width=edge, stroke_fill=(*halo, 190))
    draw.text(place, text, font=font, fill=(*ink, 255))
    return np.asarray(canvas)


def put(image: NDArray[np.uint8], stamp: NDArray[np.uint8], left: int, top: int) -> None:
    """Lay a picture with cover over image [H, W, 3], in place, as far as it lies inside."""
    height, width = image.shape[:2]
    rows = slice(max(top, 0), min(top + len(stamp), height))
    columns = slice(max(left, 0), min(left + stamp.shape[1], width))
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return
    part = stamp[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left].astype(
        np.float32
    )
    cover = part[..., 3:] / 255
    under = image[rows, columns]
    image[rows, columns] = np.round(under + cover * (part[..., :3] - under)).astype(np.uint8)
