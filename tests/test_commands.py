"""Sticks and velocities to commands: directions, speeds on the ellipse, what is kept at rest."""

from __future__ import annotations

import numpy as np
import pytest

from mm.commands import from_stick, from_velocity
from mm.speeds import Speeds

QUARTER = np.pi / 2
SPEEDS = Speeds(walk=(2.0, 1.5, 1.0), run=(4.0, 3.0, 2.0))


def stick(x, z, camera=0.0, *, yaw=None, **options):
    """One character that faces where the camera looks, unless told otherwise."""
    options = {"speeds": SPEEDS, **options}
    command = from_stick([[x, z]], [camera], yaw=[camera if yaw is None else yaw], **options)
    return command.velocity[0], float(command.yaw[0]), command


def test_forward_with_the_camera_along_x_goes_along_x():
    velocity, yaw, _ = stick(0, 1, QUARTER)
    np.testing.assert_allclose(velocity, [2, 0], atol=1e-6)
    assert yaw == pytest.approx(QUARTER)


def test_right_is_the_cameras_right():
    # Looking along +Z with Y up and +X to the left, the right is -X.
    velocity, yaw, _ = stick(1, 0)
    np.testing.assert_allclose(velocity, [-1.5, 0], atol=1e-6)
    assert yaw == pytest.approx(-QUARTER)
    # Looking along +X, the right is +Z.
    np.testing.assert_allclose(stick(1, 0, QUARTER)[0], [0, 1.5], atol=1e-6)


@pytest.mark.parametrize("gait, speeds", [(0, (2, 1.5, 1)), (1, (4, 3, 2)), (0.5, (3, 2.25, 1.5))])
def test_full_tilts_go_at_the_speeds_of_the_gait(gait, speeds):
    forward, side, back = speeds
    assert np.hypot(*stick(0, 1, gait=[gait])[0]) == pytest.approx(forward)
    assert np.hypot(*stick(1, 0, gait=[gait])[0]) == pytest.approx(side)
    assert np.hypot(*stick(0, -1, gait=[gait])[0]) == pytest.approx(back)


def test_a_diagonal_lies_on_the_ellipse():
    half = np.sqrt(0.5)
    velocity, _, _ = stick(-half, half, strafe=[True])
    np.testing.assert_allclose(velocity, [1.5 * half, 2.0 * half], rtol=1e-6)


def test_speeds_go_by_the_characters_own_facing():
    # Facing +X, asked along -X: that is backward for it, whatever the camera.
    np.testing.assert_allclose(stick(1, 0, 0.0, yaw=QUARTER)[0], [-1, 0], atol=1e-6)


def test_strafing_faces_with_the_camera():
    _, yaw, _ = stick(1, 0, 0.3, strafe=[True])
    assert yaw == pytest.approx(0.3)


def test_at_rest_the_last_facing_asked_for_is_kept():
    velocity, yaw, _ = stick(0, 0, 1.0, yaw=0.2, last_yaw=[0.7])
    assert not velocity.any() and yaw == pytest.approx(0.7)
    assert stick(0, 0, 1.0, yaw=0.2)[1] == pytest.approx(0.2)


def test_the_dead_zone_counts_as_rest_and_the_way_beyond_it_starts_at_nothing():
    assert not stick(0.1, 0.1, deadzone=0.2)[0].any()
    assert np.hypot(*stick(0, 0.21, deadzone=0.2)[0]) == pytest.approx(2.0 * 0.01 / 0.8, rel=1e-3)
    assert np.hypot(*stick(0, 1, deadzone=0.2)[0]) == pytest.approx(2.0)


def test_a_tilt_into_the_corner_is_no_faster():
    velocity, _, _ = stick(-1, 1, strafe=[True])
    np.testing.assert_allclose(velocity, stick(-np.sqrt(0.5), np.sqrt(0.5), strafe=[True])[0], rtol=1e-5)


def test_a_camera_that_has_gone_round_many_times_asks_for_an_angle_in_range():
    _, yaw, command = stick(0, 1, 0.5 + 20 * np.pi, camera_rate=[0.4], strafe=[True])
    assert yaw == pytest.approx(0.5, abs=1e-4)
    assert command.turn_rate[0] == pytest.approx(0.4)


def test_many_equal_one_at_a_time():
    rng = np.random.default_rng(0)
    n = 1024
    values = {
        "yaw": rng.uniform(-3, 3, n),
        "last_yaw": rng.uniform(-3, 3, n),
        "camera_rate": rng.uniform(-1, 1, n),
        "strafe": rng.random(n) < 0.5,
        "gait": rng.random(n),
    }
    tilt, camera = rng.uniform(-1, 1, (n, 2)), rng.uniform(-3, 3, n)
    tilt[::7] = 0
    many = from_stick(tilt, camera, speeds=SPEEDS, **values)
    for i in range(0, n, 97):
        one = from_stick(
            tilt[i : i + 1], camera[i : i + 1], speeds=SPEEDS, **{k: v[i : i + 1] for k, v in values.items()}
        )
        np.testing.assert_array_equal(one.velocity[0], many.velocity[i])
        assert one.yaw[0] == many.yaw[i]
    assert many.velocity.dtype == many.yaw.dtype == np.float32 and len(many) == n


def test_a_velocity_faces_its_way_a_facing_or_the_last_one():
    velocity = [[1, 0], [0, 0], [1, 0]]
    command = from_velocity(velocity, [[0, 0], [0, 0], [0, -2]], last_yaw=[9, 0.4, 9])
    np.testing.assert_allclose(command.yaw, [QUARTER, 0.4, -np.pi], rtol=1e-6)
    np.testing.assert_allclose(command.velocity, velocity)


def test_a_velocity_is_shortened_to_the_greatest_speed():
    command = from_velocity([[3, 4], [0.3, 0.4], [0, 0]], max_speed=1)
    np.testing.assert_allclose(command.velocity, [[0.6, 0.8], [0.3, 0.4], [0, 0]], rtol=1e-6)
