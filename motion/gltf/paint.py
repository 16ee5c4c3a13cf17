"""Colours of a mesh where its vertices are: its material's, those of its texture, and its own.

All are linear, and what a mesh has of them is multiplied (the specification, 3.9.2 and 3.7.2.1).
"""

from __future__ import annotations

import io
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import Note, UserError
from . import accessors
from .document import Document, Item, of_uri

Array = NDArray[np.float64]

GREY = (0.5, 0.5, 0.5)  # of what tells no colour
SIDE = 256  # texels to which a texture is made smaller: vertices lie farther apart
MOST_TEXELS = 1 << 26
_REPEAT, _MIRRORED, _CLAMPED = 10497, 33648, 33071


def colours(document: Document, primitive: Item, count: int) -> Array:
    """Linear colours [count, 3] of a primitive's vertices. A texture that cannot be read is a `Note`."""
    attributes = primitive.needed("attributes")
    index = primitive.index("material", "materials")
    surface = None if index is None else document.items("materials")[index].item("pbrMetallicRoughness")
    factor = None if surface is None else surface.numbers("baseColorFactor", 4)
    parts = [] if factor is None else [np.clip(factor[:3], 0, 1)]
    own = attributes.index("COLOR_0", "accessors")
    if own is not None:
        kind = "VEC4" if document.items("accessors")[own].data.get("type") == "VEC4" else "VEC3"
        parts.append(_each(attributes, accessors.numbers(document, own, kind), count)[:, :3].clip(0, 1))
    painted = None if surface is None else surface.item("baseColorTexture")
    if painted is not None:
        places = attributes.index(f"TEXCOORD_{painted.integer('texCoord', 0)}", "accessors")
        texels = _texels(document, painted.index("index", "textures"))
        if places is not None and texels is not None:
            spots = _each(attributes, accessors.numbers(document, places, "VEC2"), count)
            parts.append(_at(texels, spots, _wraps(document, painted)))
    return np.broadcast_to(np.prod(np.broadcast_arrays(*parts), axis=0) if parts else GREY, (count, 3))


def _each(attributes: Item, values: Array, count: int) -> Array:
    if len(values) != count:
        raise attributes.fault(f"{len(values)} colours or their places for {count} vertices")
    return values


def _at(texels: Array, places: Array, wraps: tuple[int, int]) -> Array:
    """Colours [V, 3] of an image [H, W, 3] at places [V, 2], the first texel's corner being at 0, 0."""
    found = []
    for axis, wrap in enumerate(wraps):
        side, at = texels.shape[1 - axis], places[:, axis]
        if wrap == _MIRRORED:
            at = 1 - np.abs(at % 2 - 1)
        elif wrap != _CLAMPED:
            at = at % 1
        found.append(np.clip(np.floor(at * side), 0, side - 1).astype(np.int64))
    return np.asarray(texels[found[1], found[0]])


def _wraps(document: Document, painted: Item) -> tuple[int, int]:
    """What lies beyond a texture's edges, along both of its axes."""
    texture = painted.index("index", "textures")
    sampler = None if texture is None else document.items("textures")[texture].index("sampler", "samplers")
    if sampler is None:
        return _REPEAT, _REPEAT
    of = document.items("samplers")[sampler]
    return of.integer("wrapS", _REPEAT), of.integer("wrapT", _REPEAT)


def _texels(document: Document, texture: int | None) -> Array | None:
    """An image's linear colours [H, W, 3], at most `SIDE` to a side; None where it cannot be read."""
    source = None if texture is None else document.items("textures")[texture].index("source", "images")
    if source is None:
        return None  # of a kind that an extension tells of
    item = document.items("images")[source]
    try:
        return (_picture(_bytes(document, item)) / 255) ** 2.2
    except (UserError, OSError, ValueError, SyntaxError) as error:
        said = error.what if isinstance(error, UserError) else f"{item.where}: {error}"
        warnings.warn(Note(f"{document.path}: shown without a texture: {said}"), stacklevel=2)
        return None


def _bytes(document: Document, item: Item) -> bytes:
    view = item.index("bufferView", "bufferViews")
    data = (
        of_uri(document.path, item) if view is None else accessors.block(document.items("bufferViews")[view])
    )
    return data.tobytes()


def _picture(data: bytes) -> NDArray[Any]:
    from PIL import Image as pillow

    try:
        opened = pillow.open(io.BytesIO(data))
    except pillow.DecompressionBombError as error:
        raise ValueError(error) from error
    with opened as image:
        if image.width * image.height > MOST_TEXELS:
            raise ValueError(f"{image.width} x {image.height} texels")
        small = image.convert("RGB")
        small.thumbnail((SIDE, SIDE), pillow.Resampling.BOX)
        return np.asarray(small, np.float64)
