"""Meshes of simple bodies: what sections along a line enclose, capsules, ellipsoids, arrows."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

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
    u, v = (np.sign(w) * np.abs(w) ** (2 / square) for w in _circle())
    rings = centres[:, None] + u[:, None] * first[:, None] + v[:, None] * second[:, None]
    vertices = np.concatenate([rings.reshape(-1, 3), centres[:1], centres[-1:]])
    return smooth(vertices, _faces(len(centres)), colour)


def _circle() -> tuple[Array, Array]:
    angles = np.arange(AROUND) * (2 * np.pi / AROUND)
    return np.cos(angles), np.sin(angles)


@cache
def _faces(sections: int) -> NDArray[np.int64]:
    """Triangles around so many sections, one after the other, and the middles of the first and last one."""
    k = np.arange(AROUND)
    n = (k + 1) % AROUND
    last = (sections - 1) * AROUND
    low, high = (np.full(AROUND, sections * AROUND + end) for end in (0, 1))
    faces = [np.stack([low, n, k], -1), np.stack([high, last + k, last + n], -1)]
    for r in range(0, last, AROUND):
        faces += [np.stack([r + k, r + n, r + AROUND + n], -1)]
        faces += [np.stack([r + k, r + AROUND + n, r + AROUND + k], -1)]
    return np.concatenate(faces)


def smooth(vertices: Array, triangles: NDArray, colour: ArrayLike) -> Mesh:
    """A closed surface turned to the outside, with normals that are the mean of the faces around a vertex."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    if np.sum(_cross(a, b) * c) < 0:
        triangles = triangles[:, ::-1]
    found = normals(vertices, triangles).astype(np.float32)
    return Mesh(vertices.astype(np.float32), found, triangles, np.asarray(colour, np.float32))


def normals(vertices: Array, triangles: NDArray) -> Array:
    """Unit normals [V, 3]: the faces' around each vertex, by their areas."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    faces, at = _cross(b - a, c - a), triangles.T.ravel()
    sums = [np.bincount(at, np.tile(faces[:, i], 3), len(vertices)) for i in range(3)]
    found = np.stack(sums, axis=-1)
    return found / np.maximum(np.linalg.norm(found, axis=-1, keepdims=True), 1e-30)


def _cross(a: Array, b: Array) -> Array:
    # Arrows are made in every frame of a window; np.cross spends most of its time on generality.
    x, y, z = (
        a[:, (i + 1) % 3] * b[:, (i + 2) % 3] - a[:, (i + 2) % 3] * b[:, (i + 1) % 3] for i in range(3)
    )
    return np.stack([x, y, z], axis=-1)


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
    """Rows [..., 3, 3] of unit vectors, right-handed, the first one given [..., 3]."""
    other = np.eye(3)[np.argmin(np.abs(along), axis=-1)]
    second = np.cross(along, other)
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    return np.stack([along, second, np.cross(along, second)], axis=-2)


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
    lengths = np.linalg.norm(vectors, axis=-1)
    long = np.flatnonzero(lengths > 1e-6)
    if not len(long):
        empty = np.zeros((0, 3), np.float32)
        return Mesh(empty, empty, np.zeros((0, 3), np.int32), empty)
    start, length = origins[long].astype(np.float64), lengths[long].astype(np.float64)
    frames = across(vectors[long] / length[:, None])
    head = np.minimum(5 * radius, 0.6 * length)
    shaft, none = np.full_like(head, radius), np.zeros_like(head)
    places = np.stack([none, length - head, length - head, length], axis=-1)
    radii = np.stack([shaft, shaft, 2.4 * head / 5, 0.05 * shaft], axis=-1)
    middles = start[:, None] + places[..., None] * frames[:, None, 0]
    u, v = (w[:, None] * frames[:, None, i] for i, w in enumerate(_circle(), start=1))  # [arrows, AROUND, 3]
    rings = middles[:, :, None] + radii[..., None, None] * (u + v)[:, None]
    vertices = np.concatenate([rings.reshape(len(long), -1, 3), middles[:, [0, -1]]], axis=1)
    faces, corners = _faces(places.shape[1]), vertices.shape[1]
    triangles = faces + corners * np.arange(len(long))[:, None, None]
    shades = np.repeat(np.broadcast_to(colours, origins.shape)[long], corners, axis=0)
    return smooth(vertices.reshape(-1, 3), triangles.reshape(-1, 3), shades)
