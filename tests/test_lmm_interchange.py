"""The reference's networks: byte for byte, the same answers, and nothing foreign is taken for one."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import lmm_models
import numpy as np
import pytest

from lmm import interchange
from lmm.evaluator import Evaluator
from lmm.model import RUNTIME, Model
from lmm.network import Network
from mm import interchange as databases
from motion import kinematics, quat
from motion.errors import UserError


def _write(path: Path, *sizes: int) -> Path:
    interchange.write_network(path, lmm_models.network(*sizes))
    return path


def _assert_equal(found: Network, expected: Network) -> None:
    one, other = found.to_arrays(""), expected.to_arrays("")
    assert one.keys() == other.keys()
    for name, array in one.items():
        np.testing.assert_array_equal(array, other[name], err_msg=name)


def test_bytes_stand_as_documented(tmp_path: Path) -> None:
    network = lmm_models.network(3, 4, 2)
    interchange.write_network(tmp_path / "network.bin", network)
    three, two = struct.pack("<i", 3), struct.pack("<i", 2)
    expected = three + network.input_mean.tobytes() + three + network.input_std.tobytes()
    expected += two + network.output_mean.tobytes() + two + network.output_std.tobytes()
    expected += struct.pack("<i", 2)  # layers
    expected += struct.pack("<ii", 3, 4) + network.weights[0].tobytes()
    expected += struct.pack("<i", 4) + network.biases[0].tobytes()
    expected += struct.pack("<ii", 4, 2) + network.weights[1].tobytes() + two + network.biases[1].tobytes()
    assert (tmp_path / "network.bin").read_bytes() == expected
    _assert_equal(interchange.read_network(tmp_path / "network.bin"), network)


@pytest.mark.parametrize("kind", ["float16", "int8"])
def test_quantised_weights_are_written_as_what_they_stand_for(tmp_path: Path, kind: str) -> None:
    network = lmm_models.network(6, 9, 4).as_type(kind)  # type: ignore[arg-type]
    interchange.write_network(tmp_path / "network.bin", network)
    found = interchange.read_network(tmp_path / "network.bin")
    assert found.weight_type == "float32"
    x = np.random.default_rng(1).standard_normal((20, 6)).astype(np.float32)
    np.testing.assert_array_equal(found.evaluate(x), network.evaluate(x))


def test_only_relu_can_be_written(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="have ReLU between their layers, this one has ELU"):
        interchange.write_network(tmp_path / "network.bin", lmm_models.network(3, 2, activation="elu"))
    assert not list(tmp_path.iterdir())


# Bad files


def test_every_truncation_and_anything_that_follows_is_refused(tmp_path: Path) -> None:
    path = _write(tmp_path / "network.bin", 3, 4, 2)
    data = path.read_bytes()
    for cut in [*range(0, len(data), 4), len(data) - 1]:
        path.write_bytes(data[:cut])
        with pytest.raises(UserError, match="not the public reference's network, or cut short") as caught:
            interchange.read_network(path)
        assert caught.value.path == str(path) and caught.value.remedy
    path.write_bytes(data + b"\0\0")
    with pytest.raises(UserError, match="2 bytes follow its last array"):
        interchange.read_network(path)


FOREIGN = {
    "empty": b"",
    "text": b"HIERARCHY\nROOT Hips\n{\n" * 50,
    "noise": np.random.default_rng(1).bytes(3000),
    "zeros": bytes(3000),
    "only zeros": bytes(20),
    "negative": struct.pack("<ii", -1, -1) * 20,
    "huge": struct.pack("<ii", 2**31 - 1, 2**31 - 1) * 20,
}


@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN.keys())
def test_foreign_files_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "foreign.bin").write_bytes(content)
    with pytest.raises(UserError, match="not the public reference's network"):
        interchange.read_network(tmp_path / "foreign.bin")


def _layers(path: Path, *, layers: int | None = None, **changes: np.ndarray) -> Path:
    """A file of a network of 3, 4 and 2 whose parts may not fit."""
    parts = lmm_models.network(3, 4, 2).to_arrays("") | changes
    with path.open("wb") as stream:
        for name in ("input_mean", "input_std", "output_mean", "output_std"):
            databases.put(stream, parts[name], 1)
        stream.write(struct.pack("<i", 2 if layers is None else layers))
        for layer in range(2):
            databases.put(stream, parts[f"{layer}.weight"], 2)
            databases.put(stream, parts[f"{layer}.bias"], 1)
    return path


def _of(*shape: int, value: float = 1.0) -> np.ndarray:
    return np.full(shape, value, np.float32)


WRONG = {
    "a layer that does not follow": (
        {"1.weight": _of(5, 2)},
        r"weight of layer 1 .*\(5, 2\), expected .*\(4, 2\)",
    ),
    "a bias too long": ({"0.bias": _of(5)}, r"bias of layer 0 .*\(5,\)"),
    "a mean too short": ({"input_mean": _of(2)}, r"input_mean .*\(2,\), expected .*\(3,\)"),
    "a deviation too long": ({"output_std": _of(3)}, r"output_std .*\(3,\), expected .*\(2,\)"),
    "no layers": ({"layers": 0}, "0 layers"),
    "layers below none": ({"layers": -1}, "-1 layers"),
    "a million layers": ({"layers": 1_000_000}, "1000000 layers"),
    "NaN": ({"1.weight": _of(4, 2, value=np.nan)}, "not all finite"),
    "infinity": ({"output_mean": _of(2, value=np.inf)}, "not all finite"),
    "division by 0": ({"input_std": np.array([1, 0, 1], np.float32)}, "input 1 is divided by 0"),
    "division by less": ({"input_std": np.array([1, 1, -2], np.float32)}, "input 2 is divided by -2"),
}


@pytest.mark.parametrize(("changes", "message"), WRONG.values(), ids=WRONG.keys())
def test_networks_that_do_not_fit_are_refused(tmp_path: Path, changes: dict, message: str) -> None:
    path = _layers(tmp_path / "network.bin", **changes)
    with pytest.raises(UserError, match=message) as caught:
        interchange.read_network(path)
    assert caught.value.path == str(path) and caught.value.remedy and "\n" not in str(caught.value)


def test_a_network_without_width_is_refused(tmp_path: Path) -> None:
    nothing = struct.pack("<i", 0)
    data = 4 * nothing + struct.pack("<i", 1) + struct.pack("<ii", 0, 0) + nothing
    (tmp_path / "network.bin").write_bytes(data)
    with pytest.raises(UserError, match="layers are 0-0 wide"):
        interchange.read_network(tmp_path / "network.bin")


# Folders


@pytest.mark.parametrize("crouch", [False, True])
def test_a_model_comes_back_from_its_folder(tmp_path: Path, crouch: bool) -> None:
    db = lmm_models.database(crouch=crouch)
    model = lmm_models.model(db)
    assert bool(model.description.crouch_tag) == crouch
    paths = interchange.export_directory(model, tmp_path / "out", database=db)
    assert sorted(path.name for path in paths) == sorted(path.name for path in (tmp_path / "out").iterdir())
    assert paths == interchange.outputs(tmp_path / "out", with_database=True)
    np.testing.assert_array_equal(databases.read_latent(tmp_path / "out" / "latent.bin"), model.latents(db))

    again = interchange.import_directory(tmp_path / "out", db)
    for name, network in model.networks.items():
        _assert_equal(again.networks[name], network)
    for name in ("state_low", "state_high", "state_std"):
        np.testing.assert_allclose(getattr(again, name), getattr(model, name), rtol=1e-4, atol=1e-5)
    assert again.compressor is None and again.L == model.L
    np.testing.assert_array_equal(again.latents(db), model.latents(db))
    assert again.description.crouch_tag == model.description.crouch_tag
    again.check(db)
    again.save(tmp_path / "model")
    interchange.export_directory(Model.load(tmp_path / "model"), tmp_path / "twice", database=db)
    for name in (*RUNTIME, "latent"):
        one, other = (tmp_path / folder / f"{name}.bin" for folder in ("out", "twice"))
        assert one.read_bytes() == other.read_bytes(), name


def test_latents_are_the_projector_s_where_none_are_given(tmp_path: Path) -> None:
    db = lmm_models.database(crouch=True)
    model = lmm_models.model(db)
    interchange.export_directory(model, tmp_path)
    again = interchange.import_directory(tmp_path, db)
    crouched = (db.tags & model.description.crouch_tag != 0)[:, None].astype(np.float32)
    assert 0 < crouched.mean() < 1
    answers = model.projector.evaluate(np.concatenate([db.features, crouched], axis=1))[:, model.F :]
    np.testing.assert_allclose(again.latents(db), answers, atol=1e-5)
    np.testing.assert_allclose(again.state_low[model.F :], answers.min(axis=0), atol=1e-5)
    np.testing.assert_allclose(again.state_high[model.F :], answers.max(axis=0), atol=1e-5)


def test_a_projector_that_is_not_asked_to_crouch_stays_so(tmp_path: Path) -> None:
    interchange.export_directory(lmm_models.model(lmm_models.database()), tmp_path)
    again = interchange.import_directory(tmp_path, lmm_models.database(crouch=True))
    assert again.description.crouch_tag == 0
    again.validate()


def test_what_does_not_fit_the_database_is_refused(tmp_path: Path) -> None:
    db = lmm_models.database()
    model = lmm_models.model(db)

    def refused(match: str, **changed: Network | np.ndarray) -> str:
        for path in interchange.export_directory(model, tmp_path):
            interchange.write_network(path, changed.get(path.stem, getattr(model, path.stem)))  # type: ignore[arg-type]
        with pytest.raises(UserError, match=match) as caught:
            interchange.import_directory(tmp_path, db)
        assert caught.value.remedy
        return Path(caught.value.path or "").name

    pose = model.layout.size
    few, other = lmm_models.network(27, 9, pose), lmm_models.network(32, 9, pose + 15)
    assert refused("of 27 inputs and 338 outputs; .*27 features", decompressor=few) == "decompressor.bin"
    assert refused("would have 32 and 338", decompressor=other) == "decompressor.bin"
    assert refused("would have 32 and 32", stepper=lmm_models.network(33, 33)) == "stepper.bin"
    assert refused("would have 27 and 32", projector=lmm_models.network(28, 32)) == "projector.bin"

    interchange.export_directory(model, tmp_path, database=db)
    databases.write_latent(tmp_path / "latent.bin", np.zeros((len(db), 4), np.float32))
    with pytest.raises(UserError, match=r"latents of 480 frames x 4; .* 480 frames .* take 5 latents"):
        interchange.import_directory(tmp_path, db)
    databases.write_latent(tmp_path / "latent.bin", np.full((len(db), 5), np.nan, np.float32))
    with pytest.raises(UserError, match="not all finite"):
        interchange.import_directory(tmp_path, db)
    databases.write_features(tmp_path / "features.bin", db.features, db.offset, db.scale * np.float32(1.01))
    with pytest.raises(UserError, match="normalised otherwise"):
        interchange.import_directory(tmp_path, db)


def test_a_folder_without_networks_is_refused(tmp_path: Path) -> None:
    db = lmm_models.database()
    with pytest.raises(UserError, match=r"no decompressor\.bin in this folder"):
        interchange.import_directory(tmp_path, db)
    interchange.export_directory(lmm_models.model(db), tmp_path)
    (tmp_path / "stepper.bin").unlink()
    with pytest.raises(UserError, match=r"stepper\.bin: cannot read: No such file"):
        interchange.import_directory(tmp_path, db)


def test_an_export_that_cannot_be_whole_leaves_nothing(tmp_path: Path) -> None:
    db = lmm_models.database()
    model = lmm_models.model(db)
    for spoiled, match in (
        (replace(model, compressor=None), "without its compressor"),
        (replace(model, frames=7), "not of this database"),
        (replace(model, stepper=lmm_models.network(32, 32, activation="elu")), "ELU"),
    ):
        with pytest.raises(UserError, match=match):
            interchange.export_directory(spoiled, tmp_path / "new", database=db)
        assert not (tmp_path / "new").exists()


# The official networks


@pytest.mark.parametrize("name", RUNTIME)
def test_official_networks_come_back_byte_for_byte(data: Path, tmp_path: Path, name: str) -> None:
    official = data / "reference" / "orangeduck" / f"{name}.bin"
    interchange.write_network(tmp_path / "network.bin", interchange.read_network(official))
    assert (tmp_path / "network.bin").read_bytes() == official.read_bytes()


def _oracle(data: Path, name: str) -> tuple[Network, np.ndarray, np.ndarray]:
    """An official network, inputs, and what the public reference makes of them."""
    network = interchange.read_network(data / "reference" / "orangeduck" / f"{name}.bin")
    path = data / "reference" / "oracle" / f"network_{name}.csv"
    table = np.loadtxt(path, np.float32, delimiter=",", skiprows=1)
    return network, table[:, : network.sizes[0]], table[:, network.sizes[0] :]


def _assert_near(found: np.ndarray, expected: np.ndarray) -> None:
    """Equal but for the order of float32 sums."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize("name", RUNTIME)
def test_official_networks_answer_as_the_public_reference(data: Path, name: str) -> None:
    network, inputs, expected = _oracle(data, name)
    assert len(inputs) == 32 and expected.shape[1] == network.sizes[-1]
    _assert_near(network.evaluate(inputs), expected)
    _assert_near(Evaluator(network).evaluate(inputs), expected)


@pytest.mark.parametrize("name", RUNTIME)
def test_official_networks_answer_the_same_in_torch(data: Path, name: str) -> None:
    torch = pytest.importorskip("torch")
    network, inputs, expected = _oracle(data, name)
    layers: list = []
    for weight, bias in zip(network.weights, network.biases, strict=True):
        linear = torch.nn.Linear(*weight.shape)
        linear.weight.data, linear.bias.data = torch.tensor(weight.T.copy()), torch.tensor(bias)
        layers += [linear, torch.nn.ReLU()]
    mean_in, std_in, mean_out, std_out = (
        torch.tensor(np.array(a)) for a in list(network.to_arrays("").values())[:4]
    )
    with torch.no_grad():
        found = torch.nn.Sequential(*layers[:-1])((torch.tensor(inputs) - mean_in) / std_in)
    _assert_near((found * std_out + mean_out).numpy(), expected)


def test_official_networks_make_a_model(data: Path, tmp_path: Path) -> None:
    db = databases.import_directory(data / "reference" / "oracle")
    db.save(tmp_path / "db")
    model = interchange.import_directory(data / "reference" / "orangeduck", db)
    assert (model.F, model.L, model.parameters) == (27, 32, 1_360_328)
    model.save(tmp_path / "model")
    interchange.export_directory(Model.load(tmp_path / "model"), tmp_path / "out")
    for name in RUNTIME:
        official = data / "reference" / "orangeduck" / f"{name}.bin"
        assert (tmp_path / "out" / f"{name}.bin").read_bytes() == official.read_bytes(), name


def test_official_rotations_stand_as_our_layout_reads_them(data: Path) -> None:
    """Two columns, row by row: read so they are nearly orthonormal, as two rows of three they are not."""
    db = databases.import_directory(data / "reference" / "oracle")
    model = interchange.import_directory(data / "reference" / "orangeduck", db)
    vectors = model.decompressor.evaluate(model.projector.evaluate(db.features[::10]))
    six = vectors[:, model.layout.slices["rotations"]].reshape(len(vectors), -1, 6)

    def faults(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
        lengths = np.linalg.norm(np.stack([one, other]), axis=-1)
        return np.abs(lengths - 1).mean(), np.abs((one * other).sum(axis=-1)).mean()

    assert max(faults(six[..., 0::2], six[..., 1::2])) < 0.01
    assert min(faults(six[..., :3], six[..., 3:])) > 0.1

    poses, _ = model.layout.unpack(vectors, db.fps)
    np.testing.assert_allclose(np.linalg.norm(poses.rotations, axis=-1), 1, atol=1e-5)
    matrix = quat.to_matrix(poses.rotations[:, 1:])[..., :2]
    assert np.abs(matrix - six.reshape(*six.shape[:2], 3, 2)).mean() < 0.01
    # And positions are those of a human: bones as long as in the reference's own data.
    lengths = np.linalg.norm(poses.positions[:, 2:], axis=-1)
    expected = np.linalg.norm(db.poses.positions[:, 2:], axis=-1).mean(axis=0)
    np.testing.assert_allclose(lengths.mean(axis=0), expected, atol=0.02)
    heads, _ = kinematics.forward(db.skeleton, poses.positions, poses.rotations)
    assert 1.0 < np.median(heads[:, 14, 1]) < 2.0
