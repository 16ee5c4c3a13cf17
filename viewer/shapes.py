"""Meshes of simple bodies: what sections along a line enclose, capsules, ellipsoids, arrows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .scene import Floats, Mesh

Array = NDArray[np.float64]

AROUND = 14  # corners of a section
_CAP = np.radians([75.0, 50.0, 25.0])  # where a round end has sections


def loft(
    centres: ArrayLike, first: ArrayLike, second: ArrayLike, colour: ArrayLike, *, square: float = 2.0
) -> Mesh:
    """The closed surface around R sections.

    centres [R, 3] are their middles, first and second [R, 3] their half axes. A section is a superellipse:
    |u|^square + |v|^square = 1, an ellipse for 2, nearly a rectangle for 6.
    """
    centres, first, second = (np.asarray(a, np.float64) for a in (centres, first, second))
    angles = np.arange(AROUND) * (2 * np.pi / AROUND)
    u, v = (np.sign(w) * np.abs(w) ** (2 / square) for w in (np.cos(angles), np.sin(angles)))
    rings = centres[:, None] + u[:, None] * first[:, None] + v[:, None] * second[:, None]
    vertices = np.concatenate([rings.reshape(-1, 3), centres[:1], centres[-1:]])
    k = np.arange(AROUND)
    n = (k + 1) % AROUND
    last = (len(centres) - 1) * AROUND
    low, high = np.full(AROUND, len(vertices) - 2), np.full(AROUND, len(vertices) - 1)
    faces = [np.stack([low, n, k], -1), np.stack([high, last + k, last + n], -1)]
    for r in range(0, last, AROUND):
        faces += [np.stack([r + k, r + n, r + AROUND + n], -1)]
        faces += [np.stack([r + k, r + AROUND + n, r + AROUND + k], -1)]
    return smooth(vertices, np.concatenate(faces), colour)


def smooth(vertices: Array, triangles: NDArray, colour: ArrayLike) -> Mesh:
    """A closed surface turned to the outside, with normals that are the mean of the faces around a vertex."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    if np.sum(np.cross(a, b) * c) < 0:
        triangles = triangles[:, ::-1]
    found = normals(vertices, triangles).astype(np.float32)
    return Mesh(vertices.astype(np.float32), found, triangles, np.asarray(colour, np.float32))


def normals(vertices: Array, triangles: NDArray) -> Array:
    """Unit normals [V, 3]: the faces' around each vertex, by their areas."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    faces = np.cross(b - a, c - a)
    found = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(found, triangles[:, i], faces)
    return found / np.maximum(np.linalg.norm(found, axis=-1, keepdims=True), 1e-30)


def limb(
    frame: ArrayLike,
    start: ArrayLike,
    stations: Sequence[tuple[float, ...]],
    colour: ArrayLike,
    *,
    caps: tuple[float, float] = (1.0, 1.0),
    square: float = 2.0,
) -> Mesh:
    """A round-ended body along an axis.

    Parameters
    ----------
    frame : [3, 3], rows along the axis, and along the sections' first and second half axis.
    start : [3], where the axis begins.
    stations : (distance along the axis, half axis, half axis[, shift along the second one]), metres.
    caps : how far the ends bulge, in parts of their mean half axis.
    """
    frame, start = np.asarray(frame, np.float64), np.asarray(start, np.float64)
    rows = np.array([(*station, 0.0)[:4] for station in stations], np.float64)
    ends = []
    for row, sign, bulge in ((rows[0], -1, caps[0]), (rows[-1], 1, caps[1])):
        share = np.cos(_CAP)[:, None]
        cap = np.repeat(row[None], len(_CAP), axis=0)
        cap[:, 1:3] *= share
        cap[:, 0] += sign * bulge * np.sin(_CAP) * row[1:3].mean()
        ends.append(cap)
    rows = np.concatenate([ends[0], rows, ends[1][::-1]])
    centres = start + rows[:, :1] * frame[0] + rows[:, 3:] * frame[2]
    return loft(centres, rows[:, 1:2] * frame[1], rows[:, 2:3] * frame[2], colour, square=square)


def capsule(start: ArrayLike, stop: ArrayLike, radii: tuple[float, float], colour: ArrayLike) -> Mesh:
    """A capsule between two points [3], its radius going from one to the other."""
    start, stop = np.asarray(start, np.float64), np.asarray(stop, np.float64)
    length = float(np.linalg.norm(stop - start))
    along = (stop - start) / length if length > 1e-9 else np.array([0.0, 1.0, 0.0])
    stations = [(0.0, radii[0], radii[0]), (max(length, 1e-4), radii[1], radii[1])]
    return limb(across(along), start, stations, colour)


def ellipsoid(centre: ArrayLike, half_axes: ArrayLike, colour: ArrayLike) -> Mesh:
    """An ellipsoid by its centre [3] and half axes [3, 3], in rows."""
    axis, first, second = np.asarray(half_axes, np.float64)
    angles = np.radians(np.arange(-80, 81, 20.0))[:, None]
    centres = np.asarray(centre, np.float64) + np.sin(angles) * axis
    return loft(centres, np.cos(angles) * first, np.cos(angles) * second, colour)


def across(along: Array) -> Array:
    """Rows [3, 3] of unit vectors, right-handed, the first one given."""
    other = np.eye(3)[np.argmin(np.abs(along))]
    second = np.cross(along, other)
    second /= np.linalg.norm(second)
    return np.stack([along, second, np.cross(along, second)])


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one."""
    firsts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.normals for m in meshes]),
        np.concatenate([m.triangles + first for m, first in zip(meshes, firsts, strict=False)]),
        np.concatenate([m.colours for m in meshes]),
    )


def arrows(origins: Floats, vectors: Floats, colours: Floats, radius: float) -> Mesh:
    """Arrows as one mesh: shafts and heads, which are shorter where the arrow is; none without a length."""
    made = []
    for origin, vector, colour in zip(origins, vectors, np.broadcast_to(colours, origins.shape), strict=True):
        length = float(np.linalg.norm(vector))
        if length > 1e-6:
            made.append(_arrow(origin, vector / length, length, radius, colour))
    empty = np.zeros((0, 3), np.float32)
    return merged(made) if made else Mesh(empty, empty, np.zeros((0, 3), np.int32), empty)


def _arrow(origin: Floats, along: Floats, length: float, radius: float, colour: Floats) -> Mesh:
    head = min(5 * radius, 0.6 * length)
    wide = 2.4 * radius * head / (5 * radius)
    frame = across(along.astype(np.float64))
    rows = np.array([(0, radius), (length - head, radius), (length - head, wide), (length, 0.05 * radius)])
    middles = origin + rows[:, :1] * frame[0]
    return loft(middles, rows[:, 1:] * frame[1], rows[:, 1:] * frame[2], colour)
