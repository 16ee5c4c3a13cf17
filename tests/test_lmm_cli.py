"""``python -m lmm`` from the outside: what it prints, what it writes, how it fails."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import lmm_models
import mann_models
import pfnn_models
import pytest
from click.testing import CliRunner, Result

from lmm import pretrained, summary
from lmm.cli import main
from lmm.controller import controller
from lmm.mann.model import MannModel
from lmm.model import Model
from lmm.pfnn.model import PhaseModel
from lmm.training import mann_settings, pfnn_settings
from lmm.training import settings as training_settings
from lmm.training.settings import Settings
from mm.database import Database
from motion import files

STAGES = ("decompressor", "stepper", "projector")
LINE = {
    "stage": "projector",
    "iteration": 30,
    "seconds": 90.0,
    "learning_rate": 1e-3,
    "loss": {"position": 2.0},
    "errors": {"training": {"error_cm": 1.0}, "held_out": {"error_cm": 2.0}},
}


def _lmm(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def _fails(*arguments: object) -> str:
    """The one line of a command that fails as it should."""
    result = _lmm(*arguments)
    lines = result.stderr.splitlines()
    assert result.exit_code == 2 and len(lines) == 1 and lines[0].startswith("error: "), result.output
    return lines[0]


@pytest.fixture(scope="module")
def db(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("lmm") / "walk.mmdb"
    lmm_models.database().save(path)
    return path


@pytest.fixture(scope="module")
def model(db: Path) -> Path:
    path = db.parent / "walk.lmm"
    lmm_models.model(Database.load(db)).save(path)
    return path


Call = tuple[str, Settings, dict[str, Any]]


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[Call]:
    """What the command asks of training, which is done by a stand-in that takes no time."""
    pytest.importorskip("torch", reason="training needs torch: pip install 'motion-matching[train]'")
    from lmm.training import train

    made: list[Call] = []

    def stand_in(database: Database, output: str, settings: Settings, **options: Any) -> Model:
        made.append((database.fingerprint, settings, options))
        found = lmm_models.model(database)
        found.save(output)
        Path(f"{output}.jsonl").write_text(json.dumps(LINE) + "\n")
        return found

    monkeypatch.setattr(train, "train", stand_in)
    return made


def test_train_tells_what_it_made(db: Path, tmp_path: Path, calls: list[Call]) -> None:
    out = tmp_path / "new" / "walk.lmm"
    result = _lmm("train", db, "-o", out, "--preset", "smoke")
    assert result.exit_code == 0 and result.stderr == ""
    made = Model.load(out)
    size = out.stat().st_size / 1e6
    assert f"{out}: {made.parameters:,} parameters, {size:.1f} MB, trained in 1.5 minutes" in result.stdout
    assert "held out" in result.stdout and "position cm" in result.stdout
    assert calls == [
        (
            Database.load(db).fingerprint,
            training_settings.preset("ours", "smoke"),
            {"resume": False, "tensorboard": None},
        )
    ]


def test_errors_stand_in_one_order_before_and_after_storing(capsys: pytest.CaptureFixture[str]) -> None:
    for parts in (("training", "held_out"), ("held_out", "training")):
        summary.show_errors({"stepper": {part: {"error_cm": 1.0} for part in parts}})
        header = capsys.readouterr().out.splitlines()[0]
        assert header.index("training") < header.index("held out")


def test_errors_are_told_in_words_stage_by_stage(capsys: pytest.CaptureFixture[str]) -> None:
    # As a stored model has them: sorted by name.
    summary.show_errors(
        {
            "closed_loop": {"training": {"own_regret": 4.0}},
            "decompressor": {"training": {"error_cm": 1.0}},
            "stepper": {"training": {"after_20_cm": 3.0, "after_60_cm": 3.5, "error_cm": 2.0}},
        }
    )
    told = [line.partition("│")[0].strip() for line in capsys.readouterr().out.splitlines()[2:]]
    assert told == [
        "decompressor: joints off, cm",
        "stepper: joints off after 10 frames, cm",
        "stepper: joints off after 20 frames, cm",
        "stepper: joints off after 60 frames, cm",
        "closed loop, own queries: query distance / true neighbour's",
    ]


def test_train_passes_its_options(db: Path, tmp_path: Path, calls: list[Call]) -> None:
    out, own = tmp_path / "walk.lmm", tmp_path / "own.toml"
    own.write_text("latent = 16\nseed = 3\nheld_out = 0.2\n[stepper]\nbatch = 7\n")
    options = ["--recipe", "reference", "--preset", "quick", "--config", own, "--seed", 5, "--threads", 2]
    more = ["--resume", "--tensorboard", tmp_path / "board", "--json"]
    facts = json.loads(_lmm("train", db, "-o", out, *options, *more).stdout)
    assert facts["path"] == str(out) and facts["fingerprint"] == Model.load(out).fingerprint
    assert facts["minutes"] == 1.5 and facts["log"] == f"{out}.jsonl"
    ((_, settings, passed),) = calls
    base = training_settings.preset("reference", "quick")
    stepper = dataclasses.replace(base.stepper, batch=7)
    # What the command line says counts more than what the file says.
    assert settings == dataclasses.replace(base, latent=16, held_out=0.2, seed=5, threads=2, stepper=stepper)
    assert passed == {"resume": True, "tensorboard": str(tmp_path / "board")}


def test_the_settings_in_the_help_are_settings(db: Path, tmp_path: Path, calls: list[Call]) -> None:
    lines = [line.strip() for line in _lmm("train", "--help").stdout.splitlines()]
    start = lines.index("latent = 24")
    (tmp_path / "own.toml").write_text("\n".join(lines[start : start + 4]))
    assert _lmm("train", db, "-o", tmp_path / "m", "--config", tmp_path / "own.toml").exit_code == 0
    ((_, settings, _),) = calls
    assert (settings.latent, settings.stepper.batch, settings.stepper.iterations) == (24, 64, 20000)


def test_a_phase_functioned_network_is_trained_and_told_of(
    db: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is asked of its training, by a stand-in, and what is told of what comes of it."""
    pytest.importorskip("torch", reason="training needs torch: pip install 'motion-matching[train]'")
    from lmm.training import train_locomotion

    made: list[Any] = []

    def stand_in(database: Database, output: str, settings: Any, **options: Any) -> PhaseModel:
        made.append((settings, options))
        found = pfnn_models.model()
        found.errors = {"pfnn": {"training": {"error_cm": 1.25, "after_30_cm": 3.5}}}
        found.save(output)
        Path(f"{output}.jsonl").write_text(json.dumps(LINE) + "\n")
        return found

    monkeypatch.setattr(train_locomotion, "train", stand_in)
    out, own = tmp_path / "walk.pfnn", tmp_path / "own.toml"
    own.write_text("[pfnn]\nbatch = 7\n")
    asked = ["--model", "pfnn", "--preset", "quick", "--configuration", "holden-xl", "--config", own]
    result = _lmm("train", db, "-o", out, *asked, "--seed", 2)
    assert result.exit_code == 0 and "1.25" in result.stdout
    base = pfnn_settings.preset("ours", "quick", "holden-xl")
    stage = dataclasses.replace(base.pfnn, batch=7)
    expected = dataclasses.replace(base, pfnn=stage, seed=2)
    assert made == [(expected, {"resume": False, "tensorboard": None})]

    shown = _lmm("info", out).stdout
    facts = json.loads(_lmm("info", out, "--json").stdout)
    network = PhaseModel.load(out).network
    for mode, sets in (("cubic", 4), ("linear", 10), ("constant", 50)):
        assert facts["bytes"][mode] == sets * 4 * network.parameters
        assert f"{mode} {facts['bytes'][mode] / 1e6:.2f}" in shown
    assert (
        facts["kind"] == "pfnn"
        and "-".join(map(str, network.sizes)) in shown
        and "after 30 frames, cm" in shown
    )

    assert "give --model pfnn too" in _lmm("train", db, "-o", out, "--configuration", "holden").stderr


def test_a_mode_adaptive_network_is_trained_and_told_of(
    db: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Experts on the command line count more than those of a file; labels go with it."""
    pytest.importorskip("torch", reason="training needs torch: pip install 'motion-matching[train]'")
    from lmm.training import train_locomotion

    made: list[Any] = []

    def stand_in(database: Database, output: str, settings: Any, **options: Any) -> MannModel:
        made.append((settings, options))
        found = mann_models.model(experts=8)
        found.save(output)
        Path(f"{output}.jsonl").write_text(json.dumps(LINE) + "\n")
        return found

    monkeypatch.setattr(train_locomotion, "train", stand_in)
    out, own = tmp_path / "walk.mann", tmp_path / "own.toml"
    own.write_text("[mann]\nbatch = 7\nexperts = 2\n")
    asked = ["--model", "mann", "--preset", "smoke", "--recipe", "reference", "--config", own]
    result = _lmm("train", db, "-o", out, *asked, "--experts", 8, "--labels", tmp_path / "labels")
    assert result.exit_code == 0, result.output
    base = mann_settings.preset("reference", "smoke")
    expected = dataclasses.replace(base, mann=dataclasses.replace(base.mann, batch=7, experts=8))
    options = {"resume": False, "tensorboard": None, "labels": str(tmp_path / "labels")}
    assert made == [(expected, options)]
    assert json.loads(_lmm("info", out, "--json").stdout)["kind"] == "mann"

    for more, message in (
        (["--experts", 4], "give --model mann too"),
        (["--model", "pfnn", "--experts", 4], "give --model mann too"),
        (["--model", "mann", "--configuration", "holden"], "give --model pfnn too"),
        (["--labels", tmp_path], "give --model pfnn or mann too"),
    ):
        assert message in _lmm("train", db, "-o", out, *more).stderr


@pytest.mark.filterwarnings("always::motion.errors.Note")
def test_notes_of_a_training_are_lines(db: Path, tmp_path: Path) -> None:
    """Clips that are left out, and labels that fit none."""
    pytest.importorskip("torch", reason="training needs torch: pip install 'motion-matching[train]'")
    thrown = lmm_models.thrown(Database.load(db), "run")
    thrown.save(tmp_path / "thrown.mmdb")
    own, out = tmp_path / "own.toml", tmp_path / "m"
    own.write_text("[pfnn]\niterations = 2\nhidden = [8]\nwindow = 1\n")
    options = ["--model", "pfnn", "--config", own, "--held-out", 0, "--threads", 1]
    result = _lmm("train", tmp_path / "thrown.mmdb", "-o", out, *options)
    assert result.exit_code == 0, result.output
    notes = [line for line in result.stderr.splitlines() if line.startswith("note: ")]
    assert notes == [
        "note: 1 of 2 clips is left out, without labels: run (neither foot touches the ground: "
        "no phase without contacts of both feet)"
    ]
    told = _fails("train", db, "-o", out, *options, "--labels", tmp_path)
    assert "no labels (NAME.labels.csv) of any clip" in told


def test_training_that_is_stopped_says_how_to_go_on(
    db: Path, tmp_path: Path, calls: list[Call], monkeypatch: pytest.MonkeyPatch
) -> None:
    from lmm.training import train

    def stop(*args: Any, **kwargs: Any) -> Model:
        raise KeyboardInterrupt("stopped at iteration 7 of the stepper; give --resume to go on from there")

    monkeypatch.setattr(train, "train", stop)
    result = _lmm("train", db, "-o", tmp_path / "walk.lmm")
    assert result.exit_code == 130
    message = result.stderr.lstrip("\n")  # after Ctrl-C the terminal's cursor stands behind a ^C
    assert message == "error: stopped at iteration 7 of the stepper; give --resume to go on from there\n"


def test_training_without_torch(db: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    told = _fails("train", db, "-o", tmp_path / "walk.lmm")
    assert told == "error: torch is not installed; pip install 'motion-matching[train]'"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--preset", "tiny"], "'tiny' is not one of 'smoke', 'quick', 'full'"),
        (["--recipe", "theirs"], "'theirs' is not one of"),
        (["--seed", "-1"], "-1 is not in the range x>=0"),
        (["--seed", str(2**63)], "seed: "),
        (["--held-out", "1"], "1 is out of range; give a number 0 to 0.9"),
        (["--held-out", "nan"], "nan is out of range"),
        (["--threads", "0"], "0 is not in the range"),
        (["--device", "tpu"], "'tpu' is not one of"),
        (["--config", "nowhere.toml"], "nowhere.toml: cannot read"),
    ],
)
def test_options_that_make_no_sense(options: list[str], message: str, db: Path, tmp_path: Path) -> None:
    assert message in _fails("train", db, "-o", tmp_path / "walk.lmm", *options)
    assert list(tmp_path.iterdir()) == []


def test_faults_of_a_config_name_line_and_key(db: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text("[stepper]\nrate = 3\n")
    told = _fails("train", db, "-o", tmp_path / "walk.lmm", "--config", own)
    assert f"{own}:2: stepper.rate: unknown key; choose from iterations, " in told


def test_outputs_that_cannot_be_written(db: Path, tmp_path: Path) -> None:
    before = db.read_bytes()
    assert "would be written over" in _fails("train", db, "-o", db)
    assert "it is a folder" in _fails("train", db, "-o", tmp_path)
    (tmp_path / "walk.lmm.jsonl").mkdir()
    assert "walk.lmm.jsonl: cannot write: it is a folder" in _fails("train", db, "-o", tmp_path / "walk.lmm")
    assert "cannot write" in _fails("train", db, "-o", "/dev/full/walk.lmm")
    assert db.read_bytes() == before


def test_databases_that_cannot_be_trained_on(db: Path, tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="training needs torch: pip install 'motion-matching[train]'")
    out = tmp_path / "walk.lmm"
    assert "cannot read: No such file" in _fails("train", tmp_path / "nowhere", "-o", out)
    (tmp_path / "text").write_text("no database")
    assert "not a motion database" in _fails("train", tmp_path / "text", "-o", out)
    whole = Database.load(db)
    stop = int(whole.stops[1])  # the first clip and its mirrored copy
    assert whole.names[0] == whole.names[1] != whole.names[2]
    one = dataclasses.replace(
        whole,
        poses=whole.poses[:stop],
        **{name: getattr(whole, name)[:stop] for name in ("contacts", "features", "tags")},
        **{name: getattr(whole, name)[:2] for name in ("starts", "stops", "names", "mirrored")},
    )
    one.save(tmp_path / "one.mmdb")
    told = _fails("train", tmp_path / "one.mmdb", "-o", out)
    assert told.startswith("error: a database of one clip; ")
    (tmp_path / "long.toml").write_text("[stepper]\nwindow = 9999\n")
    told = _fails("train", db, "-o", out, "--config", tmp_path / "long.toml")
    assert "too small a database: no clip is as long as a window, 9999 frames" in told
    assert "there is no checkpoint to go on from" in _fails("train", db, "-o", out, "--resume")
    assert not out.exists()


def test_training_on_all_of_one_clip_and_again(db: Path, tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="training needs torch: pip install 'motion-matching[train]'")
    out, own = tmp_path / "walk.lmm", tmp_path / "own.toml"
    stages = (*STAGES, "closed_loop")
    sizes = "\n".join(f"[{name}]\nhidden = [8]\niterations = 2\nbatch = 4" for name in stages)
    own.write_text(f"latent = 4\ncompressor = [8]\n{sizes}\n")
    options = ["--preset", "smoke", "--config", own, "--held-out", 0, "--threads", 1]
    result = _lmm("train", db, "-o", out, *options)
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["own.toml", "walk.lmm", "walk.lmm.jsonl"]
    assert Model.load(out).held_out == ()
    first = out.read_bytes()
    facts = json.loads(_lmm("train", db, "-o", out, *options, "--json").stdout)
    assert out.read_bytes() == first
    assert facts["training"]["settings"]["latent"] == 4 and facts["latent"] == 4
    assert "there is no checkpoint to go on from" in _fails("train", db, "-o", out, *options, "--resume")


def test_info(model: Path, db: Path) -> None:
    facts = json.loads(_lmm("info", model, "--json").stdout)
    loaded = Model.load(model)
    assert facts["parameters"] == loaded.parameters and facts["file_bytes"] == model.stat().st_size
    assert facts["bytes"] == loaded.memory() and sum(facts["bytes"].values()) < facts["file_bytes"]
    assert facts["state_bytes"] == controller(loaded).memory()["state"]
    assert set(facts["networks"]) == {"decompressor", "stepper", "projector", "compressor"}
    stepper = facts["networks"]["stepper"]
    assert stepper["sizes"] == [32, 16, 16, 32] and stepper["weights"] == "float32"
    assert (facts["features"], facts["latent"], facts["joints"], facts["fps"]) == (27, 5, 23, 60)
    assert facts["database"] == Database.load(db).fingerprint and facts["held_out"] == ["run"]
    assert facts["training"]["settings"]["recipe"] == "ours" and facts["errors"] == {
        "held_out": {"position_cm": 2.0}
    }
    text = _lmm("info", model).stdout
    for part in (
        f"{loaded.parameters:,} parameters",
        "23 joints at 60 fps",
        f"fingerprint  {loaded.fingerprint}",
        f"database     {loaded.database}",
        f"a character  {facts['state_bytes'] / 1000:.1f} kB of state",
        "held out     run",
        "recipe ours, preset smoke, seed 0",
        "32-16-16-32",
        "position cm │        2",
    ):
        assert part in text


def test_info_without_a_compressor(model: Path, tmp_path: Path) -> None:
    small = dataclasses.replace(Model.load(model).as_type("int8"), compressor=None, held_out=(), training={})
    small.save(tmp_path / "small.lmm")
    facts = json.loads(_lmm("info", tmp_path / "small.lmm", "--json").stdout)
    assert set(facts["networks"]) == {"decompressor", "stepper", "projector"}
    assert facts["networks"]["stepper"]["weights"] == "int8"
    text = _lmm("info", tmp_path / "small.lmm").stdout
    assert "held out     nothing" in text and "training     unknown" in text


def test_commands_know_the_models_that_ship_by_name(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pretrained, "FOLDER", model.parent)
    monkeypatch.chdir(tmp_path)
    facts = json.loads(_lmm("info", "walk", "--json").stdout)
    assert facts["file_bytes"] == model.stat().st_size and facts["path"] == "walk"
    rows = json.loads(_lmm("convert", "walk", "-o", "small", "--weights", "int8", "--json").stdout)
    assert [row["model"] for row in rows] == ["walk", "small"]
    assert rows[0]["file_bytes"] == model.stat().st_size
    assert "no: cannot read" in _fails("info", "no")


def test_info_of_what_is_no_model(model: Path, db: Path, tmp_path: Path) -> None:
    assert "a motion database, no model of any kind that `lmm train` makes" in _fails("info", db)
    cut = tmp_path / "cut.lmm"
    cut.write_bytes(model.read_bytes()[:-100])
    assert "cut short" in _fails("info", cut)
    cut.write_bytes(b"no model")
    assert "no model of any kind that `lmm train` makes; train one, or name" in _fails("info", cut)
    files.save(tmp_path / "odd.lmm", "learned motion matching model", 1, {}, {})
    assert "damaged learned motion matching model" in _fails("info", tmp_path / "odd.lmm")


def test_curves(tmp_path: Path) -> None:
    logs = [tmp_path / "a.lmm.jsonl", tmp_path / "b.lmm.jsonl"]
    for log in logs:
        log.write_text(json.dumps(LINE) + "\n" + json.dumps(LINE | {"seconds": 180.0}) + "\n")
    result = _lmm("curves", *logs, "-o", tmp_path / "curves.png")
    told = "projector: a.lmm reaches b.lmm's last held-out error of 2 cm after 1.5 minutes"
    assert result.exit_code == 0 and result.stdout.startswith(told)
    assert result.stdout.endswith(f"\nwrote {tmp_path / 'curves.png'}\n")
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")
    result = _lmm("curves", *logs, "-o", tmp_path / "curves.svg", "--names", "ours,the reference")
    text = (tmp_path / "curves.svg").read_text()
    assert result.exit_code == 0 and ">ours<" in text and ">the reference<" in text
    (race,) = json.loads(_lmm("curves", *logs, "-o", tmp_path / "c.png", "--json").stdout)["races"]
    assert (race["stage"], race["value"], race["minutes"]) == ("projector", 2.0, 1.5)
    assert "1 names of 2 logs" in _fails("curves", *logs, "-o", tmp_path / "x.png", "--names", "ours")
    assert "unknown form of picture" in _fails("curves", *logs, "-o", tmp_path / "x.gif")
    (tmp_path / "bad.jsonl").write_text("{}\n")
    told = _fails("curves", tmp_path / "bad.jsonl", "-o", tmp_path / "x.png")
    assert "bad.jsonl:1: not a line of a training's log" in told
    assert not (tmp_path / "x.png").exists()
