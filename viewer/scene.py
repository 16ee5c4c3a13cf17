"""What is drawn, as plain data: layers of bodies, surfaces, lines, points, arrows and labels.

A scene knows nothing of who draws it. Its layers have names and keep their arrays: `Layer.update` exchanges
some of them every frame, so that a window need only move what changed. Positions are in the world, metres,
Y up; colours are sRGB, 0 to 1; widths and sizes on the screen are pixels of a picture 720 pixels high.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float32]


def colour(text: str) -> Floats:
    """Red, green and blue, float32 [3], of ``#rrggbb``."""
    return np.array([int(text[i : i + 2], 16) / 255 for i in (1, 3, 5)], np.float32)


def levels(shade: ArrayLike) -> tuple[int, int, int]:
    """A colour [3] as pictures have it: whole numbers from 0 to 255."""
    red, green, blue = np.round(255 * np.asarray(shade)).astype(int).tolist()
    return red, green, blue


@dataclass(frozen=True, eq=False, repr=False)
class Mesh:
    """A closed or open surface of triangles.

    Attributes
    ----------
    vertices, normals : float32 [V, 3], metres and unit vectors.
    triangles : int32 [F, 3], counter-clockwise as seen from outside.
    colours : float32 [V, 3]; one colour [3] is given to all vertices.
    """

    vertices: Floats
    normals: Floats
    triangles: NDArray[np.int32]
    colours: Floats

    def __post_init__(self) -> None:
        count = len(self.vertices)
        for name, shape in (("vertices", (count, 3)), ("normals", (count, 3)), ("colours", (count, 3))):
            values = np.asarray(getattr(self, name), np.float32)
            if name == "colours":
                values = np.broadcast_to(values, shape)
            _check(name, values, shape)
            object.__setattr__(self, name, np.ascontiguousarray(values))
        triangles = np.ascontiguousarray(self.triangles, np.int32).reshape(-1, 3)
        if triangles.size and not 0 <= triangles.min() <= triangles.max() < count:
            raise ValueError(f"triangles of vertices {triangles.min()} to {triangles.max()}, of {count}")
        object.__setattr__(self, "triangles", triangles)

    def __repr__(self) -> str:
        return f"Mesh({len(self.vertices)} vertices, {len(self.triangles)} triangles)"


@dataclass(eq=False, kw_only=True)
class Layer:
    """One named part of a scene.

    Attributes
    ----------
    visible : whether it is drawn.
    revision : goes up with every change; who draws compares it with what it has drawn.
    """

    visible: bool = True
    revision: int = field(default=0, init=False)

    def update(self, **values: Any) -> None:
        """Exchange some of the attributes; arrays and colours are checked as at the beginning.

        Other arrays of the same numbers are no change.
        """
        before = {}
        for name, value in values.items():
            if not hasattr(self, name):
                raise AttributeError(f"a {type(self).__name__} has no {name}")
            before[name] = getattr(self, name)
            setattr(self, name, value)
        self.__post_init__()
        if not all(_same(value, getattr(self, name)) for name, value in before.items()):
            self.revision += 1

    def __post_init__(self) -> None:
        """Bring arrays to their types and check their shapes."""


@dataclass(eq=False, kw_only=True)
class Solids(Layer):
    """N times the same K rigid parts, each placed by a transform of its own: characters, obstacles.

    Attributes
    ----------
    parts : K meshes, each in axes of its own.
    transforms : float32 [N, K, 3, 4], from a part's axes to the world: rotation, then place in column 3.
    opacity : 1 hides what is behind, less lets it be seen.
    shadow : whether it casts one on the ground.
    """

    parts: Sequence[Mesh]
    transforms: Floats
    opacity: float = 1.0
    shadow: bool = True

    def __post_init__(self) -> None:
        self.transforms = _array("transforms", self.transforms, (-1, len(self.parts), 3, 4))


@dataclass(eq=False, kw_only=True)
class Surface(Layer):
    """A mesh in the world, whose vertices may move: a skinned character, a terrain. See also `Solids`.

    Attributes
    ----------
    mesh : what is drawn.
    two_sided : whether it is seen from behind, too.
    shaded : whether shadows fall on it, as on uneven ground.
    """

    mesh: Mesh
    opacity: float = 1.0
    shadow: bool = True
    two_sided: bool = False
    shaded: bool = False


@dataclass(eq=False, kw_only=True)
class Lines(Layer):
    """Polylines.

    Attributes
    ----------
    points : float32 [P, 3], those of one line after those of another.
    starts : int [L], where each line begins among them; the first at 0.
    colours : float32 [P, 3] or one colour [3]; a piece has that of its first point.
    width : pixels.
    through : how much of it is seen through what stands before it, 0 to 1.
    """

    points: Floats
    starts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(1, np.int64))
    colours: Floats = field(default_factory=lambda: np.full(3, 0.5, np.float32))
    width: float = 2.0
    through: float = 0.0

    def __post_init__(self) -> None:
        self.points = _array("points", self.points, (-1, 3))
        self.starts = np.asarray(self.starts, np.int64)
        self.colours = _colours(self.colours, len(self.points))

    def pieces(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The points at which pieces begin and end."""
        begin = np.arange(max(len(self.points) - 1, 0))
        begin = np.setdiff1d(begin, self.starts[1:] - 1)
        return begin, begin + 1


@dataclass(eq=False, kw_only=True)
class Points(Layer):
    """Round points (colours, through: see Lines): positions float32 [P, 3], size their diameter, pixels."""

    positions: Floats
    colours: Floats = field(default_factory=lambda: np.full(3, 0.5, np.float32))
    size: float = 8.0
    through: float = 0.0

    def __post_init__(self) -> None:
        self.positions = _array("positions", self.positions, (-1, 3))
        self.colours = _colours(self.colours, len(self.positions))


@dataclass(eq=False, kw_only=True)
class Arrows(Layer):
    """Solid arrows: origins, vectors float32 [A, 3], radius of the shaft in metres, colours as of Lines."""

    origins: Floats
    vectors: Floats
    colours: Floats = field(default_factory=lambda: np.full(3, 0.5, np.float32))
    radius: float = 0.012
    shadow: bool = False

    def __post_init__(self) -> None:
        self.origins = _array("origins", self.origins, (-1, 3))
        self.vectors = _array("vectors", self.vectors, (len(self.origins), 3))
        self.colours = _colours(self.colours, len(self.origins))


@dataclass(eq=False, kw_only=True)
class Labels(Layer):
    """Texts whose lower middle stands at positions float32 [K, 3]; size is their height, pixels.

    colours None is the theme's ink.
    """

    texts: Sequence[str]
    positions: Floats
    colours: Floats | None = None
    size: float = 20.0

    def __post_init__(self) -> None:
        self.positions = _array("positions", self.positions, (len(self.texts), 3))
        if self.colours is not None:
            self.colours = _colours(self.colours, len(self.texts))


@dataclass(frozen=True)
class Ground:
    """Level ground at y = 0 with a grid.

    Attributes
    ----------
    spacing : metres from line to line; every fifth is stronger.
    centre : x, z of where it is seen best; it fades into the background farther off.
    radius : metres from there at which nothing is left of it.
    """

    spacing: float = 1.0
    centre: tuple[float, float] = (0.0, 0.0)
    radius: float = 15.0


@dataclass(frozen=True)
class Sun:
    """Light from afar: a direction [3] towards it, not level; how dark its shadow is, 0 to 1."""

    direction: tuple[float, float, float] = (0.45, 1.0, 0.35)
    shadow: float = 0.42


@dataclass(frozen=True)
class Theme:
    """Colours of what is around the characters, as ``#rrggbb``."""

    zenith: str
    horizon: str
    floor: str
    lines: str
    ink: str
    halo: str


LIGHT = Theme("#d9e0e8", "#f1f3f5", "#e2e5e9", "#b9c0c9", "#1f2328", "#ffffff")
DARK = Theme("#0f1114", "#1c1f24", "#2a2e35", "#474d57", "#eceff2", "#000000")


@dataclass(eq=False)
class Scene:
    """Layers by name, drawn in their order, and what is around them."""

    layers: dict[str, Layer] = field(default_factory=dict)
    ground: Ground | None = field(default_factory=Ground)
    sun: Sun = field(default_factory=Sun)
    theme: Theme = LIGHT


def _check(name: str, values: NDArray, shape: tuple[int, ...]) -> None:
    if values.ndim != len(shape) or any(n not in (-1, m) for n, m in zip(shape, values.shape, strict=True)):
        raise ValueError(f"{name} are {values.shape}, expected {shape}, -1 being any number")


def _array(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Floats:
    found = np.ascontiguousarray(values, np.float32)
    _check(name, found, shape)
    return found


def _colours(values: ArrayLike, count: int) -> Floats:
    found = np.asarray(values, np.float32)
    if found.shape == (3,):
        return found
    return _array("colours", found, (count, 3))


def _same(before: Any, now: Any) -> bool:
    """Whether nothing changed; an array that is still the same one may have been written to."""
    if isinstance(before, np.ndarray) and isinstance(now, np.ndarray):
        return before is not now and np.array_equal(before, now, equal_nan=True)
    return before is now or (type(before) is type(now) and bool(before == now))
