"""Feature extraction, against closed forms, a world-space twin, and the public reference's own numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from features import custom, extract, normalise, presets
from features.context import Context
from features.schema import Feature, Schema, register
from motion import kinematics, quat
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton

RADIUS, SPEED = 4.0, 1.5
TURN = SPEED / RADIUS  # rad/s, to the left
ARM = np.array([0.1, -0.8, 0.2])  # the left foot from the hips

RIG = Skeleton(
    ("root", "pelvis", "thigh", "foot_l", "foot_r", "skull"),
    np.array([-1, 0, 1, 2, 1, 1]),
    np.zeros((6, 3)),
    {"root": 0, "hips": 1, "left_foot": 3, "right_foot": 4, "head": 5},
)


def circle(fps: float, seconds: float = 6.0, start: float = 0.0) -> Poses:
    """A body that walks a circle to the left; its left foot circles in the root's yz-plane, its head nods."""
    time = start + np.arange(round(seconds * fps)) / fps
    yaw = TURN * time
    poses = Poses.empty(len(time), len(RIG))
    poses.positions[:, 0] = RADIUS * np.stack([1 - np.cos(yaw), 0 * yaw, np.sin(yaw)], -1) + [30, 0, -20]
    poses.rotations[:, 0] = quat.from_yaw(yaw)
    poses.velocities[:, 0] = SPEED * np.stack([np.sin(yaw), 0 * yaw, np.cos(yaw)], -1)
    poses.angular_velocities[:, 0] = [0, TURN, 0]
    poses.positions[:, 1] = [0, 0.9, 0]
    poses.rotations[:, 1] = quat.from_axis_angle([1, 0, 0], 2 * time)
    poses.angular_velocities[:, 1] = [2, 0, 0]
    poses.positions[:, 3] = ARM
    poses.positions[:, 5] = [0, 0.5, 0]
    return poses


def ground(schema: Schema, poses: Poses, fps: float = 60, starts=(0,), stops=None) -> np.ndarray:
    stops = (len(poses),) if stops is None else stops
    return extract.extract(schema, RIG, fps, poses, starts, stops)


@pytest.mark.parametrize("fps", [60, 30, 120, 29.97, 25, 100])
def test_a_circle_seen_from_the_root_is_the_same_at_any_rate(fps):
    times = np.array([-1.0, -1 / 3, 0.0, 0.25, 2 / 3])
    schema = Schema(
        "circle",
        (
            Feature("p", "trajectory_position", times=tuple(times)),
            Feature("d", "trajectory_direction", times=tuple(times)),
        ),
    )
    raw = ground(schema, circle(fps), fps)
    inner = raw[int(np.ceil(fps)) : -int(np.ceil(fps))]
    angle = TURN * times
    position = RADIUS * np.stack([1 - np.cos(angle), np.sin(angle)], -1)
    direction = np.stack([np.sin(angle), np.cos(angle)], -1)
    # Between frames the path is a chord: at most SPEED^2 / RADIUS / 8 / fps^2 off.
    chord = SPEED * TURN / 8 / fps**2 + 2e-5
    np.testing.assert_allclose(inner[:, :10], np.broadcast_to(position.ravel(), (len(inner), 10)), atol=chord)
    np.testing.assert_allclose(
        inner[:, 10:], np.broadcast_to(direction.ravel(), (len(inner), 10)), atol=chord
    )


def test_joints_of_the_circle_have_their_closed_forms():
    schema = Schema(
        "joints",
        (
            Feature("p", "position", "left_foot"),
            Feature("v", "velocity", "left_foot"),
            Feature("w", "angular_velocity", "left_foot"),
            Feature("hips", "velocity", "hips"),
            Feature("h", "height", "left_foot"),
            Feature("root", "velocity", "root"),
            Feature("origin", "position", "root"),
            Feature("nod", "heading", "head"),
        ),
    )
    poses = circle(60)
    raw = ground(schema, poses)
    angle = 2 * np.arange(len(poses)) / 60
    swung = np.stack(
        [
            np.full(len(angle), ARM[0]),
            ARM[1] * np.cos(angle) - ARM[2] * np.sin(angle),
            ARM[1] * np.sin(angle) + ARM[2] * np.cos(angle),
        ],
        -1,
    )
    position = swung + np.array([0, 0.9, 0])
    # Root's travel along +Z, its turn about +Y, the hips' turn about +X.
    velocity = np.array([0, 0, SPEED]) + np.cross([0, TURN, 0], position) + np.cross([2, 0, 0], swung)
    part = schema.slices
    np.testing.assert_allclose(raw[:, part["p"]], position, atol=1e-5)
    np.testing.assert_allclose(raw[:, part["v"]], velocity, atol=1e-5)
    np.testing.assert_allclose(raw[:, part["w"]], np.broadcast_to([2, TURN, 0], position.shape), atol=1e-5)
    np.testing.assert_allclose(
        raw[:, part["hips"]], np.broadcast_to([0, 0, SPEED], position.shape), atol=1e-5
    )
    np.testing.assert_allclose(raw[:, part["h"]][:, 0], position[:, 1], atol=1e-5)
    np.testing.assert_allclose(
        raw[:, part["root"]], np.broadcast_to([0, 0, SPEED], position.shape), atol=1e-5
    )
    assert np.all(raw[:, part["origin"]] == 0)
    # The head nods in the root's yz-plane, so its heading is straight ahead or straight back.
    expected = np.stack([0 * angle, np.sign(np.cos(angle))], -1)
    sure = np.abs(np.cos(angle)) > 0.01
    np.testing.assert_allclose(raw[sure, part["nod"]], expected[sure], atol=1e-4)


@pytest.mark.parametrize(
    ("axis", "expected"),
    [("+x", (1, 0)), ("-x", (-1, 0)), ("+z", (0, 1)), ("-z", (0, -1)), ("+y", (0, 0)), ("-y", (0, 0))],
)
def test_heading_follows_the_joint_axis_that_the_schema_names(axis, expected):
    schema = Schema("h", (Feature("h", "heading", "head", axis=axis),))
    poses = circle(60, 0.5)
    poses.rotations[:, 1] = [1, 0, 0, 0]
    np.testing.assert_allclose(ground(schema, poses), np.tile(expected, (30, 1)), atol=1e-6)


def test_continued_trajectories_of_a_circle_stay_on_it_beyond_the_clip():
    times = (-1.0, 0.5, 1.5)
    schema = Schema(
        "on",
        tuple(
            Feature(kind, f"trajectory_{kind}", times=times, beyond="continue")
            for kind in ("position", "direction")
        ),
    )
    raw = ground(schema, circle(60, 1.0))
    angle = TURN * np.array(times)
    position = RADIUS * np.stack([1 - np.cos(angle), np.sin(angle)], -1)
    direction = np.stack([np.sin(angle), np.cos(angle)], -1)
    expected = np.concatenate([position.ravel(), direction.ravel()])
    np.testing.assert_allclose(raw, np.broadcast_to(expected, raw.shape), atol=1e-4)


def test_samples_stop_at_the_ends_of_their_range():
    times = (-1.0, -0.25, 0.25, 1.0)
    schema = Schema(
        "ends",
        (Feature("p", "trajectory_position", times=times), Feature("d", "trajectory_direction", times=times)),
    )
    first, second = circle(60, 2.0), circle(60, 3.0, start=40.0)
    both = Poses(
        *(np.concatenate(pair) for pair in zip(*(p.arrays().values() for p in (first, second)), strict=True))
    )
    raw = ground(schema, both, starts=(0, 120), stops=(120, 300))
    np.testing.assert_array_equal(raw, np.concatenate([ground(schema, first), ground(schema, second)]))
    x, z = raw[:, 0:8:2], raw[:, 1:8:2]
    assert np.all(x[[0, 120], :2] == 0) and np.all(z[[0, 120], :2] == 0)
    assert np.all(x[[119, 299], 2:] == 0) and np.all(z[[119, 299], 2:] == 0)
    # 30 frames before the end, a second ahead is half a second ahead.
    np.testing.assert_allclose(z[89, 3], RADIUS * np.sin(TURN * 30 / 60), atol=2e-5)


def random_poses(seed: int, count: int = 40) -> Poses:
    random = np.random.default_rng(seed)
    poses = Poses(*(random.normal(size=(count, len(RIG), 3)).astype(np.float32) for _ in range(4)))
    poses.rotations = quat.normalize(random.normal(size=(count, len(RIG), 4))).astype(np.float32)
    poses.positions[:, 0, 1] = 0
    poses.rotations[:, 0] = quat.from_yaw(np.cumsum(random.uniform(-1, 1, count)))
    return poses


def in_world(poses: Poses) -> dict[str, np.ndarray]:
    """The obvious way: forward kinematics in the world, float64, then into the root's frame."""
    arrays = [array.astype(np.float64) for array in poses.arrays().values()]
    position, rotation, velocity, angular = kinematics.forward_velocities(RIG, *arrays)
    inverse = np.broadcast_to(quat.inv(rotation[:, :1]), rotation.shape)
    return {
        "position": quat.rotate(inverse, position - position[:, :1]),
        "velocity": quat.rotate(inverse, velocity),
        "angular_velocity": quat.rotate(inverse, angular),
    }


@pytest.mark.parametrize("seed", range(5))
def test_joints_agree_with_kinematics_in_the_world(seed):
    kinds, roles = ("position", "velocity", "angular_velocity"), tuple(RIG.roles)
    schema = Schema("all", tuple(Feature(f"{r} {k}", k, r) for r in roles for k in kinds))
    poses = random_poses(seed)
    raw, truth = ground(schema, poses), in_world(poses)
    for feature in schema.features:
        expected = truth[feature.kind][:, RIG.role(str(feature.role))]
        np.testing.assert_allclose(raw[:, schema.slices[feature.name]], expected, atol=2e-5)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 1000), st.floats(-3, 3), st.floats(-50, 50), st.floats(-50, 50))
def test_features_do_not_know_where_in_the_world_they_are(seed, angle, x, z):
    schema = presets.load("o3de59")
    poses, turn = random_poses(seed), quat.from_yaw(angle)
    moved = poses.copy()
    moved.positions[:, 0] = quat.rotate(turn, poses.positions[:, 0]) + np.array([x, 0, z])
    moved.rotations[:, 0] = quat.mul(turn, poses.rotations[:, 0])
    moved.velocities[:, 0] = quat.rotate(turn, poses.velocities[:, 0])
    moved.angular_velocities[:, 0] = quat.rotate(turn, poses.angular_velocities[:, 0])
    np.testing.assert_allclose(ground(schema, moved, 10), ground(schema, poses, 10), atol=1e-4)


def test_chunks_leave_no_seam(monkeypatch):
    schema = presets.load("o3de59")
    poses = circle(60, 5.0)
    whole = ground(schema, poses, starts=(0, 130), stops=(130, 300))
    monkeypatch.setattr(extract, "CHUNK", 37)
    np.testing.assert_array_equal(ground(schema, poses, starts=(0, 130), stops=(130, 300)), whole)


def test_a_missing_role_names_feature_role_and_joints():
    schema = Schema("mine", (Feature("left_toe_height", "height", "left_toe"),))
    with pytest.raises(UserError) as caught:
        ground(schema, circle(60, 0.1))
    for part in ("schema 'mine'", "feature 'left_toe_height'", "'left_toe'", *RIG.names):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("starts", "stops"), [((0,), (5,)), ((0, 4), (3, 6)), ((1,), (6,)), ((0, 0), (0, 6)), ((), ())]
)
def test_ranges_must_cover_the_frames(starts, stops):
    with pytest.raises(ValueError, match="do not cover 6 frames"):
        ground(presets.load("lmm27"), circle(60, 0.1), starts=starts, stops=stops)


class TestCustom:
    @pytest.fixture(autouse=True)
    def registry(self):
        before = dict(custom._registry)
        yield
        custom._registry.clear()
        custom._registry.update(before)

    def run(self, function, monkeypatch) -> np.ndarray:
        register("mine", function, columns=("a", "b"))
        monkeypatch.setattr(extract, "CHUNK", 16)
        return ground(Schema("c", (Feature("m", "custom", function="mine"),)), circle(60, 1.0))

    def test_sees_what_the_other_features_see(self, monkeypatch):
        def stride(context: Context) -> np.ndarray:
            assert context.rotation("left_foot").shape == (len(context), 4)
            ahead = context.trajectory_positions([0.5])[:, 0, 1]
            return np.stack([context.position("left_foot")[:, 2], ahead], -1)

        twin = Schema(
            "t", (Feature("p", "position", "left_foot"), Feature("t", "trajectory_position", times=(0.5,)))
        )
        np.testing.assert_array_equal(self.run(stride, monkeypatch), ground(twin, circle(60, 1.0))[:, [2, 4]])

    def test_a_wrong_shape_is_told(self, monkeypatch):
        with pytest.raises(UserError, match=r"'m' returned shape \(16, 3\), expected \(16, 2\)"):
            self.run(lambda context: np.zeros((len(context), 3)), monkeypatch)

    def test_numbers_that_are_not_finite_are_told(self, monkeypatch):
        def broken(context: Context) -> np.ndarray:
            frames = np.arange(context.frames.start, context.frames.stop, dtype=float)
            frames[frames == 21] = np.nan
            return np.stack([frames, frames], -1)

        with pytest.raises(UserError, match="not finite at frame 21"):
            self.run(broken, monkeypatch)

    def test_an_unregistered_function_is_told(self):
        schema = Schema("c", (Feature("m", "custom", function="gone", columns=("a",)),))
        with pytest.raises(UserError, match="'gone' is registered"):
            ground(schema, circle(60, 0.1))


def read(path: Path, *layout: tuple[int, str, int]) -> list[np.ndarray]:
    """Arrays of the public reference's binary files; layout: dimensions, element type, numbers an element."""
    raw, at, arrays = path.read_bytes(), 0, []
    for dimensions, dtype, width in layout:
        shape = np.frombuffer(raw, "<i4", dimensions, at)
        array = np.frombuffer(raw, dtype, int(np.prod(shape)) * width, at + 4 * dimensions)
        at += 4 * dimensions + array.nbytes
        arrays.append(array.reshape(*shape, width) if width > 1 else array.reshape(shape))
    assert at == len(raw)
    return arrays


@pytest.fixture(scope="module")
def oracle(data):
    folder = data / "reference" / "oracle"
    three, four, ints = (2, "<f4", 3), (2, "<f4", 4), (1, "<i4", 1)
    *database, _ = read(folder / "database.bin", three, three, four, three, ints, ints, ints, (2, "u1", 1))
    features = read(folder / "features.bin", (2, "<f4", 1), (1, "<f4", 1), (1, "<f4", 1))
    positions, velocities, rotations, angular, parents, starts, stops = database
    roles = {"root": 0, "hips": 1, "left_foot": 4, "right_foot": 8}
    skeleton = Skeleton(tuple(f"bone{i}" for i in range(23)), parents, positions[0], roles)
    return skeleton, Poses(positions, rotations, velocities, angular), starts, stops, features


def test_equals_the_public_reference(oracle):
    skeleton, poses, starts, stops, (expected, offset, scale) = oracle
    schema = presets.load("lmm27")
    raw = extract.extract(schema, skeleton, 60, poses, starts, stops)
    ours = normalise.fit(schema, raw)
    np.testing.assert_allclose(ours[0], offset, atol=5e-6)
    np.testing.assert_allclose(ours[1], scale, rtol=2e-6)
    # Its stored rotations are off unit length by up to 4e-6, which its detour through the world keeps.
    np.testing.assert_allclose(normalise.normalise(raw, *ours), expected, atol=1.5e-4)


def test_a_feature_that_is_not_finite_is_named_with_its_frame():
    poses = circle(60)
    poses.positions[7, 5, 1] = np.nan
    schema = Schema("s", (Feature("foot", "position", "left_foot"), Feature("nod", "position", "head")))
    with pytest.raises(UserError, match="'s', feature 'nod' is not finite at frame 7"):
        ground(schema, poses)
