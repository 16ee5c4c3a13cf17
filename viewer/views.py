"""Where the camera of a film stands, and the pictures that it takes of a stage at given times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from . import camera
from .camera import Camera
from .raster import Renderer, text
from .scene import Ground, Theme, colour
from .stage import Stage

Image = NDArray[np.uint8]

SIDES = {"front": 0.0, "side": 90.0, "quarter": 35.0, "back": 180.0}  # degrees to the character's left
KINDS = ("follow", "orbit", "fixed")
_SAMPLES = 40  # instants at which a film's extent is looked at
_WAIST = 0.52  # of how tall they are: what the camera looks at
_MARGIN = 1.06
_LIFT = 0.3


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
    room : how much farther than that, so that there is room for panels above them.
    """

    kind: str = "follow"
    azimuth: float = np.radians(SIDES["quarter"])
    elevation: float = np.radians(12.0)
    distance: float | None = None
    turn: float = 8.0
    room: float = 1.0


def film(
    stage: Stage, times: Sequence[float], size: tuple[int, int], view: View, *, compiled: bool = True
) -> Iterator[Image]:
    """Pictures [H, W, 3] of a stage at rising times, size being (width, height)."""
    renderer = Renderer(*size, compiled=compiled)
    eye = first_camera(stage, times, size, view)
    before = times[0]
    for time in times:
        stage.move_to(time)
        if view.kind != "fixed":
            eye = camera.follow(eye, goal(stage) + _above(stage, view), time - before)
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
    here = replace(view, kind="follow")
    whole = first_camera(stage, times, (wide, size[1]), here)
    for time, start, stop in zip(times, edges, edges[1:], strict=False):
        eye = first_camera(stage, [time], (wide, size[1]), replace(here, distance=whole.distance))
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
    far = max(first_camera(stage, times, part, view).distance for stage, part in each)
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


def first_camera(stage: Stage, times: Sequence[float], size: tuple[int, int], view: View) -> Camera:
    """The camera at the first of the times, from where all that comes is seen; the stage is left there."""
    some = np.unique(np.linspace(times[0], times[-1], min(len(times), _SAMPLES)))
    middles, corners = stage.boxes(some.tolist())
    stage.move_to(times[0])
    if view.kind == "fixed":
        middles = np.broadcast_to((middles.min(axis=0) + middles.max(axis=0)) / 2, middles.shape)
    waist = np.array([0.0, _WAIST * stage.tall, 0.0]) + _above(stage, view)
    azimuth = float(stage.yaws[0]) + view.azimuth
    way = {"azimuth": azimuth, "elevation": view.elevation}
    distance = view.distance
    if distance is None:
        seen = corners - middles[:, None] - waist
        if view.kind == "orbit":  # from all sides
            far = np.linalg.norm(seen[..., [0, 2]], axis=-1)
            seen = np.stack([far * np.cos(azimuth), seen[..., 1], -far * np.sin(azimuth)], axis=-1)
        distance = view.room * _MARGIN * camera.fitting(seen.reshape(-1, 3), aspect=size[0] / size[1], **way)
    return camera.orbit(middles[0] + waist, distance=distance, **way)


def _above(stage: Stage, view: View) -> NDArray[np.float64]:
    """How much higher the camera looks where there is to be room above them."""
    return np.array([0.0, _LIFT * (view.room - 1) * stage.tall, 0.0])


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
    ink, halo = (tuple(np.round(255 * colour(c)).astype(int).tolist()) for c in (theme.ink, theme.halo))
    size = max(10, round(0.032 * len(image)))
    stamp = text.picture(words, size, ink, halo)
    text.put(image, stamp, (image.shape[1] - stamp.shape[1]) // 2, len(image) - len(stamp) - size // 3)
