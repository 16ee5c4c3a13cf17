"""Metrics against cases worked out by hand, and against real clips."""

from __future__ import annotations

import numpy as np
import pytest

from features.terrain import flat
from mm import metrics
from motion import kinematics, quat

FPS = 60.0


def test_joint_position_error_by_hand():
    truth = np.zeros((4, 3, 3))
    found = truth.copy()
    found[:, 1, 0] = 0.03  # one joint 3 cm off always
    found[0, 2] = [0, 0.03, 0.04]  # another 5 cm off once
    errors = metrics.joint_position_error(truth, found)
    assert errors.mean == pytest.approx((4 * 3 + 5) / 12)
    values = np.array([3.0] * 4 + [5] + [0] * 7)
    assert errors.std == pytest.approx(values.std())
    assert errors.p99 == pytest.approx(np.percentile(values, 99))
    assert (errors.worst_joint, errors.worst) == (1, pytest.approx(3))


def test_rotation_error_is_the_angle_and_ignores_signs():
    truth = quat.identity(2, 1)
    found = quat.from_axis_angle([0.0, 1.0, 0.0], np.radians([[30.0], [90.0]]))
    assert metrics.rotation_error(truth, found).mean == pytest.approx(60)
    assert metrics.rotation_error(truth, -found).mean == pytest.approx(60)


def test_velocity_error_ignores_a_constant_offset():
    truth = np.cumsum(np.ones((10, 2, 3)), axis=0) / FPS
    assert metrics.velocity_error(truth, truth + 0.1, FPS).mean == pytest.approx(0, abs=1e-9)
    faster = truth * [1.25, 1, 1]  # 0.25 m/s too fast along x
    assert metrics.velocity_error(truth, faster, FPS).mean == pytest.approx(25)


def test_velocity_error_leaves_out_steps_between_clips():
    truth = np.zeros((6, 2, 3))
    found = truth.copy()
    found[3:, :, 0] += 1  # a metre from one frame to the next, 6,000 cm/s in one of five steps
    assert metrics.velocity_error(truth, found, FPS).mean == pytest.approx(6000 / 5)
    assert metrics.velocity_error(truth, found, FPS, starts=[0, 3]).mean == 0
    assert metrics.velocity_error(truth, found, FPS, starts=[0, 2]).mean == pytest.approx(6000 / 4)


def foot(speed: float, height: float, frames: int = 61) -> np.ndarray:
    """One foot [T, 1, 3] that slides along x at a height."""
    x = speed * np.arange(frames) / FPS
    return np.stack([x, np.full(frames, height), np.zeros(frames)], axis=-1)[:, None]


@pytest.mark.parametrize(
    ("height", "weight"), [(0.0, 1.0), (0.025, 0.0), (0.1, 0.0), (-0.02, 1.0), (0.0125, 2 - np.sqrt(2))]
)
def test_foot_skate_formula(height, weight):
    assert metrics.foot_skate(foot(0.8, height), FPS) == pytest.approx(80 * weight)


def test_foot_skate_is_measured_above_the_resting_height():
    ankle = foot(0.8, 0.09)
    assert metrics.foot_skate(ankle, FPS) == 0
    assert metrics.foot_skate(ankle, FPS, [0.09]) == pytest.approx(80)
    assert metrics.resting_heights(ankle) == pytest.approx([0.09])


def test_resting_heights_are_those_of_walking_not_of_lying():
    """An animal lies for 8 s with its hocks on the ground, then walks for 2 s; they stand at 12 cm."""
    frames, walks = 600, np.arange(600) >= 480
    feet = np.zeros((frames, 2, 3))
    feet[:, :, 1] = 0.004
    steps = np.stack([np.sin(np.arange(frames) / 9) > 0, np.sin(np.arange(frames) / 9) <= 0], axis=1)
    feet[walks, :, 1] = np.where(steps[walks], 0.12, 0.2)
    speed = np.where(walks, 0.8, 0.0)
    contacts = np.where(walks[:, None], steps, True)
    assert metrics.resting_heights(feet, contacts, speed) == pytest.approx([0.12, 0.12])
    assert metrics.resting_heights(feet) == pytest.approx([0.004, 0.004])
    # Whoever never walks has the low percentile; so has a foot that is hardly ever down while walking.
    assert metrics.resting_heights(feet, contacts, 0 * speed) == pytest.approx([0.004, 0.004])
    contacts[walks, 1] = False
    assert metrics.resting_heights(feet, contacts, speed) == pytest.approx([0.12, 0.004])


def test_without_feet_nothing_skates_and_nothing_glides():
    none, root = np.zeros((61, 0, 3)), np.cumsum(np.full((61, 2), 0.02), axis=0)
    assert metrics.resting_heights(none, np.zeros((61, 0)), np.ones(61)).shape == (0,)
    assert np.isnan(metrics.foot_skate(none, FPS, np.zeros(0)))
    assert np.isnan(metrics.skate_ratio(none, FPS, np.zeros(0)))
    assert np.isnan(metrics.glide_share(none, root, FPS))


def test_airborne_is_when_every_foot_is_up():
    feet = np.zeros((4, 2, 3))
    feet[:, :, 1] = [[0.1, 0.1], [0.1, 0.16], [0.3, 0.2], [0.3, 0.16]]
    assert metrics.airborne_share(feet, [0.1, 0.1]) == 0.5
    assert np.isnan(metrics.airborne_share(np.zeros((61, 0, 3))))


def test_foot_skate_averages_feet_and_characters():
    feet = np.stack([foot(0.8, 0.0), foot(0.0, 0.0)], axis=1)  # two characters, one foot each
    assert metrics.foot_skate(feet, FPS) == pytest.approx(40)


def test_skate_ratio_needs_both_frames_low_and_fast():
    assert metrics.skate_ratio(foot(0.8, 0.04), FPS) == 1
    assert metrics.skate_ratio(foot(0.4, 0.04), FPS) == 0
    assert metrics.skate_ratio(foot(0.8, 0.06), FPS) == 0
    hops = foot(0.8, 0.0)
    hops[1::2, 0, 1] = 0.06  # low only every other frame
    assert metrics.skate_ratio(hops, FPS) == 0
    either = np.concatenate([foot(0.8, 0.0), foot(0.0, 0.0)], axis=1)
    assert metrics.skate_ratio(either, FPS) == 1


def test_glide_is_travel_without_a_foot_going_back():
    t = np.arange(121) / FPS
    root = np.stack([np.zeros(121), 1.2 * t], axis=-1)
    carried = np.zeros((121, 2, 3))
    carried[..., 1], carried[..., 2] = 0.3, root[:, None, 1]  # both feet in the air, fixed to the root
    assert metrics.glide_share(carried, root, FPS) == 1
    planted = carried.copy()
    planted[:, 0] = 0  # one foot stays on the ground
    assert metrics.glide_share(planted, root, FPS) == 0
    assert metrics.glide_share(carried, 0 * root, FPS) == 0  # standing still is no glide


def test_heights_over_a_ground_are_those_above_what_is_beneath():
    points = np.array([[2.0, 1.0, 3.0], [-1.0, 0.0, 0.5]])
    over = metrics.over_ground(points, lambda x, z: 0.1 * x + z)
    np.testing.assert_allclose(over, [[2.0, 1.0 - 3.2, 3.0], [-1.0, -0.4, 0.5]])
    assert points[0, 1] == 1.0


# A frame of two feet, heights of toe and heel; they rest at 2 and 3 cm.
SOLES = 0.01 * np.array([[[2.0, 3.0], [2.0, 3.0]], [[0.5, 3.0], [-1.0, 2.0]], [[5.0, 8.0], [9.0, 3.0]]])
RESTS = 0.01 * np.array([[2.0, 3.0], [2.0, 3.0]])


def soles(heights: np.ndarray) -> np.ndarray:
    return np.stack([7 + 0 * heights, heights, heights - 5], axis=-1)


def test_a_frame_sinks_as_deep_as_its_deepest_sole():
    np.testing.assert_allclose(metrics.sink(soles(SOLES), flat, RESTS), [0, 3, 0], atol=1e-12)
    two = np.stack([SOLES, SOLES - 0.01], axis=1)  # a second character stands 1 cm lower
    np.testing.assert_allclose(metrics.sink(soles(two), flat, RESTS), [[0, 1], [3, 4], [0, 1]], atol=1e-12)
    raised = metrics.sink(soles(SOLES + 0.5), lambda x, z: 0.5 + 0 * x, RESTS)
    np.testing.assert_allclose(raised, [0, 3, 0], atol=1e-12)
    assert np.isnan(metrics.sink(np.zeros((3, 0, 2, 3)), flat)).all()


def test_the_shortest_way_out_of_the_ground_may_be_to_the_side():
    def stair(x, z):
        return np.where(x < 0, 0.3, 0.0)

    def sunk(*point: float, ground=stair) -> float:
        return float(metrics.sink(np.array(point).reshape(1, 1, 1, 3), ground)[0])

    assert sunk(0.001, 0.0, 5.0) == 0
    assert sunk(-0.04, 0.0, 5.0) == pytest.approx(5)  # 4 cm, but ways out are 3, 5, 7, ... cm long
    assert sunk(-0.04, 0.29, 5.0) == pytest.approx(1)  # nearer to the top
    assert sunk(-0.04, -0.03, 5.0) == pytest.approx(np.hypot(3, 5))  # aside, and up to the lower floor
    assert sunk(-0.5, 0.1, 5.0) == pytest.approx(20)
    # A slope of 45 degrees, 10 cm above the point: 7.07 cm away, up it and against it.
    assert sunk(1.0, 0.9, 0.0, ground=lambda x, z: x) == pytest.approx(100 * 0.1 / np.sqrt(2), rel=0.01)


def test_a_planted_foot_hovers_by_its_lowest_point():
    # Planted and above rest: frame 0 not at all; frame 2 the left one by 3 (its toe), the right by 0 (heel).
    for planted, mean in (([[1, 1], [0, 0], [1, 1]], 3 / 4), ([[0, 0], [1, 1], [1, 0]], 3 / 3)):
        assert metrics.hover(soles(SOLES), flat, planted, RESTS) == pytest.approx(mean)
    assert np.isnan(metrics.hover(soles(SOLES), flat, np.zeros((3, 2)), RESTS))


def test_smooth_is_a_centred_average():
    values = np.zeros(21)
    values[10] = 1
    smoothed = metrics.smooth(values, FPS, 5 / FPS)
    np.testing.assert_allclose(smoothed[8:13], 0.2)
    assert smoothed[7] == pytest.approx(0) and smoothed[13] == pytest.approx(0)
    ramp = np.arange(30.0)
    np.testing.assert_allclose(metrics.smooth(ramp, FPS)[6:-6], ramp[6:-6])


def test_wrap():
    np.testing.assert_allclose(
        metrics.wrap([0.5, np.pi + 0.1, -np.pi - 0.1]), [0.5, 0.1 - np.pi, np.pi - 0.1]
    )


def test_root_speed_path_length_and_speed_ratio():
    positions = np.stack([np.zeros(301), 1.5 * np.arange(301) / FPS], axis=-1)
    np.testing.assert_allclose(metrics.root_speed(positions, FPS), 1.5)
    assert metrics.path_length(positions) == pytest.approx(7.5)
    asked = np.full((301, 2), [0.0, 2.0])
    assert metrics.speed_ratio(positions, asked, FPS) == pytest.approx(0.75)
    assert np.isnan(metrics.speed_ratio(positions, 0 * asked, FPS))


def test_trajectory_error_beside_a_straight_path():
    z = np.linspace(0, 10, 400)
    positions = np.stack([np.full(400, 0.25), z], axis=-1)
    path = np.array([[0.0, 0.0], [0.0, 10.0]])
    yaws = np.full(400, np.radians(10.0))
    errors = metrics.trajectory_error(positions, yaws, np.zeros(400), path)
    assert errors.mean_cm == pytest.approx(25)
    assert errors.p95_cm == pytest.approx(25)
    assert errors.heading_deg == pytest.approx(10)


def test_heading_error_takes_the_short_way_round():
    positions, yaws = np.zeros((5, 2)), np.full(5, np.radians(179.0))
    errors = metrics.trajectory_error(positions, yaws, np.full(5, np.radians(-179.0)), None)
    assert errors.heading_deg == pytest.approx(2)
    assert np.isnan(errors.mean_cm)


def test_nearest_point_is_windowed_where_a_path_doubles_back():
    # Out along z, 1 m aside, back again: walking the way out 0.9 m aside is nearer to the way back.
    path = np.array([[0.0, 0.0], [0.0, 20.0], [1.0, 20.0], [1.0, 0.0]])
    out = np.stack([np.linspace(0, 0.9, 900), np.linspace(0, 15, 900)], axis=-1)
    distance, direction = metrics.nearest_on_path(out, path)
    assert distance[-1] == pytest.approx(0.9)
    np.testing.assert_allclose(direction, 0, atol=1e-9)
    back = np.stack([np.full(900, 1.0), np.linspace(20, 5, 900)], axis=-1)
    distance, direction = metrics.nearest_on_path(back, path)
    np.testing.assert_allclose(distance, 0, atol=1e-9)
    np.testing.assert_allclose(np.abs(direction[10:]), np.pi, atol=1e-9)


@pytest.mark.parametrize("before", [0.5, 1.2, 1.9])
def test_who_turns_before_a_sharp_corner_has_gone_over_to_the_way_behind_it(before):
    turn = np.radians(123)
    corner, back = np.array([0.0, 20.0]), np.array([np.sin(turn), np.cos(turn)])
    path = np.stack([np.zeros(2), corner, corner + 20 * back])
    ahead = np.stack([np.zeros(400), np.linspace(0, 20 - before, 400)], axis=-1)
    aside = ahead[-1] + np.linspace(0, 15, 300)[:, None] * back  # beside the way back from then on
    distance, direction = metrics.nearest_on_path(np.concatenate([ahead, aside]), path)
    assert distance[-1] == pytest.approx(before * np.sin(turn))
    assert direction[-1] == pytest.approx(turn)


@pytest.mark.parametrize("lobe", [1, -1])
def test_who_begins_at_a_crossing_is_on_the_branch_that_it_keeps_to(lobe):
    angle = np.linspace(0, 2 * np.pi, 400)
    left = 2 * np.stack([1 - np.cos(angle), np.sin(angle)], axis=-1)
    path = np.concatenate([left, left * [-1, 1]])
    walked = left[:300] * [lobe, 1] + [0.001, 0.001]
    distance, _ = metrics.nearest_on_path(walked, path)
    assert distance.max() < 0.01


def test_nearest_point_goes_round_a_closed_path():
    angle = np.linspace(0, 4 * np.pi, 2001)  # two laps, 10 cm outside
    circle = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    distance, _ = metrics.nearest_on_path(2.1 * circle, 2 * circle[:1001:20])
    assert abs(100 * distance - 10).max() < 1.5  # the polygon's sagitta is 0.4 cm, respacing adds to it


def test_nearest_point_of_several_characters_is_each_ones_own():
    path = np.array([[0.0, 0.0], [0.0, 10.0]])
    z = np.linspace(0, 9, 300)
    one = np.stack([np.full(300, 0.1), z], axis=-1)
    other = np.stack([np.full(300, -0.3), z[::-1]], axis=-1)
    distance, _ = metrics.nearest_on_path(np.stack([one, other], axis=1), path)
    np.testing.assert_allclose(distance, np.broadcast_to([0.1, 0.3], (300, 2)), atol=1e-9)


def test_a_path_without_direction_is_refused():
    with pytest.raises(ValueError, match="no direction"):
        metrics.nearest_on_path(np.zeros((3, 2)), np.zeros((2, 2)))


def exponential(t: np.ndarray, halflife: float) -> np.ndarray:
    return np.where(t >= 0, 1 - 2.0 ** (-np.maximum(t, 0) / halflife), 0)


def test_step_response_of_an_exponential():
    t = np.arange(240) / FPS
    command = np.where(t >= 1, 2.0, 0.0)
    actual = 2 * exponential(t - 1, 0.2)
    seconds = metrics.step_response(command, actual, FPS, minimum=0.5)
    assert seconds == pytest.approx([0.2 * np.log2(10)], abs=1.5 / FPS)


def test_step_response_down_unanswered_short_and_wrapping():
    t = np.arange(240) / FPS
    down = np.where(t >= 1, 0.0, 2.0)
    slowing = 2 - 2 * exponential(t - 1, 0.1)
    assert metrics.step_response(down, slowing, FPS, minimum=0.5) == pytest.approx(
        [0.1 * np.log2(10)], abs=1.5 / FPS
    )
    assert np.isnan(metrics.step_response(down, np.full(240, 2.0), FPS, minimum=0.5)).all()
    blip = np.where((t > 1) & (t < 1.2), 2.0, 0.0)
    blip_answers = metrics.step_response(blip, blip, FPS, minimum=0.5)
    assert len(blip_answers) == 1  # the way up is held for 0.2 s only, the way down for good
    yaw = np.where(t >= 1, np.radians(-170.0), np.radians(170.0))  # 20 degrees across the seam
    assert metrics.step_response(yaw, yaw, FPS, minimum=0.1, angular=True) == pytest.approx([1 / FPS])


def test_responsiveness_of_a_ramp():
    t = np.arange(360) / FPS
    asked = np.zeros((360, 1, 2))
    asked[t >= 1, 0, 1] = 2.0
    speed = np.clip(t - 1, 0, 1) * 2  # 2 m/s after a second
    positions = np.zeros((360, 1, 2))
    positions[:, 0, 1] = np.cumsum(speed) / FPS
    yaw = np.where(t >= 3, np.radians(90.0), 0.0)[:, None]
    turned = np.radians(90.0) * np.clip((t - 3) / 0.5, 0, 1)[:, None]
    found = metrics.responsiveness(asked, yaw, positions, turned, FPS)
    # 0.2 s of smoothing rounds the ramp's upper corner, which costs up to 0.05 s.
    assert 0.9 <= found.speed_s < 0.95
    assert 0.45 <= found.heading_s < 0.5
    assert (found.speed_steps, found.heading_steps, found.answered) == (1, 1, 1.0)
    still = metrics.responsiveness(0 * asked, 0 * yaw, positions, turned, FPS)
    assert np.isnan(still.speed_s) and np.isnan(still.answered) and still.speed_steps == 0


def test_jerk_of_a_cubic():
    t = np.arange(50) / FPS
    positions = np.zeros((50, 2, 3))
    positions[:, 0, 0] = 2 * t**3  # third derivative 12
    assert metrics.jerk(positions, FPS) == pytest.approx(6)  # the other joint's is 0
    assert metrics.jerk(positions[:3], FPS) == 0


def test_pop_is_what_velocity_does_not_predict():
    positions = np.zeros((20, 2, 3))
    positions[:, 0, 0] = 0.01 * np.arange(20)
    assert metrics.pops(positions).max() == pytest.approx(0, abs=1e-12)
    positions[10:, 0, 1] += 0.04  # a jump of 4 cm at frame 10
    pops = metrics.pops(positions)
    assert pops[10] == pytest.approx(4) and pops[9] == pytest.approx(0, abs=1e-12)
    transition = np.zeros(20, bool)
    transition[10] = True
    assert metrics.largest_pop(positions, transition) == pytest.approx(4)
    elsewhere = np.zeros(20, bool)
    elsewhere[5] = True
    assert metrics.largest_pop(positions, elsewhere) == pytest.approx(0, abs=1e-12)
    assert np.isnan(metrics.largest_pop(positions, np.zeros(20, bool)))


def test_command_path_is_the_integral():
    asked = np.full((60, 2), [0.0, 1.5])
    np.testing.assert_allclose(metrics.command_path(asked, [1.0, 0.0], FPS)[-1], [1, 1.5])


CLIPS = (
    "lafan1/locomotion_60fps/walk1_subject1_walk2_filtered.bvh",
    "bandai/dataset-2/dataset-2_walk_active_001.bvh",
    "cmu/asfamc/16/16_15.amc",
)


@pytest.mark.parametrize("name", CLIPS)
def test_real_clips_skate_little_and_sped_up_ones_more(data, name):
    from motion import sources

    clip = sources.load(data / name)
    positions, _ = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    roles = clip.skeleton.roles
    feet = positions[:, [roles.get(f"{s}_toe", roles.get(f"{s}_foot")) for s in ("left", "right")]]
    hips = positions[:, roles["hips"]]
    rest = metrics.resting_heights(feet)
    skate = metrics.foot_skate(feet, clip.fps, rest)
    speed = float(metrics.root_speed(hips[:, [0, 2]], clip.fps).mean())
    assert 100 * speed > 50  # it does walk
    assert skate < 0.15 * 100 * speed
    faster = feet + 0.1 * (hips - hips[:1])[:, None] * [1, 0, 1]
    assert metrics.foot_skate(faster, clip.fps, rest) > 1.15 * skate
    assert metrics.glide_share(feet, hips[:, [0, 2]], clip.fps) < 0.02
    assert metrics.skate_ratio(faster, clip.fps, rest) >= metrics.skate_ratio(feet, clip.fps, rest)


def test_relative_error_is_the_share_of_the_distance_from_the_root():
    truth = np.array([[[0.0, 1.0, 0.0], [0.0, 0.0, 2.0]], [[0.0, 1.0, 0.0], [3.0, 0.0, 4.0]]])
    found = truth.copy()
    found[0, 0, 0], found[1, 1, 1] = 0.1, 1
    np.testing.assert_allclose(metrics.relative_error(truth, found), [[0.1, 0], [0, 0.2]])
    assert np.isfinite(metrics.relative_error(np.zeros((1, 3)), np.ones((1, 3)))).all()


def test_significance_is_that_of_the_thesis():
    # Laps of HOLDEN-XL and HOLDEN-XT have means 0.499 and 0.382, deviations 0.0161 and 0.0167: 7.1.
    def laps(mean, sd):
        return mean + sd * np.array([1.0, -1.0] * 9 + [0.0])

    assert metrics.significance(laps(0.499, 0.0161), laps(0.382, 0.0167)) == pytest.approx(7.1, abs=0.05)
    assert metrics.significance([0.0, 2.0], [3.0, 5.0]) == pytest.approx(3 / np.sqrt(2))
    assert metrics.significance([1, 1], [1, 1]) == 0
    assert metrics.significance([1, 1], [2, 2]) == np.inf
    assert np.isnan(metrics.significance([1], [1, 2]))


def walking(
    speed: float, steps: float, frames: int = 301, *, stride: float = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Feet [T, 2, 3] that swing by turns, and a root [T, 2] that moves along z at a speed."""
    time = np.arange(frames) / FPS
    root = np.stack([np.zeros(frames), speed * time], axis=-1)
    angle = 2 * np.pi * time / stride
    swing = steps * np.stack([np.sin(angle), -np.sin(angle)], axis=-1)
    feet = np.zeros((frames, 2, 3))
    feet[..., 2] = root[:, None, 1] + swing
    return feet, root


@pytest.mark.parametrize(("speed", "steps", "stalls"), [(1, 0.3, False), (1, 0, True), (0, 0, True)])
def test_who_is_carried_along_or_stands_has_stalled(speed, steps, stalls):
    feet, root = walking(speed, steps)
    asked = np.tile([0.0, 1.0], (len(root), 1))
    found = metrics.longest_stall(feet, root, asked, FPS)
    assert found == 301 / FPS if stalls else found < 0.2
    asked[:100] = 0  # nothing is asked for at first, and for a moment later
    asked[200] = 0
    found = metrics.longest_stall(feet, root, asked, FPS)
    assert found == 100 / FPS if stalls else found < 0.2
    two = metrics.longest_stall(
        np.stack([feet, feet], 1), np.stack([root, root], 1), np.stack([asked, 0 * asked], 1), FPS
    )
    assert two == found
    assert np.isnan(metrics.longest_stall(feet[:, :0], root, asked, FPS))


@pytest.mark.parametrize("stride", [0.4, 0.5, 0.7, 1.4])
def test_who_takes_quick_or_slow_steps_has_not_stalled(stride):
    feet, root = walking(3, 3 * stride / 4, stride=stride)
    asked = np.tile([0.0, 3.0], (len(root), 1))
    assert metrics.longest_stall(feet, root, asked, FPS) < 0.2
