"""Quaternions by their three smallest components: never farther off than the bound that is stated."""

from __future__ import annotations

import numpy as np
import pytest

from mm.codecs import smallest_three
from motion import quat


def rotations(count: int, joints: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    q = rng.standard_normal((count, joints, 4))
    q[: count // 4] = 1 + 0.05 * rng.standard_normal((count // 4, joints, 4))  # where rounding costs most
    q[count // 4 : count // 2, :, 1:] *= 1e-3  # hardly turned
    q[0, 0], q[0, 1], q[0, 2] = [1, 0, 0, 0], [0, 0, -1, 0], [-1, 1, -1, 1]
    return quat.normalize(q)


@pytest.mark.parametrize("bits", [6, 11, 16, 18])
def test_rounding_is_within_the_bound_and_close_to_it(bits: int) -> None:
    truth = rotations(2000, 7)
    rows = smallest_three.encode(truth, bits)
    assert rows.dtype == np.uint8 and rows.shape == (2000, -(-7 * (2 + 3 * bits) // 8))
    off = quat.angle_between(smallest_three.decode(rows, 7, bits), truth)
    assert off.max() <= smallest_three.bound(bits)
    assert off.max() >= 0.6 * smallest_three.bound(bits)


def test_sizes_and_bounds_are_those_known() -> None:
    assert smallest_three.width(11) == 35 and smallest_three.width(16) == 50
    # Half a step of sqrt(2) / 65535, sqrt(3) of it, twice for the component left out, twice for the angle.
    np.testing.assert_allclose(smallest_three.bound(16), 2 * 6**0.5 / 65535, rtol=1e-3)
    assert np.degrees(smallest_three.bound(11)) == pytest.approx(0.137, abs=1e-3)


def test_either_sign_is_the_same_rotation() -> None:
    truth = rotations(100, 3)
    np.testing.assert_array_equal(smallest_three.encode(truth, 11), smallest_three.encode(-truth, 11))


def test_no_joints_take_no_bytes() -> None:
    rows = smallest_three.encode(np.zeros((5, 0, 4)), 11)
    assert rows.shape == (5, 0) and smallest_three.decode(rows, 0, 11).shape == (5, 0, 4)
