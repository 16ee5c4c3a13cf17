"""Scenes as pictures.

Ground and sky are drawn first, as the pixels see them, then meshes by samples, then lines and points over
them, and at last labels. Shadows are those of the meshes on the level ground, drawn as seen from above.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from .. import shapes
from ..camera import NEAR, Camera, axes, focal, matrix, project
from ..scene import (
    Arrows,
    Floats,
    Labels,
    Layer,
    Lines,
    Mesh,
    Points,
    Scene,
    Solids,
    Surface,
    Theme,
    colour,
    levels,
)
from . import kernels, kernels_numpy, text

STANDARD = 720  # the height of pictures for which widths and sizes are given
_SUN, _SKY, _BOUNCE = 0.78, (0.36, 0.38, 0.41), (0.17, 0.16, 0.15)
_LINE = 0.016  # metres, the width of the ground's lines
_BIAS = 0.004  # share by which strokes count as nearer than they are: they lie on what they are about
_TEXEL, _MOST, _SOFT = 0.012, 600_000, 0.02  # metres a cell of shadows, cells, metres of their soft edge


@dataclass(eq=False)
class _Geometry:
    """Triangles in the world: arrays as the kernels take them."""

    vertices: Floats
    normals: Floats
    colours: Floats
    triangles: NDArray[np.int32]
    two_sided: NDArray[np.bool_]
    opacities: Floats
    shaded: NDArray[np.bool_]


class _Shadow(NamedTuple):
    """How dark a level plane is, 0 to 1 [rows of z, columns of x]: its corner, metres a cell, its height, and
    how far, in x and z, the light moves while it falls by a metre."""

    mask: Floats
    corner: NDArray
    texel: float
    level: float
    slant: NDArray


_NONE = _Shadow(np.zeros((1, 1), np.float32), np.zeros(2), 1.0, 0.0, np.zeros(2))


class Renderer:
    """Draws scenes as pictures of one size.

    Parameters
    ----------
    width, height : pixels.
    compiled : whether the compiled loops draw, or their plain and slow twins.
    """

    def __init__(self, width: int, height: int, *, compiled: bool = True) -> None:
        if min(width, height) < 1:
            raise ValueError(f"a picture of {width} x {height}")
        self.width, self.height = width, height
        self._loops: Any = kernels if compiled else kernels_numpy
        rows, columns = 2 * height, 2 * width
        self._depth = np.zeros((rows, columns), np.float32)
        self._ids = np.full((rows, columns), kernels.NONE, np.int32)
        self._low, self._high = np.full(rows, columns, np.int64), np.zeros(rows, np.int64)
        self._models: WeakKeyDictionary[Layer, tuple[int, Mesh, NDArray]] = WeakKeyDictionary()

    def render(self, scene: Scene, camera: Camera) -> NDArray[np.uint8]:
        """A picture of the scene, uint8 [height, width, 3]."""
        image = np.empty((self.height, self.width, 3), np.uint8)
        shown = [layer for layer in scene.layers.values() if layer.visible]
        solid = self._geometry(layer for layer in shown if _opacity(layer) == 1)
        clear = self._geometry(layer for layer in shown if _opacity(layer) < 1)
        shadow = _NONE
        if scene.ground is not None or solid.shaded.any():
            casters = self._geometry(layer for layer in shown if getattr(layer, "shadow", False))
            shadow = self._shadow(scene, casters)
        self._background(image, scene, camera, shadow)
        floor = self._floor(scene, camera)
        self._meshes(image, solid, camera, scene, floor, shadow)
        for layer in shown:
            if isinstance(layer, (Lines, Points)):
                self._strokes(image, layer, camera, floor)
        if len(clear.triangles):
            # Their own samples: what is seen through them is the picture so far, not one another.
            self._meshes(image, clear, camera, scene, floor, shadow)
        for layer in shown:
            if isinstance(layer, Labels):
                self._labels(image, layer, camera, scene.theme)
        self._loops.clear(self._depth, self._ids, self._low, self._high)
        return image

    def _geometry(self, layers: Iterable[Layer]) -> _Geometry:
        """All triangles of layers that have any, in the world."""
        found: list[tuple[Floats, Floats, Floats, NDArray[np.int32], bool, float, bool]] = []
        for layer in layers:
            if isinstance(layer, Solids):
                mesh, parts = self._model(layer)
                for transforms in layer.transforms:
                    vertices, normals = np.empty_like(mesh.vertices), np.empty_like(mesh.normals)
                    self._loops.place(transforms, parts, mesh.vertices, mesh.normals, vertices, normals)
                    found.append(
                        (vertices, normals, mesh.colours, mesh.triangles, False, layer.opacity, False)
                    )
            elif isinstance(layer, (Surface, Arrows)):
                mesh = _mesh(layer)
                sides, shaded = (getattr(layer, name, False) for name in ("two_sided", "shaded"))
                of = mesh.vertices, mesh.normals, mesh.colours**2, mesh.triangles
                found.append((*of, sides, _opacity(layer), shaded))
        if not found:
            none = np.zeros((0, 3), np.float32)
            no = none[:, 0] > 0
            return _Geometry(none, none, none, none.astype(np.int32), no, none[:, 0], no)
        firsts = np.cumsum([0, *(len(part[0]) for part in found)]).astype(np.int32)
        counts = [len(part[3]) for part in found]
        return _Geometry(
            np.concatenate([part[0] for part in found]),
            np.concatenate([part[1] for part in found]),
            np.concatenate([part[2] for part in found]),
            np.concatenate([part[3] + first for part, first in zip(found, firsts, strict=False)]),
            np.repeat([part[4] for part in found], counts),
            np.repeat(np.array([part[5] for part in found], np.float32), counts),
            np.repeat([part[6] for part in found], counts),
        )

    def _model(self, layer: Solids) -> tuple[Mesh, NDArray]:
        """The parts of solids as one mesh of linear colours, and which part each vertex is of; kept."""
        mark = hash(tuple(map(id, layer.parts)))
        kept = self._models.get(layer)
        if kept is None or kept[0] != mark:
            mesh = shapes.merged(layer.parts)
            mesh = Mesh(mesh.vertices, mesh.normals, mesh.triangles, mesh.colours**2)
            parts = np.repeat(np.arange(len(layer.parts)), [len(part.vertices) for part in layer.parts])
            kept = self._models[layer] = (mark, mesh, parts)
        return kept[1:]

    def _floor(self, scene: Scene, camera: Camera) -> Floats:
        """1 / w of the ground in each row of samples, 0 where there is none."""
        rows = (np.arange(2 * self.height) + 0.5) / 2
        turn, eye = axes(camera), camera.position
        fall = turn[2, 1] + (rows - self.height / 2) / focal(camera, self.height) * turn[1, 1]
        if scene.ground is None or eye[1] <= 0:
            return np.zeros(len(rows), np.float32)
        return np.maximum(-fall / eye[1], 0).astype(np.float32)

    def _background(self, image: NDArray, scene: Scene, camera: Camera, shadow: _Shadow) -> None:
        theme, ground = scene.theme, scene.ground
        colours = np.float32(255) * np.stack(
            [colour(c) for c in (theme.zenith, theme.horizon, theme.floor, theme.lines)]
        )
        grid = np.array([1.0, _LINE, 0, 0, 1], np.float32)
        if ground is not None:
            grid = np.array([ground.spacing, _LINE, *ground.centre, ground.radius], np.float32)
        self._loops.background(
            *(image, camera.position, axes(camera), focal(camera, self.height), ground is not None),
            *(grid, colours, shadow.mask, shadow.corner, shadow.texel, scene.sun.shadow),
        )

    def _shadow(self, scene: Scene, casters: _Geometry) -> _Shadow:
        """The shadow on the level ground, or on a plane as high as the lowest of those who cast it."""
        x, y, z = scene.sun.direction
        slant, vertices = np.array([-x / y, -z / y]), casters.vertices
        level = 0.0
        if scene.ground is None:
            level = float(
                np.nanmin(np.where(np.isfinite(vertices[:, 1]), vertices[:, 1], np.nan), initial=0.0)
            )
            vertices = vertices - np.array([0, level, 0], np.float32)
        reached = vertices[:, [0, 2]] + np.maximum(vertices[:, 1:2], 0) * slant
        reached = reached[np.isfinite(reached).all(axis=1)]
        if not len(reached):
            return _NONE
        low, high = reached.min(axis=0), reached.max(axis=0)
        texel = max(_TEXEL, float(np.sqrt(np.prod(high - low + 8 * _SOFT) / _MOST)))
        reach = max(1, round(_SOFT / texel))
        corner = low - (3 * reach + 2) * texel
        columns, rows = np.ceil((high - corner) / texel).astype(int) + 3 * reach + 2
        mask, turned = np.zeros((rows, columns), np.float32), np.empty((columns, rows), np.float32)
        self._loops.cast(vertices, casters.triangles, slant, corner, texel, mask)
        for _ in range(2):
            self._loops.blur(mask, reach, turned)
            self._loops.blur(turned, reach, mask)
        return _Shadow(mask, corner, texel, level, slant)

    def _meshes(
        self,
        image: NDArray,
        what: _Geometry,
        camera: Camera,
        scene: Scene,
        floor: Floats,
        shadow: _Shadow,
    ) -> None:
        if not len(what.triangles):
            return
        places = np.empty((len(what.vertices), 3))
        self._loops.project(matrix(camera, 2 * self.width, 2 * self.height), what.vertices, places)
        shares = np.empty((len(what.triangles), 3, 3))
        ids, low, high = self._ids, self._low, self._high
        if what.opacities[0] < 1:
            ids = np.full_like(ids, kernels.NONE)
        self._loops.visibility(
            *(places, what.triangles, what.two_sided, NEAR, floor),
            *(self._depth, ids, low, high, shares),
        )
        sun = np.array(scene.sun.direction, np.float64)
        light = np.append(sun / np.linalg.norm(sun), _SUN)
        veil = np.array(
            [*shadow.slant, shadow.level, *shadow.corner, 1 / shadow.texel, scene.sun.shadow], np.float64
        )
        self._loops.shade(
            *(image, ids, low, high, shares, what.triangles, what.vertices, what.normals),
            *(what.colours, what.opacities, what.shaded, camera.position, light),
            *(np.array(_SKY), np.array(_BOUNCE), shadow.mask, veil),
        )

    def _strokes(self, image: NDArray, layer: Lines | Points, camera: Camera, floor: Floats) -> None:
        if isinstance(layer, Lines):
            begin, end = layer.pieces()
            points, width = layer.points, layer.width
        else:
            begin = end = np.arange(len(layer.positions))
            points, width = layer.positions, layer.size
        if not len(begin):
            return
        places = np.empty((len(points), 3))
        self._loops.project(matrix(camera, self.width, self.height), points, places)
        shades = 255 * np.broadcast_to(layer.colours, points.shape)[begin].astype(np.float64)
        radius = width * self.height / STANDARD / 2
        self._loops.strokes(
            *(image, self._depth, floor, places[begin], places[end], shades),
            *(radius, _BIAS, layer.through, NEAR),
        )

    def _labels(self, image: NDArray, layer: Labels, camera: Camera, theme: Theme) -> None:
        places, far = project(camera, layer.positions, self.width, self.height)
        halo = levels(colour(theme.halo))
        inks = [colour(theme.ink)] * len(far)
        if layer.colours is not None:
            inks = list(np.broadcast_to(layer.colours, (len(far), 3)))
        size = max(6, round(layer.size * self.height / STANDARD))
        for k in np.argsort(-far):
            if far[k] < NEAR or not layer.texts[k].strip():
                continue
            stamp = text.picture(layer.texts[k], size, levels(inks[k]), halo)
            text.put(image, stamp, round(places[k, 0] - stamp.shape[1] / 2), round(places[k, 1] - len(stamp)))


def _opacity(layer: Layer) -> float:
    return float(getattr(layer, "opacity", 1.0))


def _mesh(layer: Surface | Arrows) -> Mesh:
    if isinstance(layer, Surface):
        return layer.mesh
    return shapes.arrows(layer.origins, layer.vectors, layer.colours, layer.radius)
