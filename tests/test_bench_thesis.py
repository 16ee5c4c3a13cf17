"""The thesis's experiment: laps of who obeys exactly, models in their rows, and the thesis's own numbers."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import lmm_models
import mann_models
import numpy as np
import page_html
import pandas as pd
import pfnn_models
import pytest
from click.testing import CliRunner

from bench.cli import main
from bench.thesis import measure, page, published, rows
from mm.control import Command
from mm.course import Course, Waypoint
from mm.description import Description
from mm.enlarged import enlarged
from motion import quat
from motion.errors import UserError
from motion.pose import Poses

SIDE, SPEED = 2.0, 2.0
SQUARE = """closed = true
corner_speed = 1.0
waypoints = [
    { position = [0, 0], speed = 2.0 }, { position = [0, 2], speed = 2.0 },
    { position = [2, 2], speed = 2.0 }, { position = [2, 0], speed = 2.0 },
]
"""


@pytest.fixture(scope="module")
def database():
    return lmm_models.database()


@pytest.fixture(scope="module")
def databases(database):
    return rows.Databases(database)


@pytest.fixture(scope="module")
def ava(database):
    """A model of the database's rig with 40 joints."""
    return pfnn_models.model(found=Description.of(enlarged(database, 40)))


@pytest.fixture
def square(monkeypatch, tmp_path):
    """Puts a small course in the place of the thesis's."""
    (tmp_path / "square.toml").write_text(SQUARE)
    monkeypatch.setattr(measure, "COURSE", tmp_path / "square.toml")
    monkeypatch.setattr(measure, "FRAMES", 20)
    monkeypatch.setattr(measure, "WARM", 5)


class Obedient:
    """Goes as it is asked, to the letter; or does not move."""

    name, count, fps = "obedient", 1, 60.0

    def __init__(self, share: float = 1.0) -> None:
        self._share, self._poses = share, Poses.empty(1, 1)

    def reset(self, positions: Any, yaws: Any) -> None:
        self._poses.positions[:, 0, [0, 2]] = positions

    def step(self, command: Command) -> Poses:
        self._poses.positions[:, 0, [0, 2]] += self._share * command.velocity / np.float32(self.fps)
        self._poses.rotations[:, 0] = quat.from_yaw(command.yaw)
        return self._poses


def square_course(laps: int) -> Course:
    places = [(0.0, 0.0), (0.0, SIDE), (SIDE, SIDE), (SIDE, 0.0)]
    waypoints = tuple(Waypoint(position=place, speed=SPEED) for place in places)
    return Course(waypoints=waypoints, closed=True, corner_speed=1.0, laps=laps)


def test_laps_of_who_obeys():
    found = measure.drive(Obedient(), square_course(3))
    assert [lap["lap"] for lap in found] == [1, 2, 3]
    around = 4 * SIDE / SPEED * 60  # frames; corners are cut within a waypoint's radius of 0.7 m
    for lap in found:
        assert 0.5 * around < lap["frames"] < 1.05 * around
        assert lap["median_ms"] > 0 and lap["sd_ms"] >= 0 and lap["path_cm"] < lap["path_max_cm"] < 60


def test_laps_of_a_course_whose_length_is_no_round_number():
    course = replace(square_course(7), waypoints=square_course(7).waypoints[:3])  # a triangle
    assert [lap["lap"] for lap in measure.drive(Obedient(), course)] == list(range(1, 8))


def test_who_stands_ends_no_lap_and_who_is_slow_some():
    assert measure.drive(Obedient(0.0), square_course(2)) == []
    assert len(measure.drive(Obedient(0.15), square_course(4))) in range(1, 4)


def test_significances_of_the_thesis():
    frames, errors = published.FRAME_MS, published.ACCURACY
    assert measure.significance_of(frames["HOLDEN"], frames["HOLDEN-XT"]) == pytest.approx(0.35, abs=0.005)
    assert measure.significance_of(frames["HOLDEN-XL"], frames["HOLDEN-XT"]) == pytest.approx(7.1, abs=0.05)
    assert measure.significance_of(errors["AVA-M"], errors["HOLDEN"]) == pytest.approx(2.5, abs=0.05)
    assert measure.significance_of(errors["AVA"], errors["AVA-M"]) == pytest.approx(2.9, abs=0.05)


def test_published_laps_are_those_of_the_published_means():
    for name in ("HOLDEN", "HOLDEN-XL", "HOLDEN-XT"):
        laps = np.array(published.LAPS_MS[name])
        assert len(laps) == published.LAPS
        assert laps.mean() == pytest.approx(published.FRAME_MS[name][0], abs=6e-4)
        assert laps.std(ddof=1) == pytest.approx(published.FRAME_MS[name][1], abs=5e-4)
    for box in published.ACCURACY_BOX.values():
        assert list(box) == sorted(box)


def save(model: Any, path: Any) -> Any:
    model.save(path)
    return path


def settings(model: Any, configuration: str) -> Any:
    return replace(model, training={"settings": {"configuration": configuration}})


def test_models_stand_in_their_rows(databases, ava, tmp_path):
    plain, deep = pfnn_models.model(), pfnn_models.model(layers=3)
    paths = [
        save(ava, tmp_path / "1"),
        save(settings(plain, "holden-xt"), tmp_path / "2"),
        save(deep, tmp_path / "3"),
        save(plain, tmp_path / "4"),
    ]
    placed = rows.placed(paths, databases)
    assert [(row.name, row.path.name, len(row.database.skeleton)) for row in placed.values()] == [
        ("HOLDEN", "4", 23),
        ("HOLDEN-XL", "3", 23),
        ("HOLDEN-XT", "2", 23),
        ("AVA", "1", 40),
    ]
    with pytest.raises(UserError, match=r"a second model for HOLDEN: .*; leave it or .*4 out|second model"):
        rows.placed([*paths, save(settings(plain, "holden"), tmp_path / "5")], databases)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (mann_models.model, "mode-adaptive networks; give phase-functioned networks"),
        (lambda: pfnn_models.model(fps=30.0), "30 frames per second, not 60"),
        (
            lambda: pfnn_models.model(
                found=replace(
                    pfnn_models.description(),
                    skeleton=replace(
                        pfnn_models.description().skeleton,
                        names=("root", *(f"j{j}" for j in range(1, len(pfnn_models.description().skeleton)))),
                    ),
                )
            ),
            "other joints",
        ),
    ],
)
def test_models_that_are_none_of_the_experiments(databases, tmp_path, make, message):
    with pytest.raises(UserError, match=message):
        rows.placed([save(make(), tmp_path / "model")], databases)


def test_the_whole_experiment(databases, ava, square, tmp_path):
    held = replace(pfnn_models.model(), held_out=("run",), frames=480)
    held.training = {"settings": {"configuration": "holden", "pfnn": {"batch": 48}}}
    path = save(held, tmp_path / "holden.pfnn")
    record = {"stage": "pfnn", "seconds": 90.0, "learning_rate": 0.1, "errors": {}}
    lines = [record | {"iteration": n, "loss": {"frames": 1 / n}} for n in (10, 20)]
    (tmp_path / "holden.pfnn.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    placed = rows.placed([path, save(ava, tmp_path / "ava.pfnn")], databases)
    found = measure.measure(databases, placed, laps=2, name="db")

    summary = found.summary.set_index("configuration")
    assert list(summary.index) == ["HOLDEN", "HOLDEN-XL", "HOLDEN-XT", "AVA", "AVA-M"]
    assert [name for name in summary.index if np.isfinite(summary["relative"][name])] == [
        "HOLDEN",
        "AVA",
        "AVA-M",
    ]
    assert summary["published_frame_ms"]["HOLDEN-XL"] == 0.499 and pd.isna(summary["model"]["HOLDEN-XT"])
    files = found.files[found.files["configuration"] == "HOLDEN"]
    assert summary["relative"]["HOLDEN"] == pytest.approx(files["relative"].mean())
    assert list(files["held_out"]) == [name == "run" for name in databases.database.names]
    assert any("HOLDEN-XL is empty" in note for note in found.notes)
    assert any("did" in note and "of 2 laps" in note for note in found.notes)  # they are of random numbers
    assert found.training == {"HOLDEN": {"epochs": [1.0, 2.0], "mse": [0.1, 0.05]}}
    steps, sizes = found.pipeline.set_index("step"), found.sizes.set_index("data")
    assert steps["HOLDEN"]["training"] == 90 and np.isnan(steps["AVA"]["training"])
    assert steps["published HOLDEN"]["training"] == 43 * 3600 and steps["HOLDEN"]["labels"] > 0
    assert sizes["HOLDEN"]["weights"] == pytest.approx(50 * 4 * held.network.parameters / 1e6)
    inputs, outputs = held.network.sizes[0], held.network.sizes[-1]
    assert sizes["HOLDEN"]["vectors"] == pytest.approx(4 * 118 * (inputs + outputs) * 4 / 1e6)
    modes = found.modes[found.modes["configuration"] == "AVA"]
    assert list(modes["mode"]) == ["cubic", "linear", "constant"] and (modes["frame_ms"] > 0).all()

    written = page.save(found, tmp_path / "out", command="bench <thesis>")
    assert {p.name for p in written} == {p.name for p in (tmp_path / "out").iterdir()}
    assert page_html.files(tmp_path / "out") == set(page.FILES)
    told = json.loads((tmp_path / "out" / "thesis.json").read_text())
    assert told["models"]["AVA"]["sizes"][0] == ava.network.sizes[0] and len(told["files"]) == 12
    text = (tmp_path / "out" / "report.html").read_text()
    page_html.check(text)
    assert "bench &lt;thesis&gt;" in text and text.count("<svg") == 6 and "HOLDEN-XT is empty" in text


def test_the_error_of_shared_joints_is_that_of_these_joints(databases, ava, tmp_path, monkeypatch, square):
    """Joints that are added are put out exactly: AVA-M then is AVA times all joints over those shared."""
    large = databases.of(40)
    network = ava.network
    layout = ava.layout
    own = {large.skeleton.index(name) - 1 for name in databases.database.skeleton.names[1:]}
    step = measure.frames.step

    def exact(truth: Any) -> Any:
        found = step(truth)
        relative = found.relative.copy()
        relative[:, [j for j in range(layout.joints) if j not in own]] = 0
        return replace(found, relative=relative)

    monkeypatch.setattr(measure.frames, "step", exact)
    placed = rows.placed([save(replace(ava, network=network), tmp_path / "ava")], databases)
    found = measure.measure(databases, placed, laps=2)
    means = found.summary.set_index("configuration")["relative"]
    assert means["AVA-M"] == pytest.approx(means["AVA"] * layout.joints / len(own))


@pytest.fixture
def undrawn(monkeypatch):
    """Figures are made, but not turned into text, which takes long."""
    monkeypatch.setattr(page.figures, "svg", lambda picture, label: "<svg></svg>")


def test_without_models_the_thesis_is_left(databases, undrawn):
    found = measure.measure(databases, {}, laps=2)
    assert len(found.notes) == 4 and found.line is None
    assert not len(found.laps) and not len(found.files)
    assert found.pipeline.set_index("step")["HOLDEN"]["labels"] > 0
    assert page.html(found, command="x").count("<svg") == 6
    with pytest.raises(UserError, match="1 laps"):
        measure.measure(databases, {}, laps=1)


def test_what_is_missing_is_trained_once_on_its_data(database, tmp_path, monkeypatch):
    pytest.importorskip("torch")
    from lmm.training import checkpoint, train_locomotion

    monkeypatch.setattr(rows, "JOINTS", 40)
    asked: list[tuple[Any, ...]] = []

    def train(database: Any, path: Any, settings: Any, *, resume: bool) -> None:
        asked.append((len(database.skeleton), settings.configuration, settings.preset, resume))
        pfnn_models.model(found=Description.of(database)).save(path)

    monkeypatch.setattr(train_locomotion, "train", train)
    checkpoint.path_of(tmp_path / "ava.pfnn").write_bytes(b"")
    told: list[str] = []
    databases = rows.Databases(database)
    paths = [rows.train(databases, name, tmp_path, note=told.append) for name in ("HOLDEN-XT", "AVA", "AVA")]
    assert asked == [(23, "holden-xt", "quick", False), (40, "ava", "quick", True)]
    assert [path.name for path in paths] == ["holden-xt.pfnn", "ava.pfnn", "ava.pfnn"]
    assert ["is trained" in line for line in told] == [True, True]
    assert list(rows.placed(paths[:2], databases)) == ["HOLDEN", "AVA"]  # the stub has no settings


def run(*arguments: Any, code: int = 0) -> Any:
    result = CliRunner().invoke(main, ["thesis", *map(str, arguments)])
    assert result.exit_code == code, result.output + result.stderr
    return result


def test_the_command(database, square, undrawn, tmp_path):
    database.save(tmp_path / "db")
    model = save(pfnn_models.model(), tmp_path / "a.pfnn")
    shown = run(tmp_path / "db", "--models", model, "--quick", "--laps", 2, "-o", tmp_path / "out").stdout
    assert "HOLDEN-XL" in shown and "note: AVA is empty" in shown
    assert page_html.files(tmp_path / "out") == set(page.FILES)
    told = json.loads(run(tmp_path / "db", "--models", model, "--quick", "--laps", 2, "--json").stdout)
    assert told["summary"][0]["operations"] > 0 and told["summary"][1]["operations"] is None

    assert "give -o FOLDER, or --quick" in run(tmp_path / "db", code=2).stderr
    assert "none.pfnn" in run(tmp_path / "db", "--models", "none.pfnn", "--quick", code=2).stderr
    message = run(tmp_path / "db", "--models", tmp_path / "db", "--quick", code=2).stderr
    assert "error: " in message and "Traceback" not in message
