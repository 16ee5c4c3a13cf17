"""Training of networks that a trajectory drives: what they learn, that it repeats, goes on, refuses."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import lmm_models
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from features import label_files  # noqa: E402
from lmm.evaluation.phase import free_run, joint_errors, windows  # noqa: E402
from lmm.locomotion.labelling import labels_of  # noqa: E402
from lmm.locomotion.model import LocomotionModel  # noqa: E402
from lmm.locomotion.statistics import joint_weights  # noqa: E402
from lmm.mann import sway  # noqa: E402
from lmm.mann.controller import MannController  # noqa: E402
from lmm.mann.layout import from_axes, to_axes  # noqa: E402
from lmm.mann.model import MannModel  # noqa: E402
from lmm.pfnn.controller import PhaseController  # noqa: E402
from lmm.pfnn.model import PhaseModel  # noqa: E402
from lmm.training import mann_settings, pfnn_settings  # noqa: E402
from lmm.training.checkpoint import Checkpoint  # noqa: E402
from lmm.training.data import LIBRARIES  # noqa: E402
from lmm.training.locomotion import WORK, LocomotionData, LocomotionStage  # noqa: E402
from lmm.training.locomotion_settings import LocomotionTraining  # noqa: E402
from lmm.training.mann import MannData, MannStage, lasting  # noqa: E402
from lmm.training.pfnn import PhaseData, PhaseStage  # noqa: E402
from lmm.training.train_locomotion import train  # noqa: E402
from mm.control import Command  # noqa: E402
from mm.database import Database  # noqa: E402
from motion.errors import Note, UserError  # noqa: E402

PRESETS = {"pfnn": pfnn_settings.preset, "mann": mann_settings.preset}
DATA = {"pfnn": PhaseData, "mann": MannData}
STAGES = {"pfnn": PhaseStage, "mann": MannStage}
MODELS = {"pfnn": PhaseModel, "mann": MannModel}
CONTROLLERS = {"pfnn": PhaseController, "mann": MannController}


def settings(
    kind: str, recipe: str = "ours", *, held_out: float = 0.3, seed: int = 0, **changes: object
) -> LocomotionTraining:
    """A training of a second or two."""
    found = PRESETS[kind](recipe, "smoke")
    small = {"iterations": 150, "batch": 32, "window": 2, "hidden": (48, 48), "evaluate": 50} | changes
    stage = {kind: replace(getattr(found, kind), **small)}
    return replace(found, held_out=held_out, seed=seed, threads=1, **stage)


def data_of(kind: str, database: Database, held_out: tuple[str, ...]) -> LocomotionData:
    return DATA[kind](database, labels_of(database, phase=kind == "pfnn"), held_out)


def outputs(model: LocomotionModel, data: LocomotionData, rows: np.ndarray) -> np.ndarray:
    """What a network that runs makes of rows of the data."""
    (found,) = free_run(model.network, data.frames, rows, data.layout, fps=60.0, steps=1)
    return found


@pytest.fixture(scope="module")
def database() -> Database:
    return lmm_models.database()


@pytest.fixture(scope="module", params=["pfnn", "mann"])
def kind(request) -> str:
    return request.param


@pytest.fixture(scope="module")
def data(kind, database) -> LocomotionData:
    return data_of(kind, database, ("run",))


@pytest.fixture(scope="module")
def stage(kind, data) -> LocomotionStage:
    return STAGES[kind](data, settings(kind))


@pytest.fixture(scope="module")
def trained(kind, database, tmp_path_factory) -> LocomotionModel:
    return train(database, tmp_path_factory.mktemp("trained") / "walk", settings(kind))


def test_windows_stay_within_ranges_and_off_those_held_out(database, data) -> None:
    of_row = database.ranges()[data.frames.frame]
    for window in (1, 2, 30):
        for part in ("training", "held_out"):
            rows = data.starts(window, part)
            assert len(rows) and np.array_equal(of_row[rows], of_row[rows + window - 1])
            names = {database.names[r] for r in of_row[rows]}
            assert names == ({"run"} if part == "held_out" else set(database.names) - {"run"})
        lengths = database.stops - database.starts - 2
        assert len(windows(data.frames.frame, window)) == (lengths - window + 1).clip(0).sum()
    assert len(windows(data.frames.frame, 10_000)) == 0


def test_the_vectors_take_the_memory_that_is_told(kind, database, data) -> None:
    taken = data.frames.x.nbytes + data.frames.y.nbytes
    if kind == "mann":
        taken += sway.sways(database, data.labels).nbytes
    told = data.memory() - LIBRARIES - WORK
    assert taken < told < 1.1 * taken


def test_characters_without_a_phase_follow_as_far_as_the_data_goes(kind, data, trained) -> None:
    if kind == "pfnn":
        assert data.bounds() is None and trained.bounds is None
        return
    y = data.frames.y
    least, most = data.bounds()
    np.testing.assert_array_equal(trained.bounds, data.bounds())
    assert (least <= y).all() and (y <= most).all()
    np.testing.assert_allclose(most - least, 1.2 * (y.max(axis=0) - y.min(axis=0)), rtol=1e-5, atol=1e-6)


def test_a_network_that_knows_the_data_runs_freely_on_it(kind, data) -> None:
    """Errors are those of what is fed back: 0 for the truth, by as much as joints are off for others."""
    found, layout = data.frames, data.layout
    rows = data.sample(20, "training", window=40)
    off = np.zeros(layout.output_size, np.float32)
    off[layout.outputs["positions"].start :: 3][: layout.joints] = 0.02

    class Truth:
        def __init__(self, by: float) -> None:
            self.step, self.by, self.seen = -1, by, []

        def evaluate(self, x, *phases):
            self.step += 1
            self.seen.append((x.copy(), *(phase.copy() for phase in phases)))
            return found.y[rows + self.step] + self.by * off

    for by in (0, 1):
        network = Truth(by)
        for step, y in enumerate(free_run(network, found, rows, layout, fps=60.0, steps=40)):
            errors = joint_errors(y, found.y[rows + step], layout)
            np.testing.assert_allclose(errors, 2 * by, atol=1e-4)
        x, *phases = network.seen[-1]
        assert len(phases) == (kind == "pfnn")
        for phase in phases:
            turned = np.mod(phase - found.phase[rows + 39] + 1, 2 * np.pi) - 1
            np.testing.assert_allclose(turned, 0, atol=1e-3)
        expected = found.x[rows + 39].copy()
        expected[:, layout.inputs["positions"]] += by * off[layout.outputs["positions"]]
        np.testing.assert_allclose(x, expected, atol=2e-4)


def test_a_run_in_training_goes_on_from_what_was_put_out(data, stage) -> None:
    """The true outputs lead to the true inputs of the frame to come, others to theirs."""
    stage.begin()
    layout, rows = data.layout, torch.from_numpy(data.starts(2))
    truth, y = stage._x[rows + 1], stage._y[rows]
    np.testing.assert_allclose(stage._fed_back(truth, y), truth, atol=2e-3)
    moved = stage._fed_back(truth, y + 1) - truth
    for block in ("positions", "velocities"):
        np.testing.assert_allclose(moved[:, layout.inputs[block]], 1, atol=2e-3)
    if "rotations" in layout.inputs:  # they are made whole, as when characters are driven
        put_out = (y + 1)[:, layout.outputs["rotations"]].numpy().reshape(len(y), layout.joints, 6)
        found = (truth + moved)[:, layout.inputs["rotations"]].numpy().reshape(put_out.shape)
        np.testing.assert_allclose(found, to_axes(from_axes(put_out)), atol=2e-3)
    for block in {"path", "going"} & layout.inputs.keys():
        for way in moved[:, layout.inputs[block]].split(12, dim=1):
            assert way[:, :7].abs().max() < 2e-3  # the past, and where it is now
            # Little of what is asked counts soon, most of it late.
            assert (way[:, 7:].diff(dim=1) < 0).all() and 0.6 < way[:, 7].mean() < 1
            assert way[:, 11].mean() < 0.3
    for block in {"gaits", "speeds"} & layout.inputs.keys():
        assert moved[:, layout.inputs[block]].abs().max() == 0


def test_noise_moves_inputs_as_far_as_they_vary(kind, stage) -> None:
    """By half a deviation of their block at most, in metres and not as they count; by a tenth of it what is
    asked for, and gaits not at all."""
    stage.begin()
    layout, known = stage._data.layout, stage.network.input_std
    off = (stage._noise * known).numpy()
    found = stage._data.frames.x[stage._data.sample(20_000, "training")]
    for block, columns in layout.inputs.items():
        spread = found[:, columns].std(axis=0).mean()
        if block == "gaits":
            assert not off[columns].any()
        elif block in ("positions", "rotations", "velocities"):
            np.testing.assert_allclose(off[columns], 0.5 * spread, rtol=1e-3)
        elif block != "heights":
            np.testing.assert_allclose(off[columns].mean(), 0.1 * max(spread, 0.1), rtol=0.5)


def test_training_learns_more_than_the_mean_and_keeps_clips_apart(kind, database, trained) -> None:
    assert trained.held_out and set(trained.held_out) < set(database.names)
    assert trained.database == database.fingerprint
    assert trained.contacts == (
        ("left_heel", "left_toe", "right_heel", "right_toe") if kind == "pfnn" else database.contact_roles
    )
    assert trained.network.sizes[1:-1] == (48, 48)
    errors = trained.errors[kind]
    assert set(errors) == {"training", "held_out"}
    of_all = data_of(kind, database, trained.held_out)
    rows = of_all.starts(1)
    mean = of_all.frames.y[rows].mean(axis=0, keepdims=True).repeat(len(rows), axis=0)
    of_the_mean = joint_errors(mean, of_all.frames.y[rows], of_all.layout).mean()
    found = errors["training"]
    assert found["error_cm"] < 0.5 * of_the_mean
    assert found["error_cm"] < found["after_30_cm"] and np.isfinite(found["after_60_cm"])
    assert errors["held_out"]["error_cm"] < 30  # of another gait, which is no reason to burst
    # Errors are those of the network that is written.
    y = outputs(trained, of_all, rows)
    assert joint_errors(y, of_all.frames.y[rows], of_all.layout).mean() == pytest.approx(
        found["error_cm"], rel=1e-3
    )


def test_the_same_seed_gives_the_same_model_and_goes_on_to_it(
    kind, database, trained, tmp_path, monkeypatch
) -> None:
    brief = [
        train(database, tmp_path / f"seed-{seed}", settings(kind, seed=seed, held_out=0.0, iterations=3))
        for seed in (0, 1)
    ]
    assert not np.array_equal(brief[0].network.weights[0], brief[1].network.weights[0])
    write = Checkpoint.save

    def save(self, path):
        write(self, path)
        if self.iteration == 30:
            raise KeyboardInterrupt

    monkeypatch.setattr(Checkpoint, "save", save)
    often = replace(settings(kind), checkpoint_seconds=0.0)
    with pytest.raises(KeyboardInterrupt):
        train(database, tmp_path / "again", often)
    monkeypatch.undo()
    assert Checkpoint.load(tmp_path / "again.checkpoint").held_out == list(trained.held_out)
    with pytest.raises(UserError, match="of other settings: seed was 0, is 1"):
        train(database, tmp_path / "again", settings(kind, seed=1), resume=True)
    resumed = train(database, tmp_path / "again", settings(kind), resume=True)
    assert {path.name for path in tmp_path.glob("again*")} == {"again", "again.jsonl"}
    ours, theirs = (model.network.to_arrays("") for model in (resumed, trained))
    assert ours.keys() == theirs.keys()
    for name in ours:
        np.testing.assert_array_equal(ours[name], theirs[name])
    assert MODELS[kind].load(tmp_path / "again").errors == trained.errors


def test_the_published_recipe_trains_too(kind, database, tmp_path) -> None:
    model = train(database, tmp_path / "reference", settings(kind, "reference", iterations=30))
    lines = (tmp_path / "reference.jsonl").read_text()
    assert ('"weights"' in lines) == (kind == "pfnn")
    assert model.training["settings"]["recipe"] == "reference"
    data = data_of(kind, database, ())
    assert np.isfinite(outputs(model, data, data.starts(1))).all()


def test_epochs_say_how_many_iterations(database, tmp_path) -> None:
    """Every frame that is trained on counts once an epoch, on average."""
    asked = settings("mann", "reference", epochs=2, evaluate=10)
    model = train(database, tmp_path / "m", asked)
    data = data_of("mann", database, model.held_out)
    assert data.count() == len(data.starts(1))
    iterations = math.ceil(2 * data.count() / 32)
    assert lasting(asked.mann, data.count()).iterations == iterations
    last = (tmp_path / "m.jsonl").read_text().splitlines()[-1]
    assert f'"iteration": {iterations},' in last
    assert model.training["settings"]["mann"]["epochs"] == 2


def test_gates_see_joints_whatever_those_count_elsewhere(database) -> None:
    """First gates are the same for joints that count a tenth as for those that count as they are."""
    found = []
    for scale in (1.0, 0.1):
        stage = MannStage(data_of("mann", database, ()), settings("mann", joint_scale=scale, noise=0.0))
        stage.begin()
        network = stage.network
        found.append(network.gate((stage._x - network.input_mean) / network.input_std).detach())
    np.testing.assert_allclose(found[0], found[1], atol=1e-4)
    assert found[0].std(dim=0).max() > 0.01


def test_own_sway_is_taken_away_and_that_of_others_added(database) -> None:
    """Sways of 1 become 0 to 1 less, alike in all of the past and in all of the future; others' of 1 add
    one amount to both."""
    data, count = data_of("mann", database, ()), 32

    class Draw(np.random.Generator):
        """Others are the frame after those of the batch."""

        def integers(self, low, high, size):  # type: ignore[override]
            return np.full(size, count)

    stage = MannStage(data, settings("mann", sway=1.5))
    stage.begin()
    rows = torch.arange(count)
    true = stage._x[rows]

    def change(own: float, others: float) -> np.ndarray:
        stage._sways = torch.full_like(stage._sways, others)
        stage._sways[rows] = own
        return (stage._told(Draw(np.random.Philox(3)))(true.clone(), rows) - true).numpy()

    columns, past = sway.columns(data.layout), sway.of_past(data.layout)
    others = np.setdiff1d(np.arange(data.layout.input_size), columns)
    for moved in (change(1, 0), change(0, 1)):
        assert (moved[:, others] == 0).all()
    less = -change(1, 0)[:, columns]
    assert less.min() >= -1e-5 and less.max() <= 1 + 1e-5 and less.max() > 0.8
    for part in (past, ~past):
        np.testing.assert_allclose(less[:, part], less[:, part][:, :1].repeat(part.sum(), 1), atol=1e-5)
    assert np.abs(less[:, past][:, 0] - less[:, ~past][:, 0]).max() > 0.3
    more = change(0, 1)[:, columns]
    np.testing.assert_allclose(more, more[:, :1].repeat(len(columns), 1), atol=1e-5)
    assert -1.5 - 1e-5 <= more.min() < -1 and 1 < more.max() <= 1.5 + 1e-5

    plain = MannStage(data, settings("mann", sway=0.0))
    plain.begin()
    assert torch.equal(plain._told(np.random.default_rng())(true.clone(), rows), true)


def test_all_joints_of_a_large_rig_count_and_are_off_as_those_of_an_ordinary_one(kind, database) -> None:
    """Of N times the joints each counts 1 / sqrt N, and is off by sqrt N as much; what is asked as it did."""
    data, noise = data_of(kind, database, ()), 0.5
    count = int(np.count_nonzero(joint_weights(database.skeleton)))
    more = (count / 2) ** 0.5
    found = []
    for ordinary in (0, count, 4 * count, 2):
        stage = STAGES[kind](data, settings(kind, ordinary=ordinary, noise=noise))
        stage.begin()
        found.append((stage.network.input_std.clone(), stage._noise * stage.network.input_std))
    for stds, off in found[1:3]:
        assert torch.equal(stds, found[0][0]) and torch.equal(off, found[0][1])
    (stds, off), (large, further) = found[0], found[3]
    joints = np.zeros(len(stds), bool)
    for block in data.layout.inputs.keys() & {"positions", "rotations", "velocities"}:
        joints[data.layout.inputs[block]] = True
    np.testing.assert_allclose(large / stds, np.where(joints, more, 1), rtol=1e-6)
    moved = off > 0
    assert moved[joints].any()
    np.testing.assert_allclose((further / off)[moved], np.where(joints, more, 1)[moved], rtol=1e-6)


def test_what_is_trained_drives_characters(kind, trained) -> None:
    driven = CONTROLLERS[kind](trained, count=2)
    for _ in range(30):
        poses = driven.step(Command.still(2))
    assert np.isfinite(poses.positions).all() and np.isfinite(poses.rotations).all()


def test_labels_that_are_given_count(kind, database, data, tmp_path) -> None:
    """They are learned; they are part of what a training may go on with."""
    own = slice(0, int(database.stops[0]))
    name, labels = database.names[0], data.labels
    path = tmp_path / "labels" / f"{name}.labels.csv"
    path.parent.mkdir()
    walking = labels.gait[own].copy()
    walking[:] = np.eye(6)[3]  # crouching
    label_files.write(path, replace(labels[own], gait=walking))
    brief = settings(kind, iterations=2, held_out=0.0, noise=0.0)
    models = [
        train(database, tmp_path / f"m{i}", brief, labels=given)
        for i, given in enumerate((None, tmp_path / "labels"))
    ]
    assert models[1].training["labels"] == 1 and "labels" not in models[0].training
    columns = models[0].layout.inputs["gaits"]
    crouching = [model.network.input_mean[columns][36:48] for model in models]
    assert crouching[0].max() < 0.01 and crouching[1].min() > 0.3


def test_a_training_goes_on_with_the_same_labels_only(database, tmp_path, monkeypatch) -> None:
    labels, folder = labels_of(database), tmp_path / "labels"
    folder.mkdir()
    own, path = slice(0, int(database.stops[0])), folder / f"{database.names[0]}.labels.csv"
    label_files.write(path, labels[own])

    def stop(self, path):
        write(self, path)
        raise KeyboardInterrupt

    write = Checkpoint.save
    monkeypatch.setattr(Checkpoint, "save", stop)
    brief = replace(settings("pfnn", iterations=3), checkpoint_seconds=0.0)
    with pytest.raises(KeyboardInterrupt):
        train(database, tmp_path / "m", brief, labels=folder)
    monkeypatch.undo()
    text = Path(path).read_text()
    label_files.write(path, replace(labels[own], contacts=1 - labels.contacts[own]))
    with pytest.raises(UserError, match="of another database"):
        train(database, tmp_path / "m", brief, labels=folder, resume=True)
    Path(path).write_text(text)
    train(database, tmp_path / "m", brief, labels=folder, resume=True)


def test_clips_without_a_gait_are_left_out_and_told(database, tmp_path) -> None:
    """Somebody who is thrown about in the air, beside two who walk."""
    thrown = lmm_models.thrown(database, "run")
    three = replace(thrown, names=("run", "run", "straight", "walk"), mirrored=np.zeros(4, bool))
    with pytest.warns(Note, match="^1 of 3 clips is left out.*run .neither foot touches the ground"):
        model = train(three, tmp_path / "m", settings("pfnn", iterations=2))
    assert model.training["left_out"] == ["run"] and set(model.held_out) < {"straight", "walk"}
    with pytest.warns(Note):
        data = data_of("pfnn", three, model.held_out)
    kept = three.ranges()[data.frames.frame]
    assert {three.names[r] for r in kept} == {"straight", "walk"}
    assert data.count() == len(data.starts(1))
    with pytest.raises(UserError, match="a database of one clip"), pytest.warns(Note):
        train(thrown, tmp_path / "n", settings("pfnn"))


def test_a_database_that_does_not_do_is_one_line(kind, database, tmp_path) -> None:
    with pytest.raises(UserError, match="no clip is as long as a window, 5002 frames"):
        train(database, tmp_path / "m", settings(kind, window=5000))
    alone = replace(database, names=("one",) * len(database.names))
    with pytest.raises(UserError, match="a database of one clip"):
        train(alone, tmp_path / "m", settings(kind))
    footless = {role: joint for role, joint in database.skeleton.roles.items() if "foot" not in role}
    other = replace(database, skeleton=database.skeleton.with_roles(footless))
    with pytest.raises(UserError, match=r"none of 2 clips can be labelled: run, straight \(no joint plays"):
        train(other, tmp_path / "m", settings(kind))
    assert not list(tmp_path.iterdir())
