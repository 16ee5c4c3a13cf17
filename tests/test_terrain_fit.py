"""Grounds fitted to feet: against walks on known ground, SciPy's interpolator, and real captures."""

import numpy as np
import pytest
import synthetic
from scipy.interpolate import RBFInterpolator

from features import contacts as touching
from features import patches, terrain, terrain_fit, terrain_made
from motion import kinematics, sources
from motion.errors import UserError

RNG = np.random.default_rng(11)
FPS = 60.0


@pytest.fixture(scope="module")
def some():
    return patches.cut([terrain_made.make(seed, size=(12, 8)) for seed in (1, 2)], count=300)


@pytest.fixture(scope="module")
def walk():
    """Ankles [T, 2, 3] and true contacts [T, 2] of a walk on flat ground."""
    clip = synthetic.walk(turn=synthetic.weave, seconds=6)
    positions, _ = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    feet = positions[:, [clip.skeleton.role("left_foot"), clip.skeleton.role("right_foot")]]
    return feet, synthetic.planted(clip, "walk")


def on(ground, feet, contacts, clearance=0.08):
    """The walk's feet where a ground would have them: on it in contact, above it else."""
    above = feet[..., 1] - synthetic.ANKLE
    feet = feet.copy()
    feet[..., 1] = ground(feet[..., 0], feet[..., 2]) + np.where(contacts, 0, above + clearance)
    return feet


def gaps(ground, feet):
    """How high a ground [K] stands above feet [T, C, 3]."""
    return ground(feet[..., 0], feet[..., 2]) - feet[..., 1]


def test_contacts_on_flat_ground_touch_and_no_foot_sinks(walk, some):
    places, contacts = walk
    feet = terrain_fit.soles(places, contacts)
    np.testing.assert_allclose(feet[contacts][:, 1], 0, atol=1e-9)
    for own, grounds in terrain_fit.fit_clip(some, feet, contacts, FPS):
        assert len(grounds) == terrain_fit.COUNT
        found, down = gaps(grounds, feet[own]), contacts[own]
        assert np.abs(found[:, down]).max() < 1e-3
        assert found[:, ~down].max() < 0.02
        assert np.ptp(grounds(*RNG.uniform(-3, 3, (2, 500))), axis=0).max() > 0.02  # they are not all flat


def test_the_ground_walked_on_is_found_and_needs_no_correction(walk, some):
    places, contacts = walk
    truth = some[17]
    middle = places[contacts][:, [0, 2]].mean(axis=0)

    def height(x, z):
        return truth.heights(np.stack([x.ravel(), z.ravel()], -1) - middle)[0].reshape(x.shape) + 0.7

    feet = on(height, places, contacts)
    grounds = terrain_fit.fit(some, feet, contacts, count=3)
    np.testing.assert_array_equal(grounds.patches.transforms[0], truth.transforms[0])
    assert grounds.errors[0] < 1e-9 < 1e-5 < grounds.errors[1]
    x, z = RNG.uniform(-1, 1, (2, 200)) + middle[:, None]
    np.testing.assert_allclose(grounds.only(0)(x, z), height(x, z), atol=1e-4)
    assert np.abs(gaps(grounds, feet)[:, contacts]).max() < 5e-3


def test_the_one_ground_is_one_of_all(walk, some):
    places, contacts = walk
    grounds = terrain_fit.fit(some, places, contacts, count=4)
    x, z = RNG.uniform(-2, 2, (2, 5, 7))
    assert grounds(x, z).shape == (4, 5, 7) and grounds(x, z).dtype == np.float32
    np.testing.assert_array_equal(grounds.only(2)(x, z), grounds(x, z)[2])
    assert np.all(np.diff(grounds.errors) >= 0)


def test_the_correction_is_scipys():
    knots, values = RNG.uniform(-1, 1, (30, 2)), RNG.normal(size=(30, 4))
    weights, constants = terrain_fit._solve(terrain_fit._distances(knots, knots), values)
    truth = RBFInterpolator(knots, values, kernel="linear", degree=0, smoothing=terrain_fit.SMOOTHING)
    points = RNG.uniform(-2, 2, (100, 2))
    found = constants - terrain_fit._distances(points, knots) @ weights
    np.testing.assert_allclose(found, truth(points), atol=1e-9)


def test_choice_by_hand():
    """Of a step and a plane: who steps up takes the step, who swings through it does not."""
    rows = np.zeros((41, 41), np.float32)
    step = rows.copy()
    step[25:] = 0.3
    maps = [terrain.Heightmap(heights, 0.1) for heights in (rows, step)]
    transforms = np.tile([[[10.0, 0, 20], [0, 10.0, 20]]], (2, 1, 1))
    two = patches.Patches(tuple(maps), np.arange(2), transforms, np.zeros(2))
    x = np.linspace(-1, 1, 40)
    feet = np.zeros((40, 1, 3))
    feet[:, 0, 0] = x
    up = x > 0.45
    contacts = (np.abs(x) > 0.6)[:, None]

    def best(heights, down, **options):
        feet[:, 0, 1] = heights
        return terrain_fit.fit(two, feet, down, count=1, **options).patches.which[0]

    assert best(np.where(up, 0.3, 0.0), contacts) == 1
    assert best(np.zeros(40), contacts) == 0
    low, early = np.where(up, 0.1, 0.0), (x < -0.6)[:, None]
    middle = x[early[:, 0]].mean()
    two.transforms[:, 0, 2] = 20 + 10 * middle  # the patches stay where they are
    assert best(low, early) == 0
    assert best(np.where(up, 0.62, 0.0), early) == 0
    assert best(np.where(up, 0.62, 0.0), early, jumping=up.astype(float)) == 1


def test_rest_heights():
    contacts = np.ones((300, 3), np.uint8)
    contacts[:, 2] = 0
    places = RNG.normal(0, 0.002, (300, 3, 3))
    places[:, 0, 1] += 0.03
    places[:, 1, 1] += 0.09
    places[100:190, :, 1] += 0.4  # on a box
    places[:20, :, 1] -= 0.2  # flawed frames
    np.testing.assert_allclose(terrain_fit.rest_heights(places, contacts), [0.03, 0.09, 0.06], atol=1e-3)
    np.testing.assert_array_equal(terrain_fit.rest_heights(places, np.zeros((300, 3))), np.zeros(3))


@pytest.mark.parametrize(("frames", "fps"), [(600, 60), (601, 30), (40, 60), (1, 120)])
def test_stretches_cover_a_clip(frames, fps):
    parts = terrain_fit.stretches(frames, fps)
    owned = np.concatenate([np.arange(frames)[own] for own, _ in parts])
    np.testing.assert_array_equal(owned, np.arange(frames))
    for own, reached in parts:
        assert own.stop - own.start <= 3 * fps
        assert reached == slice(max(0, own.start - fps), min(frames, own.stop + fps))


def test_heights_beside_a_trajectory_are_right_middle_left():
    points, ahead = np.array([[1.0, 2.0], [0.0, 0.0]]), np.array([[0.0, 1.0], [1.0, 0.0]])
    places = terrain_fit.beside(points, ahead)
    np.testing.assert_allclose(places[0], [[0.75, 2], [1, 2], [1.25, 2]])  # left is +X for who faces +Z
    np.testing.assert_allclose(places[1], [[0, 0.25], [0, 0], [0, -0.25]])
    heights = terrain_fit.along(lambda x, z: 10 * x + z, points, ahead)
    np.testing.assert_allclose(heights, [[9.5, 12, 14.5], [0.25, 0, -0.25]])


def test_feet_that_cannot_be_fitted(some, walk):
    feet, contacts = walk
    with pytest.raises(UserError, match="ask for fewer"):
        terrain_fit.fit(some, feet, contacts, count=len(some) + 1)
    with pytest.raises(UserError, match="not finite"):
        terrain_fit.fit(some, np.where(contacts[..., None], feet, np.nan), contacts)
    with pytest.raises(ValueError, match="expected"):
        terrain_fit.fit(some, feet, contacts[:, 0])
    airborne = terrain_fit.fit(some, feet, np.zeros_like(contacts))
    assert np.isfinite(airborne(*RNG.uniform(-3, 3, (2, 50)))).all()
    assert gaps(airborne, feet).max() < 0.05


def test_one_frame_and_feet_that_stand_still(some):
    feet = np.tile([[[0.1, 0.0, 0.2], [-0.1, 0.0, 0.2]]], (90, 1, 1))
    for frames in (1, 90):
        grounds = terrain_fit.fit(some, feet[:frames], np.ones((frames, 2)))
        assert np.abs(gaps(grounds, feet[:1])).max() < 1e-3


@pytest.mark.parametrize(
    "name", ["pfnn/animations/NewCaptures10_000.bvh", "lafan1/original_30fps/obstacles1_subject2.bvh"]
)
def test_who_climbs_boxes_stands_on_what_is_fitted(data, some, name):
    """Feet on boxes of up to a metre: contacts are met as well as a function of the place can meet them."""
    clip = sources.load(data / name)
    frames = slice(0, round(20 * clip.fps))
    world = kinematics.forward(clip.skeleton, clip.positions[frames], clip.rotations[frames])
    names, contacts = touching.find(clip.skeleton, clip.fps, *world)
    feet = terrain_fit.soles(touching.points(clip.skeleton, clip.fps, *world, names), contacts)
    down = contacts != 0
    assert feet[down][:, 1].max() > 0.3
    off, sunk, flat = [], [], np.abs(feet[down][:, 1])
    for own, grounds in terrain_fit.fit_clip(some, feet, contacts, clip.fps, count=5):
        found = gaps(grounds, feet[own])
        off.append(np.abs(found[:, down[own]]).ravel())
        sunk.append(found[:, ~down[own]].ravel())
    assert np.median(np.concatenate(off)) < 0.002
    assert np.percentile(np.concatenate(off), 95) < 0.015 < 0.1 < np.percentile(flat, 95)
    assert np.percentile(np.concatenate(sunk), 99) < 0.02
