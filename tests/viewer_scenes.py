"""Small scenes for the viewer's tests: boxes, a person and a camera that looks straight ahead."""

from __future__ import annotations

import numpy as np

from viewer.camera import Camera
from viewer.scene import Mesh, Scene, Solids, colour

RED, BLUE = colour("#ff0000"), colour("#0000ff")


def rectangle(centre: tuple[float, float, float], wide: float, high: float, tint: np.ndarray = RED) -> Mesh:
    """A rectangle that faces +Z."""
    x, y, z = centre
    corners = [(x + sx * wide / 2, y + sy * high / 2, z) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    ahead = np.tile([0.0, 0.0, 1.0], (4, 1)).astype(np.float32)
    return Mesh(np.array(corners, np.float32), ahead, np.array([[0, 1, 2], [0, 2, 3]], np.int32), tint)


def solids(*meshes: Mesh, **more: object) -> Solids:
    """Meshes in the world as they are."""
    at_rest = np.tile(np.eye(3, 4, dtype=np.float32), (1, len(meshes), 1, 1))
    return Solids(parts=meshes, transforms=at_rest, **more)  # type: ignore[arg-type]


def scene(*meshes: Mesh, **more: object) -> Scene:
    """A scene of meshes without a ground."""
    return Scene({"solids": solids(*meshes, **more)}, ground=None)


def ahead(distance: float = 5.0, *, height: float = 0.0, field: float = 0.6) -> Camera:
    """A camera on the z axis that looks along -Z at the origin (at a height above it)."""
    return Camera(np.array([0.0, height, distance]), np.array([0.0, height, 0.0]), field)
