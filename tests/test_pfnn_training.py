"""Training of phase-functioned networks: the blend of weights, what it learns, repeats, goes on, refuses."""

from __future__ import annotations

from dataclasses import replace

import lmm_models
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from lmm.evaluation.phase import free_run, joint_errors, windows  # noqa: E402
from lmm.locomotion.labelling import labels_of  # noqa: E402
from lmm.pfnn.model import PhaseModel  # noqa: E402
from lmm.pfnn.spline import coefficients  # noqa: E402
from lmm.training import pfnn_settings  # noqa: E402
from lmm.training.checkpoint import Checkpoint  # noqa: E402
from lmm.training.data import LIBRARIES  # noqa: E402
from lmm.training.locomotion import WORK  # noqa: E402
from lmm.training.mixed_networks import PhaseLayers  # noqa: E402
from lmm.training.pfnn import PhaseData, PhaseStage  # noqa: E402
from lmm.training.train_locomotion import train  # noqa: E402
from mm.database import Database  # noqa: E402
from motion.errors import Note, UserError  # noqa: E402


def settings(recipe: str = "ours", *, held_out: float = 0.3, seed: int = 0, **changes: object):
    """A training of a second or two."""
    found = pfnn_settings.preset(recipe, "smoke")
    small = {"iterations": 150, "batch": 32, "window": 2, "hidden": (48, 48), "evaluate": 50} | changes
    return replace(found, pfnn=replace(found.pfnn, **small), held_out=held_out, seed=seed, threads=1)


@pytest.fixture(scope="module")
def database() -> Database:
    return lmm_models.database()


@pytest.fixture(scope="module")
def data(database) -> PhaseData:
    return PhaseData(database, labels_of(database), ("run",))


@pytest.fixture(scope="module")
def trained(database, tmp_path_factory) -> PhaseModel:
    return train(database, tmp_path_factory.mktemp("trained") / "walk.pfnn", settings())


def layers(*sizes: int) -> PhaseLayers:
    """Of random numbers, biases and normalisation too."""
    found, rng = PhaseLayers(sizes, seed=1, name="any"), np.random.default_rng(2)
    with torch.no_grad():
        for bias in found.biases:
            bias.normal_(generator=torch.Generator().manual_seed(3))
    ends = {"input_mean": 0, "input_std": 0, "output_mean": -1, "output_std": -1}
    found.normalise(**{n: rng.uniform(0.5, 2, sizes[i]).astype(np.float32) for n, i in ends.items()})
    return found


def test_a_batch_is_what_weights_blended_sample_by_sample_give() -> None:
    """Outputs and gradients of four products are those of a blend for each sample (REFERENCE 4.1)."""
    network, rng = layers(7, 12, 12, 5), np.random.default_rng(0)
    x = torch.from_numpy(rng.standard_normal((30, 7)).astype(np.float32))
    shares = torch.from_numpy(coefficients(rng.uniform(0, 2 * np.pi, 30)).astype(np.float32))
    aim = torch.from_numpy(rng.standard_normal((30, 5)).astype(np.float32))

    def naive() -> torch.Tensor:
        rows = []
        for row, share in zip(x, shares, strict=True):
            h = row
            for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
                h = torch.nn.functional.elu(h) if i else h
                h = h @ (share[:, None, None] * weight).sum(0) + (share[:, None] * bias).sum(0)
            rows.append(h)
        return torch.stack(rows)

    both = []
    for outputs in (network.inner(x, shares), naive()):
        network.zero_grad()
        (outputs * aim).sum().backward()
        both.append([outputs.detach(), *(parameter.grad.clone() for parameter in network.parameters())])
    for ours, expected in zip(*both, strict=True):
        np.testing.assert_allclose(ours, expected, rtol=1e-4, atol=1e-5)


def test_the_network_of_torch_and_the_stored_one_agree() -> None:
    network, rng = layers(9, 16, 16, 16, 6), np.random.default_rng(1)
    x, phases = rng.standard_normal((50, 9)).astype(np.float32), rng.uniform(-7, 14, 50)
    found = network.evaluate(x, phases, chunk=20)
    np.testing.assert_allclose(found, network.network().evaluate(x, phases), atol=2e-5)


def test_dropout_leaves_a_share_and_draws_what_it_is_given() -> None:
    network = layers(40, 6)
    x, shares = torch.ones(2000, 40), torch.full((2000, 4), 0.25)

    def draw(seed: int) -> torch.Tensor:
        return network.inner(x, shares, keep=0.7, draw=torch.Generator().manual_seed(seed)).detach()

    assert torch.equal(draw(1), draw(1)) and not torch.equal(draw(1), draw(2))
    whole = network.inner(x, shares).detach()
    np.testing.assert_allclose(draw(1).mean(dim=0), whole.mean(dim=0), atol=0.1)


def test_windows_stay_within_ranges_and_off_those_held_out(database, data) -> None:
    of_row = database.ranges()[data.frames.frame]
    for window in (1, 2, 30):
        for part in ("training", "held_out"):
            rows = data.starts(window, part)
            assert len(rows) and np.array_equal(of_row[rows], of_row[rows + window - 1])
            names = {database.names[r] for r in of_row[rows]}
            assert names == ({"run"} if part == "held_out" else set(database.names) - {"run"})
        lengths = database.stops - database.starts - 2
        assert len(windows(data.frames.frame, window)) == (lengths - window + 1).clip(0).sum()
    assert len(windows(data.frames.frame, 10_000)) == 0


def test_the_vectors_take_the_memory_that_is_told(database, data) -> None:
    taken = data.frames.x.nbytes + data.frames.y.nbytes
    told = data.memory() - LIBRARIES - WORK
    assert taken < told < 1.1 * taken


def test_a_network_that_knows_the_data_runs_freely_on_it(database, data) -> None:
    """Errors are those of what is fed back: 0 for the truth, by as much as joints are off for others."""
    found, layout = data.frames, data.layout
    rows = data.sample(20, "training", window=40)
    off = np.zeros(layout.output_size, np.float32)
    off[layout.outputs["positions"].start :: 3][: layout.joints] = 0.02

    class Truth:
        def __init__(self, by: float) -> None:
            self.step, self.by, self.seen = -1, by, []

        def evaluate(self, x, phases):
            self.step += 1
            self.seen.append((x.copy(), phases.copy()))
            return found.y[rows + self.step] + self.by * off

    for by in (0, 1):
        network = Truth(by)
        for step, y in enumerate(free_run(network, found, rows, layout, fps=60.0, steps=40)):
            errors = joint_errors(y, found.y[rows + step], layout)
            np.testing.assert_allclose(errors, 2 * by, atol=1e-4)
        x, phases = network.seen[-1]
        turned = np.mod(phases - found.phase[rows + 39] + 1, 2 * np.pi) - 1
        np.testing.assert_allclose(turned, 0, atol=1e-3)
        expected = found.x[rows + 39].copy()
        expected[:, layout.inputs["positions"]] += by * off[layout.outputs["positions"]]
        np.testing.assert_allclose(x, expected, atol=2e-4)


def test_a_run_in_training_goes_on_from_what_was_put_out(data) -> None:
    """The true outputs lead to the true inputs of the frame to come, others to theirs."""
    stage = PhaseStage(data, settings())
    stage.begin()
    layout, rows = data.layout, torch.from_numpy(data.starts(2))
    truth, y = stage._x[rows + 1], stage._y[rows]
    np.testing.assert_allclose(stage._fed_back(truth, y), truth, atol=2e-3)
    moved = stage._fed_back(truth, y + 1) - truth
    for block in ("positions", "velocities"):
        np.testing.assert_allclose(moved[:, layout.inputs[block]], 1, atol=2e-3)
    way = moved[:, layout.inputs["path"]][:, :12]
    assert way[:, :7].abs().max() < 2e-3  # the past, and where it is now
    # Little of what is asked counts soon, most of it late.
    assert (way[:, 7:].diff(dim=1) < 0).all() and 0.7 < way[:, 7].mean() < 1 and way[:, 11].mean() < 0.3


def test_training_learns_more_than_the_mean_and_keeps_clips_apart(database, trained) -> None:
    assert trained.held_out and set(trained.held_out) < set(database.names)
    assert trained.database == database.fingerprint and trained.contacts[0] == "left_heel"
    assert trained.network.sizes[1:-1] == (48, 48)
    errors = trained.errors["pfnn"]
    assert set(errors) == {"training", "held_out"}
    of_all = PhaseData(database, labels_of(database), trained.held_out)
    rows = of_all.starts(1)
    mean = of_all.frames.y[rows].mean(axis=0, keepdims=True).repeat(len(rows), axis=0)
    of_the_mean = joint_errors(mean, of_all.frames.y[rows], of_all.layout).mean()
    found = errors["training"]
    assert found["error_cm"] < 0.5 * of_the_mean
    assert found["error_cm"] < found["after_30_cm"] and np.isfinite(found["after_60_cm"])
    assert errors["held_out"]["error_cm"] < 30  # of another gait, which is no reason to burst
    # Errors are those of the network that is written.
    y = trained.network.evaluate(of_all.frames.x[rows], of_all.frames.phase[rows])
    assert joint_errors(y, of_all.frames.y[rows], of_all.layout).mean() == pytest.approx(
        found["error_cm"], rel=1e-3
    )


def test_the_same_seed_gives_the_same_model_and_goes_on_to_it(
    database, trained, tmp_path, monkeypatch
) -> None:
    brief = [
        train(database, tmp_path / f"seed-{seed}", settings(seed=seed, held_out=0.0, iterations=3))
        for seed in (0, 1)
    ]
    assert not np.array_equal(brief[0].network.weights[0], brief[1].network.weights[0])
    write = Checkpoint.save

    def save(self, path):
        write(self, path)
        if self.iteration == 30:
            raise KeyboardInterrupt

    monkeypatch.setattr(Checkpoint, "save", save)
    often = replace(settings(), checkpoint_seconds=0.0)
    with pytest.raises(KeyboardInterrupt):
        train(database, tmp_path / "again", often)
    monkeypatch.undo()
    resumed = train(database, tmp_path / "again", settings(), resume=True)
    assert {path.name for path in tmp_path.glob("again*")} == {"again", "again.jsonl"}
    for ours, theirs in zip(resumed.network.weights, trained.network.weights, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert PhaseModel.load(tmp_path / "again").errors == trained.errors


def test_the_published_recipe_trains_too(database, tmp_path) -> None:
    model = train(database, tmp_path / "reference", settings("reference", iterations=30))
    lines = (tmp_path / "reference.jsonl").read_text()
    assert '"weights"' in lines and model.training["settings"]["recipe"] == "reference"
    assert np.isfinite(model.network.evaluate(np.zeros((1, model.layout.input_size)), [1.0])).all()


def test_clips_without_a_gait_are_left_out_and_told(database, tmp_path) -> None:
    """Somebody who is thrown about in the air, beside two who walk."""
    thrown = lmm_models.thrown(database, "run")
    three = replace(thrown, names=("run", "run", "straight", "walk"), mirrored=np.zeros(4, bool))
    with pytest.warns(Note, match="^1 of 3 clips is left out.*run .neither foot touches the ground"):
        model = train(three, tmp_path / "m", settings(iterations=2))
    assert model.training["left_out"] == ["run"] and set(model.held_out) < {"straight", "walk"}
    with pytest.warns(Note):
        data = PhaseData(three, labels_of(three), model.held_out)
    kept = three.ranges()[data.frames.frame]
    assert {three.names[r] for r in kept} == {"straight", "walk"}
    assert data.count() == len(data.starts(1))
    with pytest.raises(UserError, match="a database of one clip"), pytest.warns(Note):
        train(thrown, tmp_path / "n", settings())


def test_a_database_that_does_not_do_is_one_line(database, tmp_path) -> None:
    with pytest.raises(UserError, match="no clip is as long as a window, 5002 frames"):
        train(database, tmp_path / "m", settings(window=5000))
    alone = replace(database, names=("one",) * len(database.names))
    with pytest.raises(UserError, match="a database of one clip"):
        train(alone, tmp_path / "m", settings())
    other = replace(database, contact_roles=("left_hand", "right_hand"))
    with pytest.raises(UserError, match="its contact 'left_hand' is none of left_heel, left_toe"):
        train(other, tmp_path / "m", settings())
    assert not list(tmp_path.iterdir())
