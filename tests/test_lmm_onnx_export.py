"""The networks as ONNX: another runtime gives what ours gives, and the files say what the numbers are."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import lmm_models
import numpy as np
import pytest

from lmm import interchange, onnx_export
from lmm.evaluator import Evaluator
from lmm.model import RUNTIME, Model
from lmm.network import Network
from motion.errors import UserError

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")


def _session(model: Path | bytes) -> onnxruntime.InferenceSession:
    content = model if isinstance(model, bytes) else str(model)
    return onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])


def _run(session: onnxruntime.InferenceSession, x: np.ndarray) -> np.ndarray:
    return session.run(None, {session.get_inputs()[0].name: x})[0]


def _inputs(network: Network, rows: int) -> np.ndarray:
    """Inputs where those of training would be."""
    numbers = np.random.default_rng(rows).standard_normal((rows, network.sizes[0])).astype(np.float32)
    return numbers * network.input_std + network.input_mean


def _assert_near(found: np.ndarray, expected: np.ndarray) -> None:
    """Equal but for the order of float32 sums."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-6 * np.abs(expected).max())


@pytest.fixture(scope="module", params=[False, True], ids=["", "crouch"])
def model(request: pytest.FixtureRequest) -> Model:
    return lmm_models.model(lmm_models.database(crouch=request.param))


@pytest.mark.parametrize("kind", ["float32", "float16", "int8"])
def test_onnxruntime_answers_as_our_runtime(tmp_path: Path, model: Model, kind: str) -> None:
    """The obvious evaluation and the compiled one, for any number of rows; stored weights stay small."""
    stored = model.as_type(kind)  # type: ignore[arg-type]
    paths = onnx_export.export_directory(stored, tmp_path)
    assert paths == onnx_export.outputs(tmp_path) and [path.stem for path in paths] == list(RUNTIME)
    for path in paths:
        network = stored.networks[path.stem]
        onnx.checker.check_model(str(path), full_check=True)
        session = _session(path)
        for rows in (0, 1, 7, 300):
            x = _inputs(network, rows)
            found = _run(session, x)
            assert found.shape == (rows, network.sizes[-1])
            if rows:
                _assert_near(found, network.evaluate(x))
                _assert_near(found, Evaluator(network).evaluate(x))
        weights = [init for init in onnx.load(path).graph.initializer if init.name.startswith("weight")]
        types = {onnx.helper.tensor_dtype_to_np_dtype(init.data_type) for init in weights}
        assert types == {np.dtype(kind)}


def test_elu_is_exported_too() -> None:
    network = lmm_models.network(5, 9, 9, 4, activation="elu")
    made = onnx_export.to_onnx(network, "compressor", "frame", "latent")
    x = _inputs(network, 50)
    _assert_near(_run(_session(made.SerializeToString()), x), network.evaluate(x))
    relu = replace(network, activation="relu")
    assert np.abs(relu.evaluate(x) - network.evaluate(x)).max() > 0.1


def test_the_files_say_what_their_numbers_are(tmp_path: Path, model: Model) -> None:
    paths = {path.stem: path for path in onnx_export.export_directory(model, tmp_path)}
    ends = {name: _session(path) for name, path in paths.items()}
    names = {n: (s.get_inputs()[0].name, s.get_outputs()[0].name) for n, s in ends.items()}
    assert names == {
        "decompressor": ("state", "pose"),
        "stepper": ("state", "rate"),
        "projector": ("query", "state"),
    }
    about = {
        key: json.loads(text)
        for key, text in ends["decompressor"].get_modelmeta().custom_metadata_map.items()
    }
    assert about == json.loads(json.dumps(onnx_export.describe(model)))
    widths = {s.get_inputs()[0].name: s.get_inputs()[0].shape for s in ends.values()}
    assert widths == {"state": ["batch", len(about["state"])], "query": ["batch", len(about["query"])]}
    assert about["state"][: model.F] == list(model.description.schema.columns)
    assert about["joints"] == list(model.description.skeleton.names) and about["fps"] == 60
    assert len(about["query"]) == model.F + bool(model.description.crouch_tag)
    blocks = [(block["start"], block["stop"]) for block in about["pose"]]
    assert blocks[0][0] == 0 and blocks[-1][1] == ends["decompressor"].get_outputs()[0].shape[1]
    assert all(one[1] == other[0] for one, other in pairwise(blocks))


def test_a_frame_can_be_run_from_the_files_alone(tmp_path: Path, model: Model) -> None:
    """Projection, a step and a pose by what the metadata says, without a line of ours."""
    run = {path.stem: _session(path) for path in onnx_export.export_directory(model, tmp_path)}
    about = {k: json.loads(v) for k, v in run["stepper"].get_modelmeta().custom_metadata_map.items()}
    db = lmm_models.database(crouch=bool(model.description.crouch_tag))
    raw = db.features[:3] * db.scale + db.offset
    query = (raw - np.array(about["offset"], np.float32)) / np.array(about["scale"], np.float32)
    query = np.pad(query, ((0, 0), (0, len(about["query"]) - model.F)))
    state = _run(run["projector"], query)
    state = state + _run(run["stepper"], state) / np.float32(about["fps"])
    pose = _run(run["decompressor"], state)

    expected = model.projector.evaluate(query)
    expected = expected + model.stepper.evaluate(expected) / np.float32(60)
    poses, contacts = model.layout.unpack(model.decompressor.evaluate(expected), 60)
    block = {block["what"]: slice(block["start"], block["stop"]) for block in about["pose"]}
    positions = pose[:, block["positions"]].reshape(3, len(about["joints"]) - 1, 3)
    np.testing.assert_allclose(positions, poses.positions[:, 1:], atol=1e-4)
    np.testing.assert_array_equal(pose[:, block["contacts"]] > 0.5, contacts)


def test_the_same_model_gives_the_same_bytes(tmp_path: Path, model: Model) -> None:
    one = onnx_export.export_directory(model, tmp_path / "one")
    other = onnx_export.export_directory(model, tmp_path / "other")
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in other]


@pytest.mark.parametrize("name", RUNTIME)
def test_official_networks_answer_the_same_in_onnxruntime(data: Path, name: str) -> None:
    network = interchange.read_network(data / "reference" / "orangeduck" / f"{name}.bin")
    table = np.loadtxt(
        data / "reference" / "oracle" / f"network_{name}.csv", np.float32, delimiter=",", skiprows=1
    )
    made = onnx_export.to_onnx(network, name, *onnx_export.ENDS[name])
    found = _run(_session(made.SerializeToString()), table[:, : network.sizes[0]])
    _assert_near(found, table[:, network.sizes[0] :])


def test_without_onnx_the_hint_says_what_to_install(
    tmp_path: Path, model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)  # as Python knows one that is not there
    with pytest.raises(UserError, match=r"onnx is not installed; pip install 'motion-matching\[export\]'"):
        onnx_export.export_directory(model, tmp_path / "new")
    assert not (tmp_path / "new").exists()
