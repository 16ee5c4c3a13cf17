"""The judgement of models: against cases worked out by hand, and models whose errors are known."""

from __future__ import annotations

from dataclasses import replace

import lmm_models
import numpy as np
import pytest

from lmm.evaluation import decompressor, projector, stepper
from mm import quality
from mm import queries as recorded
from motion import quat
from motion.skeleton import Skeleton


@pytest.fixture(scope="module")
def database():
    return lmm_models.database()


@pytest.fixture(scope="module")
def exact(database):
    """A model that takes poses apart and puts them together again without loss."""
    return lmm_models.linear_model(database)


@pytest.fixture(scope="module")
def rough(database):
    """One that keeps four numbers of a pose."""
    return lmm_models.linear_model(database, latents=4)


ARM = Skeleton(("root", "a", "b"), np.array([-1, 0, 1]), np.zeros((3, 3)))


def arm(count: int) -> tuple[np.ndarray, np.ndarray]:
    """An arm of two bones of a metre along x, the ground root somewhere else in every frame."""
    positions, rotations = np.zeros((count, 3, 3), np.float32), quat.identity(count, 3).astype(np.float32)
    positions[:, 0, 0] = np.arange(count)
    positions[:, 1:, 0] = 1
    return positions, rotations


def test_pose_errors_by_hand():
    true_positions, true_rotations = arm(5)
    positions, rotations = true_positions.copy(), true_rotations.copy()
    positions[:, 0] += 7  # roots are aligned
    rotations[:, 0] = quat.from_axis_angle([0.0, 1.0, 0.0], 0.4)
    rotations[2:, 1] = quat.from_axis_angle([0.0, 1.0, 0.0], np.pi / 2)  # b, 1 m on, goes round a
    found = decompressor.pose_errors(
        true_positions, true_rotations, positions, rotations, ARM, fps=60, starts=[0, 2]
    )
    assert found["joints"] == {"a": 0, "b": pytest.approx(100 * np.sqrt(2) * 3 / 5, rel=1e-5)}
    position = found["position_cm"]
    assert position["mean"] == pytest.approx(100 * np.sqrt(2) * 3 / 10, rel=1e-5)
    assert position["worst_joint"] == "b" and position["worst"] == pytest.approx(found["joints"]["b"])
    assert found["rotation_deg"]["mean"] == pytest.approx(90 * 3 / 10, rel=1e-4)
    assert found["velocity_cm_s"]["mean"] == pytest.approx(0, abs=1e-3)  # the step of frame 2 begins a clip
    one = decompressor.pose_errors(true_positions, true_rotations, positions, rotations, ARM, fps=60)
    assert one["velocity_cm_s"]["mean"] == pytest.approx(6000 * np.sqrt(2) / 8, rel=1e-4)


def test_a_single_frame_has_no_velocity():
    poses = arm(1)
    assert "velocity_cm_s" not in decompressor.pose_errors(*poses, *poses, ARM, fps=60, starts=[0])


def test_what_loses_nothing_has_no_error(database, exact):
    found = decompressor.errors(exact, database)
    assert found["frames"] == len(database) and found["contacts"] == 1
    assert found["position_cm"]["p99"] < 0.02 and found["rotation_deg"]["p99"] < 0.1
    assert found["velocity_cm_s"]["mean"] < 0.5 and found["root_velocity_cm_s"] < 0.01


def test_decompressor_errors_are_those_of_the_poses(database, rough):
    """By another way: least squares in closed form, poses compared joint by joint."""
    vectors = rough.layout.pack(database).astype(np.float64)
    mean = vectors.mean(axis=0)
    left, sizes, axes = np.linalg.svd(vectors - mean, full_matrices=False)
    made, _ = rough.layout.unpack(
        ((left[:, :4] * sizes[:4]) @ axes[:4] + mean).astype(np.float32), database.fps
    )
    for ranges in (None, rough.training_ranges(database)):
        some = np.ones(len(database), bool) if ranges is None else ranges[database.ranges()]
        truth = quality.in_root_space(
            database.skeleton, database.poses.positions[some], database.poses.rotations[some]
        )
        mine = quality.in_root_space(database.skeleton, made.positions[some], made.rotations[some])
        found = decompressor.errors(rough, database, ranges=ranges)
        apart = 100 * np.linalg.norm(truth - mine, axis=-1)
        assert found["frames"] == some.sum()
        assert found["position_cm"]["mean"] == pytest.approx(apart.mean(), rel=1e-3)
        assert found["position_cm"]["p99"] == pytest.approx(np.percentile(apart, 99), rel=1e-3)
        assert found["position_cm"]["mean"] > 0.3
        assert list(found["joints"]) == list(database.skeleton.names[1:])


def test_starts_are_frames_that_enough_follow(database):
    ranges = np.array(database.names) == "run"
    begin = stepper.choose_starts(database, 10_000, 30, ranges=ranges)
    ends = database.stops[database.ranges()[begin]]
    assert np.all(begin + 30 < ends) and set(np.array(database.names)[database.ranges()[begin]]) == {"run"}
    assert len(begin) == np.sum(ranges * (database.stops - database.starts - 30))
    few = stepper.choose_starts(database, 7, 30, seed=1)
    assert len(np.unique(few)) == 7
    assert not np.array_equal(few, stepper.choose_starts(database, 7, 30, seed=2))
    assert len(stepper.choose_starts(database, 7, 10_000)) == 0


def test_a_stepper_that_stands_still_drifts_as_the_pose_at_the_start_does(database, exact):
    found = stepper.drift(exact, database, starts=50, steps=30, least=5)
    np.testing.assert_allclose(found.joints, found.still, atol=0.05)
    assert np.nanmax(found.decoded) < 0.05
    begin = stepper.choose_starts(database, 50, 5)
    last = (database.stops - 1)[database.ranges()][begin]
    for step in (1, 30):
        there = begin + step <= last
        np.testing.assert_array_equal(np.isfinite(found.joints[step - 1]), there)
        local = [
            quality.in_root_space(database.skeleton, poses.positions, poses.rotations)
            for poses in (database.poses[begin[there]], database.poses[begin[there] + step])
        ]
        apart = 100 * np.linalg.norm(local[0] - local[1], axis=-1).mean(axis=-1)
        np.testing.assert_allclose(found.still[step - 1, there], apart, atol=1e-3)
    rows = found.table((1, 5, 30, 60))
    assert [row["steps"] for row in rows] == [1, 5, 30] and rows[0]["runs"] == 50
    assert rows[1]["joints_cm"] == pytest.approx(np.mean(found.joints[4]))
    assert rows[1]["joints_p95_cm"] == pytest.approx(np.percentile(found.joints[4], 95))
    assert found.curves()["joints_cm"][4] == pytest.approx(rows[1]["joints_cm"])


def test_a_stepper_that_knows_the_way_does_not_drift(database, exact):
    """Runs of a stepper that looks up what truly follows: only what the decompressor loses is left."""
    latents = exact.latents(database)
    table = np.concatenate([database.features, latents], axis=1)

    class Oracle:
        def __init__(self, begin):
            self.frame = begin

        def evaluate(self, states):
            self.frame = self.frame + 1
            return (table[np.minimum(self.frame, len(table) - 1)] - states) * np.float32(database.fps)

    begin = stepper.choose_starts(database, 20, 40)
    knowing = replace(exact, stepper=Oracle(begin))
    found = stepper.drift(knowing, database, latents, starts=20, steps=40, least=40)
    assert found.joints.max() < 0.05 and found.heading.max() < 1
    assert found.path.max() < 1.0  # a cm over 40 frames, walking a metre: velocities are of instants
    assert found.still[-1].mean() > 5


def test_free_runs_add_rates_over_time():
    rate = lmm_models.layer(np.diag([1.0, 0.0]), [0.0, 30.0])  # x grows by itself, y steadily
    states = list(stepper.free_run(rate, np.array([[1.0, 0.0]]), 10.0, 3))
    np.testing.assert_allclose(np.array(states)[:, 0], [[1.1, 3], [1.21, 6], [1.331, 9]], rtol=1e-5)


def test_answer_errors_by_hand(database):
    features = database.schema.size
    zero = np.zeros((4, features), np.float32)
    neighbour, answer = zero.copy(), zero.copy()
    neighbour[:, 0], answer[:, 1] = 2, [1, 2, 4, 8]
    latents = np.zeros((4, 2), np.float32)
    found = projector.answer_errors(
        database.schema, zero, answer, latents + np.array([1.0, 0.0]), neighbour, latents, np.array([0.5, 1]),
        bound=np.array([3.0, 5.0, 5.0, 100.0]),
    )  # fmt: skip
    shares = np.array(found["regret"].pop("shares"))
    assert shares.sum() == 1 and shares[-1] == 0.25
    np.testing.assert_array_equal(projector.BINS[:-1][shares > 0], projector.BINS[[10, 20, 40, 59]])
    assert found["regret"] == {
        "median": pytest.approx(1.5),
        "mean": pytest.approx(15 / 8),
        "p95": pytest.approx(np.percentile([0.5, 1, 2, 4], 95)),
    }
    assert found["latent_error"] == found["latent_error_median"] == pytest.approx(np.sqrt(4 / 2))
    # Costs: answers 1, 4, 16, 64; neighbours 4.
    assert found["decisions"] == {"as_search": 0.5, "jumps": 0.75, "search_jumps": 0.75}
    assert found["feature_error"] == pytest.approx(np.sqrt((4 * 4 + 85) / (4 * features)))


def test_a_projector_that_echoes_is_near_the_query_but_off_the_data(database, exact):
    asked = recorded.record(database, 300)
    found = projector.errors(exact, database, asked)
    assert found["queries"] == 300 and found["regret"]["median"] == 0 and found["decisions"]["jumps"] == 1
    _, costs = recorded.neighbours(database, replace(asked, current=np.full(300, -1, np.int32)), ignore_end=0)
    assert found["off_data"] == pytest.approx(np.sqrt(np.median(costs)), rel=1e-3)
    # The answer's latents are the mean: off by as much as the latents are spread, more or less.
    assert 0.3 < found["latent_error"] < 3


def test_noisy_rows_are_rows_with_real_noise(database):
    asked = recorded.record(database, 400)
    ranges = np.array(database.names) == "run"
    noisy = projector.noisy_rows(database, asked, ranges=ranges, seed=3)
    assert len(noisy) == 400 and np.all(noisy.current == -1)
    residuals = recorded.residuals(database, asked, ranges=ranges)
    rows = database.features[np.flatnonzero(ranges[database.ranges()])]
    possible = {tuple(np.round(r, 3)) for r in residuals}
    for query in noisy.features[:10]:
        assert any(tuple(np.round(query - row, 3)) in possible for row in rows)
    assert not np.array_equal(
        noisy.features, projector.noisy_rows(database, asked, ranges=ranges, seed=4).features
    )


def test_who_may_crouch_is_asked_whether_to():
    tagged = lmm_models.database(crouch=True)
    model = lmm_models.linear_model(tagged, latents=3)
    asked = recorded.record(tagged, 200)
    asked.required[:] = np.arange(200) % 2 == 0
    weight = np.zeros((model.F + 1, model.F + 3), np.float32)
    weight[-1, -1] = 5
    model = replace(model, projector=lmm_models.layer(weight, np.zeros(model.F + 3)))
    np.testing.assert_array_equal(projector.answers(model, asked)[:, -1], 5 * asked.required)
    noisy = projector.noisy_rows(tagged, asked)
    np.testing.assert_array_equal(noisy.required ^ noisy.forbidden, 1)
    assert 0 < noisy.required.mean() < 1
