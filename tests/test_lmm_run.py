"""``lmm run`` from the outside: by a model alone, by mixtures with its database, and refusals in one line."""

from __future__ import annotations

import json

import linear_models
import numpy as np
import pytest
from click.testing import CliRunner
from test_retarget import other_joints

from lmm.cli import main
from lmm.controller import controller
from lmm.model import Model
from mm.build import build
from mm.control import Command
from mm.database import Database
from mm.recording import Recording
from motion import bvh, quat
from motion.clip import Clip
from motion.errors import UserError


@pytest.fixture(scope="module")
def folder(walker_files, tmp_path_factory):
    folder = tmp_path_factory.mktemp("learned")
    (folder / "tags.csv").write_text("tag,clips\nrunning,run\ncrouch,*_turn\n")
    database = build([walker_files], jobs=1, tags=folder / "tags.csv")
    database.save(folder / "walker.mmdb")
    linear_models.fitted(database).save(folder / "walker.lmm")
    build([walker_files], jobs=1, fps=30).save(folder / "slow.mmdb")
    return folder


def lmm(*arguments, code=0):
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + result.stderr
    return result


def test_a_model_alone_drives(folder, tmp_path):
    out, tape = tmp_path / "out.bvh", tmp_path / "run.rec"
    course = ("--course", "circle", "--seconds", 6, "--count", 2, "--spread")
    facts = json.loads(
        lmm("run", folder / "walker.lmm", *course, "-o", out, "--record", tape, "--json").stdout
    )
    recording, clip, model = Recording.load(tape), bvh.read(out), Model.load(folder / "walker.lmm")
    assert facts["model"].endswith("walker.lmm") and facts["database"] is None
    assert facts["system"] == recording.system == "lmm-PSD"
    assert len(recording) == len(clip) == 360
    assert recording.database == model.database != "" and recording.schema["name"] == "mm27"
    np.testing.assert_allclose(clip.positions[:, 0], recording["positions"][:, 0, 0], atol=2e-5)
    # It goes where it is told at the speed of the data, and holds no frame.
    assert facts["path_error_cm"] < 25
    assert facts["asked_speed_mps"] == pytest.approx(1.2, rel=0.05)
    assert facts["speed_mps"] == pytest.approx(facts["asked_speed_mps"], rel=0.2)
    assert (recording["frame"] == -1).all() and recording["transition"].any()
    assert np.isfinite(recording["positions"]).all()


def test_mixtures_take_the_database(folder, tmp_path):
    tapes = {}
    for learned in ("", "D", "SD"):
        tape = tmp_path / f"{learned}.rec"
        lmm(
            *("run", folder / "walker.lmm", "--db", folder / "walker.mmdb", "--learned", learned),
            *("--course", "circle", "--seconds", 2, "--record", tape, "--index", "brute"),
        )
        tapes[learned] = Recording.load(tape)
    # The search alone decides where in the data a character is, and this decompressor is near to perfect.
    np.testing.assert_array_equal(tapes["D"]["frame"], tapes[""]["frame"])
    apart = np.linalg.norm(tapes["D"]["positions"] - tapes[""]["positions"], axis=-1)[:, :, 1:]
    assert apart.max() > 0 and apart.mean() < 2e-3
    assert (tapes["SD"]["frame"] == -1).all() and (tapes["D"]["frame"] >= 0).all()
    assert [tape.system for tape in tapes.values()] == ["mm", "lmm-D", "lmm-SD"]


def test_it_crouches_when_asked(folder):
    """The only tag that a projector knows: who is asked to play it is searched for anew, at once."""
    model = Model.load(folder / "walker.lmm")
    driven = controller(model)
    tag = model.description.crouch_tag
    assert tag == 2
    asked = np.arange(30) >= 17
    tags, searched = [], []
    for crouch in asked:
        command = Command.still(1)
        command.crouch[:] = crouch
        driven.step(command)
        tags.append(int(driven.state.tags()[0]))
        searched.append(bool(driven.record()["forced"][0]))
    assert searched[17] and not any(searched[2:17])
    assert [bool(t & tag) for t in tags[2:]] == asked[2:].tolist()


def test_a_rig_needs_no_database(folder, tmp_path):
    target = other_joints()
    still = quat.identity(2, len(target))
    bvh.write(tmp_path / "rig.bvh", Clip("rig", target, 60.0, np.tile(target.offsets, (2, 1, 1)), still))
    out = tmp_path / "out.bvh"
    lmm(
        *("run", folder / "walker.lmm", "--course", "circle", "--seconds", 1),
        *("--rig", tmp_path / "rig.bvh", "-o", out),
    )
    clip = bvh.read(out)
    assert set(clip.skeleton.names) == set(target.names) and len(clip) == 60


def test_feet_are_held_as_in_motion_matching(folder):
    driven = controller(Model.load(folder / "walker.lmm"))
    legs = driven._legs
    database = Database.load(folder / "walker.mmdb")
    exact = controller(Model.load(folder / "walker.lmm"), learned="", database=database)._legs
    np.testing.assert_array_equal(legs.heights, exact.heights)
    command = Command.still(1)
    command.velocity[:, 1] = 1.2
    held = 0
    for _ in range(120):
        driven.step(command)
        held += int(driven.planted().sum())
    assert held > 10


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--learned", "D"), "give --db DB too"),
        (("--learned", "PQ"), "'PQ' does not name stages"),
        (("--index", "exact"), "leave P out of --learned"),
        (("--learned", "SD", "--db", "{db}", "--index", "magic"), "magic"),
        (("--learned", "D", "--db", "{other}"), "frames per second"),
        (("--learned", "D", "--db", "{model}"), "expected a motion database"),
        (("--require-tag", "running"), "the projector knows nothing of the tag 'running'"),
        (("--forbid-tag", "flying"), "no tag 'flying'; the database's tags are running, crouch"),
        (("--require-tag", "crouch", "--forbid-tag", "crouch"), "no frame with crouch and without crouch"),
        (("-o", "{model}"), "would be written over"),
        (("--record", "{db}", "--db", "{db}"), "would be written over"),
        (("--course", "cirle"), "no course 'cirle'"),
    ],
)
def test_faults_are_one_line(folder, arguments, message):
    places = {name: folder / f"{name}.mmdb" for name in ("walker", "slow")}
    files = {"db": places["walker"], "other": places["slow"], "model": folder / "walker.lmm"}
    given = [a.format(**files) for a in arguments]
    course = () if "--course" in given else ("--course", "still", "--seconds", 0.1)
    result = lmm("run", folder / "walker.lmm", *course, *given, code=2)
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1 and message in result.stderr


def test_what_is_no_model_is_refused(folder, tmp_path):
    result = lmm("run", folder / "walker.mmdb", "--course", "still", code=2)
    assert "no model of any kind that `lmm train` makes" in result.stderr
    assert "drive it as it is (python -m mm run)" in result.stderr
    assert "No such file" in lmm("run", tmp_path / "none", "--course", "still", code=2).stderr


def test_stages_without_a_database_are_refused(folder):
    with pytest.raises(UserError, match="need the database"):
        controller(Model.load(folder / "walker.lmm"), learned="SD")


def test_help_ends_with_an_example():
    assert "Example: python -m lmm run" in lmm("run", "--help").stdout
