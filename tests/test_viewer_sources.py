"""viewer.sources and viewer.tuning: what files are taken for, what does not fit; what sliders do."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

import lmm_models
import numpy as np
import pfnn_models
import pytest

from lmm import pretrained
from lmm.locomotion.settings import LocomotionSettings
from mm import courses
from mm.build import build
from mm.codecs.compressed import compress
from mm.controller import Controller
from mm.recording import record
from mm.reweighted import reweighted
from mm.settings import Settings
from motion import bvh, config, console
from motion.config import ConfigError
from motion.errors import UserError
from viewer import sources
from viewer.controls import Stick
from viewer.session import Session
from viewer.tuning import Tuning, Workshop, sliders


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, walker_clips) -> Path:
    """A file of every kind, of two databases that differ in their tags."""
    place = tmp_path_factory.mktemp("files")
    data, other = lmm_models.database(), lmm_models.database(crouch=True)
    data.save(place / "walk.mmdb")
    other.save(place / "crouch.mmdb")
    compress(data, "float16", rigs=False).save(place / "small.mmdb")
    lmm_models.model(data).save(place / "walk.lmm")
    pfnn_models.model().save(place / "walk.pfnn")
    bvh.write(place / "stroll.bvh", walker_clips[0])
    run = record(Controller(data), courses.load("circle"), seconds=0.5, progress=console.silent)
    run.save(place / "last.rec")
    parts = {"step_seconds": run.step_seconds[:0], "stage_seconds": run.stage_seconds[:0]}
    arrays = {name: array[:0] for name, array in run.arrays.items()}
    dataclasses.replace(run, arrays=arrays, **parts).save(place / "none.rec")
    (place / "notes.txt").write_text("nothing")
    return place


def read(folder: Path, *names: str) -> sources.Sources:
    return sources.read([folder / name for name in names])


def test_every_kind_of_file_is_known_by_what_it_holds(folder: Path) -> None:
    found = read(folder, "walk.mmdb", "walk.lmm", "walk.pfnn", "stroll.bvh", "last.rec")
    assert list(found.clips) == ["stroll"] and found.clips["stroll"].seconds == pytest.approx(299 / 60)
    assert list(found.runs) == ["last"] and list(found.databases) == ["walk"]
    assert list(found.models) == ["lmm", "pfnn"]
    assert found.data_of(found.runs["last"]) is found.databases["walk"]


def test_every_part_moves(folder: Path) -> None:
    found = read(folder, "walk.mmdb", "walk.lmm", "walk.pfnn")
    parts = found.parts()
    assert list(parts) == ["mm", "lmm", "pfnn"]
    systems = {name: part.make() for name, part in parts.items()}
    systems |= {name: part.make() for name, part in found.parts(["lmm-D", "lmm-PS"]).items()}
    session = Session(systems, Stick(len(systems)))
    session.advance(0.1)
    assert not session.look().errors and not session.fixed
    assert parts["mm"].data is parts["lmm"].data is found.databases["walk"]
    assert parts["pfnn"].data is None
    settings = dataclasses.replace(Settings(), foot_lock=False)
    assert parts["mm"].make(settings).settings == settings


def test_a_compressed_database_moves_and_knows_its_model(folder: Path) -> None:
    found = read(folder, "small.mmdb", "walk.lmm", "last.rec")
    parts = found.parts()
    assert list(parts) == ["mm", "lmm"] and parts["lmm"].data is found.databases["small"]
    assert parts["mm"].make().count == 1
    assert found.data_of(found.runs["last"]) is found.databases["small"]
    with pytest.raises(UserError, match="not compressed"):
        found.parts(["lmm-D"])


def test_a_run_is_of_a_database_that_differs_in_rounding_only(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped, data = lmm_models.model(lmm_models.database()), lmm_models.database()
    rounded = dataclasses.replace(data, offset=data.offset * np.float32(1 + 1e-6))
    rounded.save(tmp_path / "walk.mmdb")
    assert rounded.fingerprint != data.fingerprint

    def found(*paths: Path) -> bool:
        read = sources.read([*paths, folder / "last.rec"])
        return read.data_of(read.runs["last"]) is read.databases["walk"]

    assert found(tmp_path / "walk.mmdb", folder / "walk.lmm")  # the model is of both
    with pytest.raises(UserError, match="not made from this database"):
        found(tmp_path / "walk.mmdb")
    monkeypatch.setattr(sources.models, "load", lambda _: shipped)
    assert found(tmp_path / "walk.mmdb")
    with pytest.raises(UserError, match="not made from this database"):
        found(folder / "crouch.mmdb")


def test_a_folder_is_its_clips(walker_files: Path) -> None:
    found = sources.read([walker_files])
    assert set(found.clips) == {"straight", "left_turn", "right_turn", "stand", "run"}


def test_several_databases_are_told_apart(folder: Path) -> None:
    found = read(folder, "walk.mmdb", "crouch.mmdb", "walk.lmm")
    assert list(found.parts()) == ["mm-walk", "mm-crouch", "lmm"]
    assert found.parts(["lmm"])["lmm"].data is found.databases["walk"]
    (folder / "b").mkdir()
    for name in ("walk.mmdb", "walk.lmm"):
        (folder / "b" / name).write_bytes((folder / name).read_bytes())
    found = read(folder, "walk.mmdb", "b/walk.mmdb", "walk.lmm", "b/walk.lmm")
    assert list(found.parts()) == ["mm-walk", "mm-walk-b", "lmm", "lmm-walk"]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("none.rec",), "none.rec: a run of no frames; record it again"),
        (("notes.txt",), "notes.txt: nothing that can be shown; give motion files, a database"),
        (("absent.mmdb",), "absent.mmdb: no such file; .*dancecard"),
        (("crouch.mmdb", "walk.lmm"), "walk.lmm: the model is not of this database: other tags"),
        (("crouch.mmdb", "last.rec"), "last.rec: the run was not made from this database; give the"),
        (("small.mmdb", "dancecard"), "the model is not of this database"),
        (("walk.mmdb", "walk.mmdb"), "walk.mmdb: it is given twice; name it once"),
    ],
)
def test_what_does_not_fit_is_one_line(folder: Path, names: tuple[str, ...], message: str) -> None:
    paths = [name if name in pretrained.names() else folder / name for name in names]
    with pytest.raises(UserError, match=message) as found:
        sources.read(paths)
    assert "\n" not in str(found.value)


def test_systems_that_are_not_there_are_refused_with_those_that_are(folder: Path) -> None:
    found = read(folder, "walk.lmm")
    with pytest.raises(UserError, match="no system 'mm'; choose from lmm; with its database also lmm-P"):
        found.parts(["mm"])
    with pytest.raises(UserError, match="no systems are named; choose from lmm"):
        found.parts([])
    with pytest.raises(UserError, match="lmm-SD has stages that are not learned"):
        found.parts(["lmm-SD"])
    with pytest.raises(UserError, match="give a database or a model"):
        read(folder, "last.rec").parts(["mm"])


def test_with_nothing_the_networks_that_ship_move_at_once() -> None:
    found = sources.read([])
    assert list(found.parts()) == ["lmm", "pfnn"]
    session = Session({name: part.make() for name, part in found.parts().items()}, Stick(2))
    session.advance(0.1)
    assert not session.look().errors


def test_the_built_in_database_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data, made = lmm_models.database(), []
    shipped = lmm_models.model(data)

    def few(*_: Any) -> list:
        made.append(1)
        return []

    monkeypatch.setattr(sources.models, "load", lambda _: shipped)
    monkeypatch.setattr(sources.dancecard, "dances", few)
    monkeypatch.setattr(sources, "build", lambda *_, **__: dataclasses.replace(data))
    for _ in range(2):
        assert sources.built_in(folder=tmp_path / "cache").fingerprint == data.fingerprint
    assert len(made) == 1
    elsewhere = dataclasses.replace(shipped.description, fingerprint="of another machine")
    rounded = dataclasses.replace(shipped, description=elsewhere)
    monkeypatch.setattr(sources.models, "load", lambda _: rounded)
    sources.built_in(folder=tmp_path / "cache")
    assert len(made) == 1
    (tmp_path / "cache" / "dancecard.mmdb").write_bytes(b"old")
    assert len(sources.built_in(folder=tmp_path / "cache")) == len(data)
    (tmp_path / "file").write_text("")
    assert len(sources.built_in(folder=tmp_path / "file")) == len(data)  # nowhere to keep it
    assert len(made) == 3


@pytest.mark.parametrize("kind", [Settings, LocomotionSettings])
def test_every_setting_has_a_slider_that_moves_within_what_it_may_be(kind: Any) -> None:
    found = {slider.name: slider for slider in sliders(kind)}
    assert list(found) == [field.name for field in dataclasses.fields(kind)]
    for name, slider in found.items():
        assert len(slider.about) > 10 and slider.default == getattr(kind(), name)
        values = {"number": (slider.low, slider.high), "switch": (False, True), "choice": slider.choices}
        assert len(values[slider.kind]) >= 2
        for value in values[slider.kind]:
            partner = {"jog_to": 9.0} if name == "jog_from" else {}
            assert getattr(kind(**{name: value}, **partner), name) == value
        if slider.kind == "number":
            assert slider.default is None or slider.low <= slider.default <= slider.high


@pytest.fixture(scope="module")
def part(folder: Path) -> sources.Part:
    return read(folder, "walk.mmdb").parts()["mm"]


def test_sliders_move_and_go_back(part: sources.Part, tmp_path: Path) -> None:
    tuning = Tuning(part)
    assert not tuning.set("velocity_halflife", 0.5) and not tuning.set("foot_height", 0.04)
    assert tuning.settings == Settings(velocity_halflife=0.5, foot_height=0.04)
    tuning.set("foot_height", None)
    assert tuning.set("ignore_end", 0.5)  # takes another index
    with pytest.raises(ConfigError, match="continuing_bias"):
        tuning.set("continuing_bias", 1.0)
    with pytest.raises(ConfigError, match="unknown key"):
        tuning.set("speed", 1.0)
    tuning.save(tmp_path / "mine.toml")
    assert config.load(Settings, tmp_path / "mine.toml") == tuning.settings
    again = Tuning(part)
    assert again.load(tmp_path / "mine.toml")
    assert again.settings == tuning.settings == Settings(velocity_halflife=0.5, ignore_end=0.5)
    assert again.reset() and not again.reset()
    assert again.settings == Settings()
    (tmp_path / "bad.toml").write_text("search_interval = -1\n")
    with pytest.raises(UserError, match=r"bad.toml:1: search_interval"):
        again.load(tmp_path / "bad.toml")


def test_weights_are_those_of_a_database_built_with_them(
    part: sources.Part, walker_files: Path, tmp_path: Path
) -> None:
    base = build([walker_files], jobs=1, mirror=False)
    names = list(base.schema.slices)
    weights = {names[0]: 3.0, names[-1]: 0.0}
    found = reweighted(base, weights)
    built = build([walker_files], jobs=1, mirror=False, schema=found.schema)
    np.testing.assert_allclose(found.features, built.features, atol=1e-4, rtol=1e-4)
    back = reweighted(found, {name: base.schema.features[i].weight for i, name in enumerate(names)})
    np.testing.assert_allclose(back.features, base.features, atol=1e-4, rtol=1e-4)
    with pytest.raises(UserError, match="no feature 'nose'"):
        reweighted(base, {"nose": 1.0})

    tuning = Tuning(part)
    slider = tuning.weight_sliders[0]
    assert slider.rebuilds and slider.low <= slider.default <= slider.high
    assert tuning.set_weight(slider.name, 2.5)
    with pytest.raises(UserError, match="weight"):
        tuning.set_weight(slider.name, -1.0)
    with pytest.raises(UserError, match="no such feature"):
        tuning.set_weight("nose", 1.0)
    assert tuning.weights == {slider.name: 2.5}
    tuning.save_schema(tmp_path / "mine.toml")
    assert build([walker_files], jobs=1, schema=tmp_path / "mine.toml").schema.features[0].weight == 2.5
    assert tuning.reset() and not tuning.weights


def test_features_of_networks_have_no_weights(folder: Path) -> None:
    tuning = Tuning(read(folder, "walk.mmdb", "walk.pfnn").parts()["pfnn"])
    assert not tuning.weight_sliders
    assert isinstance(tuning.settings, LocomotionSettings)
    with pytest.raises(UserError, match="cannot weigh otherwise"):
        tuning.set_weight("left_foot_position", 1.0)


def test_a_system_of_other_weights_goes_on_where_the_old_one_is(part: sources.Part) -> None:
    tuning, workshop = Tuning(part), Workshop()
    session = Session({"mm": part.make()}, Stick())
    session.advance(0.2)
    name = tuning.weight_sliders[0].name
    for weight in (1.5, 2.0, 4.0):  # a slider that is dragged
        tuning.set_weight(name, weight)
        workshop.start("mm", tuning)
    made: dict[str, Any] = {}
    deadline = time.monotonic() + 30
    while not made and time.monotonic() < deadline:
        made = workshop.ready()
    assert not workshop.busy and not workshop.ready()
    workshop.close()
    assert made["mm"].database.schema.features[0].weight == 4.0
    before = session.look().actors["mm"]
    tuning.set("velocity_halflife", 0.1)  # moved meanwhile
    tuning.take(session, "mm", made["mm"])
    assert session.actors["mm"].system.settings == tuning.settings == Settings(velocity_halflife=0.1)
    session.single_step()
    after = session.look().actors["mm"]
    np.testing.assert_allclose(after.positions, before.positions, atol=0.05)
