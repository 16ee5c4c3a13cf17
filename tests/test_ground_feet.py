"""Feet on slopes, steps and cliffs against closed forms, compiled against plain; bones keep their length."""

import numpy as np
import pytest
import synthetic

from features import terrain, terrain_made
from mm.build import build
from mm.description import Description
from mm.ground_feet import GroundFeet
from motion import kinematics, quat
from motion.errors import NotFinite, UserError

FPS = 60.0
HILLS = terrain_made.make(4, "hills", size=(30, 30))


@pytest.fixture(scope="module")
def database(walker_files):
    return build([walker_files], jobs=1, mirror=False)


@pytest.fixture(scope="module")
def legs(database):
    return Description.of(database).feet()


def frames(database, name, count=120):
    """Local positions [T, J, 3], rotations [T, J, 4] and contacts [T, C] of a clip's first frames."""
    start = database.starts[[name in other for other in database.names].index(True)]
    poses = database.poses[slice(start, start + count)]
    return poses.positions.copy(), poses.rotations.copy(), database.contacts[start : start + count].copy()


def at(clips, frame):
    """Positions, rotations and contacts [N, ..] of several clips at a frame."""
    return (np.stack([clip[part][frame] for clip in clips]) for part in range(3))


def world(database, legs, positions, rotations):
    """World positions of joints [.., J, 3], and of what touches and of ankles [.., C, 3]."""
    joints, turns = kinematics.forward(
        database.skeleton, positions.astype(np.float64), rotations.astype(np.float64)
    )
    touching = legs.joints[:, 3]
    touches = joints[..., touching, :] + quat.rotate(turns[..., touching, :], legs.points)
    return joints, touches, joints[..., legs.joints[:, 2], :]


def play(database, legs, clip, ground, *, count=120, **options):
    """A clip's frames one after another on a ground: before and after, positions and rotations, contacts."""
    positions, rotations, contacts = frames(database, clip, count)
    feet = GroundFeet(database.skeleton, legs, FPS, 1, ground=ground, **options)
    after = positions.copy(), rotations.copy()
    for i in range(len(positions)):
        feet.apply(contacts[i : i + 1], after[0][i : i + 1], after[1][i : i + 1])
    return (positions, rotations), after, contacts


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("clip", ["left_turn", "run", "stand"])
def test_flat_ground_changes_nothing_and_raised_flat_ground_raises(database, legs, clip, compiled):
    count = 120 if compiled else 20
    before, after, _ = play(database, legs, clip, terrain.flat, compiled=compiled, count=count)
    for was, now in zip(before, after, strict=True):
        np.testing.assert_array_equal(was, now)
    before, after, _ = play(
        database, legs, clip, lambda x, z: np.full_like(x, 2.5), compiled=compiled, count=count
    )
    before[0][:, 0, 1] += 2.5
    for was, now in zip(before, after, strict=True):
        np.testing.assert_allclose(was, now, atol=2e-6)


@pytest.mark.parametrize("slope", [(0.3, 0.0), (0.0, -0.25), (0.15, 0.2)])
@pytest.mark.parametrize("clip", ["straight", "run"])
def test_on_a_slope_feet_stay_as_high_above_it_as_they_were(database, legs, clip, slope):
    def plane(x, z):
        return slope[0] * x + slope[1] * z + 0.4

    before, after, contacts = play(database, legs, clip, plane)
    _, was, _ = world(database, legs, *before)
    _, now, _ = world(database, legs, *after)
    above = now[..., 1] - plane(now[..., 0], now[..., 2])
    off = np.abs(above - was[..., 1])
    assert off[contacts != 0].max() < 1e-3
    assert np.percentile(off, 99) < 1e-3
    np.testing.assert_allclose(after[0][:, 0, 1], plane(after[0][:, 0, 0], after[0][:, 0, 2]), atol=1e-5)
    assert np.abs(now - was)[contacts != 0][:, [0, 2]].max() < 1e-3  # what touches comes straight up


def test_a_foot_lies_as_the_slope_does(database, legs):
    before, after, contacts = play(database, legs, "stand", lambda x, z: 0.3 * z)
    _, touch_was, ankle_was = world(database, legs, *before)
    _, touch, ankle = world(database, legs, *after)
    rise = ((touch - ankle) - (touch_was - ankle_was))[..., 1]
    under = 0.3 * (touch_was - ankle_was)[..., 2]
    assert contacts.all() and under.min() > 0.03
    np.testing.assert_allclose(rise, under, atol=2e-5)
    lengths = [np.linalg.norm(a - b, axis=-1) for a, b in ((touch, ankle), (touch_was, ankle_was))]
    np.testing.assert_allclose(*lengths, atol=1e-5)


@pytest.mark.parametrize("clip", ["left_turn", "run"])
@pytest.mark.parametrize("kind", ["hills", "steps"])
def test_bones_keep_their_length_and_only_legs_bend(database, legs, clip, kind):
    ground = terrain_made.make(2, kind, size=(20, 20))
    before, after, _ = play(database, legs, clip, ground)
    assert np.abs(after[1] - before[1]).max() > 0.05
    np.testing.assert_allclose(np.linalg.norm(after[1], axis=-1), 1, atol=1e-5)
    root, hips = 0, np.flatnonzero(database.skeleton.parents == 0)
    others = np.setdiff1d(np.arange(len(database.skeleton)), [root, *hips])
    np.testing.assert_array_equal(after[0][:, others], before[0][:, others])
    np.testing.assert_array_equal(after[0][:, root, [0, 2]], before[0][:, root, [0, 2]])
    stiff = np.setdiff1d(np.arange(len(database.skeleton)), legs.joints[:, :3])
    np.testing.assert_array_equal(after[1][:, stiff], before[1][:, stiff])


@pytest.mark.parametrize("height", [0.15, -0.12])
def test_one_foot_on_a_step(database, legs, height):
    def step(x, z):
        return np.where(x > 0, height, 0.0)

    before, after, _ = play(database, legs, "stand", step)
    _, was, _ = world(database, legs, *before)
    joints, now, ankles = world(database, legs, *after)
    left = [i for i, role in enumerate(database.contact_roles) if role.startswith("left")]
    right = [i for i, role in enumerate(database.contact_roles) if role.startswith("right")]
    assert was[:, left, 0].min() > 0.02 and was[:, right, 0].max() < -0.02
    np.testing.assert_allclose(now[:, left, 1] - was[:, left, 1], height, atol=1e-3)
    np.testing.assert_allclose(now[:, right, 1] - was[:, right, 1], 0, atol=1e-3)
    hips = joints[:, legs.joints[:, 0]]
    whole = synthetic.THIGH + synthetic.SHIN
    reach = np.linalg.norm(hips - ankles, axis=-1)
    assert reach.max() <= max(0.95, np.linalg.norm(reach)) * whole + 1e-3


def test_the_body_sinks_as_far_as_the_lower_leg_needs(database, legs):
    """Of feet that are 25 cm apart in height the lower one decides, by the leg's length (Pythagoras)."""

    def step(x, z):
        return np.where(x > -0.05, 0.0, -0.25)

    before, after, _ = play(database, legs, "stand", step)
    was, _, ankle_was = world(database, legs, *before)
    now, _, ankle = world(database, legs, *after)
    right = int(np.argmin(ankle_was[0, :, 0]))
    hip = was[:, legs.joints[right, 0]]
    full = np.maximum(
        0.95 * (synthetic.THIGH + synthetic.SHIN), np.linalg.norm(hip - ankle_was[:, right], axis=-1)
    )
    aside = np.linalg.norm((hip - ankle[:, right])[:, [0, 2]], axis=-1)
    expected = ankle[:, right, 1] + np.sqrt(full**2 - aside**2)
    np.testing.assert_allclose(now[:, legs.joints[right, 0], 1], expected, atol=1e-3)


def test_beside_a_cliff_the_body_stays(database, legs):
    before, after, _ = play(database, legs, "stand", lambda x, z: np.where(x > 0.03, 0.0, -30.0))
    assert np.isfinite(after[0]).all() and np.isfinite(after[1]).all()
    was, now = (world(database, legs, *poses)[0] for poses in (before, after))
    hips = database.skeleton.role("hips")
    # The mean of the ground under root and feet is far below: the pose sinks to it, no leg is torn off.
    for a, b in zip(legs.joints[:, 0], legs.joints[:, 2], strict=True):
        assert np.linalg.norm(now[:, a] - now[:, b], axis=-1).max() < synthetic.THIGH + synthetic.SHIN
    assert np.abs(now[:, hips, [0, 2]] - was[:, hips, [0, 2]]).max() < 1e-5


def test_steps_are_taken_smoothly_and_in_time(database, legs):
    """Walking over a kerb: nothing jumps, and a swinging foot rises before it is there."""

    def kerb(x, z):
        return np.where(z > 1.0, 0.15, 0.0)

    before, after, contacts = play(database, legs, "straight", kerb)
    _, was, _ = world(database, legs, *before)
    _, now, _ = world(database, legs, *after)
    raised = now[..., 1] - was[..., 1]
    assert was[0, 0, 2] < 0.5 and was[-1, 0, 2] > 1.5
    assert np.abs(np.diff(raised, axis=0)).max() < 0.035
    assert np.abs(np.diff(after[0][:, 0, 1])).max() < 0.03
    assert np.abs(raised[was[..., 2] < 0.3]).max() < 1e-3
    assert np.abs(raised[-20:] - 0.15).max() < 0.01
    speeds = np.gradient(was[..., 2], 1 / FPS, axis=0)
    arrivals = [(int(np.argmax(was[:, foot, 2] > 1.0)), foot) for foot in range(2)]
    swings = [here for here in arrivals if speeds[here] > 2]
    assert swings and all(raised[here] > 0.05 and not contacts[here] for here in swings)


@pytest.mark.parametrize("follow", [True, False])
@pytest.mark.parametrize("ground", [HILLS, terrain_made.make(3, "steps", size=(30, 30))])
def test_compiled_is_plain(database, legs, ground, follow):
    clips = [frames(database, name) for name in ("straight", "left_turn", "run")]
    runs = []
    for compiled in (True, False):
        feet = GroundFeet(database.skeleton, legs, FPS, 3, ground=ground, follow=follow, compiled=compiled)
        shown = []
        for i in range(120):
            positions, rotations, contacts = (
                np.stack([clip[part][i] for clip in clips]) for part in range(3)
            )
            feet.apply(contacts, positions, rotations)
            shown.append((positions, rotations))
        runs.append(shown)
    for part in range(2):
        fast, plain = (np.stack([frame[part] for frame in run]) for run in runs)
        np.testing.assert_allclose(fast, plain, atol=5e-4)


def test_each_of_many_does_as_alone_and_reset_forgets(database, legs):
    clips = [frames(database, name) for name in ("straight", "run")]
    many = GroundFeet(database.skeleton, legs, FPS, 2, ground=HILLS)
    alone = GroundFeet(database.skeleton, legs, FPS, 1, ground=HILLS)
    first = None
    for i in range(40):
        positions, rotations, contacts = at(clips, i)
        one = tuple(array[1:].copy() for array in (contacts, positions, rotations))
        many.apply(contacts, positions, rotations)
        alone.apply(*one)
        np.testing.assert_array_equal(one[1][0], positions[1])
        np.testing.assert_array_equal(one[2][0], rotations[1])
        first = positions.copy() if first is None else first
    many.reset()
    positions, rotations, contacts = at(clips, 0)
    many.apply(contacts, positions, rotations)
    np.testing.assert_array_equal(positions, first)


def test_poses_made_for_a_ground_are_kept_out_of_it(database, legs):
    """What sinks comes up to the usual height, what hovers in contact comes down, what swings stays."""
    positions, rotations, contacts = frames(database, "straight", 60)
    _, touches, _ = world(database, legs, positions, rotations)
    low, high = legs.heights[:, 0], legs.heights[:, 1]
    for offset in (0.04, -0.04):  # the ground lies so much too high

        def ground(x, z, offset=offset):
            return np.full_like(x, offset)

        after = positions.copy(), rotations.copy()
        for i in range(60):
            feet = GroundFeet(database.skeleton, legs, FPS, 1, ground=ground, follow=False)
            feet.apply(contacts[i : i + 1], after[0][i : i + 1], after[1][i : i + 1])
        _, now, _ = world(database, legs, *after)
        above, was = now[..., 1] - offset, touches[..., 1] - offset
        wanted = np.where(contacts != 0, np.clip(was, low, high), np.maximum(was, low))
        np.testing.assert_allclose(above, wanted, atol=1e-3)
        np.testing.assert_array_equal(after[0][:, 0], positions[:, 0])


def test_an_overstretched_knee_reaches_too(database, legs):
    positions, rotations, contacts = frames(database, "stand", 1)
    upper, knee, ankle = legs.joints[0, :3]
    hinge = legs.hinges[0].astype(np.float64)
    rotations[0, upper] = quat.from_axis_angle(hinge, 0.0)
    rotations[0, knee] = quat.from_axis_angle(hinge, -0.06)
    rotations[0, ankle] = quat.identity()
    for compiled in (True, False):
        after = positions.copy(), rotations.copy()
        feet = GroundFeet(
            database.skeleton, legs, FPS, 1, compiled=compiled,
            ground=lambda x, z: np.where(x > 0, 0.15, 0.0),
        )  # fmt: skip
        feet.apply(contacts, *after)
        _, was, _ = world(database, legs, positions, rotations)
        _, now, _ = world(database, legs, *after)
        np.testing.assert_allclose(now[0, 0, 1] - was[0, 0, 1], 0.15, atol=1e-3)


@pytest.mark.parametrize(
    ("ground", "message"),
    [
        (lambda x, z: np.zeros(3), r"gives heights \(3,\)"),
        (lambda x, z: x * np.nan, "gives no finite heights"),
    ],
)
def test_a_ground_that_is_none(database, legs, ground, message):
    positions, rotations, contacts = frames(database, "stand", 1)
    feet = GroundFeet(database.skeleton, legs, FPS, 1, ground=ground)
    with pytest.raises(UserError, match=message):
        feet.apply(contacts, positions, rotations)


def test_poses_that_are_no_numbers_are_told_from_grounds_that_are_none(database, legs):
    positions, rotations, contacts = frames(database, "stand", 1)
    positions[:, 0] = np.nan
    feet = GroundFeet(database.skeleton, legs, FPS, 1, ground=HILLS)
    with pytest.raises(NotFinite, match="poses that are no numbers"):
        feet.apply(contacts, positions, rotations)


@pytest.mark.parametrize("compiled", [True, False])
def test_up_a_staircase_every_step_is_seen_ahead_not_only_the_first(database, legs, compiled):
    """A slope rises as much behind as ahead, and so do stairs: what tells them is where the rise is."""

    def stairs(x, z):
        return 0.17 * np.floor(np.maximum(z - 0.4, 0) / 0.3)

    _, after, contacts = play(database, legs, "straight", stairs, compiled=compiled)
    _, now, _ = world(database, legs, *after)
    deep = stairs(now[..., 0], now[..., 2]) + 0.02 - now[..., 1]  # toes rest 2 cm above the ground
    climbing = now[:, :, 2] > 0.9
    swings = climbing & (contacts == 0)
    assert swings.sum() > 50 and np.ptp(after[0][:, 0, 1]) > 0.6
    assert np.percentile(deep[swings], 95) < 0.03
    assert np.percentile(deep[climbing & (contacts != 0)], 99) < 0.01
