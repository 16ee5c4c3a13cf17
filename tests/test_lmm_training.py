"""Training from a database to a model: what it learns, keeps apart, repeats, and refuses."""

from __future__ import annotations

from dataclasses import replace

import lmm_models
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from lmm import stages  # noqa: E402
from lmm.model import Model  # noqa: E402
from lmm.training import settings as settings_of  # noqa: E402
from lmm.training.checkpoint import Checkpoint  # noqa: E402
from lmm.training.closed_loop import ClosedLoopStage  # noqa: E402
from lmm.training.data import Data, floored, spread  # noqa: E402
from lmm.training.decompressor import DecompressorStage  # noqa: E402
from lmm.training.networks import Perceptron  # noqa: E402
from lmm.training.projector import ProjectorStage, kinds  # noqa: E402
from lmm.training.randomness import generator  # noqa: E402
from lmm.training.stepper import StepperStage  # noqa: E402
from lmm.training.train import train  # noqa: E402
from motion.errors import UserError  # noqa: E402


def settings(recipe: str = "ours", **changes: object):
    """A training of a second or two."""
    found = settings_of.preset(recipe, "smoke")
    small = {
        "decompressor": replace(found.decompressor, iterations=150, batch=64, hidden=(64,), evaluate=50),
        "stepper": replace(found.stepper, iterations=60, batch=32, hidden=(48, 48), evaluate=30),
        "projector": replace(found.projector, iterations=60, batch=64, hidden=(48, 48), evaluate=30),
    }
    if found.closed_loop is not None:
        small["closed_loop"] = replace(found.closed_loop, iterations=40, batch=64, evaluate=20)
    common = {"latent": 8, "compressor": (48, 48), "held_out": 0.3, "threads": 1}
    return replace(found, **(small | common | changes))


def brief(recipe: str = "ours", **changes: object):
    """A training that learns nothing, for what needs no more than that all stages were gone through."""
    found = settings(recipe, **changes)
    few = {"decompressor": 20, "stepper": 10, "projector": 10, "closed_loop": 12}
    plans = ((name, getattr(found, name), count) for name, count in few.items())
    return replace(
        found, **{name: replace(plan, iterations=n, evaluate=n // 2) for name, plan, n in plans if plan}
    )


@pytest.fixture(scope="module")
def database():
    return lmm_models.database()


@pytest.fixture(scope="module")
def trained(database, tmp_path_factory):
    return train(database, tmp_path_factory.mktemp("trained") / "walk.lmm", settings())


@pytest.fixture(scope="module")
def briefly(database, tmp_path_factory):
    return train(database, tmp_path_factory.mktemp("briefly") / "walk.lmm", brief())


def test_training_writes_a_model_that_knows_the_data(database, trained, tmp_path):
    assert trained.held_out and set(trained.held_out) < set(database.names)
    trained.check(database)
    assert np.isfinite(trained.latents(database)).all()
    states = np.hstack([database.features, trained.latents(database)])
    states = states[trained.training_ranges(database)[database.ranges()]].astype(np.float64)
    np.testing.assert_allclose(trained.state_std, states.std(axis=0), rtol=1e-5)
    errors = trained.errors["decompressor"]
    for stage in ("decompressor", "stepper", "projector", "closed_loop"):
        assert set(trained.errors[stage]) == {"training", "held_out"}, stage
    layout = trained.layout
    mean = layout.pack(database).mean(axis=0, keepdims=True).repeat(len(database), axis=0)
    data = Data(database, trained.held_out)
    stage = DecompressorStage(data, settings())
    stage.begin()
    of_the_mean = stage.joint_errors(mean, np.arange(len(database))).mean()
    assert errors["training"]["error_cm"] < 0.3 * of_the_mean  # it has learned more than the mean pose


def test_the_same_seed_gives_the_same_model_and_another_another(database, briefly, tmp_path):
    again = train(database, tmp_path / "again.lmm", brief())
    other = train(database, tmp_path / "other.lmm", brief(seed=1))
    assert again.fingerprint == briefly.fingerprint != other.fingerprint
    assert Model.load(tmp_path / "again.lmm").fingerprint == again.fingerprint
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "again.lmm", "again.lmm.jsonl", "other.lmm", "other.lmm.jsonl"
    ]  # fmt: skip


@pytest.mark.parametrize("stage", ["stepper", "projector", "closed_loop", ""])
def test_a_training_goes_on_at_any_stage_to_the_same_model(database, briefly, tmp_path, monkeypatch, stage):
    """Stages that are done are not begun again: those that follow must do without."""
    write = Checkpoint.save

    def save(self, path):
        write(self, path)
        if self.stage == stage:
            raise KeyboardInterrupt

    monkeypatch.setattr(Checkpoint, "save", save)
    with pytest.raises(KeyboardInterrupt):
        train(database, tmp_path / "walk.lmm", brief())
    monkeypatch.undo()
    resumed = train(database, tmp_path / "walk.lmm", brief(), resume=True)
    assert resumed.fingerprint == briefly.fingerprint


def test_the_published_recipe_trains_too(database, tmp_path):
    model = train(database, tmp_path / "reference.lmm", brief("reference"))
    assert model.training["settings"]["recipe"] == "reference"
    assert np.isfinite([network.evaluate(np.zeros((1, network.sizes[0]), np.float32)).sum()
                        for network in model.networks.values()]).all()  # fmt: skip


def test_windows_stay_within_clips_and_off_those_held_out(database):
    held = (database.names[0],)
    data = Data(database, held)
    for window in (1, 2, 20):
        starts = data.starts(window)
        ranges = database.ranges()
        assert np.array_equal(ranges[starts], ranges[starts + window - 1])
        assert not {database.names[r] for r in np.unique(ranges[starts])} & set(held)
        lengths = (database.stops - database.starts)[data.ranges["training"]]
        assert len(starts) == (lengths - window + 1).clip(0).sum()
    both = np.concatenate([data.frames["training"], data.frames["held_out"]])
    assert np.array_equal(np.sort(both), np.arange(len(database)))


def test_a_stepper_can_run_on_and_its_first_step_is_the_networks_rate(database, trained):
    state = stages.LatentState.of(
        np.hstack([database.features[:5], trained.latents(database)[:5]]).astype(np.float32), trained.F
    )
    before = state.values.copy()
    stages.StepperStepping(trained).step(state)
    expected = before + trained.stepper.evaluate(before) / np.float32(database.fps)
    np.testing.assert_allclose(state.values, expected, atol=1e-4)


def test_answers_of_the_projector_are_searched_among_what_it_may_know(database):
    held = tuple(sorted(set(database.names)))[:1]
    chosen = settings()
    data = Data(database, held)
    first = DecompressorStage(data, chosen)
    first.begin()
    stage = ProjectorStage(data, chosen, first)
    stage.begin()
    of_range = database.ranges()
    made, again, other = (stage.made(generator(seed, "made"), 200) for seed in (0, 0, 1))
    np.testing.assert_array_equal(made[0].features, again[0].features)
    assert (made[0].features[:, None] != other[0].features).any(axis=2).all()
    for queries, frames in (stage._real, made, *stage.judged.values()):
        assert len(queries) == len(frames) > 0
        assert not {database.names[r] for r in np.unique(of_range[frames])} & set(held)
        ends = database.stops[of_range[frames]] - queries.ignore_end
        assert (frames < ends).all()
    queries, frames = stage.judged["training"]
    assert (np.abs(queries.current - frames) >= queries.radius).all()
    assert (made[0].current == -1).all() and (stage._real[0].current == -1).all()
    # Brute force agrees on a sample.
    allowed = np.isin(of_range, np.flatnonzero(data.ranges["training"]))
    allowed &= np.arange(len(database)) < (database.stops - queries.ignore_end)[of_range]
    for i in range(0, len(queries), max(1, len(queries) // 20)):
        mine = allowed & (np.abs(np.arange(len(database)) - queries.current[i]) >= queries.radius)
        distances = ((database.features[mine] - queries.features[i]) ** 2).sum(axis=1)
        found = ((database.features[frames[i]] - queries.features[i]) ** 2).sum()
        assert found == pytest.approx(distances.min(), rel=1e-4, abs=1e-5)


@pytest.fixture(scope="module")
def projector(database, trained):
    chosen, data = settings(), Data(database, trained.held_out)
    first = DecompressorStage(data, chosen)
    first.begin()
    return ProjectorStage(data, chosen, first)


def closed_loop(projector, model):
    """The stage as it begins when the networks before it are a model's."""
    chosen = settings()
    stage = ClosedLoopStage(projector._data, chosen, chosen.closed_loop, projector, lambda: model)
    stage.begin()
    return stage


def test_the_closed_loop_is_trained_on_what_its_own_networks_ask(database, trained, projector):
    """Its crowd's queries hold the poses that the networks reached, which no frame of the data has."""
    held = trained.held_out
    stage = closed_loop(projector, trained)
    queries, frames = stage._asked
    assert len(queries) > 1000 and (queries.current == -1).all()
    assert not {database.names[r] for r in np.unique(database.ranges()[frames])} & set(held)
    pose = np.array(
        [column for column, name in enumerate(database.schema.columns) if "trajectory" not in name]
    )
    away = (
        np.abs(queries.features[:200, None, pose] - database.features[None][..., pose])
        .max(axis=-1)
        .min(axis=1)
    )
    of_data = np.abs(projector._real[0].features[:200, None, pose] - database.features[None][..., pose])
    assert np.median(away) > 1e-3 > np.median(of_data.max(axis=-1).min(axis=1))
    before = projector.projector.layers[0].weight.clone()
    sum(stage.loss(0).values()).backward()
    assert projector.projector.layers[0].weight.grad.abs().sum() > 0
    assert torch.equal(before, projector.projector.layers[0].weight)


@pytest.mark.parametrize("speed", [1e6, np.nan])  # or is nowhere
def test_a_crowd_that_runs_away_is_told_of(trained, projector, capsys, speed):
    """And the closed loop goes on without it."""
    stage = closed_loop(projector, trained)
    assert stage.evaluate()["training"]["ran_away"] < 0.5 and capsys.readouterr().err == ""
    stepper = trained.stepper
    fast = np.full_like(stepper.biases[-1], speed)
    lost = replace(trained, stepper=replace(stepper, biases=(*stepper.biases[:-1], fast)))
    stage = closed_loop(projector, lost)
    told = capsys.readouterr().err
    assert told.startswith("note: closed_loop: 100% of what the networks' own crowd asked lies far off")
    assert "nothing of it is trained on" in told and told.count("\n") == 1
    errors = stage.evaluate()["training"]
    assert errors["ran_away"] == 1 and "own_error_cm" not in errors
    assert all(torch.isfinite(term) for term in stage.loss(0).values())


def test_a_stepper_learns_the_same_seconds_at_any_rate():
    database = lmm_models.database(fps=30.0)
    data, chosen = Data(database), settings(held_out=0.0)
    first = DecompressorStage(data, chosen)
    first.begin()
    stage = StepperStage(data, chosen, first)
    stage.begin()
    assert chosen.stepper.window == 20 and np.array_equal(stage._starts, data.starts(10))
    assert all(torch.isfinite(term) for term in stage.loss(0).values())


def test_half_of_a_steppers_windows_begin_off_the_data(database):
    data, chosen = Data(database), settings(held_out=0.0, stepper_noise=0.5)
    first = DecompressorStage(data, chosen)
    first.begin()
    stage = StepperStage(data, chosen, first)
    stage.begin()
    states = torch.from_numpy(stage.states[:64].copy())
    moved = stage._disturbed(states, np.random.default_rng(1)) - states
    assert (moved[:32].abs().sum(dim=1) > 0).all() and not moved[32:].any()
    width, std = data.features.shape[1], stage.states.std(axis=0)
    sizes = (moved[:32] / torch.from_numpy(std)).abs().mean(dim=0)
    assert sizes[width:].mean() > 2 * sizes[:width].mean() > 0
    none = StepperStage(data, settings(held_out=0.0, stepper_noise=0.0), first)
    none.begin()
    assert none._disturbed(states, np.random.default_rng(1)) is states


def test_a_projector_of_crouching_data_is_told_who_crouches():
    database = lmm_models.database(crouch=True)
    data, chosen = Data(database), settings(held_out=0.0)
    first = DecompressorStage(data, chosen)
    first.begin()
    stage = ProjectorStage(data, chosen, first)
    stage.begin()
    assert stage.projector.network().sizes[0] == database.schema.size + 1
    tag = database.tag_mask(["crouch"])
    made = stage.made(generator(0, "made"), 200)
    for queries, frames in (stage._real, made):
        asked = stage.inputs(queries)[:, -1] == 1
        assert np.array_equal((database.tags[frames] & tag) != 0, asked)
    assert 0 < stage.inputs(made[0])[:, -1].mean() < 1


def test_crouching_is_trained_on_and_so_is_going_upright(tmp_path):
    """What a crowd asks for while it is trained on must be there, or hours later nobody can go on."""
    database = lmm_models.database(crouch=True)
    assert kinds(database) == {"straight": {"crouched frames"}, "run": {"upright frames"}}
    with pytest.raises(
        UserError, match=r"of 2 clips only one has \w+ frames, only one has \w+ frames; .*out 0"
    ):
        train(database, tmp_path / "walk.lmm", settings())
    short = replace(database, stops=database.starts + 20)  # at 60 Hz no search looks at them
    assert set(map(len, kinds(short).values())) == {0}
    with pytest.raises(UserError, match="no clip is longer than its end that is not searched, 20 frames"):
        train(short, tmp_path / "walk.lmm", settings())
    for within in (True, False):  # crouched at the end of a clip alone, or upright there
        tags = np.full(len(database), not within, np.uint32)
        tags[-5:] = within
        late = replace(database, tags=tags)
        kind = "crouched" if within else "upright"
        with pytest.raises(UserError, match=f"all {kind} frames lie in ends of clips .* 20 frames; build"):
            train(late, tmp_path / "walk.lmm", settings())
    assert not list(tmp_path.iterdir())


def test_rates_do_not_cross_clips(database):
    data, chosen = Data(database), settings(held_out=0.0)
    first = DecompressorStage(data, chosen)
    first.begin()
    stage = StepperStage(data, chosen, first)
    stage.begin()
    states = stage.states
    inner = np.setdiff1d(np.arange(len(database)), database.stops - 1)
    rates = (states[inner + 1] - states[inner]) * np.float32(database.fps)
    np.testing.assert_allclose(stage.stepper.output_mean.numpy(), rates.mean(axis=0), rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(stage.stepper.output_std.numpy(), rates.std(axis=0), rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("activation", ["relu", "elu"])
def test_a_network_of_torch_and_the_stored_one_agree(activation):
    rng = np.random.default_rng(3)
    module = Perceptron((7, 16, 16, 5), activation, seed=1, name="any")
    sizes = {"input_mean": 7, "input_std": 7, "output_mean": 5, "output_std": 5}
    numbers = {name: rng.uniform(0.5, 2, size).astype(np.float32) for name, size in sizes.items()}
    numbers["input_std"][2] = numbers["output_std"][1] = 0
    module.normalise(**numbers)
    x = rng.standard_normal((50, 7)).astype(np.float32)
    np.testing.assert_allclose(module.evaluate(x), module.network().evaluate(x), atol=2e-6)
    assert np.all(module.evaluate(x)[:, 1] == numbers["output_mean"][1])


def test_inputs_that_hardly_vary_are_not_blown_up():
    std = np.array([1.0, 2.0, 1e-4, 0.0, 0.02, 0.04], np.float32)
    mean = (1.0 + 2.0 + 1e-4) / 3
    np.testing.assert_allclose(floored(std, 4), [1.0, 2.0, 0.1 * mean, 0.0, 0.02, 0.04], rtol=1e-6)


@pytest.mark.parametrize("kind", [StepperStage, ProjectorStage, None])
def test_features_of_one_gait_are_not_blown_up_in_another(database, kind):
    """Who walks straight on never turns aside; a network that is told in those units who runs in a curve
    puts joints metres away."""
    data, chosen = Data(database, ("run",)), settings()
    first = DecompressorStage(data, chosen)
    first.begin()
    module = first.decompressor
    if kind is not None:
        stage = kind(data, chosen, first)
        stage.begin()
        (module,) = stage.modules().values()
    std = data.features[data.frames["training"]].std(axis=0)
    units = module.input_std[: len(std)].numpy()
    assert std.min() < 0.05 * std.mean() and units.min() > 0.09 * std.mean()
    np.testing.assert_allclose(units[std > std.mean()], std[std > std.mean()], rtol=1e-4)


def test_columns_that_do_not_vary_have_no_spread():
    values = np.random.default_rng(0).standard_normal((1000, 3)).astype(np.float32)
    values[:, 1] = 1.2345
    values[:, 2] *= 1e-3
    mean, std = spread(values)
    assert std[1] == 0 and mean[1] == pytest.approx(1.2345)
    np.testing.assert_allclose(std[[0, 2]], values.std(axis=0)[[0, 2]], rtol=1e-4)


@pytest.mark.data
def test_the_dog_trains(data, tmp_path):
    from mm.build import build

    database = build([data / "dog_mann"], schema="quadruped39", jobs=1, mirror=False)
    database.save(tmp_path / "dog.mmdb")
    model = train(database, tmp_path / "dog.lmm", brief(held_out=0.1))
    assert model.F == 39 and model.layout.joints == len(database.skeleton)
    assert np.isfinite(model.errors["decompressor"]["held_out"]["error_cm"])
