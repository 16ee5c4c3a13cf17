from __future__ import annotations

import contextlib
import errno
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from motion import quat
from motion.clip import Clip
from motion.errors import UserError
from viewer import body, camera, film, shapes, shows, views
from viewer.stage import Stage
from viewer.views import View

SIZE = (96, 72)


def pictures(count: int, size: tuple[int, int] = (33, 21)) -> Iterator[np.ndarray]:
    for i in range(count):
        image = np.zeros((size[1], size[0], 3), np.uint8)
        image[:, : (i + 1) * size[0] // count] = 255
        yield image


def middle(image: np.ndarray, side: str) -> float:
    """The mean column of what is of a side's colour."""
    shade = 255 * body.SIDES[side]
    hue = image - image.mean(axis=-1, keepdims=True)
    like = hue @ (shade - shade.mean())
    return float(np.argwhere(like > 0.5 * like.max())[:, 1].mean())


def test_a_picture_is_written_as_it_is(tmp_path: Path) -> None:
    image = next(pictures(2))
    assert film.write(tmp_path / "one.png", iter([image])) == 1
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "one.png")), image)


def test_a_gif_lasts_as_long_as_it_should(tmp_path: Path) -> None:
    assert film.write(tmp_path / "f.gif", pictures(9), fps=30.0) == 9
    with Image.open(tmp_path / "f.gif") as found:
        assert found.n_frames == 9 and found.size == (33, 21)
        lasts, light = [], []
        for i in range(9):
            found.seek(i)
            lasts.append(found.info["duration"])
            light.append(np.asarray(found.convert("L")).mean())
    assert sum(lasts) == pytest.approx(300, abs=10)
    assert all(last % 10 == 0 for last in lasts)
    assert (np.diff(light) > 0).all()


def test_an_mp4_has_all_frames_at_its_rate(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    assert film.write(tmp_path / "f.mp4", pictures(12, (65, 47)), fps=24.0) == 12
    with av.open(str(tmp_path / "f.mp4")) as found:
        frames = [frame.to_ndarray(format="rgb24") for frame in found.decode(video=0)]
        assert float(found.streams.video[0].average_rate) == 24
    assert len(frames) == 12
    assert frames[0].shape == (48, 66, 3)  # even
    assert (np.diff([frame.mean() for frame in frames]) > 0).all()


def test_a_film_that_breaks_off_leaves_nothing(tmp_path: Path) -> None:
    def broken() -> Iterator[np.ndarray]:
        yield from pictures(3)
        raise RuntimeError("the third was the last")

    for name in ("f.png", "f.gif", "f.mp4"):
        if name != "f.png":
            with pytest.raises(RuntimeError, match="third"):
                film.write(tmp_path / name, broken())
    assert list(tmp_path.iterdir()) == []


class Full(io.BytesIO):
    """A file on a disk that is full after some bytes."""

    def write(self, data: Any) -> int:
        if self.tell() + len(data) > 500:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data)


@pytest.mark.parametrize("name", ["f.png", "f.gif", "f.mp4"])
def test_a_full_disk_is_told(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film.files, "atomic", lambda _: contextlib.nullcontext(Full()))
    noise = np.random.default_rng(0).integers(0, 255, (12, 48, 64, 3), np.uint8)
    with pytest.raises(OSError, match="No space left"):
        film.write(name, iter(noise))


def test_large_pictures_of_a_gif_are_not_all_held_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(film, "_BYTES", 5 * 33 * 21 * 3)
    made, written = [], []

    def counted() -> Iterator[np.ndarray]:
        for picture in pictures(20):
            made.append(1)
            yield picture

    save = Image.Image.save

    def saved(self: Any, *args: Any, **options: Any) -> None:
        written.append(len(made))
        save(self, *args, **options)

    monkeypatch.setattr(Image.Image, "save", saved)
    assert film.write(tmp_path / "f.gif", counted()) == 20
    assert written[0] == 6


def test_names_and_missing_libraries_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("f.avi", "film"):
        with pytest.raises(UserError, match=r"name it \*\.png, \*\.gif, \*\.mp4"):
            film.write(tmp_path / name, pictures(1))
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    with pytest.raises(UserError, match=r"av is not installed; pip install 'motion-matching\[viewer\]'"):
        film.write(tmp_path / "f.mp4", pictures(1))
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def straight(walker_clips: list[Clip]) -> Stage:
    return Stage([shows.of_clip(walker_clips[0])])


@pytest.mark.parametrize(("side", "sign"), [("front", 1), ("back", -1)])
def test_left_is_left(straight: Stage, side: str, sign: int) -> None:
    view = View(azimuth=np.radians(views.SIDES[side]))
    (image,) = views.film(straight, [1.0], SIZE, view)
    assert sign * (middle(image, "left") - middle(image, "right")) > 2


def test_a_camera_that_follows_keeps_the_walker_in_the_middle(straight: Stage) -> None:
    times = np.arange(0, 3, 0.2).tolist()
    images = list(views.film(straight, times, SIZE, View(azimuth=np.pi / 2)))
    assert len(images) == len(times)
    places = [(middle(image, "left") + middle(image, "right")) / 2 for image in images]
    assert np.abs(np.array(places) - SIZE[0] / 2).max() < 0.12 * SIZE[0]
    assert not np.array_equal(images[0], images[-1])


@pytest.mark.parametrize("kind", ["follow", "orbit", "fixed"])
@pytest.mark.parametrize("above", [0.0, 0.4])
def test_what_is_left_free_for_panels_is_free(walker_clips: list[Clip], kind: str, above: float) -> None:
    stage = Stage([shows.of_clip(clip) for clip in walker_clips[:2]])
    times = np.arange(0, 2, 0.5).tolist()
    eye = views.first_camera(stage, times, SIZE, View(kind, azimuth=0.0, above=above))
    seen = []
    for time in times if kind == "fixed" else times[:1]:
        joints = np.concatenate([stage.pose(i, time)[0].reshape(-1, 3) for i in range(2)])
        seen.append(camera.project(eye, joints, *SIZE)[0])
    x, y = np.concatenate(seen).T
    assert above * SIZE[1] - 0.02 * SIZE[1] <= y.min() and y.max() <= SIZE[1]
    assert x.min() >= 0 and x.max() <= SIZE[0]


def test_whoever_is_looked_at_is_in_the_light_from_any_side(straight: Stage) -> None:
    bright = []
    for azimuth in np.radians([0, 90, 180, 270]):
        (image,) = views.film(straight, [1.0], SIZE, View(azimuth=azimuth, elevation=0.1))
        hue = np.ptp(image.astype(int), axis=-1)
        bright.append(image[hue > 60].mean())
    assert max(bright) < 1.3 * min(bright)


def test_a_camera_that_stands_sees_it_pass(straight: Stage) -> None:
    images = list(views.film(straight, [0.0, 1.5, 3.0], SIZE, View("fixed", azimuth=np.pi / 2)))
    places = [middle(image, "left") for image in images]
    # Seen from its left, it walks to the left of the picture, and is in it all the time.
    assert SIZE[0] > places[0] > places[1] + 8 > places[2] + 16 > 16


def test_an_orbit_comes_to_the_other_side(straight: Stage) -> None:
    times = np.arange(0, 2.01, 0.25).tolist()
    images = list(views.film(straight, times, SIZE, View("orbit", azimuth=0.0, turn=4.0)))
    sides = [middle(image, "left") - middle(image, "right") for image in (images[0], images[-1])]
    assert sides[0] > 2 and sides[1] < -2


def test_a_strip_has_its_poses_side_by_side(straight: Stage) -> None:
    size = (250, 80)
    parts = list(views.strip(straight, [0.5, 1.0, 1.5], size, View(azimuth=np.pi / 2)))
    assert [part.shape[:2] for part in parts] == [(80, 83), (80, 84), (80, 83)]
    whole = views.joined(parts)
    assert whole.shape == (80, 250, 3)
    for part in parts:
        assert abs((middle(part, "left") + middle(part, "right")) / 2 - 41.5) < 9


def test_in_a_strip_poses_are_seen_whole_however_they_turned(walker_clips: list[Clip]) -> None:
    """Upright ahead, then lying on the air to the left: seen from the side that is the widest pose."""
    show = shows.of_clip(walker_clips[0])
    hips, (ahead, left) = show.skeleton.roles["hips"], quat.from_yaw(np.array([0.0, np.pi / 2]))
    show.rotations = show.rotations.copy()
    show.rotations[:31, :, 0], show.rotations[31:, :, 0] = ahead, left
    bent = quat.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(np.pi / 2)).astype(np.float32)
    show.rotations[31:, :, hips] = quat.mul(bent, show.rotations[31:, :, hips])
    view = View(azimuth=np.pi / 2, elevation=0.1)
    for part in views.strip(Stage([show]), [0.2, 0.8], (200, 200), view):
        hue = np.ptp(part.astype(int), axis=-1) > 60  # of a body's sides
        assert hue.sum() > 100
        assert not hue[:, [0, 1, -2, -1]].any() and not hue[[0, -1]].any()


def test_what_reaches_beyond_the_joints_is_seen_too(walker_clips: list[Clip]) -> None:
    show = shows.of_clip(walker_clips[0])
    pole = shapes.capsule(np.zeros(3), np.array([0.0, 0.0, 1.2]), (0.05, 0.05), body.SIDES["left"])
    head = np.array([show.skeleton.roles["head"]])
    hat = np.concatenate([show.body.joints[show.body.joints != head], head])
    parts = [p for j, p in zip(show.body.joints, show.body.parts, strict=True) if j != head]
    show.body = body.Body(hat, (*parts, pole))
    (image,) = views.film(Stage([show]), [0.5], (60, 120), View(azimuth=np.pi / 2, elevation=0.1))
    ahead = np.ptp(image.astype(int), axis=-1) > 60
    assert ahead[:, :25].sum() > 20  # it is there, to the left
    assert not ahead[:, 0].any()


def test_poses_that_are_no_numbers_are_not_seen_and_break_nothing(walker_clips: list[Clip]) -> None:
    show = shows.of_clip(walker_clips[0])
    show.positions = show.positions.copy()
    show.positions[31:] = np.nan
    stage = Stage([show])
    before, after = views.film(stage, [0.5, 0.6], SIZE, View(azimuth=0.0))
    assert before.shape == after.shape
    assert before[:40].std() > after[:40].std()


def test_all_of_several_are_seen(walker_clips: list[Clip]) -> None:
    stage = Stage([shows.of_clip(clip) for clip in walker_clips[:3]])
    view = View(azimuth=0.0, elevation=0.1)
    (image,) = views.film(stage, [0.0], (160, 72), view)
    shade = body.SIDES["left"] - body.SIDES["left"].mean()
    hue = (image / 255 - image.mean(axis=-1, keepdims=True) / 255) @ shade
    columns = np.flatnonzero((hue > 0.5 * hue.max()).any(axis=0))
    assert (np.diff(columns) > 3).sum() == 2  # three, apart from each other
    assert columns.min() > 4 and columns.max() < 156
