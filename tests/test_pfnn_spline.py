"""lmm.pfnn.spline: the closed spline against SciPy's Hermite pieces; modes; the published sets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from lmm.pfnn import published, spline
from motion.errors import UserError

TURN = 2 * np.pi


def scipy_spline(points: np.ndarray) -> CubicHermiteSpline:
    """Catmull-Rom round the cycle: through the points, slopes half what their neighbours differ by."""
    knots = np.arange(-1, 6)
    values = points[knots % 4]
    slopes = (points[(knots + 1) % 4] - points[(knots - 1) % 4]) / 2
    return CubicHermiteSpline(knots * (TURN / 4), values, slopes / (TURN / 4))


def test_coefficients_are_the_hermite_spline_through_the_points() -> None:
    points = np.random.default_rng(0).standard_normal((4, 3))
    phases = np.linspace(0, TURN, 101)
    np.testing.assert_allclose(spline.coefficients(phases) @ points, scipy_spline(points)(phases), atol=1e-12)


def test_coefficients_go_round_the_cycle_and_sum_to_1() -> None:
    phases = np.linspace(-7, 13, 50).reshape(5, 10)
    found = spline.coefficients(phases)
    assert found.shape == (5, 10, 4)
    np.testing.assert_allclose(found.sum(axis=-1), 1)
    np.testing.assert_allclose(spline.coefficients(phases + TURN), found, atol=1e-12)


def test_control_points_stand_at_quarters() -> None:
    np.testing.assert_allclose(spline.coefficients(np.arange(4) * TURN / 4), np.eye(4), atol=1e-12)


@pytest.mark.parametrize("mode", ["cubic", "linear", "constant"])
def test_shares_of_sets_give_the_spline(mode: spline.Mode) -> None:
    points = np.random.default_rng(1).standard_normal((4, 3))
    phases = np.random.default_rng(2).uniform(0, TURN, 200)
    first, shares = spline.shares(phases, mode)
    held = spline.sets(points, mode)
    assert len(held) == spline.SETS[mode] and shares.shape == (200, spline.USED[mode])
    which = (first[:, None] + np.arange(spline.USED[mode])) % len(held)
    found = np.einsum("nu,nuc->nc", shares, held[which])
    exact = scipy_spline(points)(phases)
    # Straight pieces differ by bend h^2 / 8, the nearest set by slope h / 2.
    slope, bend = (np.abs(scipy_spline(points)(np.linspace(0, TURN, 999), nu)).max() for nu in (1, 2))
    limits = {"cubic": 1e-12, "linear": 1.01 * bend * (TURN / 10) ** 2 / 8, "constant": slope * TURN / 100}
    assert np.abs(found - exact).max() <= limits[mode]
    if mode != "cubic":
        assert np.abs(found - exact).max() > limits[mode] / 10


def test_linear_mode_meets_its_sets() -> None:
    first, shares = spline.shares([0.0, 0.05 * TURN, 0.95 * TURN, TURN], "linear")
    assert first.tolist() == [0, 0, 9, 0]
    np.testing.assert_allclose(shares, [[1, 0], [0.5, 0.5], [0.5, 0.5], [1, 0]], atol=1e-12)


def test_sets_keep_the_type_and_hold_the_spline() -> None:
    points = np.random.default_rng(3).standard_normal((4, 5, 2)).astype(np.float16)
    held = spline.sets(points, "constant")
    assert held.dtype == np.float16 and held.shape == (50, 5, 2)
    exact = scipy_spline(points.astype(np.float64))(np.arange(50) / 50 * TURN)
    np.testing.assert_allclose(held, exact, atol=4e-3)


def test_an_unknown_mode_lists_the_modes() -> None:
    with pytest.raises(UserError, match="cubic, linear, constant"):
        spline.check_mode("quadratic")


def test_four_published_sets_reproduce_the_fifth(data: Path) -> None:
    folder = data / "reference" / "pfnn" / "network"
    for layer, (rows, columns) in enumerate(((512, 342), (512, 512), (311, 512))):
        names = [*published.CONTROL_FILES, "006"]
        *controls, sixth = (published.read(folder / f"W{layer}_{k}.bin", rows, columns) for k in names)
        blended = np.tensordot(spline.coefficients(TURN * 6 / 50), np.array(controls), axes=1)
        error = np.linalg.norm(blended - sixth) / np.linalg.norm(sixth)
        nearest = min(np.linalg.norm(control - sixth) for control in controls) / np.linalg.norm(sixth)
        assert error < 0.02 < nearest
