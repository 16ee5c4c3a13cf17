"""Scenes drawn by Open3D: only what changed since the last frame is told to it.

Moving a geometry takes 15 us and making one 0.2 ms or more, so rigid parts, balls and arrows are made once
and moved, and so are the parts' shadows: copies of them pressed flat onto the ground along the light, as in
the films of `viewer.raster`. What is seen through bodies is drawn nearer to the eye: shrunk around it, it
looks the same, and lies before all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np
import open3d as o3d
from numpy.typing import ArrayLike, NDArray
from open3d.visualization import gui, rendering

from .. import shapes
from ..camera import NEAR, Camera, axes, focal
from ..scene import (
    Arrows,
    Floats,
    Ground,
    Labels,
    Layer,
    Lines,
    Mesh,
    Points,
    Scene,
    Solids,
    Sun,
    Surface,
    Theme,
    colour,
)

Array = NDArray[np.floating]

FAR = 500.0  # metres beyond which nothing is drawn
_SUN, _SKY = 50_000, 34_000  # lights' strengths, by which bodies look as in the films of `viewer.raster`
_UNEVEN = 0.75  # of its colours' light that uneven ground gives back: it faces the sun, and has no shadows
_LETTER = 0.5  # how wide letters are on average, in parts of their height
_LIFT = 0.003  # metres by which shadows lie on the ground, and its lines half of that
_BEFORE = 0.08  # how near what is seen through bodies is drawn, in parts of its distance
_SHADES = 24  # levels of each of the three colours of points that have colours of their own
_LARGE = 24.0  # pixels of the largest points
_RINGS, _AROUND = 24, 48  # of the floor
_STEP = 1.3  # ratio of one radius of the ground to the next
_LINE = np.array([[0.0, 0, 0], [1, 0, 0]])  # ends of an arrow's parts, and half axes there
_ROUND = np.array([[[0.0, 1, 0]] * 2, [[0.0, 0, 1]] * 2])


class Drawing:
    """What a window's scene widget shows.

    Parameters
    ----------
    widget : of a window that is open.
    pixels : pixels of the screen for one of a picture 720 high: widths and sizes are given for that.
    smooth : whether edges are, which takes several samples a pixel.
    """

    def __init__(self, widget: Any, *, pixels: float = 1.0, smooth: bool = True) -> None:
        self._widget, self._scene, self._pixels = widget, widget.scene, pixels
        self._drawn: dict[str, _Drawn] = {}
        self._around: tuple[Theme, Sun] | None = None
        self._floor: tuple[Any, ...] | None = None
        view = self._scene.view
        view.set_sample_count(4 if smooth else 1)
        view.set_shadowing(False)
        view.set_ambient_occlusion(False)
        view.set_post_processing(False)  # would bend colours, and takes most of a frame's time without a card
        self._scene.show_skybox(False)

    def show(self, scene: Scene, eye: Camera) -> None:
        """Let the widget show the scene as seen by this camera."""
        self._light(scene)
        self._ground(scene)
        for name in [
            name for name, drawn in self._drawn.items() if scene.layers.get(name) is not drawn.layer
        ]:
            self._drawn.pop(name).clear()
        for name, layer in scene.layers.items():
            drawn = self._drawn.get(name)
            if drawn is None:
                drawn = self._drawn[name] = _KINDS[type(layer)](self, name, layer)
            drawn.show(scene, eye)
        self._see(eye)

    def _see(self, eye: Camera) -> None:
        frame, camera = self._widget.frame, self._scene.camera
        aspect = frame.width / max(frame.height, 1)
        camera.set_projection(np.degrees(eye.field), aspect, NEAR, FAR, rendering.Camera.FovType.Vertical)
        camera.look_at(eye.target, eye.position, [0.0, 1.0, 0.0])

    def _light(self, scene: Scene) -> None:
        if self._around == (scene.theme, scene.sun):
            return
        self._around = scene.theme, scene.sun
        # Of the background alone Open3D takes the colour for sRGB, and shows it as it is in linear light.
        self._scene.set_background(np.append(colour(scene.theme.horizon) ** (1 / 2.2), 1.0))
        world, towards = self._scene.scene, np.array(scene.sun.direction)
        world.set_sun_light(
            (-towards / np.linalg.norm(towards)).astype(np.float32), np.ones(3, np.float32), _SUN
        )
        world.enable_sun_light(True)
        world.set_indirect_light_intensity(_SKY)

    def _ground(self, scene: Scene) -> None:
        """The floor fades into the background around its middle; its lines stay where they are."""
        ground = scene.ground
        if ground is None:
            for name in ("floor", "grid"):
                self.remove(name)
            self._floor = None
            return
        radius = _STEP ** np.ceil(np.log(ground.radius) / np.log(_STEP))
        every = 5 * ground.spacing
        middle = np.round(np.array(ground.centre) / every) * every
        if self._floor != (made := (radius, ground.spacing, scene.theme)):
            self._floor = made
            self.add("floor", mesh_of(_floor(radius + every, scene.theme)), material("defaultUnlit"))
            self.add(
                "grid",
                lines_of(*_grid(ground, radius, scene.theme)),
                material("unlitLine", line_width=1.2 * self._pixels),
            )
        for name, lift in (("floor", 0.0), ("grid", _LIFT / 2)):
            place = np.eye(4)
            place[:3, 3] = [middle[0], lift, middle[1]]
            self.place(name, place)

    # What the layers draw with

    def add(self, name: str, geometry: Any, how: Any) -> None:
        """Draw a geometry in place of the one that had this name."""
        self.remove(name)
        self._scene.add_geometry(name, geometry, how, False)
        self._scene.scene.set_geometry_culling(
            name, False
        )  # its bounds are not those of where it is moved to

    def remove(self, name: str) -> None:
        if self._scene.has_geometry(name):
            self._scene.remove_geometry(name)

    def place(self, name: str, transform: Array) -> None:
        self._scene.set_geometry_transform(name, transform)

    def has(self, name: str) -> bool:
        return bool(self._scene.has_geometry(name))

    @property
    def pixels(self) -> float:
        return self._pixels

    @property
    def widget(self) -> Any:
        return self._widget


class _Drawn:
    """One layer as it is drawn."""

    def __init__(self, drawing: Drawing, name: str, layer: Any) -> None:
        self.drawing, self.name, self.layer = drawing, name, layer
        self._seen: tuple[int, bool] | None = None

    def show(self, scene: Scene, eye: Camera) -> None:
        now = self.layer.revision, self.layer.visible
        if now != self._seen:
            self._seen = now
            if self.layer.visible:
                self.change(scene, eye)
            else:
                self.clear()
        if self.layer.visible:
            self.follow(eye)

    def change(self, scene: Scene, eye: Camera) -> None:
        """Draw the layer as it is now."""
        raise NotImplementedError

    def follow(self, eye: Camera) -> None:
        """What there is to do in every frame."""

    def clear(self) -> None:
        """Draw nothing of it."""
        raise NotImplementedError


class _Parts(_Drawn):
    """Solids: each part is a geometry that is moved, and so is its shadow."""

    layer: Solids
    _made: tuple[Any, ...] = ()
    _names: tuple[tuple[str, str | None], ...] = ()

    def change(self, scene: Scene, eye: Camera) -> None:
        layer = self.layer
        shaded = casts(layer, scene)
        made = (len(layer.transforms), tuple(map(id, layer.parts)), layer.opacity, shaded, scene.theme)
        if made != self._made:
            self.clear()
            self._made, self._names = made, tuple(self._make(scene))
        poses = np.zeros((*layer.transforms.shape[:2], 4, 4))
        poses[..., :3, :], poses[..., 3, 3] = layer.transforms, 1.0
        shades = pressed(scene.sun) @ poses
        for (name, shade), pose, flat in zip(
            self._names, poses.reshape(-1, 4, 4), shades.reshape(-1, 4, 4), strict=True
        ):
            self.drawing.place(name, pose)
            if shade is not None:
                self.drawing.place(shade, flat)

    def _make(self, scene: Scene) -> Iterator[tuple[str, str | None]]:
        layer = self.layer
        shapes_made = [mesh_of(part) for part in layer.parts]
        outlines = [mesh_of(part, shade_of(scene)) for part in layer.parts]
        for n in range(len(layer.transforms)):
            for k, (shape, outline) in enumerate(zip(shapes_made, outlines, strict=True)):
                name, shade = f"{self.name} {n} {k}", f"{self.name} {n} {k} shadow"
                self.drawing.add(name, shape, solid(layer.opacity))
                if casts(layer, scene):
                    self.drawing.add(shade, outline, material("defaultUnlit"))
                yield name, shade if casts(layer, scene) else None

    def clear(self) -> None:
        for name in [each for pair in self._names for each in pair if each is not None]:
            self.drawing.remove(name)
        self._made, self._names = (), ()


class _Whole(_Drawn):
    """A surface: a geometry that is made anew when it changes."""

    layer: Surface

    def change(self, scene: Scene, eye: Camera) -> None:
        layer = self.layer
        self.clear()
        mesh = layer.mesh
        if not len(mesh.triangles) or not np.isfinite(mesh.vertices).all():
            return
        self.drawing.add(self.name, mesh_of(mesh), solid(layer.opacity, _UNEVEN if layer.shaded else 1.0))
        if casts(layer, scene):
            shade = f"{self.name} shadow"
            self.drawing.add(shade, mesh_of(mesh, shade_of(scene)), material("defaultUnlit"))
            self.drawing.place(shade, pressed(scene.sun))

    def clear(self) -> None:
        self.drawing.remove(self.name)
        self.drawing.remove(f"{self.name} shadow")


class _Copies:
    """A shape in several colours, and each of its copies a geometry that is moved: more are made only where
    there were never so many."""

    def __init__(self, drawing: Drawing, name: str, shape: Callable[[], Mesh], how: Any) -> None:
        self._drawing, self._name, self._shape, self._how = drawing, name, shape, how
        self._shades = np.zeros((0, 3), np.float32)

    def show(self, transforms: Array, shades: Floats) -> None:
        """Let there be a copy at each of the transforms [N, 4, 4], in colours [N, 3]."""
        count, same = len(transforms), min(len(transforms), len(self._shades))
        for k in range(count, len(self._shades)):
            self._drawing.remove(f"{self._name} {k}")
        changed = [*np.flatnonzero((shades[:same] != self._shades[:same]).any(axis=1)), *range(same, count)]
        made: dict[bytes, Any] = {}
        for k in changed:
            key = shades[k].tobytes()
            if key not in made:
                made[key] = mesh_of(self._shape(), shades[k])
            self._drawing.add(f"{self._name} {k}", made[key], self._how)
        self._shades = np.array(shades, np.float32)
        self.move(transforms)

    def move(self, transforms: Array) -> None:
        for k, transform in enumerate(transforms):
            self._drawing.place(f"{self._name} {k}", transform)

    def clear(self) -> None:
        self.show(np.zeros((0, 4, 4)), np.zeros((0, 3), np.float32))


class _Darts(_Drawn):
    """Arrows: shafts and heads."""

    layer: Arrows

    def __init__(self, drawing: Drawing, name: str, layer: Arrows) -> None:
        super().__init__(drawing, name, layer)
        self._parts = [
            _Copies(drawing, f"{name} {part}", shape, solid(1.0))
            for part, shape in (("shafts", _shaft), ("heads", _head))
        ]

    def change(self, scene: Scene, eye: Camera) -> None:
        layer = self.layer
        lengths = np.linalg.norm(layer.vectors, axis=-1)
        long = np.flatnonzero(np.isfinite(layer.origins).all(axis=1) & (lengths > 1e-6))
        shades = np.broadcast_to(layer.colours, layer.origins.shape)[long]
        placed = arrow_places(layer.origins[long], layer.vectors[long], layer.radius)
        for part, transforms in zip(self._parts, placed, strict=True):
            part.show(transforms, shades)

    def clear(self) -> None:
        for part in self._parts:
            part.clear()


class _Through(_Drawn):
    """What may be seen through bodies."""

    layer: Lines | Points

    def nearer(self, eye: Camera, share: float = 1.0) -> Array:
        """Where it is drawn instead, [4, 4], at a share of the usual distance."""
        near = _BEFORE * share if self.layer.through > 0 else 1.0
        found = np.diag([near, near, near, 1.0])
        found[:3, 3] = (1 - near) * eye.position
        return found


class _Strokes(_Through):
    """Lines."""

    def follow(self, eye: Camera) -> None:
        if self.drawing.has(self.name):
            self.drawing.place(self.name, self.nearer(eye))

    def clear(self) -> None:
        self.drawing.remove(self.name)

    layer: Lines

    def change(self, scene: Scene, eye: Camera) -> None:
        layer = self.layer
        self.clear()
        begin, end = layer.pieces()
        known = np.asarray(np.isfinite(layer.points).all(axis=1))
        points = np.where(known[:, None], layer.points, 0.0)
        # Open3D crashes on lines that all are without a length.
        long = np.abs(points[end] - points[begin]).max(axis=-1, initial=0) > 1e-5
        pieces = np.stack([begin, end], -1)[known[begin] & known[end] & long]
        if len(pieces):
            shades = np.broadcast_to(layer.colours, layer.points.shape)[pieces[:, 0]]
            how = material("unlitLine", line_width=layer.width * self.drawing.pixels)
            self.drawing.add(self.name, lines_of(points, pieces, shades), how)


class _Dots(_Through):
    """Points, as balls without shades."""

    layer: Points

    def __init__(self, drawing: Drawing, name: str, layer: Points) -> None:
        super().__init__(drawing, name, layer)
        self._balls = _Copies(drawing, name, _ball, material("defaultUnlit"))

    def change(self, scene: Scene, eye: Camera) -> None:
        known = np.isfinite(self.layer.positions).all(axis=1)
        shades = np.broadcast_to(self.layer.colours, self.layer.positions.shape)[known]
        if self.layer.colours.ndim > 1:  # that may change in every frame, a little
            shades = np.round(_SHADES * shades) / np.float32(_SHADES)
        self._balls.show(self._places(eye), shades)

    def follow(self, eye: Camera) -> None:
        self._balls.move(self._places(eye))

    def _places(self, eye: Camera) -> Array:
        """As large as they are to be seen from here [P, 4, 4]."""
        layer = self.layer
        places = layer.positions[np.isfinite(layer.positions).all(axis=1)]
        pixel = self.drawing.pixels / focal(eye, max(self.drawing.widget.frame.height, 1))
        found = np.zeros((len(places), 4, 4))
        radii = 0.5 * layer.size * pixel * np.linalg.norm(places - eye.position, axis=-1)
        found[:, [0, 1, 2], [0, 1, 2]] = radii[:, None]
        found[:, :3, 3], found[:, 3, 3] = places, 1.0
        # Of two at one place the smaller one is before the larger one, not in it.
        return self.nearer(eye, 1 - (_LARGE - layer.size) * pixel) @ found

    def clear(self) -> None:
        self._balls.clear()


class _Words(_Drawn):
    """Labels: widgets of the window."""

    layer: Labels

    def __init__(self, drawing: Drawing, name: str, layer: Labels) -> None:
        super().__init__(drawing, name, layer)
        self._labels: list[Any] = []

    def change(self, scene: Scene, eye: Camera) -> None:
        layer = self.layer
        while len(self._labels) > len(layer.texts):
            self.drawing.widget.remove_3d_label(self._labels.pop())
        ink = colour(scene.theme.ink) if layer.colours is None else layer.colours
        shades = np.broadcast_to(ink, layer.positions.shape)
        for k, (words, shade) in enumerate(zip(layer.texts, shades, strict=True)):
            if k == len(self._labels):
                self._labels.append(self.drawing.widget.add_3d_label(layer.positions[k], words))
            label = self._labels[k]
            label.text, label.scale = words, layer.size / 18
            label.color = gui.Color(*map(float, shade))

    def follow(self, eye: Camera) -> None:
        # Open3D writes to the right of a place, and below it.
        right, down, ahead = axes(eye)
        focus, size = focal(eye, max(self.drawing.widget.frame.height, 1)), self.layer.size
        for label, words, place in zip(self._labels, self.layer.texts, self.layer.positions, strict=True):
            pixel = np.dot(place - eye.position, ahead) / focus
            label.position = place - pixel * (_LETTER / 2 * size * len(words) * right + size * down)

    def clear(self) -> None:
        while self._labels:
            self.drawing.widget.remove_3d_label(self._labels.pop())


_KINDS: dict[type[Layer], type[_Drawn]] = {
    Solids: _Parts,
    Surface: _Whole,
    Arrows: _Darts,
    Lines: _Strokes,
    Points: _Dots,
    Labels: _Words,
}


def material(shader: str, **values: Any) -> Any:
    """An Open3D material of one of its shaders."""
    made = rendering.MaterialRecord()
    made.shader = shader
    for name, value in values.items():
        setattr(made, name, value)
    return made


def solid(opacity: float, dim: float = 1.0) -> Any:
    """The material of lit bodies; dim darkens their colours."""
    shader = "defaultLit" if opacity >= 1 else "defaultLitTransparency"
    return material(shader, base_color=[dim, dim, dim, opacity], base_roughness=0.75, base_reflectance=0.25)


def mesh_of(mesh: Mesh, shade: Floats | None = None) -> Any:
    """An Open3D mesh, of one colour instead of its own if one is given.

    It is one of tensors: for meshes of `open3d.geometry` without texture coordinates Open3D 0.20 hands on
    memory that nobody wrote, which a processor that draws takes a hundred times as long for.
    """
    colours = mesh.colours if shade is None else np.broadcast_to(shade, mesh.vertices.shape)
    made = o3d.t.geometry.TriangleMesh()
    made.vertex.positions = _tensor(mesh.vertices, np.float32)
    made.vertex.normals = _tensor(mesh.normals, np.float32)
    made.vertex.colors = _tensor(colours, np.float32)
    made.triangle.indices = _tensor(mesh.triangles, np.int32)
    return made


def _tensor(values: ArrayLike, kind: type) -> Any:
    tensor: Any = o3d.core.Tensor  # its stubs do not know arrays
    return tensor(np.ascontiguousarray(values, kind))


def lines_of(points: ArrayLike, pieces: ArrayLike, colours: ArrayLike) -> Any:
    """Open3D lines: points [P, 3], pieces [L, 2] between them, colours [L, 3]."""
    made = o3d.geometry.LineSet(
        o3d.utility.Vector3dVector(np.asarray(points, np.float64)),
        o3d.utility.Vector2iVector(np.asarray(pieces, np.int32)),
    )
    made.colors = o3d.utility.Vector3dVector(np.asarray(colours, np.float64))
    return made


def casts(layer: Solids | Surface | Arrows, scene: Scene) -> bool:
    """Whether a layer has a shadow: only level ground shows it."""
    return layer.shadow and scene.ground is not None


def pressed(sun: Sun) -> Array:
    """From the world to its shadows on the ground, [4, 4]."""
    x, y, z = sun.direction
    return np.array([[1, -x / y, 0, 0], [0, 0, 0, _LIFT], [0, -z / y, 1, 0], [0, 0, 0, 1.0]])


def shade_of(scene: Scene) -> Floats:
    """The colour of ground in the shade."""
    return np.asarray(colour(scene.theme.floor) * np.sqrt(1 - scene.sun.shadow), np.float32)


@cache
def _ball() -> Mesh:
    return shapes.ellipsoid(np.zeros(3), np.eye(3), np.zeros(3))


@cache
def _shaft() -> Mesh:
    """From the origin along x, 1 long, of radius 1."""
    return shapes.loft(_LINE, _ROUND[0], _ROUND[1], np.zeros(3))


@cache
def _head() -> Mesh:
    """Likewise, and pointed."""
    sizes = np.array([[1.0], [0.02]])
    return shapes.loft(_LINE, _ROUND[0] * sizes, _ROUND[1] * sizes, np.zeros(3))


def arrow_places(origins: Array, vectors: Array, radius: float) -> tuple[Array, Array]:
    """Where `_shaft` and `_head` are to be for arrows like `viewer.shapes.arrows`, [A, 4, 4] each."""
    lengths = np.linalg.norm(vectors, axis=-1).astype(np.float64)
    head = np.minimum(5 * radius, 0.6 * lengths)
    axes_of = np.swapaxes(shapes.across(vectors / lengths[:, None]), -1, -2)
    found = []
    for begin, long, thick in (
        (np.zeros_like(head), lengths - head, np.full_like(head, radius)),
        (lengths - head, head, 2.4 * head / 5),
    ):
        places = np.zeros((len(lengths), 4, 4))
        places[:, :3, :3] = axes_of * np.stack([long, thick, thick], axis=-1)[:, None]
        places[:, :3, 3] = origins + begin[:, None] * axes_of[:, :, 0]
        places[:, 3, 3] = 1.0
        found.append(places)
    return found[0], found[1]


def _faded(theme: Theme, name: str, far: Array, radius: float) -> Floats:
    """A theme's colour that goes over into the horizon's with the distance."""
    left = np.clip(1 - far / radius, 0, 1)[:, None] ** 1.5
    return np.asarray(colour(getattr(theme, name)) * left + colour(theme.horizon) * (1 - left), np.float32)


def _floor(radius: float, theme: Theme) -> Mesh:
    """A disc around the origin."""
    angles = np.arange(_AROUND) * (2 * np.pi / _AROUND)
    far = np.repeat(np.linspace(0, radius, _RINGS + 1), _AROUND)
    turn = np.tile(angles, _RINGS + 1)
    vertices = np.stack([far * np.sin(turn), 0 * far, far * np.cos(turn)], -1)
    k, n = np.arange(_AROUND), (np.arange(_AROUND) + 1) % _AROUND
    faces = [
        np.stack(corners, -1)
        for r in range(0, _RINGS * _AROUND, _AROUND)
        for corners in ((r + k, r + _AROUND + k, r + n), (r + n, r + _AROUND + k, r + _AROUND + n))
    ]
    up = np.broadcast_to(np.array([0, 1, 0], np.float32), vertices.shape)
    return Mesh(vertices.astype(np.float32), up, np.concatenate(faces), _faded(theme, "floor", far, radius))


def _grid(ground: Ground, radius: float, theme: Theme) -> tuple[Array, Array, Floats]:
    """Points, pieces and their colours of lines around the origin; every fifth is stronger."""
    cells = int(np.ceil(radius / ground.spacing))
    places = np.arange(-cells, cells + 1)
    x, z = np.meshgrid(places, places, indexing="ij")
    points = ground.spacing * np.stack([x, 0 * x, z], -1).reshape(-1, 3)
    index = np.arange(len(places) ** 2).reshape(len(places), -1)
    pieces, strong = [], []
    for begin, end, across in ((index[:-1], index[1:], z[:-1]), (index[:, :-1], index[:, 1:], x[:, :-1])):
        pieces.append(np.stack([begin.ravel(), end.ravel()], -1))
        strong.append(across.ravel() % 5 == 0)
    both, fifth = np.concatenate(pieces), np.concatenate(strong)
    far = np.linalg.norm(points[both].mean(axis=1), axis=-1)
    faint = np.where(fifth, 1.0, 0.55)[:, None]
    floor = _faded(theme, "floor", far, radius + 5 * ground.spacing)
    shades = floor + faint * np.clip(1 - far / radius, 0, 1)[:, None] * (colour(theme.lines) - floor)
    near = far < radius
    return points, both[near], shades[near].astype(np.float32)
