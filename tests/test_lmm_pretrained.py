"""The networks that ship belong to the data, the schema and the version that the project makes today."""

from __future__ import annotations

from importlib import metadata

import numpy as np
import pytest
from click.testing import CliRunner

from lmm import models, pretrained
from lmm.controller import controller
from lmm.model import Model
from lmm.pfnn.controller import PhaseController
from lmm.pfnn.model import PhaseModel
from mm.build import build
from mm.control import Command
from mm.database import Database
from motion.cli import main as motion
from motion.errors import UserError

REMAKE = "the networks that ship were trained on other data: remake them with `make pretrained`"


@pytest.fixture(scope="module")
def database(tmp_path_factory) -> Database:
    """As `make demo` builds it."""
    folder = tmp_path_factory.mktemp("dancecard")
    result = CliRunner().invoke(motion, ["dancecard", "-o", str(folder)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return build([folder], tags=folder / "tags.csv")


def test_they_are_of_the_data_that_the_generator_makes(database):
    model = Model.load("dancecard")
    try:
        model.check(database)
    except UserError as error:
        pytest.fail(f"{REMAKE} ({error})")
    assert model.training["version"] == metadata.version("motion-matching"), REMAKE
    assert model.decompressor.weight_type == "float16"


def test_the_phase_functioned_network_is_of_that_data_too(database):
    model = models.load("dancecard.pfnn")
    assert isinstance(model, PhaseModel)
    assert model.database == Model.load("dancecard").database, REMAKE  # which is known to be of this data
    assert model.training["version"] == metadata.version("motion-matching"), REMAKE
    assert model.network.weight_type == "float16"
    model.check(database)


def test_they_reproduce_the_poses(database):
    from lmm.evaluation import decompressor

    model = Model.load("dancecard")
    some = np.arange(len(database.starts)) % 3 == 0
    found = decompressor.errors(model, database, ranges=some)
    assert found["position_cm"]["mean"] < 1.0, REMAKE


@pytest.mark.parametrize("name", pretrained.names())
def test_they_drive_a_character_without_any_database(name):
    model = models.load(name)
    if isinstance(model, Model):
        system = controller(model)
        assert system.database is None
    else:
        system = PhaseController(model)
    command = Command.still(1)
    command.velocity[:] = (0.0, 1.4)
    for _ in range(240):
        poses = system.step(command)
    assert poses.positions[0, 0, 2] == pytest.approx(1.4 * 4, abs=1.0)
    assert np.isfinite(poses.rotations).all()


def test_a_file_of_the_same_name_comes_first(tmp_path, monkeypatch):
    assert pretrained.names() == ["dancecard", "dancecard.pfnn"]
    monkeypatch.chdir(tmp_path)
    assert pretrained.find("dancecard").is_file()
    (tmp_path / "dancecard").write_text("mine")
    assert str(pretrained.find("dancecard")) == "dancecard"
    assert str(pretrained.find("other.lmm")) == "other.lmm"
