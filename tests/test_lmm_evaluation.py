"""The judgement of models: against cases worked out by hand, and models whose errors are known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import lmm_models
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.backends.backend_agg import FigureCanvasAgg

from features import terrain, terrain_made
from lmm.cli import main
from lmm.evaluation import decompressor, driving, evaluate, pictures, projector, report, stepper
from lmm.model import Model
from mm import quality
from mm import queries as recorded
from mm.controller import Controller
from mm.settings import Settings
from motion import quat
from motion.errors import NotFinite, UserError
from motion.pose import Poses
from motion.skeleton import Skeleton

BRIEF = evaluate.Plan(
    starts=20,
    queries=100,
    courses=("circle", "start-stop"),
    seconds=2.0,
    mixed=("circle",),
    mixed_seconds=1.0,
    each=2,
    minutes=0.02,
    characters=2,
)


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


def test_a_decompressor_that_gives_no_numbers_misses_its_target(database, exact):
    network = exact.decompressor
    lost = replace(network, biases=(*network.biases[:-1], np.full_like(network.biases[-1], np.nan)))
    with np.errstate(invalid="ignore"):
        found = decompressor.errors(replace(exact, decompressor=lost), database)
    assert {found["position_cm"]["mean"], *found["joints"].values()} == {np.inf}
    rows = evaluate.targets(_found(decompressor={"whole": found, "held_out": found}))
    assert [row["met"] for row in rows[:2]] == [False, False]


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


def test_a_projector_that_answers_no_numbers_is_bad(database, exact):
    network = exact.projector
    lost = replace(network, biases=(*network.biases[:-1], np.full_like(network.biases[-1], np.nan)))
    lost = replace(exact, projector=lost)
    with np.errstate(invalid="ignore"):
        found = projector.errors(lost, database, recorded.record(database, 100))
    assert found["regret"]["median"] == found["off_data"] == found["latent_error"] == np.inf
    assert found["regret"]["shares"][-1] == 1 and np.isfinite(found["queries_off_data"])
    assert evaluate.target("regret", 1.05, found["regret"]["median"])["met"] is False
    mixtures = evaluate.evaluate(lost, database, BRIEF)["mixtures"]
    broke = {row["system"] for row in mixtures if "broke" in row}
    assert {"lmm-P", "lmm-PS", "lmm-PD"} <= broke and not broke & {"mm", "lmm-S", "lmm-D", "lmm-SD"}


def test_noisy_rows_are_rows_with_real_noise(database):
    asked = recorded.record(database, 400)
    ranges = np.array(database.names) == "run"
    noisy = projector.noisy_rows(database, asked, ranges=ranges, seed=3)
    assert len(noisy) == 400 and np.all(noisy.current == -1)
    residuals = recorded.residuals(database, asked)
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


def test_mm_by_way_of_stages_is_motion_matching(database, exact):
    judge = driving.Judge(database, ("circle", "start-stop"), seconds=3)
    (system,) = driving.systems(exact, database, [""])
    plain = Controller(database, settings=Settings(), name="mm")
    for course in judge.courses:
        mine, its = judge.judge(system, course), judge.judge(plain, course)
        for row in (mine, its):
            assert row.pop("frame_us") > 0
        np.testing.assert_equal(mine, its)
        assert mine["system"] == "mm" and mine["seconds"] == 3 and mine["course"] == course.name
        assert 0 <= mine["real_cm"] < 3  # what blending and foot locking make of real poses
    assert judge.courses[0].scale  # at the speeds of the data


def test_a_model_without_loss_but_for_time_stands_in_the_mean_pose(database, exact):
    """Its projector answers with latents of the mean and its stepper stays: the same pose for ever."""
    judge = driving.Judge(database, ("circle",), seconds=2)
    (system,) = driving.systems(exact, database, ["PSD"], locked=False)
    row = judge.judge(system, judge.courses[0])
    assert row["system"] == "lmm-PSD-free"
    vectors = exact.layout.pack(database)
    mean, _ = exact.layout.unpack(vectors.mean(axis=0, keepdims=True), database.fps)
    local = quality.in_root_space(database.skeleton, mean.positions, mean.rotations)
    assert row["real_cm"] == pytest.approx(driving.RealPoses(database).distances(local)[0], rel=0.05)


def test_what_is_not_of_numbers_is_not_said_to_have_broken(database, exact, monkeypatch):
    """Motion matching at the end of its clips is as sound as ever."""
    judge = driving.Judge(database, ("circle",), seconds=1)
    (system,) = driving.systems(exact, database, [""])

    def record(*args: object, **options: object) -> None:
        raise error

    monkeypatch.setattr(driving.recording, "record", record)
    error = NotFinite("the command of character 0 is not finite")
    assert judge.judge(system, judge.courses[0]) == {"system": "mm", "course": "circle", "broke": True}
    error = UserError("character 0 is at the end of its clip and no frame may follow")
    with pytest.raises(UserError, match="no frame may follow"):
        judge.judge(system, judge.courses[0])


def test_other_courses_and_no_time():
    judge = driving.Judge(lmm_models.database(), ("circle",), seconds=1)
    judge.take(("star", "random"), seconds=2)
    assert [course.name for course in judge.courses] == ["star", "random"]
    with pytest.raises(UserError, match="0 seconds"):
        judge.take(("star",), seconds=0)


def test_summaries_are_means_of_what_has_a_number():
    rows = [
        {"system": "mm", "course": c, "path_cm": path, "pop_cm": pop, "seconds": 2.0}
        for c, path, pop in (("a", 1.0, 3.0), ("b", float("nan"), 5.0), ("c", 4.0, float("nan")))
    ]
    (row,) = driving.summary(rows)
    assert row == {"system": "mm", "courses": 3, "path_cm": 2.5, "pop_cm": 5.0, "seconds": 2.0}


def test_a_system_that_breaks_is_said_to_have_broken(database, exact):
    state = exact.F + exact.L
    growing = lmm_models.layer(np.eye(state) * 600, np.ones(state))  # tenfold a frame
    found = evaluate.evaluate(replace(exact, stepper=growing), database, BRIEF)
    rows = {row["system"]: row for row in found["systems"]}
    assert rows["lmm-PSD"]["broke"] == 2 and "skate_cm_s" not in rows["lmm-PSD"]
    assert "broke" not in rows["mm"] and rows["mm"]["skate_cm_s"] >= 0
    assert [row["met"] for row in found["targets"] if "motion matching" in row["what"]] == [None, None]
    assert not found["endurance"]["passed"]
    pictures.all_of(found)
    assert "not passed" in report.lasting(found["endurance"])
    assert report.systems(found["systems"])[1]["broke"] == 2


def test_what_is_no_number_is_shown_as_none():
    """Networks whose outputs overflow are judged like others, and the tables and pictures say so."""
    none = dict.fromkeys(("mean", "std", "p99", "worst"))
    poses = {"position_cm": none | {"worst_joint": "a"}, "joints": {"a": None, "b": 1.0}}
    (row,) = report.poses({"whole": poses})
    assert row["worst joint"] == "a" and row["mean"] is row["std"] is row["p99"] is row["its mean"] is None
    shares = [0.0] * (len(projector.BINS) - 1)
    answers = {
        "regret": {"median": None, "mean": None, "p95": None, "shares": shares},
        "latent_error": None,
        "off_data": None,
    }
    (row,) = report.answers({"projector": {"real": answers}})
    assert set(row.values()) == {"real queries", None}
    drawn = pictures.regret({"projector": {"real": answers}})
    assert drawn.axes[0].get_legend().get_texts()[0].get_text() == "real queries: median -, 95 % -"
    pictures.joints({"decompressor": {"training": poses}})


def test_extremes_by_hand(database, exact):
    model = replace(
        exact, state_low=np.array([0, -1, 3], np.float32), state_high=np.array([2, 1, 3], np.float32)
    )
    joints = len(database.skeleton)
    poses = Poses.empty(2, joints)
    for mine, its in zip(poses.arrays().values(), database.poses[[0, 5]].arrays().values(), strict=True):
        mine[:] = its
    seen = driving.Extremes(database, model.state_low, model.state_high)
    inside = np.array([[1, 0, 3], [2, 1, 3]], np.float32)
    assert seen.see(inside, poses, 60)
    assert seen.bone == 0 and seen.speed == 0 and seen.excess().max() == 0 and seen.outside == -1
    bone = np.linalg.norm(database.poses.positions[:, 5], axis=-1)
    poses.positions[1, 5] *= (bone.max() + 0.03) / np.linalg.norm(poses.positions[1, 5])
    poses.positions[0, 0, 2] += 0.05
    assert seen.see(inside - np.array([[0, 2, 0], [0, 0, 7]], np.float32), poses, 60)
    assert seen.bone == pytest.approx(3, rel=1e-3) and seen.speed == pytest.approx(3, rel=1e-3)
    assert seen.hips == 0
    hips = np.linalg.norm(database.poses.positions[:, 1], axis=-1)
    poses.positions[1, 1] *= (hips.min() - 0.04) / np.linalg.norm(poses.positions[1, 1])
    assert seen.see(inside, poses, 60)
    assert seen.hips == pytest.approx(4, rel=1e-3) and seen.bone == pytest.approx(3, rel=1e-3)
    np.testing.assert_allclose(seen.excess(), [0, 0.5, 0])  # 1 below a range of 2; no range, no share
    assert seen.outside == -1
    assert seen.see(inside + np.array([2, 0, 0], np.float32), poses, 60)
    np.testing.assert_allclose(seen.excess(), [1, 0.5, 0])
    assert seen.outside == 4
    poses.rotations[0, 3, 2] = np.nan
    assert not seen.see(inside, poses, 60) and seen.broken == 5


def test_what_stands_still_lasts_and_what_grows_is_caught(database, exact):
    calm = driving.endure(exact, database, seconds=4, characters=2)
    assert 0 <= calm["stall_s"] <= 4
    assert calm["finite"] and calm["minutes"] == pytest.approx(4 / 60) and calm["broken_s"] is None
    assert calm["bone_excess_cm"] < 0.01 and calm["speed_mps"] <= 1.5 * calm["data_speed_mps"]
    state = exact.F + exact.L
    growing = lmm_models.layer(np.eye(state) * 600, np.ones(state))  # tenfold a frame
    wild = driving.endure(replace(exact, stepper=growing), database, seconds=4, characters=2)
    assert not wild["passed"] and (not wild["finite"] or wild["state_excess"] > 1)
    assert wild["outside_s"] < 1


def _found(**changes) -> dict:
    found = {
        "database": {"fps": 60.0},
        "decompressor": {"whole": {"position_cm": {"mean": 0.9}}, "held_out": {"position_cm": {"mean": 2.1}}},
        "stepper": {"training": {"drift": [{"steps": 10, "joints_cm": 5.0}]}, "held_out": {"drift": []}},
        "projector": {"real": {"regret": {"median": 1.06}}},
        "systems": [
            {"system": "mm", "skate_cm_s": 5.0, "path_cm": 2.0},
            {"system": "lmm-PSD", "skate_cm_s": 5.4, "path_cm": 2.4},
        ],
        "endurance": {"minutes": 10.0, "passed": True},
    }
    return found | changes


def test_targets_are_met_or_not():
    rows = evaluate.targets(_found())
    assert [row["met"] for row in rows] == [True, False, True, False, True, False, True]
    assert rows[4]["found"] == pytest.approx(1.08) and "10 minutes" in rows[-1]["what"]
    assert rows[2]["what"] == "drift after 10 frames (0.17 s), training clips, cm"
    free = [{"system": f"{name}-free", "skate_cm_s": 1.0, "path_cm": None} for name in ("mm", "lmm-PSD")]
    rows = evaluate.targets(_found(systems=free))
    assert [row["met"] for row in rows[4:6]] == [True, None]
    lost = {"training": {"drift": [{"steps": 10, "joints_cm": np.inf}]}, "held_out": {"drift": []}}
    assert evaluate.targets(_found(stepper=lost))[2]["met"] is False
    assert evaluate.target("nobody knows", 1.0, np.nan)["met"] is None
    # Means over the courses on which it did not break say nothing beside means over all of them.
    systems = _found()["systems"]
    systems[1]["broke"] = 1
    assert [row["met"] for row in evaluate.targets(_found(systems=systems))[4:6]] == [None, None]


def test_plain_data_has_nothing_that_json_lacks():
    value = {"a": [np.float32(1.5), float("nan"), (np.int64(2), np.inf)], "b": np.bool_(True), "c": None}
    assert evaluate.plain(value) == {"a": [1.5, None, [2, None]], "b": True, "c": None}
    json.dumps(evaluate.plain(value), allow_nan=False)


@pytest.fixture(scope="module")
def crouching():
    """Another rate, and a tag that divides the data."""
    return lmm_models.database(crouch=True, fps=30.0)


def test_everything_of_a_model_at_another_rate_with_tags(crouching):
    model = lmm_models.linear_model(crouching, latents=6)
    found = evaluate.evaluate(model, crouching, BRIEF)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert set(found["decompressor"]) == {"whole", "training", "held_out"}
    frames = {part: errors["frames"] for part, errors in found["decompressor"].items()}
    assert frames["whole"] == frames["training"] + frames["held_out"] == len(crouching)
    assert set(found["stepper"]) == {"training", "held_out"}
    assert set(found["projector"]) == {"real", "training", "held_out"}
    assert [row["system"] for row in found["systems"]] == ["mm", "lmm-PSD", "mm-free", "lmm-PSD-free"]
    assert len(found["courses"]) == 8
    assert [row["system"] for row in found["mixtures"]] == [
        "mm", *(f"lmm-{letters}" for letters in ("P", "S", "D", "PS", "PD", "SD", "PSD"))
    ]  # fmt: skip
    sizes = {row["system"]: row["memory_mb"] for row in found["mixtures"]}
    assert sizes["lmm-PSD"] < sizes["mm"]
    assert found["mixed"] == list(BRIEF.mixed)
    assert len(found["blame"]) == 3 and all("motion matching" in sentence for sentence in found["blame"])
    again = evaluate.evaluate(model, crouching, BRIEF)
    for part in ("decompressor", "stepper", "projector", "endurance"):
        assert again[part] == found[part]
    drawn = pictures.all_of(found)
    assert set(drawn) == {"joints.png", "drift.png", "regret.png", "courses.png"}
    assert all(data.startswith(b"\x89PNG") for data in drawn.values())


def test_without_held_out_clips_there_is_one_part(database, exact):
    model = replace(exact, held_out=())
    found = evaluate.evaluate(model, database, replace(BRIEF, courses=("circle",), mixed=("circle",)))
    assert set(found["decompressor"]) == {"whole", "training"} and set(found["stepper"]) == {"training"}
    assert set(found["projector"]) == {"real", "training"}
    assert not any("held" in row["what"] for row in found["targets"])
    pictures.all_of(found)


def test_characters_without_whole_legs_are_driven_once(database, exact):
    """Their feet cannot be held, so there is nothing to compare with holding them."""
    model = replace(exact, description=replace(exact.description, legs=None))
    found = evaluate.evaluate(model, database, replace(BRIEF, courses=("circle",), mixed=("circle",)))
    assert [row["system"] for row in found["courses"]] == ["mm-free", "lmm-PSD-free"]
    assert [row["met"] for row in found["targets"] if "motion matching" in row["what"]] != [None, None]


def test_the_words_of_the_regrets_picture_lie_inside():
    of_it = {"median": 1.1, "p95": 12.05, "shares": [1 / (len(pictures.BINS) - 1)] * (len(pictures.BINS) - 1)}
    picture = pictures.regret({"projector": {kind: {"regret": of_it} for kind in pictures.KINDS}})
    drawn = FigureCanvasAgg(picture)
    drawn.draw()
    (axes,) = picture.axes
    for words in (*axes.get_legend().get_texts(), axes.xaxis.label, axes.yaxis.label):
        (left, low), (right, high) = words.get_window_extent(drawn.get_renderer()).get_points()
        assert 0 <= left < right <= picture.bbox.width and 0 <= low < high <= picture.bbox.height


def test_users_that_judge_are_none_that_training_learns_from(database, exact, monkeypatch):
    users = pytest.importorskip("lmm.training.randomness").users
    asked = []
    make = recorded.random_user
    monkeypatch.setattr(
        recorded, "random_user", lambda *a, seed=0, **b: asked.append(seed) or make(*a, seed=seed, **b)
    )
    evaluate.evaluate(exact, database, replace(BRIEF, courses=("circle",), mixed=("circle",)), seed=0)
    assert len(asked) == 2 and not {seed for one in range(100) for seed in users(one)} & set(asked)


@pytest.fixture(scope="module")
def stored(database, rough, tmp_path_factory):
    folder = tmp_path_factory.mktemp("evaluate")
    database.save(folder / "walk.mmdb")
    replace(rough, database=database.fingerprint).save(folder / "walk.lmm")
    return folder


def _run(*arguments: object):
    return CliRunner().invoke(main, ["evaluate", *map(str, arguments)])


def test_the_command_prints_and_saves(stored, tmp_path, monkeypatch):
    monkeypatch.setattr(evaluate, "QUICK", BRIEF)
    asked = [stored / "walk.mmdb", stored / "walk.lmm", "--quick", "--seconds", 1]
    terrain.save(tmp_path / "hills.txt", terrain_made.make(4, "hills", size=(10, 10)))
    result = _run(*asked, "-o", tmp_path / "out", "--heights", tmp_path / "hills.txt")
    assert result.exit_code == 0, result.output
    for text in ("held out", "projector", "lmm-SD", "good enough?", "random commands", "hills.txt: 10.0 x"):
        assert text in result.stdout
    saved = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert {path.name for path in Path(tmp_path, "out").iterdir()} == {
        "evaluation.json", "joints.png", "drift.png", "regret.png", "courses.png"
    }  # fmt: skip
    assert saved["courses"][0]["seconds"] == 1 and saved["model"]["held_out"] == ["run"]
    printed = json.loads(_run(*asked, "--json", "--minutes", 0.01, "--seed", 3).stdout)
    assert set(printed) == set(saved) and printed["endurance"]["minutes"] == pytest.approx(0.01, rel=0.05)
    assert printed["decompressor"] == saved["decompressor"]
    uneven, level = ({row["system"]: row for row in found["systems"]} for found in (saved, printed))
    assert printed["ground"] is None and saved["ground"]["size_m"] == pytest.approx([10, 10], abs=0.05)
    assert "sink_cm" not in level["mm"] and 0 <= uneven["mm"]["sink_cm"] < 1 and uneven["mm"]["hover_cm"] < 1
    assert uneven["mm"]["path_cm"] == level["mm"]["path_cm"]
    assert printed["projector"] != saved["projector"]


@pytest.mark.parametrize("options", [{"fps": 30.0}, {"schema": "o3de59"}, {"crouch": True}])
def test_a_model_of_another_database_is_one_line(stored, tmp_path, options, monkeypatch):
    monkeypatch.setattr(evaluate, "evaluate", lambda *a, **b: pytest.fail("it began to work"))
    lmm_models.database(**options).save(tmp_path / "other.mmdb")
    result = _run(tmp_path / "other.mmdb", stored / "walk.lmm")
    lines = result.stderr.splitlines()
    assert result.exit_code == 2 and len(lines) == 1 and lines[0].startswith("error: "), result.output


def test_a_heightmap_that_is_none_is_told_before_the_work(stored, monkeypatch):
    monkeypatch.setattr(evaluate, "evaluate", lambda *a, **b: pytest.fail("it began to work"))
    files = stored / "walk.mmdb", stored / "walk.lmm"
    for options, message in (
        (("--heights", stored / "none.txt"), "none.txt: cannot read"),
        (("--heights-spacing", 1), "give --heights FILE too"),
    ):
        result = _run(*files, *options)
        assert result.exit_code == 2 and message in result.stderr, result.output


def test_who_breaks_on_a_ground_is_said_to_have_broken(database, exact):
    hills = terrain_made.make(4, "hills", size=(10, 10))
    growing = lmm_models.layer(1e4 * np.eye(exact.F + exact.L), np.ones(exact.F + exact.L))
    judge = driving.Judge(database, ("circle",), seconds=3, ground=hills)
    with np.errstate(over="ignore", invalid="ignore"):
        (system,) = driving.systems(replace(exact, stepper=growing), database, ["PSD"], ground=hills)
        row = judge.judge(system, judge.courses[0])
    assert row == {"system": "lmm-PSD", "course": "circle", "broke": True}


def test_a_folder_that_is_a_file_is_refused_before_the_work(stored, tmp_path, monkeypatch):
    monkeypatch.setattr(evaluate, "evaluate", lambda *a, **b: pytest.fail("it began to work"))
    (tmp_path / "out").write_text("")
    result = _run(stored / "walk.mmdb", stored / "walk.lmm", "-o", tmp_path / "out")
    assert result.exit_code == 2 and result.stderr.count("\n") == 1, result.output
    assert Model.load(stored / "walk.lmm").frames  # untouched
