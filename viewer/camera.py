"""Cameras: where they stand, how they move with what they look at, and where points appear in the picture.

Angles are radians. azimuth 0 looks from +Z, so that who faces +Z is seen from the front; pi/2 from +X, that
one's left. Pictures have x to the right and y down, in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion import springs

Array = NDArray[np.float64]

NEAR = 0.05  # metres before which nothing is drawn
FIELD = np.radians(32.0)
_STEEPEST = np.radians(89.9)


@dataclass(frozen=True, eq=False)
class Camera:
    """An upright camera: float64 [3] position and target, metres; vertical field of view, radians."""

    position: Array
    target: Array
    field: float = FIELD

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(self.target - self.position))


def orbit(
    target: ArrayLike, *, azimuth: float, elevation: float, distance: float, field: float = FIELD
) -> Camera:
    """A camera that looks at target [3] from a direction and a distance (metres)."""
    target, elevation = np.asarray(target, np.float64), np.clip(elevation, -_STEEPEST, _STEEPEST)
    level = np.array([np.sin(azimuth), 0.0, np.cos(azimuth)]) * np.cos(elevation)
    direction = level + np.array([0.0, np.sin(elevation), 0.0])
    return Camera(target + distance * direction, target, field)


def follow(camera: Camera, goal: ArrayLike, dt: float, *, halflife: float = 0.06) -> Camera:
    """The camera dt seconds later, moving along with what is at goal [3]; its direction stays.

    Half of the way is made every halflife, at any refresh rate.
    """
    moved = springs.damper(camera.target, np.asarray(goal, np.float64), halflife, dt)
    return Camera(camera.position + (moved - camera.target), moved, camera.field)


def axes(camera: Camera) -> Array:
    """Unit vectors [3, 3]: rows to the right, down and ahead."""
    ahead = (camera.target - camera.position) / camera.distance
    right = np.cross(ahead, [0.0, 1.0, 0.0])
    if not np.linalg.norm(right) > 1e-9:
        raise ValueError("a camera that looks straight up or down")
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


def focal(camera: Camera, height: int) -> float:
    """Pixels to which a metre shrinks at a metre's distance."""
    return height / 2 / np.tan(camera.field / 2)


def matrix(camera: Camera, width: int, height: int) -> Array:
    """Projection [3, 4]: (x w, y w, w) = M (X, Y, Z, 1), w the distance along the camera's axis, metres."""
    pixels = focal(camera, height)
    inside = np.array([[pixels, 0, width / 2], [0, pixels, height / 2], [0, 0, 1.0]])
    turn = axes(camera)
    return inside @ np.concatenate([turn, -(turn @ camera.position)[:, None]], axis=1)


def project(camera: Camera, points: ArrayLike, width: int, height: int) -> tuple[Array, Array]:
    """Places [..., 2] in the picture of points [..., 3], and their distances along the axis [...].

    Where the distance is not positive the point is behind the camera, and its place means nothing.
    """
    points = np.asarray(points, np.float64)
    m = matrix(camera, width, height)
    found = points @ m[:, :3].T + m[:, 3]
    far = found[..., 2:]
    return found[..., :2] / np.where(far == 0, np.nan, far), far[..., 0]


def fitting(
    points: ArrayLike, *, azimuth: float, elevation: float, aspect: float, field: float = FIELD
) -> float:
    """The least distance (metres) from which all points [P, 3] around the target are in the picture.

    aspect is the picture's width by its height; azimuth and elevation are those of `orbit`. A point r is
    seen where |r . right| <= (D + r . ahead) tan(field / 2) aspect, D the distance, and so for down.
    """
    turn = axes(orbit(np.zeros(3), azimuth=azimuth, elevation=elevation, distance=1.0))
    right, down, ahead = np.moveaxis(np.asarray(points, np.float64) @ turn.T, -1, 0)
    slope = np.tan(field / 2)
    return float(np.nanmax(np.maximum(np.abs(right) / aspect, np.abs(down)) / slope - ahead))
