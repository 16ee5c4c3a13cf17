"""The model file: what is stored comes back, and a model of other data is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import lmm_models
import numpy as np
import pytest

from lmm import frames
from lmm.model import KIND, VERSION, Model
from mm.database import Database
from motion import files, quat
from motion.errors import UserError


def _same(one: Model, other: Model) -> None:
    names = ("state_low", "state_high", "state_std")
    for name in names:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name in ("held_out", "database", "ranges", "frames", "training", "errors", "F", "L", "fingerprint"):
        assert getattr(one, name) == getattr(other, name), name
    np.testing.assert_array_equal(one.stored_latents, other.stored_latents)
    for name in ("decompressor", "stepper", "projector", "compressor"):
        mine, its = getattr(one, name), getattr(other, name)
        assert (mine is None) == (its is None)
        if mine is not None:
            arrays = its.to_arrays("")
            assert mine.activation == its.activation and mine.to_arrays("").keys() == arrays.keys()
            for part, array in mine.to_arrays("").items():
                np.testing.assert_array_equal(array, arrays[part])
                assert array.dtype == arrays[part].dtype
    (about, arrays), (again, others) = one.description.to_parts(), other.description.to_parts()
    assert about == again and arrays.keys() == others.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, others[name], err_msg=name)


@pytest.mark.parametrize("kind", ["float32", "float16", "int8"])
@pytest.mark.parametrize("crouch", [False, True])
def test_round_trip(tmp_path: Path, crouch: bool, kind: str) -> None:
    model = lmm_models.model(lmm_models.database(crouch=crouch)).as_type(kind)  # type: ignore[arg-type]
    model.save(tmp_path / "model")
    again = Model.load(tmp_path / "model")
    _same(again, model)
    again.save(tmp_path / "twice")
    assert (tmp_path / "twice").read_bytes() == (tmp_path / "model").read_bytes()


def test_without_compressor(tmp_path: Path) -> None:
    db = lmm_models.database()
    model = replace(lmm_models.model(db), compressor=None)
    model.save(tmp_path / "model")
    _same(Model.load(tmp_path / "model"), model)
    with pytest.raises(UserError, match="stored without its compressor"):
        model.latents(db)


@pytest.mark.parametrize("kind", ["float32", "float16"])
def test_latents_may_be_stored_instead(tmp_path: Path, kind: str) -> None:
    db = lmm_models.database()
    made = lmm_models.model(db)
    latents = made.latents(db).astype(kind)
    model = replace(made, compressor=None, stored_latents=latents)
    model.save(tmp_path / "model")
    again = Model.load(tmp_path / "model")
    _same(again, model)
    found = again.latents(db)
    assert found.dtype == np.float32 and again.knows_latents
    np.testing.assert_array_equal(found, latents.astype(np.float32))
    # Nothing that runs needs them.
    assert model.memory() == made.memory()
    assert again.as_type("int8").stored_latents.dtype == np.float16  # type: ignore[union-attr]
    with pytest.raises(UserError, match="not of this database"):
        again.latents(lmm_models.database(fps=30.0))
    bare = again.without_latents()
    assert not bare.knows_latents
    with pytest.raises(UserError, match="stored without its compressor"):
        bare.latents(db)
    replace(again, stored_latents=latents[1:]).save(tmp_path / "short")
    with pytest.raises(UserError, match="stored_latents"):
        Model.load(tmp_path / "short")


def test_sizes_and_bytes() -> None:
    db = lmm_models.database(crouch=True)
    model = lmm_models.model(db, latents=7)
    assert (model.F, model.L, model.layout.size) == (27, 7, 338)
    assert model.projector.sizes[0] == 28 and list(model.networks) == ["decompressor", "stepper", "projector"]
    memory = model.memory()
    assert memory["statistics"] == 2 * 4 * 27
    assert sum(memory.values()) == memory["statistics"] + sum(n.nbytes for n in model.networks.values())
    assert model.parameters == sum(network.parameters for network in model.networks.values())
    assert repr(model) == f"Model(27 features, 7 latents, {model.parameters:,} parameters)"


def test_weights_are_stored_otherwise_and_the_rest_stays() -> None:
    model = lmm_models.model(lmm_models.database())
    small = model.as_type("int8")
    assert {network.weight_type for network in small.networks.values()} == {"int8"}
    assert small.compressor is not None and small.compressor.weight_type == "float16"
    assert small.description is model.description and small.held_out == model.held_out
    assert model.decompressor.weight_type == "float32"  # as it was


def test_what_is_held_out_is_held_out_with_its_mirror() -> None:
    db = lmm_models.database()
    model = lmm_models.model(db)
    trained = model.training_ranges(db)
    names = [name for name, mine in zip(db.names, trained, strict=True) if not mine]
    assert model.held_out == ("run",) and names == ["run", "run"] and trained.sum() == 2
    assert db.mirrored[~trained].tolist() == [False, True]


# Latents


def test_the_compressor_sees_the_joints_in_the_root_s_space() -> None:
    db = lmm_models.database()
    seen = frames.compressor_inputs(db, np.array([5, 300]))
    model = lmm_models.model(db)
    assert seen.shape[1] == frames.compressor_size(model.layout)
    np.testing.assert_array_equal(seen[:, :338], model.layout.pack(db, np.array([5, 300])))
    joints = len(db.skeleton)
    poses = db.poses[np.array([5, 300])]
    for row, frame in enumerate((5, 300)):
        # By hand: along the chain to the head, the root at the origin.
        chain = db.skeleton.chain(db.skeleton.role("head"))[1:]
        place, turned = np.zeros(3), np.array([1.0, 0, 0, 0])
        for j in chain:
            place = place + quat.rotate(turned, poses.positions[row, j].astype(float))
            turned = quat.mul(turned, poses.rotations[row, j].astype(float))
        head = int(chain[-1]) - 1
        found = seen[row, 338:][: 3 * (joints - 1)].reshape(-1, 3)[head]
        np.testing.assert_allclose(found, place, atol=1e-5, err_msg=str(frame))
        six = seen[row, 338 + 3 * (joints - 1) :][: 6 * (joints - 1)].reshape(-1, 3, 2)[head]
        np.testing.assert_allclose(six, quat.to_matrix(turned)[:, :2], atol=1e-5)
    assert seen.shape == (2, 338 + 15 * (joints - 1))


def test_where_the_clip_was_in_the_world_does_not_matter() -> None:
    """The same motion, walked elsewhere in another direction, has the same latents."""
    db = lmm_models.database()
    model, poses = lmm_models.model(db), db.poses.copy()
    turn = quat.from_yaw(2.0)
    poses.positions[:, 0] = quat.rotate(turn, poses.positions[:, 0].astype(float)) + np.array([30, 0, -7])
    poses.rotations[:, 0] = quat.mul(turn, poses.rotations[:, 0].astype(float))
    for rates in (poses.velocities, poses.angular_velocities):
        rates[:, 0] = quat.rotate(turn, rates[:, 0].astype(float))
    latents = model.latents(db)
    assert latents.shape == (480, 5) and latents.dtype == np.float32 and latents.std(axis=0).min() > 0.01
    np.testing.assert_allclose(model.latents(replace(db, poses=poses)), latents, atol=1e-3)


def test_latents_in_pieces_are_those_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    db = lmm_models.database()
    model = lmm_models.model(db)
    whole = model.latents(db)
    monkeypatch.setattr("lmm.model.CHUNK", 7)
    np.testing.assert_allclose(model.latents(db), whole, atol=1e-5)


# Other data


def _other(db: Database, what: str) -> Database:
    skeleton = db.skeleton
    names = (*skeleton.names[:-1], "Tail")
    return {
        "joints": lambda: replace(db, skeleton=replace(skeleton, names=names)),
        "schema": lambda: lmm_models.database(schema="lmm27"),
        "rate": lambda: lmm_models.database(fps=30.0),
        "contacts": lambda: replace(db, contact_roles=("left_foot", "right_foot")),
        "tags": lambda: lmm_models.database(crouch=True),
        "ranges": lambda: replace(db, starts=db.starts[:1], stops=db.stops[-1:]),
        "frames": lambda: replace(db, features=db.features[:-1]),
        "offset": lambda: replace(db, offset=db.offset + np.float32(0.001) * db.scale),
        "scale": lambda: replace(db, scale=db.scale * np.float32(1.001)),
    }[what]()


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("joints", "other joints"),
        ("schema", "other schema"),
        ("rate", "60.0 frames per second, not 30.0"),
        ("contacts", "other contacts"),
        ("tags", "other tags"),
        ("ranges", "4 ranges, not 1"),
        ("frames", "480 frames, not 479"),
        ("offset", "features normalised otherwise"),
        ("scale", "features normalised otherwise"),
    ],
)
def test_a_model_of_other_data_is_refused(what: str, message: str) -> None:
    db = lmm_models.database()
    model = lmm_models.model(db)
    with pytest.raises(UserError, match=f"not of this database: {message}") as caught:
        model.check(_other(db, what), "walk.lmm")
    assert caught.value.path == "walk.lmm" and caught.value.remedy


def test_the_same_clips_built_elsewhere_are_the_same_database() -> None:
    """Rounding differs between machines, and with it the fingerprint."""
    db = lmm_models.database()
    model = lmm_models.model(db)
    model.check(db)
    noise = 1 + 1e-6 * np.random.default_rng(1).standard_normal(27)
    model.check(
        replace(
            db,
            fingerprint="another",
            features=(db.features * noise).astype(np.float32),
            offset=(db.offset * noise).astype(np.float32),
            scale=(db.scale * noise).astype(np.float32),
        )
    )


# Bad files


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model"
    lmm_models.model(lmm_models.database(), latents=2, hidden=3).save(path)
    data = path.read_bytes()
    for cut in [*range(0, len(data), 997), len(data) - 1]:
        path.write_bytes(data[:cut])
        with pytest.raises(UserError, match=r"cut short|damaged") as caught:
            Model.load(path)
        assert caught.value.path == str(path) and caught.value.remedy


def test_a_database_is_no_model(tmp_path: Path) -> None:
    lmm_models.database().save(tmp_path / "db")
    with pytest.raises(UserError, match=f"a motion database, expected a {KIND}"):
        Model.load(tmp_path / "db")


def _without(arrays: dict, *names: str) -> dict:
    return {name: array for name, array in arrays.items() if name not in names}


def _network(name: str, *sizes: int) -> dict:
    return lmm_models.network(*sizes).to_arrays(f"{name}.")


WRONG = {
    "a network that is missing": (lambda m, a: (m, _without(a, "stepper.1.weight")), "stepper.1.weight"),
    "a network of another pose": (lambda m, a: (m, a | _network("decompressor", 32, 3, 337)), "decompressor"),
    "a stepper of fewer latents": (lambda m, a: (m, a | _network("stepper", 31, 3, 3, 31)), "stepper of 31"),
    "a projector asked more": (lambda m, a: (m, a | _network("projector", 28, 3, 3, 32)), "projector of 28"),
    "another compressor": (lambda m, a: (m, a | _network("compressor", 9, 16, 5)), "compressor of 9 inputs"),
    "weights that do not follow": (
        lambda m, a: (m, a | {"stepper.1.weight": np.zeros((17, 16), np.float32)}), "weight of layer 1"),
    "weights of doubles": (
        lambda m, a: (m, a | {"stepper.1.weight": np.zeros((16, 16))}), "weight of layer 1 are float64"),
    "division by 0": (
        lambda m, a: (m, a | {"stepper.input_std": np.zeros(32, np.float32)}), "input 0 is divided by 0"),
    "a range too short": (lambda m, a: (m, a | {"state_low": np.zeros(31, np.float32)}), "state_low are"),
    "a range missing": (lambda m, a: (m, _without(a, "state_std")), "no 'state_std'"),
    "an unknown network": (lambda m, a: (m | {"activations": {"dreamer": "relu"}}, a), "dreamer"),
    "an unknown activation": (
        lambda m, a: (m | {"activations": m["activations"] | {"stepper": "tanh"}}, a), "activation 'tanh'"),
    "no description": (lambda m, a: (m | {"description": {}}, a), "no 'skeleton'"),
    "no frames": (lambda m, a: ({k: v for k, v in m.items() if k != "frames"}, a), "no 'frames'"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "message"), WRONG.values(), ids=WRONG.keys())
def test_a_file_whose_parts_do_not_fit_is_refused(tmp_path: Path, change, message: str) -> None:
    """The checksum is right, but what it is of is no model."""
    path = tmp_path / "model"
    lmm_models.model(lmm_models.database()).save(path)
    metadata, arrays, _ = files.load(path, KIND, VERSION)
    metadata = {key: value for key, value in metadata.items() if key not in ("format", "version")}
    metadata, arrays = change(metadata, {name: np.array(array) for name, array in arrays.items()})
    files.save(path, KIND, VERSION, metadata, arrays)
    with pytest.raises(UserError, match=f"damaged {KIND}: .*{message}") as caught:
        Model.load(path)
    assert caught.value.path == str(path) and "\n" not in str(caught.value)
