"""viewer.window: it opens, keys and the mouse drive, sliders change the motion, a person is seen."""

from __future__ import annotations

import ctypes.util
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mm.settings import Settings
from motion import config
from viewer.replay import Replay
from viewer.window.eye import DRAG, WHEEL, Eye

HERE = Path(__file__).parent
DRIVERS = [Path(folder, "vulkan/icd.d") for folder in ("/usr/share", "/etc", "/usr/local/share")]
MISSING = [
    what
    for what, there in (
        ("open3d", importlib.util.find_spec("open3d")),
        ("xvfb", shutil.which("xvfb-run")),
        ("xauth", shutil.which("xauth")),
        ("libxtst6", ctypes.util.find_library("Xtst")),
        ("libvulkan1", ctypes.util.find_library("vulkan")),
        ("mesa-vulkan-drivers", any(file for folder in DRIVERS for file in folder.glob("*.json"))),
        ("libgl1", ctypes.util.find_library("GL")),
        ("libegl1", ctypes.util.find_library("EGL")),
        ("libusb-1.0-0", ctypes.util.find_library("usb-1.0")),
    )
    if not there
]
opens = pytest.mark.skipif(bool(MISSING), reason=f"no window: not installed are {', '.join(MISSING)}")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the window showed while it was driven (`window_driver`)."""
    made = tmp_path_factory.mktemp("window")
    screen = ("-s", "-screen 0 640x440x24")
    done = subprocess.run(
        ["xvfb-run", "-a", *screen, sys.executable, HERE / "window_driver.py", made],
        cwd=HERE.parent,
        env={**os.environ, "PYTHONPATH": "."},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.stdout.rstrip().endswith("interrupted"), done.stdout + done.stderr
    assert done.returncode == 0, done.stderr  # an interrupt ends it in order
    return made


@pytest.fixture(scope="module")
def told(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "told.json").read_text())
    return found


@opens
def test_keys_drive_ahead_and_to_the_left(told: dict[str, Any]) -> None:
    start, ahead, left = (told[name] for name in ("start", "ahead", "left"))
    assert ahead["z"] - start["z"] > 0.8
    assert abs(ahead["x"] - start["x"]) < 0.4
    assert left["x"] - ahead["x"] > 0.3  # +X is left
    assert left["yaw"] > 0.4


@opens
def test_the_mouse_turns_the_camera_and_brings_it_nearer(told: dict[str, Any]) -> None:
    azimuth, elevation, distance = told["eye"]
    expected = [azimuth - 100 * DRAG, elevation + 20 * DRAG, WHEEL * distance]
    assert told["turned eye"] == pytest.approx(expected)


@opens
def test_a_slider_changes_the_motion_until_it_is_reset(told: dict[str, Any]) -> None:
    assert told["set"] == pytest.approx(0.62, abs=0.05)  # of 0 to 1 s, where it was clicked
    way, slow = (np.hypot(told[name]["x"], told[name]["z"]) for name in ("ahead", "slowly"))
    assert 0.2 < slow < 0.8 * way
    assert told["reset"] == 0.27


@opens
def test_settings_are_saved_by_the_name_that_is_written(folder: Path, told: dict[str, Any]) -> None:
    assert config.load(Settings, folder / "w.toml").velocity_halflife == told["set"]
    assert not told["held while a name is written"]


@opens
def test_the_timeline_scrubs_and_jumps_to_what_comes_next(told: dict[str, Any]) -> None:
    assert told["paused"]
    scrubbed, ahead = told["scrubbed"], told["ahead"]
    assert scrubbed["time"] == pytest.approx(ahead["time"], abs=0.2)
    assert scrubbed["z"] == pytest.approx(ahead["z"], abs=0.3)
    later = [step / 60 for step in told["transitions"] if step / 60 > scrubbed["time"]]
    assert told["jumped"] == pytest.approx(later[0])


@opens
def test_the_picture_is_what_the_other_renderer_draws(folder: Path) -> None:
    plain, seen = (np.asarray(Image.open(folder / f"{name}.png")).astype(int) for name in ("plain", "window"))
    seen = seen[: plain.shape[0], : plain.shape[1]]
    for red, blue in ((0, 2), (2, 0)):  # the left of the body, its right
        there, here = (picture[..., red] - picture[..., blue] > 30 for picture in (plain, seen))
        assert there.sum() > 300
        assert (there & here).sum() > 0.7 * there.sum()
        assert here.sum() < 1.4 * there.sum()
    assert np.abs(plain - seen).mean() < 12


@opens
def test_arrows_and_points_are_what_the_other_renderer_draws(folder: Path, told: dict[str, Any]) -> None:
    plain, seen = (np.asarray(Image.open(folder / f"marked {name}.png")) for name in ("plain", "window"))
    seen = seen[: plain.shape[0], : plain.shape[1]].astype(int)
    there, here = (
        picture[..., 1] > picture[..., [0, 2]].max(axis=-1) + 40 for picture in (plain.astype(int), seen)
    )
    assert there.sum() > 200
    assert (there & here).sum() > 0.7 * there.sum() and here.sum() < 1.4 * there.sum()
    x, y = (round(at) for at in told["marked"])
    for picture in (plain, seen):  # the smaller of two points at one place is before the larger one
        red, green, _ = picture[y, x]
        assert red > 150 and green < 80
        red, green, _ = picture[y, x + 9]
        assert red > 150 and green > 120


@pytest.mark.parametrize(
    ("missing", "says"), [("display", "there is no display"), ("open3d", "open3d is not installed")]
)
@opens
def test_what_is_missing_is_said_in_a_line(missing: str, says: str) -> None:
    block = "import sys; sys.modules['open3d'] = None; " if missing == "open3d" else ""
    code = f"{block}from viewer.cli import main; main(['dancecard', '--systems', 'lmm'])"
    env = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=HERE.parent, env=env, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("error: ") and says in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_the_viewer_is_imported_without_open3d() -> None:
    code = "import sys; sys.modules['open3d'] = None; import viewer.cli, viewer.window.players"
    subprocess.run([sys.executable, "-c", code], cwd=HERE.parent, check=True)


def test_an_eye_behind_someone_looks_where_they_face() -> None:
    eye = Eye([0, 1, 0], azimuth=np.pi, elevation=0.2, distance=4.0)
    assert eye.yaw == pytest.approx(0.0)
    assert eye.now().position[2] < 0
    eye.drag(-100, 0)  # the mouse to the left: the camera goes to the right of them, and looks to the left
    assert eye.yaw > 0
    eye.zoom(1)
    assert eye.distance < 4
    seen = eye.move([5, 1, 0], 10.0)
    np.testing.assert_allclose(seen.target, [5, 1, 0], atol=1e-6)


def test_a_replay_begins_again_and_steps() -> None:
    class Line:
        fps, end = 10.0, 2.0

        def at(self, time: float) -> float:
            return time

    class One:
        name, timeline = "one", Line()

    replay = Replay([One()])  # type: ignore[list-item]
    for _ in range(5):
        replay.advance(0.1)
    assert replay.look().time == pytest.approx(0.5)
    replay.single_step()
    assert replay.paused and replay.shown == pytest.approx(0.6)
    replay.single_step(back=True)
    replay.single_step(back=True)
    assert replay.shown == pytest.approx(0.4)
    replay.scrub(1.95)
    replay.resume()
    replay.advance(0.2)
    assert replay.shown == 0.0
