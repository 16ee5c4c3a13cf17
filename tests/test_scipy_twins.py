"""Our own smoothing and splines equal SciPy's, which take longer to import than a database to build."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import synthetic
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from motion import resample, root


@pytest.mark.parametrize(
    ("frames", "window", "order"),
    [(100, 31, 3), (61, 61, 3), (32, 31, 3), (5, 5, 3), (3, 3, 2), (300, 61, 3)],
)
def test_smoothing_is_savitzky_and_golay_s(frames: int, window: int, order: int) -> None:
    values = np.random.default_rng(0).standard_normal((frames, 2, 3)).cumsum(axis=0)
    expected = savgol_filter(values, window, order, axis=0, mode="interp")
    np.testing.assert_allclose(root.savitzky_golay(values, window, order), expected, atol=1e-10)


@pytest.mark.parametrize("frames", [2, 3, 4, 5, 6, 7, 40])
@pytest.mark.parametrize("fps", [100.0, 29.97, 60 / 7])
def test_positions_follow_the_cubic_spline(frames: int, fps: float) -> None:
    clip = synthetic.walk(seconds=2, speed=1.5, turn=1.0)
    clip = clip.replace(positions=clip.positions[:frames], rotations=clip.rotations[:frames])
    found = resample.resample(clip, fps)
    times = np.arange(len(found)) * 60 / fps
    expected = CubicSpline(np.arange(frames), clip.positions)(np.minimum(times, frames - 1))
    np.testing.assert_allclose(found.positions, expected, atol=1e-12)


def test_building_imports_no_slow_module() -> None:
    slow = {"scipy.signal", "scipy.interpolate", "scipy.stats"}
    code = f"import sys, mm.build; print(*({slow} & set(sys.modules)))"
    repository = Path(__file__).resolve().parents[1]
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=repository, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []
