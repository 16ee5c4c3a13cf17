"""The numbers of accessors: typed, strided, normalised and sparse views of a buffer's bytes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import digits
from .document import Bytes, Document, Item

MOST_KEYS, MOST_ZEROS = 10_000_000, 100_000  # zeros cost the file nothing
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_COMPRESSED = ("EXT_meshopt_compression", "KHR_meshopt_compression")


def numbers(document: Document, index: int, kind: str) -> NDArray[np.float64]:
    """Values [count, width] of an accessor of a kind (such as VEC3), normalised integers as fractions.

    A signed byte c stands for max(c / 127, -1), others likewise. Errors: UserError for another kind, bytes
    that the buffer does not have, and numbers that are not finite.
    """
    item = document.items("accessors")[index]
    if item.text("type") != kind:
        raise item.fault(f"type is {item.data.get('type')!r}, expected {kind!r} here")
    count = item.integer("count", least=1, most=MOST_KEYS)
    dtype = _dtype(item, _COMPONENTS)
    if item.index("bufferView", "bufferViews") is None:
        if count > MOST_ZEROS:
            raise item.fault(f"{count} values without a bufferView", f"at most {MOST_ZEROS} are read")
        raw = np.zeros((count, _WIDTHS[kind]), dtype)
    else:
        raw = _view(item, dtype, count, _WIDTHS[kind])
    sparse = item.item("sparse")
    if sparse is not None:
        raw = _replaced(sparse, raw)
    with np.errstate(invalid="ignore"):
        values = raw.astype(np.float64)
    if dtype.kind != "f" and item.data.get("normalized", False):
        values = np.maximum(values / np.iinfo(dtype).max, -1)
    if not (np.abs(values) <= digits.LIMIT).all():
        key = np.flatnonzero(~(np.abs(values) <= digits.LIMIT).all(axis=-1))[0]
        raise item.fault(f"value {key} is not finite: {raw[key].tolist()}", "repair it or cut it out")
    return values


def _dtype(item: Item, choices: dict[int, str]) -> np.dtype:
    code = item.integer("componentType")
    if code not in choices:
        raise item.fault(f"componentType is {code}, expected one of {', '.join(map(str, choices))}")
    return np.dtype(choices[code])


def _view(item: Item, dtype: np.dtype, count: int, width: int) -> NDArray:
    """A view [count, width] of the bytes that an item's bufferView and byteOffset name."""
    document = item.document
    index = item.index("bufferView", "bufferViews")
    if index is None:
        raise item.fault("bufferView is missing")
    view = document.items("bufferViews")[index]
    data = block(view)
    size = dtype.itemsize * width
    stride = view.integer("byteStride", size, least=1, most=252) if "byteStride" in view.data else size
    offset = item.integer("byteOffset", 0)
    if stride < size or offset + stride * (count - 1) + size > len(data):
        raise item.fault(
            f"{count} values of {size} bytes, {stride} apart from byte {offset} on, do not fit into the "
            f"{len(data)} bytes of {view.where}"
        )
    return np.ndarray((count, width), dtype, data.data, offset, (stride, dtype.itemsize))


def block(view: Item) -> Bytes:
    """The bytes of a bufferView; compressed ones, and those that its buffer has not, are a UserError."""
    extensions = view.item("extensions")
    for name in _COMPRESSED:
        if extensions is not None and name in extensions.data:
            raise view.fault(f"it is compressed by {name}, which is not supported", "export it uncompressed")
    buffer = view.index("buffer", "buffers")
    if buffer is None:
        raise view.fault("buffer is missing")
    data = view.document.buffer(buffer)
    start, length = view.integer("byteOffset", 0), view.integer("byteLength", least=1)
    if start + length > len(data):
        raise view.fault(f"it ends at byte {start + length} of a buffer of {len(data)}")
    return data[start : start + length]


def _replaced(sparse: Item, raw: NDArray) -> NDArray:
    """The values with those replaced that a sparse accessor names."""
    count = sparse.integer("count", least=1, most=len(raw))
    places = sparse.needed("indices")
    kinds = {code: _COMPONENTS[code] for code in (5121, 5123, 5125)}
    indices = _view(places, _dtype(places, kinds), count, 1)[:, 0].astype(np.int64)
    if indices[-1] >= len(raw) or (np.diff(indices) <= 0).any():
        raise places.fault(f"they do not rise, or go beyond the {len(raw)} values")
    raw = raw.copy()
    raw[indices] = _view(sparse.needed("values"), raw.dtype, count, raw.shape[1])
    return raw
