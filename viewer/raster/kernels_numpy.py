"""Plain twins of `kernels`, which say the same of a whole picture at once; for small ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .kernels import LEAST, NONE

Array = NDArray[Any]


def place(
    transforms: Array, parts: Array, vertices: Array, normals: Array, out_vertices: Array, out_normals: Array
) -> None:
    """See `kernels.place`."""
    turn, move = transforms[parts][..., :3], transforms[parts][..., 3]
    out_vertices[:] = np.einsum("vij,vj->vi", turn, vertices) + move
    out_normals[:] = np.einsum("vij,vj->vi", turn, normals)


def project(matrix: Array, vertices: Array, out: Array) -> None:
    """See `kernels.project`."""
    out[:] = vertices @ matrix[:, :3].T + matrix[:, 3]


def visibility(
    places: Array,
    triangles: Array,
    two_sided: Array,
    near: float,
    floor: Array,
    depth: Array,
    ids: Array,
    low: Array,
    high: Array,
    shares: Array,
) -> None:
    """See `kernels.visibility`: here every triangle is tried at every sample."""
    rows, columns = depth.shape
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    for f, corners in enumerate(places[triangles]):
        size = np.linalg.det(corners)
        if not abs(size) > LEAST or (size > 0 and not two_sided[f]) or (corners[:, 2] < near).all():
            continue
        shares[f] = np.linalg.inv(corners).T
        inside = shares[f] @ np.stack([x, y, np.ones_like(x)]).reshape(3, -1)
        z = inside.sum(axis=0).astype(np.float32).reshape(depth.shape)
        seen = (inside >= -1e-15).all(axis=0).reshape(depth.shape) & (z > depth) & (z > floor[:, None])
        depth[seen], ids[seen] = z[seen], f
    some = ids != NONE
    low[:] = np.where(some.any(axis=1), some.argmax(axis=1), columns)
    high[:] = np.where(some.any(axis=1), columns - some[:, ::-1].argmax(axis=1), 0)


def shade(
    image: Array,
    ids: Array,
    low: Array,
    high: Array,
    shares: Array,
    triangles: Array,
    vertices: Array,
    normals: Array,
    colours: Array,
    opacities: Array,
    shaded: Array,
    eye: Array,
    sun: Array,
    sky: Array,
    bounce: Array,
    shadow: Array,
    veil: Array,
) -> None:
    """See `kernels.shade`: here each sample is shaded by itself."""
    row, column = np.nonzero(ids != NONE)
    f = ids[row, column]
    places = np.stack([column + 0.5, row + 0.5, np.ones(len(row))], axis=-1)
    share = np.einsum("sik,sk->si", shares[f], places)
    share = share / share.sum(axis=-1, keepdims=True)
    at, normal, tint = (np.einsum("si,sik->sk", share, a[triangles[f]]) for a in (vertices, normals, colours))
    view = _units(eye - at)
    normal = _units(normal)
    facing = np.sum(normal * view, axis=-1, keepdims=True)
    a, b, c = np.moveaxis(vertices[triangles[f]], 1, 0)
    behind = np.sum(np.cross(b - a, c - a) * (eye - a), axis=-1, keepdims=True) < 0
    normal = np.where(behind & (facing < 0), -normal, normal)
    facing = np.where(behind, np.abs(facing), np.maximum(facing, 0))
    light = np.maximum((normal @ sun[:3] + 0.3) / 1.3, 0)[:, None]
    above = 0.5 + 0.5 * normal[:, 1:2]
    gloss = 0.1 * np.maximum(np.sum(normal * _units(sun[:3] + view), axis=-1, keepdims=True), 0) ** 24
    edge = 0.1 * (1 - facing) ** 4 * above
    found = tint * (sun[3] * light + bounce + (sky - bounce) * above) + gloss + edge
    spots = at[:, [0, 2]] + (at[:, 1:2] - veil[2]) * veil[:2] - veil[3:5]
    under = _sampled(shadow, spots * veil[5] - 0.5)
    found = found * np.where(shaded[f], 1 - veil[6] * under, 1)[:, None] ** 2
    found = 255 * np.sqrt(np.minimum(found, 1))
    samples = np.repeat(np.repeat(image, 2, axis=0), 2, axis=1).astype(np.float64)
    opacity = opacities[f][:, None]
    samples[row, column] = opacity * found + (1 - opacity) * samples[row, column]
    height, width = image.shape[:2]
    image[:] = (samples.reshape(height, 2, width, 2, 3).mean(axis=(1, 3)) + 0.5).astype(np.uint8)


def clear(depth: Array, ids: Array, low: Array, high: Array) -> None:
    """See `kernels.clear`."""
    depth[:], ids[:] = 0, NONE
    low[:], high[:] = depth.shape[1], 0


def cast(vertices: Array, triangles: Array, slant: Array, origin: Array, texel: float, mask: Array) -> None:
    """See `kernels.cast`: a cell is shaded whose middle lies inside of a triangle's shadow."""
    flat = (vertices[:, [0, 2]] + np.maximum(vertices[:, 1:2], 0) * slant - origin) / texel
    x, y = np.meshgrid(np.arange(mask.shape[1]) + 0.5, np.arange(mask.shape[0]) + 0.5)
    for corners in flat[triangles]:
        sides = [
            (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
            for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
        ]
        mask[(np.min(sides, axis=0) >= 0) | (np.max(sides, axis=0) <= 0)] = 1


def blur(mask: Array, reach: int, out: Array) -> None:
    """See `kernels.blur`."""
    padded = np.pad(mask, ((0, 0), (reach, reach)))
    count = 2 * reach + 1
    out[:] = np.mean([padded[:, i : i + mask.shape[1]] for i in range(count)], axis=0).T


def background(
    image: Array,
    eye: Array,
    axes: Array,
    focal: float,
    level: bool,
    grid: Array,
    colours: Array,
    shadow: Array,
    corner: Array,
    texel: float,
    darkness: float,
) -> None:
    """See `kernels.background`."""
    height, columns = image.shape[:2]
    right, down, ahead = axes
    spacing, width, cx, cz, radius = grid.astype(np.float64)
    zenith, horizon, floor, line = colours.astype(np.float64)
    u = ((np.arange(columns) + 0.5 - columns / 2) / focal)[None, :, None]
    v = ((np.arange(height) + 0.5 - height / 2) / focal)[:, None, None]
    ray = ahead + u * right + v * down
    sky = horizon + np.clip(1.6 * ray[..., 1:2], 0, 1) * (zenith - horizon)
    hit = (ray[..., 1:2] <= -1e-6) & bool(level and eye[1] > 0)
    far = -eye[1] / np.where(hit, ray[..., 1:2], -1)
    on = (eye + far * ray)[..., [0, 2]]
    # How far a pixel reaches on the ground: by the derivatives of its place.
    aside = np.abs(far * right[[0, 2]] / focal)
    away = -far * down[1] / ray[..., 1:2] * ray[..., [0, 2]] / focal
    filtered = aside + np.abs(np.where(hit, away, 0) + far * down[[0, 2]] / focal)
    fine = np.max(_lines(on / spacing, filtered / spacing, width / spacing), axis=-1, keepdims=True)
    coarse = _lines(on / spacing / 5, filtered / spacing / 5, 0.4 * width / spacing).max(
        axis=-1, keepdims=True
    )
    lines = np.maximum(0.6 * fine, coarse)
    left = np.maximum(1 - np.sum((on - [cx, cz]) ** 2, axis=-1, keepdims=True) / radius**2, 0) ** 2
    dark = darkness * _sampled(shadow, (on - corner) / texel - 0.5)[..., None]
    ground = horizon + left * ((floor + lines * (line - floor)) * (1 - dark) - horizon)
    image[:] = (np.where(hit, ground, sky) + 0.5).astype(np.uint8)


def strokes(
    image: Array,
    depth: Array,
    floor: Array,
    starts: Array,
    stops: Array,
    colours: Array,
    radius: float,
    bias: float,
    through: float,
    near: float,
) -> None:
    """See `kernels.strokes`: here every stroke is tried at every pixel."""
    height, width = image.shape[:2]
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)
    before = np.maximum(depth, floor[:, None]).reshape(height, 2, width, 2)
    for a, b, tint in zip(starts, stops, colours, strict=True):
        if max(a[2], b[2]) < near:
            continue
        ends = [
            p if p[2] >= near else p + (near - p[2]) / (q[2] - p[2]) * (q - p) for p, q in ((a, b), (b, a))
        ]
        (ax, bx), (wa, wb) = [p[:2] / p[2] for p in ends], [p[2] for p in ends]
        way = bx - ax
        t = np.clip((pixels - ax) @ way / max(way @ way, 1e-300), 0, 1)
        off = np.linalg.norm(pixels - ax - t[..., None] * way, axis=-1)
        z = (1 / wa + t * (1 / wb - 1 / wa)) * (1 + bias)
        free = (z[:, None, :, None] > before).mean(axis=(1, 3))
        cover = np.clip(radius + 0.5 - off, 0, 1) * min(2 * radius, 1) * (free + (1 - free) * through)
        image[:] = (image + cover[..., None] * (tint - image) + 0.5).astype(np.uint8)


def _units(v: Array) -> Array:
    found: Array = v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)
    return found


def _lines(u: Array, filtered: Array, width: float) -> Array:
    """Share of a stretch of length filtered around u that lies on lines of a width, around whole numbers."""
    filtered = np.maximum(filtered, 1e-6)

    def upto(x: Array) -> Array:
        found: Array = np.floor(x) * width + np.minimum(x - np.floor(x), width)
        return found

    start = u + width / 2 - filtered / 2
    share: Array = (upto(start + filtered) - upto(start)) / filtered
    return share


def _sampled(values: Array, at: Array) -> Array:
    """Values [rows, columns] between cells at places [..., 2] (column, row), 0 outside of their middles."""
    rows, columns = values.shape
    inside: Array = np.all((at > 0) & (at < np.array([columns, rows]) - 1), axis=-1)
    at = np.where(inside[..., None], at, 0)
    i, j = at[..., 0].astype(int), at[..., 1].astype(int)
    p, q = at[..., 0] - i, at[..., 1] - j
    k, m = np.minimum(i + 1, columns - 1), np.minimum(j + 1, rows - 1)
    above = values[j, i] + p * (values[j, k] - values[j, i])
    below = values[m, i] + p * (values[m, k] - values[m, i])
    found: Array = np.where(inside, above + q * (below - above), 0)
    return found
