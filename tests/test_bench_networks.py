"""``python -m bench networks``: what each row says, on small models, and bad input."""

from __future__ import annotations

import json

import lmm_models
import numpy as np
import pytest
from click.testing import CliRunner

from bench import networks
from bench.cli import main
from lmm import interchange, lanes
from lmm.evaluator import products_here


def bench(*arguments, code=0):
    result = CliRunner().invoke(main, ["networks", *map(str, arguments)])
    assert result.exit_code == code, result.output + result.stderr
    return result


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A model, its database, and its networks in the public format."""
    folder = tmp_path_factory.mktemp("networks")
    database = lmm_models.database()
    model = lmm_models.model(database, hidden=64)
    database.save(folder / "walk.mmdb")
    model.save(folder / "walk.lmm")
    interchange.export_directory(model, folder / "public")
    (folder / "text.lmm").write_text("not a model")
    return folder


QUICK = ("--counts", "1,5", "--repeats", 1)


def test_rows_say_what_each_network_costs_and_loses(folder):
    shown = bench(folder / "walk.lmm", "--db", folder / "walk.mmdb", *QUICK, "--json").stdout
    rows = json.loads(shown)
    kinds = [
        ("ours", "float32"),
        ("ours", "float16"),
        ("ours", "int8"),
        *(("ours", name) for name in ("bfloat16", "bfloat16x2") if name in products_here()),
        ("numpy", "float32"),
        ("loop", "float32"),
    ]
    by = {(row["network"], row["kernel"], row["weights"]): row for row in rows}
    assert list(by) == [
        (name, *kind) for name in ("decompressor", "stepper", "projector", "frame") for kind in kinds
    ]
    for name in ("decompressor", "stepper", "projector"):
        same, half, bytes_ = (by[name, "ours", kind] for kind in ("float32", "float16", "int8"))
        assert same["error_mean"] < 1e-4 and by[name, "loop", "float32"]["error_mean"] < 1e-4
        assert same["error_mean"] < half["error_mean"] < bytes_["error_mean"] < 0.1
        assert same["mb"] > half["mb"] > bytes_["mb"]
        assert by[name, "numpy", "float32"]["error_max"] == 0
        if "bfloat16" in products_here():
            rough = by[name, "ours", "bfloat16"]
            finer = by[name, "ours", "bfloat16x2"]
            assert half["error_mean"] < finer["error_mean"] < rough["error_mean"] < bytes_["error_mean"]
            assert rough["mb"] < same["mb"]
        for count in (1, 5):
            assert same[f"of_loop_{count}"] == pytest.approx(
                same[f"us_{count}"] / by[name, "loop", "float32"][f"us_{count}"]
            )
    cm = [by["decompressor", "ours", kind]["error_cm"] for kind in ("float32", "float16", "int8")]
    assert cm[0] < 1e-3 and cm[0] < cm[1] < cm[2] < 10
    frame = by["frame", "ours", "int8"]
    parts = [by[name, "ours", "int8"]["us_5"] for name in ("decompressor", "stepper", "projector")]
    assert frame["us_5"] == pytest.approx(parts[0] + parts[1] + parts[2] / 6)


def test_a_table_fits_and_a_folder_of_public_networks_will_do(folder):
    shown = bench(folder / "public", *QUICK, "--weights", "float16").stdout
    assert "float16" in shown and "int8" not in shown and "of_loop_5" in shown
    assert networks.load(folder / "public", lmm_models.database()).model is not None


def test_inputs_are_frames_of_the_database(folder):
    database = lmm_models.database()
    found = networks.load(folder / "walk.lmm", database)
    rows = {row.tobytes() for row in database.features}
    width = database.schema.size
    assert all(row.tobytes() in rows for row in found.inputs["decompressor"][:, :width])
    latents = lmm_models.model(database, hidden=64).latents(database)
    spread = found.inputs["stepper"][:, width:].std(axis=0)
    np.testing.assert_allclose(spread, latents.std(axis=0), rtol=0.2)


@pytest.mark.parametrize("activation", ["relu", "elu"])
def test_the_loop_is_the_networks_formula(activation):
    network = lmm_models.network(6, 40, 30, 7, activation=activation)
    x = np.random.default_rng(0).standard_normal((9, 6), np.float32)
    np.testing.assert_allclose(networks.Loop(network).evaluate(x), network.evaluate(x), atol=1e-5)


BAD = {
    "no such model": (("{folder}/none.lmm",), "No such file"),
    "not a model": (("{folder}/text.lmm",), "text.lmm"),
    "a folder without networks": (("{folder}",), "decompressor.bin"),
    "no such database": (("{folder}/walk.lmm", "--database", "{folder}/none"), "No such file"),
    "weights": (("{folder}/walk.lmm", "--weights", "float8"), "no weights of type 'float8'"),
    "weights that nothing multiplies": (
        ("{folder}/walk.lmm", "--weights", "bfloat16"),
        "this processor does not multiply bfloat16 numbers",
    ),
    "counts": (("{folder}/walk.lmm", "--counts", "0"), "not in the range"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_clear_line(case, folder, monkeypatch):
    arguments, expected = BAD[case]
    monkeypatch.setattr(lanes, "MULTIPLIES_PAIRS", False)
    result = bench(*(argument.format(folder=folder) for argument in arguments), code=2)
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1, result.stderr
    assert expected in result.stderr


def test_help_ends_with_an_example():
    assert "Example: python -m bench networks" in " ".join(bench("--help").stdout.split())
