"""``lmm run`` and ``info`` of networks of locomotion: what drives, on what ground, and refusals."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import lmm_models
import mann_models
import numpy as np
import pfnn_models
import pytest
from click.testing import CliRunner
from test_retarget import other_joints

from features import terrain, terrain_made
from lmm import models, pretrained
from lmm.cli import main
from lmm.evaluator import products_here
from lmm.locomotion.settings import LocomotionSettings
from lmm.mann.model import MannModel
from lmm.model import Model
from lmm.pfnn.controller import PhaseController
from lmm.pfnn.model import PhaseModel
from mm import courses
from mm.cli import main as mm_main
from mm.ground_feet import GroundFeet
from mm.recording import Recording, record
from mm.runs import fitted
from motion import bvh, config, quat
from motion.clip import Clip
from motion.errors import UserError

HILLS = terrain_made.make(2, "hills", size=(10, 10))


def blind(model: PhaseModel) -> PhaseModel:
    """The model as if it had been trained on level ground alone."""
    mean = model.network.input_mean.copy()
    mean[model.layout.inputs["heights"]] = 0
    return replace(model, network=replace(model.network, input_mean=mean))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("locomotion")
    database = lmm_models.database()
    tags = np.zeros(len(database), np.uint32)
    tags[: len(tags) // 2] = 1
    database = replace(database, tag_names=("running",), tags=tags)
    database.save(folder / "walk.mmdb")
    lmm_models.model(database).save(folder / "walk.lmm")
    tagged = replace(pfnn_models.description(), tag_names=("running",))
    replace(pfnn_models.model(), description=tagged).save(folder / "walk.pfnn")
    blind(pfnn_models.model()).save(folder / "blind.pfnn")
    mann_models.model().save(folder / "walk.mann")
    terrain.save(folder / "hills.txt", HILLS)
    rows = (folder / "hills.txt").read_text().splitlines()
    (folder / "holes.txt").write_text("\n".join([*rows[:3], "nan " + rows[3].partition(" ")[2], *rows[4:]]))
    (folder / "mm.toml").write_text("search_interval = 0.2\n")
    return folder


@pytest.fixture(autouse=True)
def there(folder, monkeypatch):
    monkeypatch.chdir(folder)


def lmm(*arguments, code=0, command=main):
    result = CliRunner().invoke(command, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + result.stderr
    return result


def test_what_a_file_holds_is_told_and_loaded(folder):
    kinds = {"walk.lmm": ("lmm", Model), "walk.pfnn": ("pfnn", PhaseModel), "walk.mann": ("mann", MannModel)}
    for name, (kind, of_kind) in kinds.items():
        loaded = models.load(folder / name)
        assert type(loaded) is of_kind
        assert models.kind_of(folder / name) == models.kind_of(loaded) == kind
    for name in pretrained.names():
        assert models.kind_of(name) in models.TYPES and models.load(name).fingerprint


def test_info_of_each(folder):
    facts = json.loads(lmm("info", "walk.mann", "--json").stdout)
    loaded = models.load(folder / "walk.mann")
    assert facts["kind"] == "mann" and facts["bytes"] == loaded.weight_bytes()
    assert facts["bytes"]["experts"] == 4 * 4 * loaded.network.parameters
    assert sum(facts["bytes"].values()) == 4 * facts["parameters"]
    shown = lmm("info", "walk.mann").stdout
    assert "mode-adaptive network" in shown and "level ground only" in shown
    assert facts["experts"] == 4 and f" of 4 experts and {facts['parameters']:,} parameters" in shown
    assert "experts" not in json.loads(lmm("info", "walk.pfnn", "--json").stdout)
    assert "uneven ground was learned" in lmm("info", "walk.pfnn").stdout
    assert "level ground only" in lmm("info", "blind.pfnn").stdout


@pytest.mark.parametrize("name", ["walk.pfnn", "walk.mann"])
def test_weights_are_stored_otherwise(name, tmp_path):
    small = tmp_path / f"small.{name[-4:]}"
    before, after = json.loads(lmm("convert", name, "-o", small, "--weights", "float16", "--json").stdout)
    assert (before["weights"], after["weights"]) == ("float32", "float16")
    stored, loaded = models.load(small), models.load(name)
    for key, size in stored.weight_bytes().items():
        assert after[f"{key}_bytes"] == size <= before[f"{key}_bytes"] == loaded.weight_bytes()[key]
    for one, other in zip(stored.network.weights, loaded.network.weights, strict=True):
        np.testing.assert_array_equal(one, other.astype(np.float16))
    lmm("convert", name, "-o", small, "--weights", "float16", "--without-compressor", code=2)
    lmm("convert", name, "-o", small, "--weights", "int8", code=2)


@pytest.mark.parametrize(
    ("model", "options", "system"),
    [
        ("walk.pfnn", (), "pfnn-cubic"),
        ("walk.pfnn", ("--mode", "linear"), "pfnn-linear"),
        ("walk.pfnn", ("--mode", "constant", "--weights", "float16"), "pfnn-constant"),
        ("walk.mann", (), "mann-4"),
        ("walk.mann", ("--weights", "float16"), "mann-4"),
    ],
)
def test_a_network_drives(tmp_path, model, options, system):
    out, tape = tmp_path / "out.bvh", tmp_path / "run.rec"
    course = ("--course", "circle", "--seconds", 1, "--count", 2, "--spread", "--character", 1)
    facts = json.loads(lmm("run", model, *course, *options, "-o", out, "--record", tape, "--json").stdout)
    recording, clip = Recording.load(tape), bvh.read(out)
    assert facts["system"] == recording.system == system and facts["heights"] is None
    assert facts["searches_per_s"] is None and facts["transitions_per_s"] is None
    assert len(recording) == len(clip) == 60 and recording.count == 2
    assert not {"searched", "transition", "frame"} & set(recording.arrays)
    np.testing.assert_allclose(clip.positions[:, 0], recording["positions"][:, 1, 0], atol=2e-5)
    assert recording.settings == asdict(LocomotionSettings())
    assert facts["asked_speed_mps"] > 0.5 and "searches_per_s" not in lmm("run", model, *course).stdout


def test_a_run_is_the_controllers(folder, tmp_path):
    """What the command line asks for is what the model's controller does on the course."""
    tape = tmp_path / "run.rec"
    lmm("run", "walk.pfnn", "--course", "star", "--seconds", 1, "--mode", "constant", "--record", tape)
    model = PhaseModel.load(folder / "walk.pfnn")
    course = fitted(courses.load("star"), model.description)
    expected = record(PhaseController(model, mode="constant"), course, seconds=1, progress=lambda it, **_: it)
    np.testing.assert_array_equal(Recording.load(tape)["rotations"], expected["rotations"])


@pytest.mark.skipif("bfloat16" not in products_here(), reason="this processor multiplies no bfloat16 numbers")
@pytest.mark.parametrize("model", ["walk.pfnn", "walk.mann", "walk.lmm"])
def test_weights_of_bfloat16_are_near(tmp_path, model):
    tapes = {}
    for weights in ("float32", "bfloat16"):
        tape = tmp_path / weights
        lmm("run", model, "--course", "still", "--seconds", 0.2, "--weights", weights, "--record", tape)
        tapes[weights] = Recording.load(tape)["positions"]
    apart = np.linalg.norm(tapes["bfloat16"] - tapes["float32"], axis=-1)
    assert 0 < apart.max() < 0.1


def test_weights_are_held_as_asked(folder):
    for name in ("walk.lmm", "walk.pfnn"):
        model = models.load(folder / name)
        half, products = models.with_weights(model, "float16")
        assert products == "float32" and {n.weight_type for n in half.networks.values()} == {"float16"}
        assert models.with_weights(model, None) == (model, "float32")
        assert models.with_weights(model, "bfloat16") == (model, "bfloat16")
    small, _ = models.with_weights(models.load(folder / "walk.lmm"), "int8")
    assert small.projector.weight_type == "int8"
    with pytest.raises(UserError, match="no weights of type 'int4'; choose from float32"):
        models.with_weights(small, "int4")


def test_settings_and_foot_lock_reach_the_controller(tmp_path):
    mine, tape = tmp_path / "mine.toml", tmp_path / "run.rec"
    lmm("settings", "-o", mine)
    assert config.load(LocomotionSettings, mine) == LocomotionSettings()
    assert lmm("settings").stdout == mine.read_text()
    mine.write_text("position_bias = 0.5\n")
    course = ("--course", "still", "--seconds", 0.2, "--record", tape)
    lmm("run", "walk.mann", *course, "--settings", mine, "--no-foot-lock")
    told = Recording.load(tape)
    assert told.settings["position_bias"] == 0.5 and told.settings["foot_lock"] is False
    assert not told["locked"].any()


def test_a_rig_is_driven(tmp_path):
    target = other_joints()
    still = quat.identity(2, len(target))
    bvh.write(tmp_path / "rig.bvh", Clip("rig", target, 60.0, np.tile(target.offsets, (2, 1, 1)), still))
    out = tmp_path / "out.bvh"
    course = ("--course", "circle", "--seconds", 0.5)
    lmm("run", "walk.mann", *course, "--rig", tmp_path / "rig.bvh", "-o", out)
    clip = bvh.read(out)
    assert set(clip.skeleton.names) == set(target.names) and len(clip) == 30


@pytest.mark.parametrize(
    ("command", "model", "told"),
    [
        (main, "walk.pfnn", True),
        (main, "blind.pfnn", False),
        (main, "walk.mann", False),
        (main, "walk.lmm", False),
        (mm_main, "walk.mmdb", False),
    ],
)
def test_characters_walk_on_a_heightmap(tmp_path, monkeypatch, command, model, told):
    """Networks that know uneven ground are told of it, the others' characters are put on it."""
    follows = []

    class Feet(GroundFeet):
        def __init__(self, *arguments, **options):
            follows.append(options["follow"])
            super().__init__(*arguments, **options)

    monkeypatch.setattr("mm.grounded.GroundFeet", Feet)
    tape = tmp_path / "run.rec"
    course = ("--course", "circle", "--seconds", 2, "--record", tape)
    facts = json.loads(lmm("run", model, *course, "--heights", "hills.txt", "--json", command=command).stdout)
    assert facts["heights"] == "hills.txt" and follows == [not told]
    recording, ground = Recording.load(tape), terrain.load("hills.txt")
    root = recording["positions"][:, 0, 0]
    away = root[:, 1] - ground(root[:, 0], root[:, 2])
    assert np.isfinite(root).all()
    if told:  # the root is as high as the mean along the way
        assert np.abs(away).max() > 0.01
    else:
        np.testing.assert_allclose(away, 0, atol=0.02)


@pytest.mark.parametrize(("command", "model"), [(main, "walk.pfnn"), (mm_main, "walk.mmdb")])
def test_a_heightmap_is_as_wide_as_its_spacing_makes_it(monkeypatch, command, model):
    grounds = []

    class Feet(GroundFeet):
        def __init__(self, *arguments, ground, **options):
            grounds.append(ground)
            super().__init__(*arguments, ground=ground, **options)

    monkeypatch.setattr("mm.grounded.GroundFeet", Feet)
    walk = ("run", model, "--course", "still", "--seconds", 0.1, "--heights", "hills.txt")
    lmm(*walk, command=command)
    lmm(*walk, "--heights-spacing", 2 * terrain.SPACING, command=command)
    near, wide = grounds
    assert near.size == pytest.approx(HILLS.size, abs=1e-3)
    x, z = np.random.default_rng(0).uniform(-4, 4, (2, 50))
    np.testing.assert_allclose(wide(2 * x, 2 * z), near(x, z), atol=1e-3)


@pytest.mark.parametrize(
    ("model", "arguments", "message"),
    [
        ("walk.pfnn", ("--learned", "D"), "--learned is for learned motion matching"),
        ("walk.mann", ("--db", "walk.mmdb"), "and this is a model of mode-adaptive networks; leave"),
        ("walk.pfnn", ("--index", "exact"), "walk.pfnn: --index is for learned motion matching"),
        ("walk.mann", ("--mode", "cubic"), "--mode is for phase-functioned networks"),
        ("walk.lmm", ("--mode", "cubic"), "this is a model of learned motion matching; leave it out"),
        ("walk.pfnn", ("--mode", "square"), "'square' is not one of 'cubic', 'linear', 'constant'"),
        ("walk.pfnn", ("--weights", "int8"), "a phase-functioned network has no int8 weights; take float16"),
        ("walk.mann", ("--weights", "int4"), "'int4' is not one of"),
        ("walk.pfnn", ("--require-tag", "running"), "phase-functioned network knows nothing of the tag"),
        ("walk.pfnn", ("--forbid-tag", "flying"), "no tag 'flying'; the database's tags are running"),
        ("walk.pfnn", ("--settings", "mm.toml"), "mm.toml:1: search_interval: unknown key"),
        ("walk.pfnn", ("--heights", "holes.txt"), "holes.txt:4: 'nan' is no height"),
        ("walk.mann", ("--heights", "walk.mmdb"), "is no height"),
        ("walk.lmm", ("--heights", "none.txt"), "none.txt: cannot read"),
        ("walk.pfnn", ("--heights", "hills.txt", "--rig", "rig.bvh"), "leave out --heights, or --rig"),
        ("walk.pfnn", ("--heights", "hills.txt", "-o", "hills.txt"), "hills.txt"),
        ("walk.pfnn", ("--heights", "hills.txt", "--heights-spacing", 0), "'--heights-spacing': 0"),
        ("walk.pfnn", ("-o", "walk.pfnn"), "walk.pfnn"),
        ("walk.mmdb", (), "no model of any kind that `lmm train` makes"),
    ],
)  # fmt: skip
def test_faults_are_one_line(folder, model, arguments, message):
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    result = lmm("run", model, "--course", "still", "--seconds", 0.1, *arguments, code=2)
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1 and message in result.stderr
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_a_spacing_without_heights_is_refused():
    for command, model in ((main, "walk.pfnn"), (mm_main, "walk.mmdb")):
        result = lmm("run", model, "--course", "still", "--heights-spacing", 0.1, command=command, code=2)
        assert "give --heights FILE too" in result.stderr


@pytest.mark.parametrize("model", ["walk.pfnn", "walk.mann"])
def test_what_exports_learned_motion_matching_says_that_it_expects_it(folder, model):
    result = lmm("export", model, "--format", "onnx", "-o", "out", code=2)
    kind = models.load(folder / model).kind
    assert result.stderr == f"error: {model}: a {kind}, expected a learned motion matching model\n"
