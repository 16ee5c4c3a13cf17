"""Grounds under a database's motion: slopes by hand, as characters are told them, and feet that touch."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import lmm_models
import numpy as np
import pfnn_models
import pytest
from click.testing import CliRunner

from features import patches, terrain, terrain_made
from features.labels import Labels
from lmm.cli import main
from lmm.locomotion import grounds, summary
from lmm.locomotion.grounds import GroundTable, Terrain
from lmm.locomotion.labelling import labels_of
from lmm.pfnn.controller import PhaseController
from lmm.pfnn.frames import frames
from lmm.pfnn.layout import Layout
from mm.control import Command
from mm.database import Database
from motion import quat
from motion.errors import Note, UserError

RNG = np.random.default_rng(4)
SLOPES = np.array([[0.2, -0.1], [0.0, 0.3], [-0.4, 0.05]])  # along x and z
LEVEL = 12.0  # metres at the origin
STEPS = 60


class Slopes:
    """Grounds of constant slope, as `features.terrain_fit.Grounds` are called."""

    def __call__(self, x, z):
        return LEVEL + np.stack([a * np.asarray(x) + b * np.asarray(z) for a, b in SLOPES])

    laid = __call__


def by_hand(slope, points, facing):
    """Heights [N, 12, 3] over their mean in the middle, and that mean [N], on one slope [2] or on [N, 2]."""
    a, b = np.moveaxis(np.broadcast_to(slope, (len(points), 2))[:, None], -1, 0)
    sides = []
    for aside in (-0.25, 0.0, 0.25):  # right, middle, left: to the left of +Z is +X
        x = points[..., 0] + aside * facing[..., 1]
        z = points[..., 1] - aside * facing[..., 0]
        sides.append(LEVEL + a * x + b * z)
    heights = np.stack(sides, axis=-1)
    mean = heights[:, :, 1].mean(axis=1)
    return heights - mean[:, None, None], mean


@pytest.fixture(scope="module")
def database() -> Database:
    return lmm_models.database()


@pytest.fixture(scope="module")
def labels(database) -> Labels:
    return labels_of(database)


@pytest.fixture
def slopes(database, labels, monkeypatch) -> GroundTable:
    """Constant slopes, other than what would be fitted."""

    def fit(cut, feet, contacts, *, count, jumping):
        assert np.abs(feet[contacts][:, 1]).max() < 0.1 and len(jumping) == len(feet)
        return Slopes()

    monkeypatch.setattr("features.terrain_fit.fit", fit)
    return grounds.fit(database, labels, Terrain.of(["hills"], count=3), steps=STEPS, jobs=1)


def around(database: Database, frame: int, inside: bool = True):
    """Positions and directions [12, 2] of the trajectory around a frame, in the world."""
    r = int(database.ranges()[frame])
    at = frame + 10 * np.arange(-6, 6)
    assert (at >= database.starts[r]).all() and (at < database.stops[r]).all()
    poses = database.poses[slice(0, len(database))]
    forward = quat.rotate(poses.rotations[at, 0].astype(float), np.array([0.0, 0, 1]))
    return poses.positions[at, 0][:, [0, 2]].astype(float), forward[:, [0, 2]]


def test_on_slopes_heights_are_those_by_hand(database, slopes) -> None:
    """Of the data and of its mirrored copies; so many steps after a frame as there."""
    which = np.array([0, 1, 2, 1])
    for r in range(len(database.starts)):
        frame = int(database.starts[r]) + 61
        ways = [around(database, frame + step) for step in range(-1, 1)]
        mirrored = database.mirrored[r]
        for step in (0, 5):
            heights, before, now = slopes.along(np.full(4, frame - step), which, step)
            slope = SLOPES[which] * ([-1, 1] if mirrored else [1, 1])
            (_, before_by_hand), (by, now_by_hand) = (
                by_hand(slope, *(np.broadcast_to(part, (4, 12, 2)) for part in way)) for way in ways
            )
            np.testing.assert_allclose(heights, by, atol=2e-3)
            np.testing.assert_allclose(before, before_by_hand, atol=2e-3)
            np.testing.assert_allclose(now, now_by_hand, atol=2e-3)
    assert slopes.mirrored.sum() == len(database) / 2 and (slopes.rows >= 0).all()


@pytest.mark.parametrize("compiled", [True, False])
def test_characters_are_told_the_same_of_a_slope(compiled) -> None:
    """What a controller gives its network is what training has along the same way: see `by_hand`."""
    model, slope = pfnn_models.model(), SLOPES[0]

    def plane(x, z):
        return (LEVEL + slope[0] * x + slope[1] * z).astype(np.float32)

    driven = PhaseController(model, count=2, ground=plane, compiled=compiled)
    driven.reset(np.array([[0, 0], [3, -2]]), np.array([0.5, 2]))
    command = Command.still(2)
    command.velocity[:] = [[1.2, 0.4], [-0.5, 1.0]]
    command.turn_rate[:] = 0.4
    for _ in range(90):
        driven.step(command)
    way = driven.record()["trajectory"].astype(float)
    facing = np.stack([np.sin(way[..., 2]), np.cos(way[..., 2])], axis=-1)
    heights, mean = by_hand(slope, way[..., :2], facing)
    told = model.layout.unpack_inputs(driven._x).heights
    np.testing.assert_allclose(told, heights, atol=1e-4)
    assert np.ptp(told[0]) > 0.1
    np.testing.assert_allclose(driven.poses().positions[:, 0, 1], mean, atol=1e-4)


def test_joints_lie_over_the_ground_of_their_frame(database, labels, slopes) -> None:
    level, layout = frames(database, labels), Layout(len(database.skeleton) - 1)
    rows, which = np.array([40, 61, 300]), np.array([2, 0, 1])
    x, y = level.x[rows], level.y[rows]
    told = slopes.along(level.frame[rows], which)
    grounds.lay(x, y, layout, *told)
    into, before = layout.unpack_inputs(x), layout.unpack_inputs(level.x[rows])
    out, known = layout.unpack_outputs(y), layout.unpack_outputs(level.y[rows])
    np.testing.assert_allclose(into.heights, told[0])
    np.testing.assert_allclose(before.positions - into.positions, _up(told[1], into.positions), atol=1e-5)
    np.testing.assert_allclose(known.positions - out.positions, _up(told[2], out.positions), atol=1e-5)
    assert np.abs(told[1] - told[2]).max() > 1e-3
    for name in ("path", "facing", "gaits", "velocities"):
        np.testing.assert_array_equal(getattr(into, name), getattr(before, name))
    for name in ("root_velocity", "contacts", "velocities", "rotations", "path"):
        np.testing.assert_array_equal(getattr(out, name), getattr(known, name))


def _up(by, positions):
    expected = np.zeros_like(positions)
    expected[..., 1] = by[:, None]
    return expected


def test_on_level_ground_nothing_changes(database, labels) -> None:
    flat = terrain.Heightmap(np.zeros((200, 200)))
    found = grounds.fit(database, labels, Terrain(("flat",), (flat,), 2), steps=2, jobs=1)
    level, layout = frames(database, labels), Layout(len(database.skeleton) - 1)
    x, y = level.x.copy(), level.y.copy()
    grounds.lay(x, y, layout, *found.along(level.frame, np.ones(len(x), int)))
    np.testing.assert_allclose(x, level.x, atol=3e-3)
    np.testing.assert_allclose(y, level.y, atol=3e-3)
    assert found.level


def test_grounds_meet_the_feet_and_take_the_room_that_is_told(database, labels) -> None:
    hills = Terrain.of(["hills"], count=4)
    found, same = (grounds.fit(database, labels, hills, steps=STEPS, jobs=jobs) for jobs in (1, 2))
    other = grounds.fit(database, labels, hills, steps=STEPS, seed=1, jobs=1)
    np.testing.assert_array_equal(found.heights, same.heights)
    assert not np.array_equal(found.heights, other.heights) and len(found) == 4
    assert found.heights.nbytes == grounds.nbytes(database, labels, count=4, steps=STEPS)
    assert found.nbytes < 1000 * len(database)
    assert found.misfits["contact_mm"] < 3 < found.misfits["patch_mm"]
    assert found.misfits["sunk_mm"] < 15 and found.level
    heights, _, now = found.along(np.arange(len(database)), np.arange(len(database)) % 4)
    assert np.abs(now).max() < 0.15 and heights.std() > 0.005
    # Who runs from the last frame on still finds heights.
    assert np.isfinite(found.along(np.array([len(database) - 1]), np.array([0]), STEPS)[0]).all()


def test_who_stands_on_a_box_has_it_under_the_feet(database, labels) -> None:
    """The ground is half a metre higher in the clip whose feet are, not in the others."""
    raised = replace(database, poses=database.poses[slice(0, len(database))].copy())
    hips = database.skeleton.roles["hips"]
    up = np.isin(database.ranges(), [r for r, name in enumerate(database.names) if name == "run"])
    raised.poses.positions[up, hips, 1] += 0.5
    found = grounds.fit(raised, labels, Terrain.of(["mixed"], count=3), steps=2, jobs=1)
    _, before, now = found.along(np.arange(len(database)), np.full(len(database), 1))
    np.testing.assert_allclose(np.median(now[up]), 0.5, atol=0.06)
    np.testing.assert_allclose(np.median(now[~up]), 0, atol=0.06)
    np.testing.assert_allclose(before, now, atol=0.1)
    assert not found.level


def test_maps_that_do_not_do_are_refused(tmp_path) -> None:
    narrow = terrain_made.make(0, size=(20, 2))
    terrain.save(tmp_path / "narrow.txt", narrow)
    with pytest.raises(UserError, match=r"narrow.txt: .*20.* x 2.* too small for motion, a patch is 5.04 m"):
        Terrain.of([str(tmp_path / "narrow.txt")])
    wide = Terrain.of([str(tmp_path / "narrow.txt")], spacing=0.2)
    assert wide.maps[0].size[1] > patches.SIDE and wide.names == ("narrow.txt",)
    with pytest.raises(UserError, match="no terrain 'hill'; choose hills, slopes, steps, mixed, or name"):
        Terrain.of(["hill"])
    assert len(Terrain.of(["steps", str(tmp_path / "narrow.txt")], spacing=0.2).maps) == 4


# Training on them, from the command line.


def lmm(*arguments, code=0):
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + result.stderr
    return result


@pytest.fixture(scope="module")
def folder(tmp_path_factory, database) -> Path:
    folder = tmp_path_factory.mktemp("terrain")
    database.save(folder / "walk.mmdb")
    terrain.save(folder / "hills.txt", terrain_made.make(2, "hills", size=(10, 10)))
    rows = (folder / "hills.txt").read_text().splitlines()
    (folder / "holes.txt").write_text("\n".join([rows[0], "nan " + rows[1].partition(" ")[2], *rows[2:]]))
    (folder / "brief.toml").write_text(
        "threads = 1\n[pfnn]\nhidden = [32, 32]\niterations = 40\nbatch = 32\nevaluate = 20\n"
    )
    return folder


TRAIN = ("train", "walk.mmdb", "--preset", "smoke", "--held-out", 0.3)


@pytest.mark.filterwarnings("always::motion.errors.Note")
def test_a_network_is_trained_on_hills_and_sees_them(folder, database, tmp_path, monkeypatch) -> None:
    pytest.importorskip("torch", reason="training needs torch")
    from lmm.training.checkpoint import Checkpoint

    monkeypatch.chdir(folder)
    brief = (*TRAIN, "--model", "pfnn", "--config", "brief.toml", "--terrain", "hills.txt", "--grounds", 3)
    told = lmm(*brief, "-o", tmp_path / "hills.pfnn", "--json")
    assert "note: feet rest on level ground only" in told.stderr
    facts = json.loads(told.stdout)
    assert facts["sees_ground"] and facts["training"]["terrain"]["maps"] == ["hills.txt"]
    assert facts["training"]["terrain"]["grounds"] == 3
    assert facts["training"]["terrain"]["contact_mm"] < facts["training"]["terrain"]["patch_mm"]
    shown = lmm("info", tmp_path / "hills.pfnn").stdout
    assert "uneven ground was learned (hills.txt); in the data feet rested on level ground" in shown

    write = Checkpoint.save

    def stop(self, path):
        write(self, path)
        raise KeyboardInterrupt

    monkeypatch.setattr(Checkpoint, "save", stop)
    (folder / "often.toml").write_text("checkpoint_seconds = 0.0\n" + (folder / "brief.toml").read_text())
    often = [part if part != "brief.toml" else "often.toml" for part in brief]
    lmm(*often, "-o", tmp_path / "again", code=130)
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    others = [part if part != 3 else 4 for part in brief]
    assert "of another database" in lmm(*others, "-o", tmp_path / "again", "--resume", code=2).stderr
    lmm(*brief, "-o", tmp_path / "again", "--resume")
    one, other = (_weights(tmp_path / name) for name in ("hills.pfnn", "again"))
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


def _weights(path):
    from lmm import models

    return models.load(path).network.to_arrays("")


def test_statistics_are_of_the_grounds_that_are_drawn(database, labels, slopes) -> None:
    pytest.importorskip("torch", reason="training needs torch")
    import torch

    from lmm.training import pfnn_settings
    from lmm.training.pfnn import PhaseData, PhaseStage

    found = pfnn_settings.preset("ours", "smoke")
    settings = replace(found, pfnn=replace(found.pfnn, hidden=(16,), batch=8, window=3, alone=0.0, noise=0.0))
    data = PhaseData(database, labels, (), slopes)
    stage = PhaseStage(data, settings)
    stage.begin()
    layout, every = data.layout, data.frames
    heights = layout.inputs["heights"]
    seen, rows = data.seen(data.starts(1))
    which = np.arange(len(rows)) % 3
    expected = slopes.along(every.frame, which)[0].swapaxes(1, 2).reshape(len(rows), -1)
    np.testing.assert_array_equal(seen.x[rows][:, heights], expected)
    np.testing.assert_allclose(stage.network.input_mean[heights], expected.mean(axis=0), atol=1e-5)
    assert data.memory() > PhaseData(database, labels, ()).memory() + slopes.nbytes
    # A run sees the ground on which it began, and its own joints over it.
    runs, first = data.seen(data.starts(3)[:5], 3)
    for step in (1, 2):
        after = stage._fed_back(
            *(torch.from_numpy(a) for a in (runs.x[first + step], runs.y[first + step - 1]))
        )
        joints = layout.inputs["positions"]
        np.testing.assert_allclose(after[:, joints], runs.x[first + step][:, joints], atol=2e-3)
    assert all(np.isfinite(term.item()) for term in stage.loss(0).values())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--model", "pfnn", "--terrain", "holes.txt"), "holes.txt:2: 'nan' is no height (number 1"),
        (("--model", "pfnn", "--terrain", "hill"), "no terrain 'hill'; choose hills, slopes, steps, mixed"),
        (
            ("--model", "pfnn", "--terrain", "hills.txt", "--terrain-spacing", 0.01),
            "too small for motion, a patch is 5.04 m wide; give a larger one",
        ),
        (("--model", "mann", "--terrain", "hills"), "give --model pfnn too"),
        (("--terrain", "hills"), "give --model pfnn too"),
        (("--model", "pfnn", "--grounds", 4), "--grounds is about uneven ground: give --terrain too"),
        (("--model", "pfnn", "--terrain-spacing", 0.1), "--terrain-spacing is about uneven ground"),
        (("--model", "pfnn", "--terrain", "hills", "--grounds", 0), "'--grounds': 0 is not in the range"),
    ],
)
def test_faults_are_one_line(folder, tmp_path, monkeypatch, arguments, message) -> None:
    pytest.importorskip("torch", reason="training needs torch")
    monkeypatch.chdir(folder)
    result = lmm(*TRAIN, "-o", tmp_path / "out", *arguments, code=2)
    assert message in result.stderr and not list(tmp_path.iterdir())


def test_a_model_tells_what_ground_the_data_had() -> None:
    model = pfnn_models.model()
    about = {"maps": ["steps"], "grounds": 10, "level_motion": False}
    facts = {"sees_ground": True, "training": {"terrain": about}}
    assert summary._ground(facts) == "uneven ground was learned (steps); in the data feet went up and down"
    assert model.sees_ground and summary._ground({"sees_ground": True, "training": {}})


def test_notes_are_for_level_motion_only(database, labels, slopes) -> None:
    pytest.importorskip("torch", reason="training needs torch")
    from lmm.training.train_locomotion import _about

    about = Terrain.of(["hills"])
    with pytest.warns(Note, match="feet rest on level ground only"):
        _about(about, replace(slopes, level=True))
    assert not _about(about, replace(slopes, level=False))["level_motion"]
