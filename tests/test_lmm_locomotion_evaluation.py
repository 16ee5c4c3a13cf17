"""The judgement of networks of locomotion: against networks whose errors are known, and by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import lmm_models
import mann_models
import numpy as np
import pfnn_models
import pytest
from click.testing import CliRunner

from features import terrain, terrain_made
from features.labels import Labels
from lmm.cli import main
from lmm.evaluation import cost, driving, evaluate, frames, free_runs, locomotion, pictures, report
from lmm.locomotion.labelling import labels_of
from lmm.pfnn.network import PhaseNetwork
from mm.ground_feet import GroundFeet
from motion import console, quat
from motion.errors import Note, UserError

BRIEF = evaluate.Plan(starts=20, courses=("circle",), seconds=1.0, each=2, minutes=0.02, characters=2)
V, W, TURN = (0.3, 1.5), 0.7, 4.0  # root velocity, m/s, turn rate and the phase's, rad/s


@pytest.fixture(scope="module")
def database():
    return lmm_models.database()


@pytest.fixture(scope="module")
def phased(database):
    """A model, one of whose clips was held out, that repeats the joints that it is given, and beside them
    always tells the same."""
    base = pfnn_models.model()
    layout = base.layout
    weight = np.zeros((4, layout.input_size, layout.output_size), np.float32)
    for block in ("positions", "velocities"):
        into, out = layout.inputs[block], layout.outputs[block]
        weight[:, range(into.start, into.stop), range(out.start, out.stop)] = 1
    told = np.zeros(layout.output_size, np.float32)
    told[layout.outputs["root_velocity"]] = V
    told[layout.outputs["turn_rate"]], told[layout.outputs["phase_rate"]] = W, TURN
    echo = PhaseNetwork(
        input_mean=np.zeros(layout.input_size, np.float32),
        input_std=np.ones(layout.input_size, np.float32),
        output_mean=told,
        output_std=np.ones(layout.output_size, np.float32),
        weights=(weight,),
        biases=(np.zeros((4, layout.output_size), np.float32),),
    )
    return replace(base, network=echo, held_out=("run",))


@pytest.fixture(scope="module")
def truth(phased, database):
    return locomotion.truth_of(phased, database)


@pytest.mark.parametrize(
    ("sizes", "count"),
    [
        ((2, 3), 11),
        ((342, 512, 311), 335_501),
        ((342, 512, 512, 311), 598_157),
        ((1302, 512, 1751), 1_566_701),
    ],
)
def test_operations_are_those_of_the_thesis(sizes, count):
    assert cost.operations(sizes) == count


def test_operations_of_experts_count_the_gate():
    model = mann_models.model()
    own = cost.operations(model.network.sizes)
    assert cost.of_model(model) == own + cost.operations(model.network.gate_sizes) > own
    assert cost.of_model(pfnn_models.model()) == cost.operations(pfnn_models.model().network.sizes)


def test_one_step_of_an_echo_by_hand(truth, database):
    found, y = frames.step(truth), truth.frames.y
    layout, joints = truth.model.layout, truth.model.layout.joints
    before = truth.frames.x[:, layout.inputs["positions"]].reshape(-1, joints, 3).astype(np.float64)
    after = y[:, layout.outputs["positions"]].reshape(-1, joints, 3).astype(np.float64)
    apart = np.sqrt(((before - after) ** 2).sum(axis=-1))
    np.testing.assert_allclose(found.position_cm, 100 * apart, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(found.relative, apart / np.linalg.norm(after, axis=-1), rtol=1e-4, atol=1e-5)
    still = np.zeros((1, 3 * joints), np.float32)  # what no weight leads to
    maps = np.concatenate([np.zeros((1, layout.output_size - 3 * joints), np.float32), still], axis=1)
    unturned = layout.unpack_outputs(maps).rotations
    real = layout.unpack_outputs(y).rotations
    np.testing.assert_allclose(
        found.rotation_deg, np.degrees(quat.angle_between(unturned, real)), rtol=1e-3, atol=0.05
    )
    root = 100 * np.linalg.norm(y[:, layout.outputs["root_velocity"]] - np.float32(V), axis=1)
    np.testing.assert_allclose(found.root_cm_s, root, rtol=1e-4)
    np.testing.assert_allclose(
        found.phase_deg_s, np.degrees(np.abs(y[:, layout.outputs["phase_rate"]][:, 0] - TURN)), rtol=1e-3
    )
    np.testing.assert_array_equal(found.contacts, truth.labels.contacts[truth.frames.frame] == 0)


def test_parts_and_files_are_those_of_the_data(truth, database):
    found = frames.step(truth)
    parts = frames.poses(truth, found)
    names = np.array(database.names)[truth.ranges]
    held = names == "run"
    assert parts["held_out"]["frames"] == held.sum() == 2 * 118
    assert parts["training"]["position_cm"]["mean"] == pytest.approx(
        found.position_cm[~held].mean(), rel=1e-5
    )
    assert list(parts["training"]["joints"]) == list(database.skeleton.names[1:])
    rows = frames.by_file(truth, found)
    assert [(row["file"], row["mirrored"], row["held_out"], row["frames"]) for row in rows] == [
        (name, bool(mirrored), name == "run", 118)
        for name, mirrored in zip(database.names, database.mirrored, strict=True)
    ]
    for r, row in enumerate(rows):
        mine = found.relative[truth.ranges == r].astype(np.float64)
        assert row["relative"] == pytest.approx(mine.mean()) and row["relative_sd"] == pytest.approx(
            mine.std()
        )
    few = frames.by_file(truth, found, joints=[0, 5])
    assert few[1]["relative"] == pytest.approx(found.relative[truth.ranges == 1][:, [0, 5]].mean(), rel=1e-5)
    means = [row["relative"] for row in rows]
    over = frames.over_files(rows)
    assert over == {
        "files": 4,
        "mean": pytest.approx(np.mean(means)),
        "sd": pytest.approx(np.std(means, ddof=1)),
    }
    assert np.isnan(frames.over_files(rows[:1])["sd"])


def test_an_echo_drifts_as_the_pose_that_is_held(truth):
    run = free_runs.drift(truth, "training", runs=30)
    assert run.joints.shape == (60, 30)
    np.testing.assert_allclose(run.joints, run.still, rtol=1e-4, atol=1e-3)
    rows = free_runs.starts(truth, "training", runs=30)
    layout, fps = truth.model.layout, truth.database.fps
    rates = np.stack([truth.frames.y[rows + s][:, layout.outputs["phase_rate"]][:, 0] for s in range(60)])
    off = np.cumsum(TURN - rates.astype(np.float64), axis=0) / fps
    wrapped = np.degrees(np.abs((off + np.pi) % (2 * np.pi) - np.pi))
    np.testing.assert_allclose(run.phase, wrapped, rtol=1e-3, atol=1e-2)
    assert [row["steps"] for row in run.table()] == [1, 5, 10, 20, 30, 60]
    row = run.table((30,))[0]
    assert row["joints_cm"] == pytest.approx(run.joints[29].mean()) and row["runs"] == 30
    assert row["path_p95_cm"] == pytest.approx(np.percentile(run.path[29], 95))
    assert set(run.curves()) == {
        "joints_cm",
        "rotation_deg",
        "phase_deg",
        "still_cm",
        "path_cm",
        "heading_deg",
    }


def test_the_way_that_is_told_is_a_polygon_on_a_circle():
    class Told:
        root_velocity, turn_rate = np.array([[0.0, 1.5]], np.float32), np.array([0.7], np.float32)

    way = np.zeros((1, 3))
    for _ in range(60):
        way = free_runs._onward(way, Told, 60.0)
    angle = 0.7 / 60  # of 60 chords, each 1.5 / 60 long and turned by it
    at = sum(1.5 / 60 * np.exp(1j * angle * k) for k in range(60))
    np.testing.assert_allclose(way[0], [at.imag, at.real, 0.7], rtol=1e-6)


def test_starts_are_of_their_part_and_clips_that_are_short_run_as_long_as_they_are(truth):
    rows = free_runs.starts(truth, "held_out", runs=10_000)
    assert len(rows) == 2 * (118 - 59) and np.all(truth.parts["held_out"][truth.ranges[rows]])
    short = replace(truth)
    short.frames = replace(truth.frames, frame=truth.frames.frame[::-1])  # no two rows follow each other
    run = free_runs.drift(short, "training", runs=5)
    assert [row["steps"] for row in run.table()] == [1]


def test_a_network_that_puts_out_no_numbers_misses_its_targets(truth):
    ends = {"output_mean": np.full_like(truth.model.network.output_mean, np.nan)}
    lost = replace(truth, model=replace(truth.model, network=replace(truth.model.network, **ends)))
    with np.errstate(invalid="ignore"):
        run = {"drift": free_runs.drift(lost, "training", runs=5).table()}
        poses = frames.poses(lost, frames.step(lost))
    rows = locomotion.targets(_found(poses=poses, free_run={"training": run}))
    assert [row["met"] for row in rows[:3]] == [False, False, False]


def test_who_learned_to_go_up_and_down_is_judged_on_level_ground_and_that_is_told(phased, database):
    def terrain(level: bool):
        return replace(phased, training={"terrain": {"level_motion": level}})

    with pytest.warns(Note, match="told of level ground"):
        locomotion.truth_of(terrain(False), database)
    locomotion.truth_of(terrain(True), database)  # a note would be an error


def test_labels_of_other_contacts_are_refused(phased, database):
    labels = labels_of(database)
    two = Labels(labels.names[1::2], labels.contacts[:, 1::2], labels.phase, labels.gait)
    with pytest.raises(UserError, match=r"contacts are left_heel.*the database that it was trained from"):
        frames.Truth(phased, database, two)


def _found(**changes: Any) -> dict[str, Any]:
    found: dict[str, Any] = {
        "kind": "pfnn",
        "database": {"fps": 30.0},
        "poses": {"training": {}, "held_out": {"position_cm": {"mean": 2.5}, "rotation_deg": {"mean": 4.5}}},
        "free_run": {"training": {"drift": [{"steps": 10, "joints_cm": 4.0}]}, "held_out": {"drift": []}},
        "costs": [
            {"frame_us": 500.0, "network_us": 400.0},
            {"frame_us": 300.0, "network_us": 200.0},
            {"frame_us": 10.0},  # of another kind
        ],
        "courses": [
            {"system": "pfnn", "course": "star", "path_max_cm": 51.0, "stall_s": 1.0},
            {"system": "pfnn", "course": "random", "path_max_cm": float("nan"), "stall_s": 3.0},
            {"system": "pfnn-free", "course": "star", "path_max_cm": 90.0, "stall_s": 9.0},
        ],
        "systems": [
            {"system": "mm", "skate_cm_s": 5.0, "path_cm": 2.0, "stall_s": 0.3},
            {"system": "pfnn", "skate_cm_s": 5.0, "path_cm": 4.0, "path_max_cm": 51.0, "stall_s": 3.0},
            {"system": "pfnn-free", "path_max_cm": 9.0},
        ],
        "endurance": {"minutes": 10.0, "passed": True, "stall_s": 3.0},
    }
    return found | changes


def test_targets_by_hand():
    rows = locomotion.targets(_found())
    assert rows[2]["what"] == "drift after 10 frames (0.33 s), training clips, cm"
    assert [(row["found"], row["met"]) for row in rows] == [
        (2.5, False),
        (4.5, True),
        (4.0, True),
        (51.0, False),
        (3.0, False),
        (1.0, True),
        (2.0, False),
        (300.0, True),
        (None, True),
    ]
    assert [row["what"].rpartition(" ")[2] for row in rows[3:5]] == ["(star)", "(random)"]
    lame = [{"system": "mm", "stall_s": 4.0}, {"system": "pfnn"}]
    row = next(r for r in locomotion.targets(_found(systems=lame)) if "without a step" in r["what"])
    assert row == {"what": row["what"], "at most": 4.0, "found": 3.0, "met": True}
    lost = [{"system": "mm"}, {"system": "pfnn-free", "broke": 1}]
    broke = {"system": "pfnn-free", "course": "circle", "broke": True}
    found = _found(systems=lost, endurance={"minutes": 0.1, "passed": False, "stall_s": None})
    found["courses"].append(broke)  # beside one where it did well
    rows = locomotion.targets(found)
    assert [row["met"] for row in rows if "any course" in row["what"]] == [False, False]
    assert all(row["what"].endswith("(circle)") for row in rows if "any course" in row["what"])
    assert {row["met"] for row in rows if "path / motion" in row["what"]} == {None}
    assert rows[-1]["met"] is False
    found["courses"] = [{"system": "pfnn-free", "course": "random", "stall_s": float("nan")}]
    rows = locomotion.targets(found)
    assert [row["met"] for row in rows if "any course" in row["what"]] == [None, None]


@pytest.mark.parametrize("make", [pfnn_models.model, mann_models.model])
def test_the_whole_judgement_of_each_kind(make, database, tmp_path, capsys, monkeypatch):
    model = replace(make(), held_out=("run",))
    found = locomotion.evaluate(model, database, BRIEF, against=make(seed=1))
    json.dumps(found, allow_nan=False)
    family = model.family
    assert [row["system"] for row in found["systems"]] == ["mm", family, "mm-free", f"{family}-free"]
    assert [row["course"] for row in found["courses"]] == ["circle"] * 4
    assert all(row["path_max_cm"] >= row["path_p95_cm"] for row in found["courses"])
    assert ("phase_deg" in found["free_run"]["training"]["curves"]) == (family == "pfnn")
    assert found["accuracy"]["files"] == len(found["files"]) == 4
    assert found["against"]["significance"] >= 0
    assert found["endurance"]["minutes"] == pytest.approx(0.02, rel=0.01)
    modes = {"pfnn": ["pfnn-cubic", "pfnn-linear", "pfnn-constant"], "mann": ["mann-4"]}[family]
    *own, lmm = found["costs"]
    assert [row["system"] for row in own] == modes and lmm["system"] == "lmm (dancecard)"
    assert all(0 < row["network_us"] < row["frame_us"] for row in own)
    assert all(row["of_lmm"] == pytest.approx(row["mean_us"] / lmm["mean_us"]) for row in own)
    report.show(found, "model")
    shown = capsys.readouterr().out
    assert "free runs" in shown and "against" in shown and "good enough?" in shown
    written = report.save(found, tmp_path, command="x")
    assert sorted(path.name for path in written) == [
        "courses.png",
        "drift.png",
        "evaluation.json",
        "files.png",
        "joints.png",
    ]
    assert all(path.stat().st_size > 1000 for path in written)
    del found["against"]
    monkeypatch.setattr(pictures.figures, "png", lambda picture: b"")  # which takes longest
    assert set(pictures.all_of(found)) == {path.name for path in written} - {"evaluation.json"}


def test_a_network_that_knows_grounds_is_told_of_the_one_it_is_judged_on(database, monkeypatch):
    follows = []

    class Feet(GroundFeet):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            follows.append(options["follow"])
            super().__init__(*arguments, **options)

    monkeypatch.setattr("mm.grounded.GroundFeet", Feet)
    hills = terrain_made.make(4, "hills", size=(10, 10))
    judge = driving.Judge(database, ("circle",), seconds=1, ground=hills)
    for knows in (True, False):
        model = pfnn_models.model()
        model.network.input_mean[model.layout.inputs["heights"]] = 0.1 * knows
        rows = [
            judge.judge(system, judge.courses[0])
            for system in locomotion.systems(model, database, count=1, ground=hills)
        ]
        assert [row["system"] for row in rows] == ["mm", "pfnn", "mm-free", "pfnn-free"]
        assert all(row["sink_cm"] >= 0 for row in rows)
        assert follows == [True, not knows] * 2
        follows.clear()


def test_who_takes_no_step_has_died_out(database, monkeypatch):
    """A network that stands in one pose, and is carried along in it."""
    model = pfnn_models.model()
    std = model.network.output_std
    carried = replace(model.network, output_std=np.where(np.arange(len(std)) < 2, std, np.float32(0)))
    monkeypatch.setattr(locomotion.driving, "MARGIN", np.inf)  # it need not stand as anybody of the data does
    monkeypatch.setattr(locomotion.driving, "HASTE", np.inf)
    plan = replace(BRIEF, minutes=0.25)
    for most, passed in ((1.0, False), (100.0, True)):
        monkeypatch.setattr(locomotion, "DIED_S", most)
        found = locomotion.endure(replace(model, network=carried), database, plan, progress=console.silent)
        assert 1 < found["stall_s"] < 100 and found["passed"] == passed


def run(*arguments: Any, code: int = 0) -> Any:
    result = CliRunner().invoke(main, ["evaluate", *map(str, arguments)])
    assert result.exit_code == code, result.output + result.stderr
    return result


def test_the_command_judges_what_the_file_holds(database, tmp_path):
    database.save(tmp_path / "db")
    pfnn_models.model().save(tmp_path / "a.pfnn")
    mann_models.model().save(tmp_path / "b.mann")
    lmm_models.model(database).save(tmp_path / "c.lmm")
    terrain.save(tmp_path / "hills.txt", terrain_made.make(4, "hills", size=(10, 10)))
    files = tmp_path / "db", tmp_path / "a.pfnn"
    told = run(
        *(*files, "--quick", "--seconds", 0.5, "--minutes", 0.01, "--json"),
        *("--against", tmp_path / "b.mann", "--heights", tmp_path / "hills.txt"),
    )
    found = json.loads(told.stdout)
    assert found["ground"]["size_m"] == pytest.approx([10, 10], abs=0.05)
    assert {"sink_cm", "hover_cm"} <= set(found["systems"][1])
    assert found["kind"] == "pfnn" and found["command"].startswith("python -m lmm")
    assert found["against"]["model"]["fingerprint"] != found["model"]["fingerprint"]

    message = run(*files, "--against", tmp_path / "c.lmm", code=2).stderr
    assert "c.lmm" in message and "give a phase-functioned or mode-adaptive network" in message
    message = run(tmp_path / "db", tmp_path / "c.lmm", "--against", tmp_path / "a.pfnn", code=2).stderr
    assert "--against is for networks of locomotion" in message
    other = lmm_models.database(fps=30.0)
    other.save(tmp_path / "slow")
    message = run(tmp_path / "slow", tmp_path / "a.pfnn", code=2).stderr
    assert "a.pfnn" in message and "60 frames per second, not 30" in message
    message = run(*files, "--labels", tmp_path / "none", code=2).stderr
    assert "error: " in message and "none" in message
