"""The training loop: going on after any stop to the same bits, faults that name their term, log, averages."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch: pip install 'motion-matching[train]'")

from lmm.training import checkpoint, log, loop  # noqa: E402
from lmm.training.optimiser import optimiser, rate  # noqa: E402
from lmm.training.randomness import generator, seeded  # noqa: E402
from lmm.training.settings import Settings, StageSettings  # noqa: E402
from motion import files  # noqa: E402
from motion.errors import UserError  # noqa: E402

REPOSITORY = Path(__file__).resolve().parents[1]
PLAN = StageSettings(iterations=30, batch=8, learning_rate=2e-2, average=0.8, clip=1.0, evaluate=10)
SETTINGS = Settings(threads=1, checkpoint_seconds=1e6)  # none but between stages
EACH = dataclasses.replace(SETTINGS, checkpoint_seconds=0.0)  # after every iteration
BASE = "0123456789abcdef"


class Fit:
    """A stage that fits y = tanh(x A), where A is of the seed, or is what the stage before found."""

    def __init__(self, name: str, plan: StageSettings, before: Fit | None = None) -> None:
        self.name, self.settings, self.before = name, plan, before
        self.at: Callable[[int], None] = lambda iteration: None
        self.fault = math.nan
        self.bad_at, self.begun = -1, 0
        with seeded(5, name):
            first, last = torch.nn.Linear(6, 16), torch.nn.Linear(16, 6)
        self.net = torch.nn.Sequential(first, torch.nn.BatchNorm1d(16), torch.nn.ELU(), last)

    def modules(self) -> dict[str, Any]:
        return {"net": self.net}

    def begin(self) -> None:
        self.begun += 1
        if self.before is None:
            self.target = torch.from_numpy(generator(5, self.name).normal(size=(6, 6)).astype(np.float32))
        else:
            self.target = self.before.net(torch.eye(6)).detach()

    def _gap(self, count: int, iteration: int) -> Any:
        draw = generator(5, self.name, iteration)
        x = torch.from_numpy(draw.standard_normal((count, 6), np.float32))
        return self.net(x) - torch.tanh(x @ self.target)

    def loss(self, iteration: int) -> dict[str, Any]:
        self.at(iteration)
        gap = self._gap(self.settings.batch, iteration)
        size = 0.1 * sum(p.square().mean() for p in self.net.parameters())
        return {"gap": gap.abs().mean(), "size": size * (self.fault if iteration == self.bad_at else 1)}

    def evaluate(self) -> dict[str, dict[str, float]]:
        error = self._gap(256, 1_000_000).abs().mean()
        return {"training": {"error_cm": float(error)}, "held_out": {"error_cm": 2 * float(error)}}


def _stages(plan: StageSettings = PLAN) -> list[Fit]:
    """Three in a row, each with an optimiser of its own."""
    found: list[Fit] = []
    for name, kind, schedule in (
        ("one", "adamw", "cosine"),
        ("two", "radam", "step"),
        ("three", "adam", "step"),
    ):
        own = dataclasses.replace(plan, optimiser=kind, schedule=schedule)
        found.append(Fit(name, own, found[-1] if found else None))
    return found


def _train(output: Path, stages: list[Fit], settings: Settings = SETTINGS, **options: Any) -> loop.Outcome:
    """Train and write a model, as a caller does."""
    outcome = loop.run(stages, settings, output, database=BASE, **options)
    arrays = {f"{s.name}.{n}": t.numpy() for s in stages for n, t in s.net.state_dict().items()}
    files.save(output, "fit", 1, {"errors": outcome.errors}, arrays)
    checkpoint.remove(checkpoint.path_of(output))
    return outcome


def _lines(output: Path) -> list[dict[str, Any]]:
    """The log without what no two trainings share."""
    return [{k: v for k, v in r.items() if k != "seconds"} for r in log.read(log.path_of(output))]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of a training that was never stopped. It is shared: write nothing beside it."""
    output = tmp_path_factory.mktemp("whole") / "fit"
    _train(output, _stages())
    return output


class Stopped(Exception):
    pass


def _stop(iteration: int) -> Callable[[int], None]:
    def at(now: int) -> None:
        if now == iteration:
            raise Stopped

    return at


def test_training_learns_logs_and_cleans_up(whole: Path) -> None:
    assert sorted(path.name for path in whole.parent.iterdir()) == ["fit", "fit.jsonl"]
    lines = log.read(log.path_of(whole))
    assert [(line["stage"], line["iteration"]) for line in lines] == [
        (name, i) for name in ("one", "two", "three") for i in (10, 20, 30)
    ]
    seconds = [line["seconds"] for line in lines]
    assert seconds == sorted(seconds) and seconds[0] > 0
    for line in lines:
        assert set(line["loss"]) == {"gap", "size"} and set(line["errors"]) == {"training", "held_out"}
    errors = [line["errors"]["training"]["error_cm"] for line in lines if line["stage"] == "one"]
    assert errors[-1] < 0.85 * errors[0]
    rates = [line["learning_rate"] for line in lines]
    assert rates[0] > rates[1] > rates[2] > 0 and rates[2] < 1e-3 and rates[3] == PLAN.learning_rate


def test_the_same_seed_gives_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    _train(tmp_path / "fit", _stages())
    assert (tmp_path / "fit").read_bytes() == whole.read_bytes()
    assert _lines(tmp_path / "fit") == _lines(whole)


@pytest.mark.parametrize(("stage", "iteration"), [(0, 1), (0, 17), (1, 0), (1, 10), (2, 29)])
def test_a_training_that_failed_goes_on_to_the_same_bytes(
    stage: int, iteration: int, whole: Path, tmp_path: Path
) -> None:
    output, stages = tmp_path / "fit", _stages()
    stages[stage].at = _stop(iteration)
    with pytest.raises(Stopped):
        _train(output, stages, EACH)
    again = _stages()
    _train(output, again, resume=True)
    assert [one.begun for one in again] == [0] * stage + [1] * (3 - stage)
    assert output.read_bytes() == whole.read_bytes()
    assert _lines(output) == _lines(whole)


def test_lines_after_the_checkpoint_are_taken_back(whole: Path, tmp_path: Path) -> None:
    output, stages = tmp_path / "fit", _stages()
    stages[1].at = _stop(25)
    with pytest.raises(Stopped):
        _train(output, stages)
    assert len(_lines(output)) == 5
    with open(log.path_of(output), "ab") as stream:
        stream.write(b'{"stage": "two", "iter')  # killed while it wrote
    seen: list[int] = []
    again = _stages()
    again[1].at = lambda iteration: seen.append(len(_lines(output))) if iteration == 0 else None
    _train(output, again, resume=True)
    assert seen == [3]
    assert output.read_bytes() == whole.read_bytes() and _lines(output) == _lines(whole)


def killed_again_and_again(folder: str, seed: int) -> None:
    """Train in children, the second time killed at random moments; for a process apart."""
    draw = random.Random(seed)
    os.fsync = lambda _: None  # who is killed loses nothing of what was written
    plan = dataclasses.replace(PLAN, iterations=60)
    settings = dataclasses.replace(SETTINGS, checkpoint_seconds=0.01)
    # What torch imports late, children have from here: else they would be killed while they import.
    number = torch.nn.Parameter(torch.zeros(1))
    number.grad = torch.zeros(1)
    for stage in _stages(plan):
        optimiser(stage.settings, [number]).step()

    def train(output: Path) -> int:
        child = os.fork()
        if child == 0:
            with contextlib.suppress(BaseException):
                _train(output, _stages(plan), settings, resume=checkpoint.path_of(output).exists())
                os._exit(0)
            os._exit(1)
        return child

    for name, kills in (("never", 0), ("often", 6)):
        killed = done = 0
        while not done:
            child = train(Path(folder) / name / "fit")
            if killed < kills:
                time.sleep(draw.uniform(0.02, 0.15))
                os.kill(child, signal.SIGKILL)
            _, status = os.waitpid(child, 0)
            killed += os.WIFSIGNALED(status)
            done = os.WIFEXITED(status)
            if done and status:
                sys.exit("a training failed")
        print(name, killed)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork to kill children quickly")
def test_a_training_killed_at_any_moment_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    code = "import sys, test_lmm_loop as t; t.killed_again_and_again(sys.argv[1], 3)"
    places = os.pathsep.join([str(REPOSITORY), str(REPOSITORY / "tests")])
    environment = os.environ | {"PYTHONPATH": places, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    words = done.stdout.split()
    assert words[:3] == ["never", "0", "often"] and int(words[3]) >= 3, "too fast to be killed"
    never, often = tmp_path / "never" / "fit", tmp_path / "often" / "fit"
    assert often.read_bytes() == never.read_bytes()
    assert _lines(often) == _lines(never)
    assert sorted(path.name for path in often.parent.iterdir()) == ["fit", "fit.jsonl"]


def _stopped(output: Path) -> checkpoint.Checkpoint:
    """The checkpoint of a training that failed in its second stage."""
    stages = _stages()
    stages[1].at = _stop(7)
    with pytest.raises(Stopped):
        _train(output, stages, EACH)
    return checkpoint.Checkpoint.load(checkpoint.path_of(output))


def test_a_checkpoint_says_where_the_training_stands(tmp_path: Path) -> None:
    point = _stopped(tmp_path / "fit")
    assert (point.stage, point.iteration, list(point.errors)) == ("two", 7, ["one"])
    assert point.machine["torch"] == torch.__version__ and point.machine["threads"] == 1
    kinds = {name.partition(".")[0] for name in point.arrays}
    assert kinds == {"done", "weights", "averages", "optimiser"}


@pytest.mark.parametrize(
    ("change", "database", "message"),
    [
        ({"seed": 3}, BASE, r"of other settings: seed was 0, is 3; give those it was begun with, or remove"),
        (
            {"stepper": dataclasses.replace(SETTINGS.stepper, batch=4, iterations=9)},
            BASE,
            r"stepper.batch was 32, is 4, stepper.iterations was 500000, is 9;",
        ),
        ({}, "fedcba9876543210", r"of another database \(01234567, this is fedcba98\); give the one"),
        ({"threads": 2}, BASE, r"threads was 1, is 2"),
        (
            {"preset": "quick", "closed_loop": StageSettings(), "latent": 4},
            BASE,
            r"settings: preset was full, is quick, latent was 32, is 4, closed_loop was none, is given; give",
        ),
    ],
)
def test_only_the_same_training_goes_on(
    change: dict[str, Any], database: str, message: str, tmp_path: Path
) -> None:
    output = tmp_path / "fit"
    _stopped(output)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(UserError, match=message):
        loop.run(_stages(), dataclasses.replace(SETTINGS, **change), output, database=database, resume=True)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_checkpoint_that_is_gone_on_from_leaves_its_room_to_the_next(tmp_path: Path) -> None:
    point = _stopped(tmp_path / "fit")
    assert point.arrays and all(array.flags.owndata for array in point.arrays.values())  # none is mapped


def test_another_version_of_torch_does_not_go_on(tmp_path: Path) -> None:
    path = checkpoint.path_of(tmp_path / "fit")
    point = _stopped(tmp_path / "fit")
    dataclasses.replace(point, machine=point.machine | {"torch": "1.0"}).save(path)
    with pytest.raises(UserError, match=r"of another machine or version: torch was 1.0, is"):
        _train(tmp_path / "fit", _stages(), resume=True)


def test_only_its_own_half_written_checkpoints_are_removed(tmp_path: Path) -> None:
    """Not those of another training in the same folder, however alike the names begin."""
    mine, other = (checkpoint.path_of(tmp_path / ("walk" * 20 + end)) for end in ("-1", "-2"))
    with files.atomic(other) as stream:
        stream.write(b"half")
        left = tmp_path / f"{files.half_written(mine)}abcd_123"
        left.touch()
        checkpoint.clean(mine)
        assert not left.exists()
    assert other.read_bytes() == b"half" and list(tmp_path.iterdir()) == [other]


def test_other_clips_held_out_do_not_go_on(whole: Path, tmp_path: Path) -> None:
    """Another version of the program may choose them otherwise, with the same settings."""
    output, stages = tmp_path / "fit", _stages()
    stages[1].at = _stop(7)
    with pytest.raises(Stopped):
        _train(output, stages, EACH, held_out=("a", "b"))
    for others in ((), ("a",), ("a", "c")):
        with pytest.raises(
            UserError, match=r"checkpoint: a training of other clips held out, .*; go on as it was begun"
        ):
            _train(output, _stages(), resume=True, held_out=others)
    _train(output, _stages(), resume=True, held_out=("b", "a"))
    assert output.read_bytes() == whole.read_bytes()


def test_a_stopped_training_is_not_written_over(tmp_path: Path) -> None:
    _stopped(tmp_path / "fit")
    with pytest.raises(UserError, match=r"was stopped here; go on with --resume, or remove the file"):
        _train(tmp_path / "fit", _stages())


def test_without_a_checkpoint_there_is_nothing_to_go_on_from(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"fit.checkpoint: there is no checkpoint .*; begin without --resume"):
        _train(tmp_path / "fit", _stages(), resume=True)
    (tmp_path / "fit").write_bytes(b"done")
    with pytest.raises(UserError, match=r"go on from, the model is there already; begin anew without"):
        _train(tmp_path / "fit", _stages(), resume=True)


def test_a_cut_or_foreign_checkpoint_is_refused(tmp_path: Path) -> None:
    output, path = tmp_path / "fit", checkpoint.path_of(tmp_path / "fit")
    point = _stopped(output)
    whole = path.read_bytes()
    for damaged in (whole[:-9], whole[:100], b"", whole[:-1] + b"?"):
        path.write_bytes(damaged)
        with pytest.raises(UserError, match="checkpoint") as caught:
            _train(output, _stages(), resume=True)
        assert "\n" not in str(caught.value) and caught.value.remedy == "remove the file to begin anew"
    arrays = {name: array for name, array in point.arrays.items() if "two" not in name}
    arrays.pop(next(name for name in arrays if name.startswith("averages.")))
    dataclasses.replace(point, arrays=arrays).save(path)
    with pytest.raises(UserError, match="damaged training checkpoint: no"):
        _train(output, _stages(), resume=True)


@pytest.mark.parametrize(
    ("fault", "told"), [(math.nan, "nan"), (math.inf, "inf"), (-math.inf, "-inf"), (1e16, r"\S+e\+1\d")]
)
def test_a_term_that_is_no_number_stops_the_training(fault: float, told: str, tmp_path: Path) -> None:
    output, stages = tmp_path / "fit", _stages()
    stages[1].bad_at, stages[1].fault = 6, fault
    with pytest.raises(UserError, match=f"^two, iteration 6: the term size is {told}; the last good"):
        _train(output, stages, EACH)
    point = checkpoint.Checkpoint.load(checkpoint.path_of(output))
    assert (point.stage, point.iteration) == ("two", 6)
    assert all(np.isfinite(array).all() for array in point.arrays.values())


@pytest.mark.parametrize("clip", [0.0, 1.0])
def test_a_gradient_that_is_no_number_stops_the_training(clip: float, tmp_path: Path) -> None:
    class Steep(Fit):
        def loss(self, iteration: int) -> dict[str, Any]:
            terms = super().loss(iteration)
            zero = terms["gap"] * 0  # the gradient of its root is infinite times 0
            return terms | {"root": zero.sqrt() if iteration == 5 else zero}

    stage = Steep("one", dataclasses.replace(PLAN, clip=clip))
    with pytest.raises(UserError, match=r"one, iteration \d: the (gradient|weights net.*) is nan"):
        _train(tmp_path / "fit", [stage], EACH)
    point = checkpoint.Checkpoint.load(checkpoint.path_of(tmp_path / "fit"))
    assert point.iteration == 5 and all(np.isfinite(array).all() for array in point.arrays.values())


def test_an_error_that_is_no_number_stops_the_training(tmp_path: Path) -> None:
    class Lost(Fit):
        def evaluate(self) -> dict[str, dict[str, float]]:
            return {"held_out": {"error_cm": math.nan}}

    with pytest.raises(UserError, match=r"one, iteration 10: error_cm \(held_out\) is nan"):
        _train(tmp_path / "fit", [Lost("one", PLAN)])


@contextlib.contextmanager
def _largest_file(size: int) -> Iterator[None]:
    """No file may grow beyond so many bytes: a full disk, but for the name of the error."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_keeps_the_last_checkpoint(whole: Path, tmp_path: Path) -> None:
    output = tmp_path / "fit"
    _stopped(output)
    path = checkpoint.path_of(output)
    before = path.read_bytes()
    with _largest_file(len(before) // 2), pytest.raises(UserError) as caught:
        _train(output, _stages(), EACH, resume=True)
    assert str(caught.value).startswith(f"{path}: cannot write: ")
    assert caught.value.remedy == "the last checkpoint stays; make room and give --resume"
    assert path.read_bytes() == before
    _train(output, _stages(), resume=True)
    assert output.read_bytes() == whole.read_bytes() and _lines(output) == _lines(whole)


def test_a_full_disk_before_the_first_checkpoint_or_line(tmp_path: Path) -> None:
    output = tmp_path / "fit"
    with _largest_file(2000), pytest.raises(UserError, match=r"cannot write: .*make room and begin anew"):
        _train(output, _stages(), EACH)
    with _largest_file(100), pytest.raises(UserError, match=r"fit.jsonl: cannot write: "):
        _train(output, _stages())


def test_ctrl_c_writes_a_checkpoint(whole: Path, tmp_path: Path) -> None:
    output, stages = tmp_path / "fit", _stages()
    stages[0].at = lambda iteration: signal.raise_signal(signal.SIGINT) if iteration == 11 else None
    handler = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt, match="stopped at iteration 12 of the one; give --resume"):
        _train(output, stages)
    assert signal.getsignal(signal.SIGINT) is handler
    assert checkpoint.Checkpoint.load(checkpoint.path_of(output)).iteration == 12
    _train(output, _stages(), resume=True)
    assert output.read_bytes() == whole.read_bytes() and _lines(output) == _lines(whole)


def test_a_second_ctrl_c_does_not_wait(tmp_path: Path) -> None:
    stages = _stages()

    def twice(iteration: int) -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    stages[0].at = twice
    with pytest.raises(KeyboardInterrupt, match="stopped at once"):
        _train(tmp_path / "fit", stages)


def test_ctrl_c_while_a_stage_begins_does_not_wait(whole: Path, tmp_path: Path) -> None:
    class Slow(Fit):
        def begin(self) -> None:
            signal.raise_signal(signal.SIGINT)
            raise AssertionError

    output, stages = tmp_path / "fit", _stages()
    with pytest.raises(KeyboardInterrupt, match="stopped at once, before the first checkpoint"):
        _train(output, [Slow("one", PLAN)])
    with pytest.raises(KeyboardInterrupt, match="stopped at once; give --resume to go on from the last"):
        _train(output, [*stages[:2], Slow("three", stages[2].settings, stages[1])])
    _train(output, _stages(), resume=True)
    assert output.read_bytes() == whole.read_bytes() and _lines(output) == _lines(whole)


def test_ctrl_c_in_the_last_iteration_of_a_stage_begins_no_other(whole: Path, tmp_path: Path) -> None:
    output, stages = tmp_path / "fit", _stages()
    stages[0].at = lambda iteration: signal.raise_signal(signal.SIGINT) if iteration == 29 else None
    with pytest.raises(KeyboardInterrupt, match="stopped after the one; give --resume"):
        _train(output, stages)
    assert stages[1].begun == 0
    _train(output, _stages(), resume=True)
    assert output.read_bytes() == whole.read_bytes() and _lines(output) == _lines(whole)


@pytest.mark.parametrize("resume", [False, True])
def test_two_trainings_of_one_model_are_refused(whole: Path, resume: bool, tmp_path: Path) -> None:
    output, stages = tmp_path / "fit", _stages()

    def another(iteration: int) -> None:
        if iteration == 15:
            with pytest.raises(UserError, match=r"fit.jsonl: another training of this model is under way; "):
                _train(output, _stages(), resume=resume)

    stages[1].at = another
    _train(output, stages, EACH)
    assert output.read_bytes() == whole.read_bytes() and _lines(output) == _lines(whole)


def test_averages_are_what_is_evaluated_and_kept(tmp_path: Path) -> None:
    plan = dataclasses.replace(PLAN, iterations=12, evaluate=12, average=0.5, clip=0.0)
    stage, seen = Fit("one", plan), []
    evaluated: list[Any] = []

    class Watched(Fit):
        def evaluate(self) -> dict[str, dict[str, float]]:
            assert not self.net.training and not torch.is_grad_enabled()
            evaluated.append(self.net[0].weight.clone())
            return super().evaluate()

    stage = Watched("one", plan)
    first = stage.net[0].weight.detach().clone()
    stage.at = lambda iteration: seen.append(stage.net[0].weight.detach().clone())
    _train(tmp_path / "averaged", [stage])
    plain = Fit("one", dataclasses.replace(plan, average=0.0))
    _train(tmp_path / "plain", [plain])
    # Each weight joins the average with 1 - min(average, (1 + i) / (10 + i)).
    expected = first
    for i, weight in enumerate([*seen[1:], plain.net[0].weight.detach()]):
        decay = min(0.5, (1 + i) / (10 + i))
        expected = decay * expected + (1 - decay) * weight
    assert torch.allclose(stage.net[0].weight, expected, atol=1e-6)
    assert torch.equal(evaluated[-1], stage.net[0].weight)
    assert not torch.allclose(plain.net[0].weight, expected, atol=1e-6)


def test_rates() -> None:
    step = StageSettings(learning_rate=2.0)
    assert [rate(step, i) for i in (0, 999, 1000, 2500)] == [2.0, 2.0, 2 * 0.99, 2 * 0.99**2]
    cosine = StageSettings(learning_rate=1.0, schedule="cosine", iterations=110, warm_up=1 / 11)
    found = [rate(cosine, i) for i in range(110)]
    assert found[:10] == pytest.approx(np.linspace(0.1, 1, 10))
    assert found[60] == pytest.approx(0.5) and 0 < found[-1] < 1e-3
    assert np.all(np.diff(found[10:]) < 0)


@pytest.mark.parametrize(
    ("name", "kind", "facts"),
    [
        ("radam", torch.optim.RAdam, {"weight_decay": 0}),
        ("adamw", torch.optim.AdamW, {"weight_decay": 1e-3, "amsgrad": True}),
        ("adam", torch.optim.Adam, {"weight_decay": 0, "amsgrad": False}),
    ],
)
def test_optimisers(name: Any, kind: type, facts: dict[str, Any]) -> None:
    found = optimiser(StageSettings(optimiser=name), [torch.nn.Parameter(torch.zeros(3))])
    assert type(found) is kind and facts.items() <= found.defaults.items()


def test_long_gradients_are_shortened(tmp_path: Path) -> None:
    class Steep(Fit):
        def loss(self, iteration: int) -> dict[str, Any]:
            return {"gap": 1e4 * super().loss(iteration)["gap"]}

    plan = dataclasses.replace(PLAN, iterations=1, clip=0.5)
    stage = Steep("one", plan)
    _train(tmp_path / "fit", [stage])
    length = sum(float(p.grad.square().sum()) for p in stage.net.parameters()) ** 0.5
    assert length == pytest.approx(0.5, rel=1e-4)


def test_randomness_is_of_seed_stage_and_iteration() -> None:
    places = [(1, "a", 0), (1, "a", 1), (1, "b", 0), (2, "a", 0)]
    found = [generator(*place).integers(1 << 60) for place in places * 2]
    assert found[:4] == found[4:] and len(set(found)) == 4
    before = torch.random.get_rng_state()
    with seeded(1, "a"):
        first = torch.rand(3)
    with seeded(1, "a"):
        assert torch.equal(torch.rand(3), first)
    assert torch.equal(torch.random.get_rng_state(), before)


def test_torch_is_left_as_it_was(tmp_path: Path) -> None:
    before = torch.get_num_threads(), torch.get_float32_matmul_precision()
    inside: list[Any] = []
    stages = _stages(dataclasses.replace(PLAN, iterations=1, evaluate=1))
    stages[0].at = lambda _: inside.append((torch.get_num_threads(), torch.get_float32_matmul_precision()))
    _train(tmp_path / "fit", stages, dataclasses.replace(SETTINGS, precision="bfloat16"))
    assert inside == [(1, "medium")]
    assert (torch.get_num_threads(), torch.get_float32_matmul_precision()) == before


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_a_device_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"torch finds no CUDA device; train on the processor: --device cpu"):
        _train(tmp_path / "fit", _stages(), dataclasses.replace(SETTINGS, device="cuda"))


def test_progress_tells_loss_and_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _train(tmp_path / "fit", _stages())
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("one (1 of 3): 30 iterations done; loss ")
    assert "gap" in lines[0] and "training error 0." in lines[0] and " cm, held out error 0." in lines[0]


@pytest.mark.parametrize(
    "line",
    [
        "no json",
        "[]",
        "{}",
        '{"stage": 1}',
        '{"stage": "a", "iteration": 1, "seconds": 1, "errors": 3, "loss": {}}',
    ],
)
def test_what_is_no_log_is_told_with_its_line(line: str, tmp_path: Path) -> None:
    path = tmp_path / "x.jsonl"
    good = {"stage": "a", "iteration": 1, "seconds": 0.5, "learning_rate": 1, "loss": {}, "errors": {}}
    path.write_text(f"{json.dumps(good)}\n{line}\n")
    with pytest.raises(UserError, match=r"x.jsonl:2: not a line of a training's log"):
        log.read(path)
    path.write_text(f"{json.dumps(good)}\n{line}")  # a line that is being written
    assert log.read(path) == [good]
    path.write_text("")
    with pytest.raises(UserError, match="an empty log"):
        log.read(path)


def test_tensorboard_gets_the_same_numbers(tmp_path: Path) -> None:
    pytest.importorskip("tensorboard", reason="needs tensorboard: pip install 'motion-matching[train]'")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    output, stages = tmp_path / "fit", _stages()
    stages[1].at = _stop(15)
    with pytest.raises(Stopped):
        _train(output, stages, EACH, tensorboard=tmp_path / "board")
    _train(output, _stages(), resume=True, tensorboard=tmp_path / "board")
    for stage in ("one", "two"):
        events = EventAccumulator(str(tmp_path / "board" / stage)).Reload()
        lines = [line for line in _lines(output) if line["stage"] == stage]
        for tag, value in (
            ("error_cm/held_out", lambda line: line["errors"]["held_out"]["error_cm"]),
            ("loss/gap", lambda line: line["loss"]["gap"]),
        ):
            found = [(event.step, event.value) for event in events.Scalars(tag)]
            assert found == [(line["iteration"], pytest.approx(value(line))) for line in lines]


def test_a_folder_for_tensorboard_that_cannot_be_written_leaves_the_log(whole: Path, tmp_path: Path) -> None:
    pytest.importorskip("tensorboard", reason="needs tensorboard: pip install 'motion-matching[train]'")
    output, folder = tmp_path / "fit", tmp_path / "board"
    log.path_of(output).write_bytes(log.path_of(whole).read_bytes())
    folder.write_text("a file")
    with pytest.raises(UserError, match=r"board.*: cannot write: Not a directory"):
        _train(output, _stages(), tensorboard=folder)
    assert _lines(output) == _lines(whole)
