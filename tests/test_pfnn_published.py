"""lmm.pfnn.published: the published weights load, in our units and axes, and walk around courses."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from lmm.cli import main
from lmm.pfnn import published
from lmm.pfnn.controller import PhaseController
from lmm.pfnn.layout import Layout
from lmm.pfnn.model import PhaseModel
from mm import courses
from mm.metrics import trajectory_error
from mm.recording import record
from mm.runs import fitted
from motion import quat
from motion.errors import UserError

PHASES = np.arange(8) / 8 * 2 * np.pi


@pytest.fixture(scope="module")
def model(request: pytest.FixtureRequest) -> PhaseModel:
    data = request.getfixturevalue("data")
    return published.model(data / "reference" / "pfnn" / "network", data / "pfnn" / "animations")


@pytest.fixture(scope="module")
def outputs(model: PhaseModel):
    """What it makes of the mean input at eight phases."""
    x = np.tile(model.network.input_mean, (len(PHASES), 1))
    return model.layout.unpack_outputs(model.network.evaluate(x, PHASES))


def test_sizes(data: Path, model: PhaseModel) -> None:
    assert model.network.sizes == (342, 512, 512, 311)
    assert model.network.parameters == 597_815


def test_it_is_metres_with_the_left_at_x(data: Path, model: PhaseModel, outputs) -> None:
    roles = {role: joint - 1 for role, joint in model.description.skeleton.roles.items()}
    mean = outputs.positions.mean(axis=0)
    assert 0.85 < mean[roles["hips"], 1] < 1.05 and 1.2 < mean[roles["head"], 1] < 1.75
    assert mean[roles["left_up_leg"], 0] > 0.05 > -0.05 > mean[roles["right_up_leg"], 0]
    assert mean[roles["left_toe"], 2] > mean[roles["left_foot"], 2]
    # The mean of its training data is a walk straight on, one cycle a second.
    assert 0.5 < outputs.root_velocity[:, 1].mean() < 1.2
    assert abs(outputs.root_velocity[:, 0].mean()) < 0.05
    assert 0.8 < outputs.phase_rate.mean() / (2 * np.pi) < 1.3


def test_rotations_point_the_bones_to_the_joints(data: Path, model: PhaseModel, outputs) -> None:
    """Two answers of the network agree: where joints are and how their parents are turned."""
    skeleton = model.description.skeleton
    for j in range(2, len(skeleton)):
        parent = int(skeleton.parents[j])
        if parent == 0 or np.linalg.norm(skeleton.offsets[j]) < 1e-6:
            continue
        bone = outputs.positions[:, j - 1] - outputs.positions[:, parent - 1]
        said = quat.rotate(outputs.rotations[:, parent - 1], skeleton.offsets[j].astype(np.float32)[None])
        cosine = np.sum(bone * said, -1) / np.linalg.norm(bone, axis=-1) / np.linalg.norm(said, axis=-1)
        assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean() < 6, skeleton.names[j]


def test_right_contact_at_phase_0_left_at_pi(data: Path, outputs) -> None:
    left, right = outputs.contacts[:, 1], outputs.contacts[:, 3]
    assert right[1] > left[1] + 0.2 and left[5] > right[5] + 0.2


def test_higher_ground_at_the_left_lifts_the_left_foot(data: Path, model: PhaseModel) -> None:
    layout, roles = model.layout, model.description.skeleton.roles
    x = np.tile(model.network.input_mean, (len(PHASES), 1))
    lifts = []
    for side in (0, 2):  # right, left
        parts = layout.unpack_inputs(x.copy())
        parts.heights[:, :, side] += 0.1
        feet = layout.unpack_outputs(model.network.evaluate(layout.pack_inputs(parts), PHASES)).positions
        lifts.append(feet[:, [roles["left_toe"] - 1, roles["right_toe"] - 1], 1].mean(axis=0))
    assert lifts[1][0] > lifts[0][0] and lifts[0][1] > lifts[1][1]


def test_it_turns_to_where_the_trajectory_does(data: Path, model: PhaseModel) -> None:
    rates = []
    for angle in (-0.6, 0.6):
        parts = model.layout.unpack_inputs(np.tile(model.network.input_mean, (len(PHASES), 1)))
        ahead = np.linspace(0, angle, 6)
        parts.facing[:, 6:] = np.stack([np.sin(ahead), np.cos(ahead)], axis=-1)
        rates.append(_turn_rate(model, parts))
    assert rates[0] < -0.1 and rates[1] > 0.1


def _turn_rate(model: PhaseModel, parts) -> float:
    y = model.network.evaluate(model.layout.pack_inputs(parts), PHASES)
    return float(model.layout.unpack_outputs(y).turn_rate.mean())


def test_it_walks_turns_stops_and_runs(data: Path, model: PhaseModel) -> None:
    """Ways are kept to within 0.5 m, feet near the ground, the speed is near what is asked."""
    for name, seconds in (("figure-of-eight", 12.0), ("square", 15.0)):
        controller = PhaseController(model)
        course = fitted(courses.load(name), model.description)
        run = record(controller, course, seconds=seconds, progress=lambda it, **_: it)
        roots, yaws = run.roots()
        errors = trajectory_error(roots.astype(float), yaws, run["command_yaw"], run.path)
        assert errors.p95_cm < 50
        speed = np.linalg.norm(np.diff(roots, axis=0), axis=-1)[120:].mean() * 60
        assert 0.7 < speed / np.linalg.norm(run["command_velocity"], axis=-1)[120:].mean() < 1.2
        heights = run["positions"][:, 0, 1, 1]  # hips
        assert heights.min() > 0.8 and heights.max() < 1.1
        assert run["contacts"][:, 0].mean(axis=0).min() > 0.1
    controller = PhaseController(model)
    run = record(controller, courses.load("still"), seconds=3.0, progress=lambda it, **_: it)
    roots, _ = run.roots()
    assert np.linalg.norm(roots[-1, 0] - roots[0, 0]) < 0.02


def folder_with(data: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "network"
    shutil.copytree(data / "reference" / "pfnn" / "network", folder)
    for file in folder.iterdir():
        file.chmod(0o644)
    folder.chmod(0o755)
    return folder


def test_a_file_of_another_size_is_named_with_both_sizes(data: Path, tmp_path: Path) -> None:
    folder = folder_with(data, tmp_path)
    file = folder / "W1_025.bin"
    file.write_bytes(file.read_bytes()[:-4])
    with pytest.raises(UserError, match=r"W1_025.bin: 1,048,572 bytes, expected 1,048,576 for 512 x 512"):
        published.network(folder)


def test_a_missing_file_is_named(data: Path, tmp_path: Path) -> None:
    folder = folder_with(data, tmp_path)
    (folder / "Ystd.bin").unlink()
    with pytest.raises(UserError, match=r"Ystd.bin: cannot read: No such file"):
        published.network(folder)


@pytest.mark.parametrize("wrong", [0.0, -1.0])
def test_what_inputs_cannot_be_divided_by_is_refused(data: Path, tmp_path: Path, wrong: float) -> None:
    file = folder_with(data, tmp_path) / "Xstd.bin"
    deviations = np.fromfile(file, "<f4")
    deviations[7] = wrong
    deviations.tofile(file)
    with pytest.raises(UserError, match=r"Xstd.bin: number 8 is not above 0"):
        published.network(file.parent)


def test_any_of_the_published_animations_do_and_others_are_refused(data: Path, tmp_path: Path) -> None:
    clip = data / "pfnn" / "animations" / "LocomotionFlat09_000.bvh"
    shutil.copy(clip, tmp_path)  # without rest.bvh, which is left out where it is
    assert len(published.describe(tmp_path).skeleton) == published.JOINTS + 1
    network, dog = data / "reference" / "pfnn" / "network", tmp_path / "dog"
    dog.mkdir()
    shutil.copy(data / "dog_mann" / "D1_010_KAN01_002.bvh", dog)
    with pytest.raises(UserError, match=r"dog: clips of 21 joints, but the published network moves 31"):
        published.model(network, dog)


def test_the_command(data: Path, model: PhaseModel, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(published, "describe", lambda animations: model.description)  # which takes longest
    folder, out = folder_with(data, tmp_path), tmp_path / "published.pfnn"
    assert {path.name for path in published.files_of(folder)} <= {path.name for path in folder.iterdir()}

    def run(*more: object, code: int = 0) -> str:
        arguments = ["import", str(folder), "-o", str(out), *map(str, more)]
        result = CliRunner().invoke(main, arguments)
        assert result.exit_code == code, result.output
        return result.output

    assert "2,391,260 parameters" in run("--animations", data / "pfnn" / "animations")
    loaded = PhaseModel.load(out).network.to_arrays("")
    for name, array in model.network.to_arrays("").items():
        np.testing.assert_array_equal(loaded[name], array)
    assert "give --db, or --animations" in run(code=2)
    file = folder / "Xmean.bin"
    file.write_bytes(file.read_bytes() + bytes(4))
    told = run("--animations", data / "pfnn" / "animations", code=2)
    assert "Xmean.bin: 1,372 bytes, expected 1,368 for 342 numbers" in told and len(told.splitlines()) == 1


def test_numbers_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "b.bin"
    np.array([1, np.nan], "<f4").tofile(file)
    with pytest.raises(UserError, match=r"b.bin: numbers that are not finite"):
        published.read(file, 2)


def test_units_scale_every_block() -> None:
    layout = Layout(2)
    into, out = published.unit_scales(layout)
    assert into[layout.inputs["path"]].tolist() == [np.float32(0.01)] * 24
    assert set(into[layout.inputs["facing"]]) == set(into[layout.inputs["gaits"]]) == {1}
    assert set(into[layout.inputs["velocities"]]) == {np.float32(0.6)}
    assert out[layout.outputs["turn_rate"]] == -60
    assert out[layout.outputs["phase_rate"]] == np.float32(2 * np.pi * 60)
    assert set(out[layout.outputs["rotations"]]) == set(out[layout.outputs["contacts"]]) == {1}
