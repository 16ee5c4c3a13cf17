"""Where the camera of a film stands, and the pictures that it takes of a stage at given times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from . import camera
from .camera import Camera
from .raster import Renderer, text
from .scene import Ground, Sun, Theme, colour, levels
from .stage import Stage

Image = NDArray[np.uint8]

SIDES = {"front": 0.0, "side": 90.0, "quarter": 35.0, "back": 180.0}  # degrees to the character's left
KINDS = ("follow", "orbit", "fixed")
_SAMPLES = 40  # instants at which a film's extent is looked at
_WAIST = 0.52  # of how tall they are: what the camera looks at
_MARGIN = 1.06
_LOOKS = 12  # instants at which what is drawn about them is looked at
_FARTHER = 1.15  # as far as the camera stands for that, to what it would stand without
_SUN = (np.radians(35.0), 0.57)  # to the right of where the camera stands, and how slanting


@dataclass(frozen=True)
class View:
    """How a stage is filmed.

    Attributes
    ----------
    kind : follow moves along; orbit does, and goes around them once every turn seconds; fixed stands where it
        sees all of the way.
    azimuth : radians from where the first character faces at the start, to its left.
    elevation : radians above level.
    distance : metres, or None for what shows all.
    above : share of the picture, at its top, that they leave free for panels.
    """

    kind: str = "follow"
    azimuth: float = np.radians(SIDES["quarter"])
    elevation: float = np.radians(12.0)
    distance: float | None = None
    turn: float = 8.0
    above: float = 0.0


def film(
    stage: Stage, times: Sequence[float], size: tuple[int, int], view: View, *, compiled: bool = True
) -> Iterator[Image]:
    """Pictures [H, W, 3] of a stage at rising times, size being (width, height)."""
    renderer = Renderer(*size, compiled=compiled)
    eye = first_camera(stage, times, size, view, marked=True)
    shine(stage, eye)
    before = times[0]
    for time in times:
        stage.move_to(time)
        if view.kind != "fixed":
            eye = camera.follow(eye, goal(stage) + _raised(eye.distance, view), time - before)
        if view.kind == "orbit":
            eye = _around(eye, 2 * np.pi * (time - before) / view.turn)
        before = time
        light(stage, eye)
        yield renderer.render(stage.scene, eye)


def strip(
    stage: Stage, times: Sequence[float], size: tuple[int, int], view: View, *, compiled: bool = True
) -> Iterator[Image]:
    """Parts of a picture of this size, side by side: poses as seen from where they face, and their times."""
    edges = np.round(np.linspace(0, size[0], len(times) + 1)).astype(int)
    wide = int(np.diff(edges).max())
    renderer = Renderer(wide, size[1], compiled=compiled)
    here, cell = replace(view, kind="follow"), (wide, size[1])
    far = max(first_camera(stage, [time], cell, here, marked=True).distance for time in times)
    for time, start, stop in zip(times, edges, edges[1:], strict=False):
        eye = first_camera(stage, [time], cell, replace(here, distance=far))
        shine(stage, eye)
        light(stage, eye)
        image = renderer.render(stage.scene, eye)
        _stamp(image, f"{time:.2f} s", stage.scene.theme)
        yield image[:, : stop - start]


def beside(
    stages: Sequence[Stage],
    times: Sequence[float],
    size: tuple[int, int],
    view: View,
    *,
    compiled: bool = True,
) -> Iterator[Image]:
    """Pictures of several stages at the same times and from the same distance, side by side."""
    edges = np.round(np.linspace(0, size[0], len(stages) + 1)).astype(int)
    sizes = [(int(wide), size[1]) for wide in np.diff(edges)]
    each = list(zip(stages, sizes, strict=True))
    far = max(first_camera(stage, times, part, view, marked=True).distance for stage, part in each)
    films = [film(stage, times, part, replace(view, distance=far), compiled=compiled) for stage, part in each]
    for pictures in zip(*films, strict=True):
        yield joined(pictures)


def joined(pictures: Iterable[Image]) -> Image:
    """Pictures of one height as one, with a thin line between them."""
    parts: list[Image] = []
    for picture in pictures:
        if parts:
            picture = picture.copy()
            picture[:, :1] = picture[:, :1] // 4 * 3
        parts.append(picture)
    return np.concatenate(parts, axis=1)


def first_camera(
    stage: Stage, times: Sequence[float], size: tuple[int, int], view: View, *, marked: bool = False
) -> Camera:
    """The camera at the first of the times, from where all that comes is seen; the stage is left there.

    marked : whether it stands farther off, if not by much, to see what is drawn about them, too.
    """
    some = np.unique(np.linspace(times[0], times[-1], min(len(times), _SAMPLES)))
    middles, corners = stage.boxes(some.tolist())
    looks = some[:: -(-len(some) // _LOOKS)] if marked and view.distance is None else some[:0]
    marks = [(stage.marks(time), stage.middle) for time in looks]
    stage.move_to(times[0])
    if view.kind == "fixed":
        centre = (middles.min(axis=0) + middles.max(axis=0)) / 2
        middles, marks = np.broadcast_to(centre, middles.shape), [(points, centre) for points, _ in marks]
    around = corners - middles[:, None]
    waist = np.array([0.0, _WAIST * stage.tall, 0.0])
    way = {"azimuth": float(stage.yaws[0]) + view.azimuth, "elevation": view.elevation}
    distance = view.distance
    if distance is None:
        distance = _distance(around - waist, size, view, **way)
        if marks:
            points = np.concatenate([points - middle for points, middle in marks])
            drawn = _distance(points - waist, size, view, **way)
            distance = float(np.clip(drawn, distance, _FARTHER * distance))
    return camera.orbit(middles[0] + waist + _raised(distance, view), distance=distance, **way)


def _distance(
    points: NDArray[np.float64], size: tuple[int, int], view: View, *, azimuth: float, elevation: float
) -> float:
    """From where points [..., 3] around what is looked at are in the part of the picture that is theirs."""
    if view.kind == "orbit":  # from all sides
        far = np.linalg.norm(points[..., [0, 2]], axis=-1)
        points = np.stack([far * np.cos(azimuth), points[..., 1], -far * np.sin(azimuth)], axis=-1)
    points, free = points.reshape(-1, 3), 1 - view.above
    if not np.isfinite(points).all(axis=1).any():
        return 0.0
    return _MARGIN * camera.fitting(
        points,
        azimuth=azimuth,
        elevation=elevation,
        aspect=size[0] / (size[1] * free),
        field=2 * np.arctan(free * np.tan(camera.FIELD / 2)),
    )


def _raised(distance: float, view: View) -> NDArray[np.float64]:
    """How much higher the camera looks, so that what it is to see is in the middle of what is left free."""
    return np.array([0.0, view.above * distance * np.tan(camera.FIELD / 2), 0.0])


def shine(stage: Stage, eye: Camera) -> None:
    """Let light come from beside the camera: whoever is looked at from the front is not in the shade."""
    x, _, z = eye.position - eye.target
    azimuth = np.arctan2(x, z) + _SUN[0]
    stage.scene.sun = Sun((float(_SUN[1] * np.sin(azimuth)), 1.0, float(_SUN[1] * np.cos(azimuth))))


def goal(stage: Stage) -> NDArray[np.float64]:
    return np.asarray(stage.middle + np.array([0.0, _WAIST * stage.tall, 0.0]), np.float64)


def _around(eye: Camera, angle: float) -> Camera:
    """The camera turned about the upright through its target."""
    x, y, z = eye.position - eye.target
    c, s = np.cos(angle), np.sin(angle)
    turned = np.array([c * x + s * z, y, c * z - s * x])
    return Camera(eye.target + turned, eye.target, eye.field)


def light(stage: Stage, eye: Camera) -> None:
    """Let level ground reach as far as this camera sees it."""
    if stage.scene.ground is None:
        return
    x, _, z = eye.target
    stage.scene.ground = Ground(
        spacing=1.0 if stage.tall > 0.8 else 0.5, centre=(float(x), float(z)), radius=6.0 + 2.2 * eye.distance
    )


def _stamp(image: Image, words: str, theme: Theme) -> None:
    """A line of text at the bottom, in the middle."""
    ink, halo = levels(colour(theme.ink)), levels(colour(theme.halo))
    size = max(10, round(0.032 * len(image)))
    stamp = text.picture(words, size, ink, halo)
    text.put(image, stamp, (image.shape[1] - stamp.shape[1]) // 2, len(image) - len(stamp) - size // 3)
