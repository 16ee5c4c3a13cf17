"""The commands that exchange models: what they write, what they say, what they refuse."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import lmm_models
import numpy as np
import pytest
from click.testing import CliRunner, Result

from lmm.cli import main
from lmm.evaluation import decompressor
from lmm.model import RUNTIME, Model
from mm import interchange


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(a) for a in arguments])


def refused(*arguments: object) -> str:
    """The one line of an error."""
    done = run(*arguments)
    assert done.exit_code == 2 and not done.stdout
    lines = done.stderr.splitlines()
    assert len(lines) == 1 and lines[0].startswith("error: "), done.stderr
    return lines[0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database, its model, and one without compressor. It is shared: write nothing into it."""
    folder = tmp_path_factory.mktemp("exchange")
    db = lmm_models.database(crouch=True)
    db.save(folder / "walk.mmdb")
    model = lmm_models.model(db)
    model.save(folder / "walk.lmm")
    replace(model, compressor=None).save(folder / "small.lmm")
    return folder


def test_networks_go_out_and_come_in(folder: Path, tmp_path: Path) -> None:
    model, db, out = folder / "walk.lmm", folder / "walk.mmdb", tmp_path / "out"
    done = run("export", model, "--format", "reference", "-o", out, "--db", db)
    assert done.exit_code == 0, done.output
    names = {*RUNTIME, "latent", "features", "database"}
    assert {path.stem for path in out.iterdir()} == names
    assert all(f"{out / name}.bin: " in done.stdout for name in names)
    assert interchange.import_directory(out).features.shape == lmm_models.database(crouch=True).features.shape

    done = run("import", out, "--db", db, "-o", tmp_path / "again.lmm")
    assert done.exit_code == 0, done.output
    again, before = Model.load(tmp_path / "again.lmm"), Model.load(model)
    assert f"{again.parameters:,} parameters" in done.stdout
    for name, network in before.networks.items():
        for one, other in zip(
            network.to_arrays("").values(), again.networks[name].to_arrays("").values(), strict=True
        ):
            np.testing.assert_array_equal(one, other)
    expected = decompressor.errors(before, lmm_models.database(crouch=True))["position_cm"]["mean"]
    found = again.errors["decompressor"]["all"]["position_cm"]
    assert found == pytest.approx(expected, rel=1e-4) and f"{found:.2f} cm" in done.stdout
    assert ("hardly of this database" in done.stderr) == (found > 10)

    # The latents came along, so that it mixes with the database; smaller files leave them out.
    assert again.compressor is None and again.knows_latents
    facts = json.loads(run("info", tmp_path / "again.lmm", "--json").stdout)
    assert facts["stored_latents_bytes"] == 4 * again.L * again.frames
    assert "MB in the file, of the database's frames" in run("info", tmp_path / "again.lmm").stdout
    small = tmp_path / "small.lmm"
    converted = run("convert", tmp_path / "again.lmm", "-o", small, "--weights", "float16", "--db", db)
    assert converted.exit_code == 0, converted.output
    assert Model.load(small).stored_latents.dtype == np.float16  # type: ignore[union-attr]
    bare = tmp_path / "bare.lmm"
    assert run("convert", small, "-o", bare, "--weights", "int8", "--without-compressor").exit_code == 0
    assert not Model.load(bare).knows_latents


def test_networks_of_other_data_are_said_to_be_off(tmp_path: Path) -> None:
    db = lmm_models.database()
    db.save(tmp_path / "db")
    model = lmm_models.model(db)
    model.decompressor.output_mean[: 3 * 22] += 0.5
    model.save(tmp_path / "model")
    assert run("export", tmp_path / "model", "--format", "reference", "-o", tmp_path).exit_code == 0
    done = run("import", tmp_path, "--db", tmp_path / "db", "-o", tmp_path / "again")
    assert done.exit_code == 0 and done.stderr.startswith("note: ") and done.stderr.count("\n") == 1


def test_onnx_is_written(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    done = run("export", folder / "small.lmm", "--format", "onnx", "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {f"{name}.onnx" for name in RUNTIME}


@pytest.mark.parametrize("model", ["walk", "small"])
def test_conversion_says_what_it_saves_and_costs(folder: Path, tmp_path: Path, model: str) -> None:
    db, rows = lmm_models.database(crouch=True), {}
    for weights in ("float32", "float16", "int8"):
        out = tmp_path / f"{weights}.lmm"
        done = run(
            "convert", folder / f"{model}.lmm", "-o", out, "--weights", weights,
            "--db", folder / "walk.mmdb", "--json",
        )  # fmt: skip
        assert done.exit_code == 0, done.output
        before, rows[weights] = json.loads(done.stdout)
        assert {network.weight_type for network in Model.load(out).networks.values()} == {weights}
        assert rows[weights]["file_bytes"] == out.stat().st_size
        assert rows[weights]["runtime_bytes"] == sum(Model.load(out).memory().values())
        assert rows[weights]["compressor"] == (
            None if model == "small" else "float16" if weights == "int8" else weights
        )
        assert before["weights"] == "float32" and before["stepper_change"] == before["projector_change"] == 0
    assert rows["float32"] == before | {"model": str(tmp_path / "float32.lmm")}
    sizes = [rows[weights]["runtime_bytes"] for weights in ("float32", "float16", "int8")]
    assert sizes == sorted(sizes, reverse=True)
    changes = [rows[weights]["stepper_change"] for weights in ("float32", "float16", "int8")]
    assert changes[0] == 0 < changes[1] < changes[2] < 0.1
    for part in ("training", "held_out"):
        base = before[f"{part}_position_cm"]
        assert rows["int8"][f"{part}_position_cm"] == pytest.approx(base, rel=0.05)
    if model == "walk":
        held_out = ~Model.load(folder / "walk.lmm").training_ranges(db)
        found = decompressor.errors(Model.load(folder / "walk.lmm"), db, ranges=held_out)
        assert 0 < held_out.sum() < len(held_out)
        assert before["held_out_position_cm"] == pytest.approx(found["position_cm"]["mean"], abs=1e-3)


def test_a_model_may_go_without_its_compressor(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.lmm"
    done = run("convert", folder / "walk.lmm", "-o", out, "--weights", "float16", "--without-compressor")
    assert done.exit_code == 0 and "position" not in done.stdout
    assert Model.load(out).compressor is None and str(out) in done.stdout
    assert out.stat().st_size < (folder / "walk.lmm").stat().st_size
    text = refused("export", out, "--format", "reference", "-o", tmp_path, "--db", folder / "walk.mmdb")
    assert "without its compressor" in text


def test_what_cannot_be_done_is_said_before_it_is_begun(folder: Path, tmp_path: Path) -> None:
    model, db = folder / "walk.lmm", folder / "walk.mmdb"
    lmm_models.database().save(tmp_path / "other.mmdb")
    empty = tmp_path / "empty"
    empty.mkdir()
    cases = {
        "no decompressor.bin": ("import", empty, "--db", db, "-o", tmp_path / "x"),
        "a motion database, expected": ("export", db, "--format", "onnx", "-o", tmp_path / "x"),
        "expected a motion database": ("import", empty, "--db", model, "-o", tmp_path / "x"),
        "would be written over": ("convert", model, "-o", model, "--weights", "int8"),
        "--db goes with": ("export", model, "--format", "onnx", "-o", tmp_path / "x", "--db", db),
        "not one of 'reference', 'onnx'": ("export", model, "--format", "bin", "-o", tmp_path / "x"),
        "not one of 'float32'": ("convert", model, "-o", tmp_path / "x", "--weights", "int4"),
        "No such file": ("convert", tmp_path / "no", "-o", tmp_path / "x", "--weights", "int8"),
        "it is a folder": ("convert", model, "-o", empty, "--weights", "int8"),
    }
    for message, arguments in cases.items():
        assert message in refused(*arguments)
    (tmp_path / "stepper.bin").mkdir()
    assert "stepper.bin: cannot write: it is a folder" in refused(
        "export", model, "--format", "reference", "-o", tmp_path
    )
    assert not (tmp_path / "x").exists() and not (tmp_path / "decompressor.bin").exists()


def test_a_database_of_another_model_is_refused(folder: Path, tmp_path: Path) -> None:
    lmm_models.database(fps=30.0).save(tmp_path / "other.mmdb")
    for command in (
        ("convert", folder / "walk.lmm", "-o", tmp_path / "x", "--weights", "int8"),
        ("export", folder / "walk.lmm", "--format", "reference", "-o", tmp_path / "x"),
    ):
        text = refused(*command, "--db", tmp_path / "other.mmdb")
        assert "walk.lmm: the model is not of this database: 60.0 frames per second, not 30.0" in text
    assert not (tmp_path / "x").exists()


def test_a_broken_network_is_refused(folder: Path, tmp_path: Path) -> None:
    assert run("export", folder / "walk.lmm", "--format", "reference", "-o", tmp_path).exit_code == 0
    cut = (tmp_path / "stepper.bin").read_bytes()[:-5]
    (tmp_path / "stepper.bin").write_bytes(cut)
    text = refused("import", tmp_path, "--db", folder / "walk.mmdb", "-o", tmp_path / "x")
    assert "stepper.bin: not the public reference's network, or cut short" in text
    assert not (tmp_path / "x").exists()
