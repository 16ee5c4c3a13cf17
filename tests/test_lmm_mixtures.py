"""Mixtures of learned and classical stages: against their twins, and motion matching itself."""

from __future__ import annotations

from dataclasses import replace

import lmm_models
import numpy as np
import pytest

from lmm import controller as controllers
from lmm import interchange, lanes, mixtures
from lmm.evaluator import products_here
from lmm.mixtures import COMBINATIONS, Nearest, Rows
from lmm.stages import LatentState
from mm import interchange as databases
from mm.control import Command
from mm.controller import Controller
from mm.settings import Settings
from mm.stages import FrameState
from motion import quat, springs
from motion.errors import UserError
from motion.pose import Poses


@pytest.fixture(scope="module")
def database():
    return lmm_models.database()


@pytest.fixture(scope="module")
def model(database):
    return lmm_models.model(database)


def controller(model, database, learned, **options) -> Controller:
    return controllers.controller(
        model, learned=learned, database=database, settings=Settings(continuing_bias=0), **options
    )


def drive(system: Controller, frames: int) -> dict[str, np.ndarray]:
    """Records [T, N, ...] of somebody who walks in a curve, and turns about."""
    records = []
    for frame in range(frames):
        heading = 0.02 * frame if frame < 40 else 2.5
        command = Command.still(system.count)
        command.velocity[:] = [1.3 * np.sin(heading), 1.3 * np.cos(heading)]
        command.yaw[:] = springs.wrap(heading)
        system.step(command)
        records.append(system.record())
    return {name: np.stack([record[name] for record in records]) for name in records[0]}


@pytest.mark.parametrize("learned", COMBINATIONS)
def test_every_mixture_drives_characters_as_its_twin_does(model, database, learned):
    runs = [drive(controller(model, database, learned, compiled=compiled), 60) for compiled in (True, False)]
    for name in ("positions", "rotations", "simulation_position", "query"):
        assert np.isfinite(runs[0][name]).all(), name
        np.testing.assert_allclose(runs[0][name], runs[1][name], atol=2e-3, rtol=1e-3, err_msg=name)
    np.testing.assert_array_equal(runs[0]["transition"], runs[1]["transition"])
    assert runs[0]["searched"].sum() >= 10
    np.testing.assert_allclose(np.linalg.norm(runs[0]["rotations"], axis=-1), 1, atol=1e-4)


@pytest.mark.parametrize("learned", COMBINATIONS)
def test_every_mixture_takes_bfloat16_products(model, database, learned):
    if "bfloat16" not in products_here():
        pytest.skip("this processor does not multiply bfloat16 numbers")
    rough, exact = (
        drive(controller(model, database, learned, count=40, products=products), 12)
        for products in ("bfloat16", "float32")
    )
    apart = np.abs(rough["positions"] - exact["positions"])
    assert np.median(apart) < 0.01
    if "D" in learned:  # elsewhere poses are those of frames
        assert apart.max() > 0
    np.testing.assert_allclose(rough["query"], exact["query"], atol=0.3)


@pytest.mark.parametrize("learned", ["", "S", "PSD"])
def test_bfloat16_products_are_refused_where_the_processor_has_none(model, database, monkeypatch, learned):
    monkeypatch.setattr(lanes, "MULTIPLIES_PAIRS", False)
    with pytest.raises(UserError, match="does not multiply bfloat16 numbers"):
        controller(model, database, learned, products="bfloat16")


@pytest.mark.parametrize("learned", COMBINATIONS)
def test_one_character_does_what_each_of_many_does(model, database, learned):
    one, many = (drive(controller(model, database, learned, count=count), 40) for count in (1, 64))
    for name in ("positions", "rotations", "query"):
        np.testing.assert_allclose(many[name][:, [0, 63]], one[name][:, [0, 0]], atol=2e-3, err_msg=name)
    np.testing.assert_array_equal(many["transition"][:, 63], one["transition"][:, 0])


def test_without_learned_stages_it_is_motion_matching(model, database):
    settings = Settings(continuing_bias=0)
    plain = drive(Controller(database, settings=settings), 60)
    mixed = drive(controller(model, database, ""), 60)
    for name in ("frame", "positions", "rotations", "cost_candidate"):
        np.testing.assert_array_equal(mixed[name], plain[name], err_msg=name)


def test_a_decompressor_without_error_shows_what_the_database_holds(database):
    """Principal components that leave nothing out, a linear network: the mixture D is motion matching."""
    model = lmm_models.linear_model(database)
    classical, learned = (drive(controller(model, database, which), 60) for which in ("", "D"))
    np.testing.assert_array_equal(learned["frame"], classical["frame"])
    assert np.abs(learned["positions"] - classical["positions"]).max() < 5e-3
    angles = quat.angle_between(learned["rotations"].astype(float), classical["rotations"].astype(float))
    assert angles.max() < np.radians(2)


def test_a_mixture_searches_and_looks_up_what_a_brute_force_would(model, database):
    rng = np.random.default_rng(0)
    rows = Rows(database, model.latents(database))
    nearest = Nearest(model, database, rows, ignore_end=0)
    frames = rng.integers(0, len(database), 30).astype(np.int32)
    values = rows.values(frames)
    np.testing.assert_array_equal(values[:, : model.F], database.features[frames])
    np.testing.assert_allclose(values[:, model.F :], model.latents(database)[frames], atol=5e-3)
    values += 0.3 * rng.normal(size=values.shape).astype(np.float32)
    every = rows.values(np.arange(len(database)))

    def distances(of: np.ndarray) -> np.ndarray:
        """Squared, of values [30] to rows [30, ...]."""
        deviation = np.maximum(model.state_std, 0.1 * model.state_std.mean())
        difference = (values.reshape(30, *[1] * (of.ndim - 2), -1) - of) / deviation
        return (difference.astype(float) ** 2).sum(axis=-1)

    least = distances(every[None]).min(axis=1)
    np.testing.assert_allclose(distances(every[nearest.frames(values)]), least, rtol=1e-4)
    # From elsewhere the nearest frame is taken only where it is so much nearer, or anything will do.
    there = np.roll(frames, 1)
    share = np.linspace(0, 1, 30).astype(np.float32)
    share[::7] = np.inf
    better = nearest.better(values, there, share)
    taken = (least < share * distances(every[there])) | np.isinf(share)
    assert 5 < taken.sum() < 30
    np.testing.assert_array_equal(better >= 0, taken)
    np.testing.assert_allclose(distances(every[better])[taken], least[taken], rtol=1e-4)


def test_a_column_that_hardly_varies_does_not_decide_what_is_nearest(model, database):
    """Rounding of a column that should be constant would be worth more than all other columns."""
    std = model.state_std.copy()
    std[3] = 1e-9
    rows = Rows(database, model.latents(database))
    nearest = Nearest(replace(model, state_std=std), database, rows, ignore_end=0)
    values = rows.values(np.array([100], np.int32))
    values[:, 3] += 1e-6
    assert nearest.frames(values)[0] == 100


def looked_up(model, database, frames, **settings) -> tuple[mixtures.LookedUpPoses, LatentState]:
    """Poses to look up, and states that are rows of the database and remember frames."""
    three = mixtures.stages(model, learned="PS", database=database, settings=Settings(**settings))
    assert isinstance(three.decompression, mixtures.LookedUpPoses)
    return three.decompression, Rows(database, model.latents(database)).states(np.array(frames, np.int32))


def shown(poses: mixtures.LookedUpPoses, state: LatentState, database) -> np.ndarray:
    """Local rotations of the joints but the root."""
    out = Poses.empty(len(state), len(database.skeleton))
    poses.decompress(state, out, np.zeros((len(state), len(database.contact_roles)), np.uint8))
    return out.rotations[:, 1:]


def test_poses_play_on_until_another_frame_is_clearly_nearer(model, database):
    start, interval = int(database.starts[0]) + 20, round(0.1 * database.fps)
    poses, state = looked_up(model, database, [start + 40] * 4, continuing_bias=0.2)
    # Near already; far away but just looked up; far away and due; nothing known.
    state.near[:] = [start + 40, start, start, -1]
    state.since[:] = [interval, interval - 1, interval, 99]
    expected = database.poses.rotations[[start + 40, start, start, start + 40], 1:]
    np.testing.assert_array_equal(shown(poses, state, database), expected)
    np.testing.assert_array_equal(state.jumped(), [2])
    np.testing.assert_array_equal(state.near, [start + 40, start, start + 40, start + 40])
    np.testing.assert_array_equal(state.since, [0, interval - 1, 0, 0])
    # Who has jumped shows the other frame from now on, and jumps once.
    shown(poses, state, database)
    assert len(state.jumped()) == 0
    # Where another frame is not nearer by the bias it stays.
    poses, state = looked_up(model, database, [start + 40], continuing_bias=0.999)
    state.values += 0.3
    state.near[:], state.since[:] = start + 38, interval
    shown(poses, state, database)
    assert state.near[0] == start + 38 and len(state.jumped()) == 0


def test_at_the_end_of_a_range_poses_go_on_elsewhere(model, database):
    poses, state = looked_up(model, database, [int(database.stops[0]) - 1], continuing_bias=0.999)
    last = shown(poses, state, database)
    np.testing.assert_array_equal(last[0], database.poses.rotations[database.stops[0] - 1, 1:])
    assert len(state.jumped()) == 1 and state.near[0] < database.stops[-1] - round(database.fps / 3)


def test_poses_that_are_looked_up_do_not_pop(database):
    """The frame changes often, by a stepper that leads astray; what is shown goes on smoothly."""
    model = lmm_models.model(database)
    system, jumps, apart = controller(model, database, "PS"), 0, []
    before = system.poses().rotations[0, 1:].astype(float)
    command = Command.still(1)
    command.velocity[:] = [0, 1.3]
    for _ in range(120):
        rotations = system.step(command).rotations[0, 1:].astype(float)
        jumps += len(system.state.jumped())
        apart.append(np.degrees(quat.angle_between(rotations, before)).max())
        before = rotations.copy()
    assert jumps >= 10
    within = np.arange(len(database) - 1)[np.diff(database.ranges()) == 0]
    real = database.poses.rotations[:, 1:].astype(float)
    fastest = np.degrees(quat.angle_between(real[within + 1], real[within])).max()
    assert max(apart) < 2 * fastest


def test_a_projection_is_taken_where_it_is_cheaper_than_playing_on(model, database):
    for learned in ("PSD", "PS", "P", "PD"):
        projection = mixtures.stages(model, learned=learned, database=database).projection
        state = FrameState(np.arange(3, dtype=np.int32), Rows(database, model.latents(database)).data)
        if "S" in learned:
            state = LatentState.of(np.zeros((3, model.F + model.L), np.float32), model.F)
        queries = database.features[[50, 100, 150]]
        none, anything = np.zeros(3, np.uint32), np.full(3, np.inf, np.float32)
        candidates, costs, found = projection.project(queries, state, anything, none, none)
        assert found.all()
        expected = ((queries - candidates.features()) ** 2).sum(axis=1)
        np.testing.assert_allclose(costs, expected, rtol=1e-5)
        for bound, better in ((costs * 1.01, True), (costs * 0.99, False)):
            again = projection.project(queries, state, bound.astype(np.float32), none, none)
            assert (again[2] == better).all(), learned


def test_guesses_become_frames_away_from_the_one_that_plays(database):
    """A projector that answers with the query: the frame it comes from is nearest, and is left out."""
    model = lmm_models.linear_model(database)
    latents = np.zeros((len(database), model.L))
    radius, start = round(database.fps / 3), int(database.starts[0]) + 40
    three = mixtures.stages(model, learned="P", database=database, latents=latents)
    frames, none = np.array([start, -1], np.int32), np.zeros(2, np.uint32)
    state = FrameState(frames, three.stepping.start(2).data)
    found, costs, any_found = three.projection.project(
        database.features[[start, start]], state, np.full(2, np.inf, np.float32), none, none
    )
    assert abs(found.index[0] - start) >= radius and costs[0] > 0 and any_found.all()
    assert found.index[1] == start and costs[1] == 0


def test_where_a_learned_state_came_from_is_left_out_of_searches(model, database):
    three = mixtures.stages(model, learned="SD", database=database)
    start, steps = int(database.starts[0]) + 30, 4
    query, none = database.features[start : start + 1], np.zeros(1, np.uint32)
    anything = np.full(1, np.inf, np.float32)
    state, costs, _ = three.projection.project(query, three.stepping.start(1), anything, none, none)
    assert state.near[0] == start and costs[0] == 0
    np.testing.assert_array_equal(state.features(), query)
    for _ in range(steps):
        three.stepping.step(state)
    assert state.near[0] == start + steps
    radius = round(database.fps / 3)
    here = database.features[start + steps - radius + 1 : start + steps + radius]
    found, _, _ = three.projection.project(here[:1], state, anything, none, none)
    assert abs(found.near[0] - (start + steps)) >= radius
    # What finds nothing cheaper stays what it is.
    kept, _, lost = three.projection.project(query, state, np.zeros(1, np.float32), none, none)
    assert not lost[0] and kept.near[0] == state.near[0]
    np.testing.assert_array_equal(kept.values, state.values)


def test_a_step_adds_a_frame_of_the_rates_and_stays_in_its_range(model, database):
    rate = np.linspace(-3, 3, model.F + model.L).astype(np.float32)
    still = lmm_models.layer(np.zeros((len(rate), len(rate))), rate)
    three = mixtures.stages(replace(model, stepper=still), learned="SD", database=database)
    end = int(database.stops[0])
    state = Rows(database, model.latents(database)).states(np.array([5, end - 2], np.int32))
    state.near[:] = [-1, end - 2]
    before = state.values.copy()
    for _ in range(3):
        three.stepping.step(state)
    np.testing.assert_allclose(state.values, before + 3 * rate / database.fps, atol=1e-5)
    np.testing.assert_array_equal(state.near, [-1, end - 1])


def test_every_mixture_crouches_where_it_is_asked_to():
    crouching = lmm_models.database(crouch=True)
    model = lmm_models.model(crouching)
    moves = Command.still(1)
    moves.crouch[:] = True
    for learned in COMBINATIONS:
        system = controller(model, crouching, learned)
        for _ in range(20):
            system.step(moves)
        assert (system.state.tags() & model.description.crouch_tag).all(), learned


@pytest.mark.parametrize("learned", ["S", "SD"])
def test_who_has_gone_on_out_of_a_tag_is_searched_for_anew(learned):
    """What a search found was crouched, but what follows is not: as in motion matching that will not do."""
    database = lmm_models.database(crouch=True)
    here = np.arange(len(database)) - database.starts[database.ranges()]
    database = replace(database, tags=database.tags * (here < 60).astype(np.uint32))
    system = controller(lmm_models.model(database), database, learned)
    moves, shown = Command.still(1), []
    moves.velocity[:], moves.crouch[:] = [0, 1.3], True
    for _ in range(200):
        system.step(moves)
        shown.append(database.tags[system.state.near[0]])
    assert np.mean(shown) > 0.8


def test_memory_counts_what_a_mixture_holds_and_nothing_else(model, database):
    def parts(learned: str) -> dict[str, int]:
        return controller(model, database, learned).memory()

    frames, stored = len(database), database.features.nbytes
    classical, alone = parts(""), parts("PSD")
    assert set(alone) == {"projector", "stepper", "decompressor", "statistics", "state", "workspace"}
    assert "poses" in classical and "latents" not in classical
    kept = parts("D")
    assert "poses" not in kept and kept["features"] == stored and kept["latents"] == frames * model.L * 2
    for learned in ("P", "S", "PS", "PD"):
        # A table of floats, and an index over it.
        assert parts(learned)["lookup"] > frames * (model.F + model.L) * 4
    assert "lookup" not in parts("SD")
    small = controller(model.as_type("int8"), database, "PSD").memory()
    assert small["decompressor"] < alone["decompressor"]


def test_memory_counts_what_a_character_holds_whatever_its_state_is(model, database):
    """All systems hold the same of a character, and a frame's number or a learned state besides."""
    learned = 2 * 4 * (model.F + model.L) + 4 * 4 + 1
    sizes = {letters: controller(model, database, letters).memory() for letters in COMBINATIONS}
    rest = {sizes[letters]["state"] - (learned if "S" in letters else 4) for letters in COMBINATIONS}
    poses = 3 * 4 * 13 * len(database.skeleton)  # what plays, what is shown, how that differs
    assert len(rest) == 1 and poses < rest.pop() < poses + 3000
    assert {memory["statistics"] for memory in sizes.values()} == {2 * 4 * model.F}
    crowd = controllers.controller(model, count=64)
    for _ in range(2):  # a crowd's networks work in more room
        assert crowd.memory() == sizes["PSD"] | {"workspace": crowd.memory()["workspace"]}
        crowd.step(Command.still(64))


def test_the_state_of_many_characters_is_made_once(model, database):
    """What the networks write to stays where it is, however often they are asked."""
    three = mixtures.stages(model)
    state = three.stepping.start(64)
    three.stepping.step(state)
    where = three.stepping._network.evaluate(state.values).ctypes.data, state.values.ctypes.data
    for _ in range(3):
        three.stepping.step(state)
    assert where == (three.stepping._network.evaluate(state.values).ctypes.data, state.values.ctypes.data)


@pytest.mark.parametrize("learned", ["PX", "PP", "psds"])
def test_letters_that_name_no_stages_are_refused(model, learned):
    with pytest.raises(UserError, match="does not name stages"):
        mixtures.stages(model, learned=learned)
    assert mixtures.letters("dp") == "PD"


def test_mixtures_need_the_database_that_the_model_was_trained_from(model, database):
    with pytest.raises(UserError, match="need the database"):
        mixtures.stages(model, learned="PS")
    with pytest.raises(UserError, match="not of this database"):
        mixtures.stages(model, learned="D", database=lmm_models.database(fps=30.0))
    with pytest.raises(UserError, match="latents of 3 frames"):
        mixtures.stages(model, learned="D", database=database, latents=np.zeros((3, model.L)))
    for shape in ((len(database), model.L + 1), (len(database),)):
        with pytest.raises(UserError, match=r"latents of shape \[.*, expected \[\d+, 5\]; make them"):
            mixtures.stages(model, learned="S", database=database, latents=np.zeros(shape))


@pytest.mark.parametrize("learned", COMBINATIONS)
def test_official_networks_drive_in_all_mixtures(data, learned):
    database = databases.import_directory(data / "reference/oracle")
    model = interchange.import_directory(data / "reference/orangeduck", database)
    settings = Settings(foot_lock=False)
    system = controllers.controller(model, learned=learned, database=database, settings=settings)
    records = drive(system, 120)
    assert all(np.isfinite(records[name]).all() for name in ("positions", "rotations", "query"))
    if learned == "PSD":
        # These networks know how to walk: their character keeps up with who is steered, hips at human height.
        travelled = np.linalg.norm(np.diff(records["positions"][:, 0, 0], axis=0), axis=-1).sum()
        assert 1 < travelled < 4
        assert ((records["positions"][:, 0, 1, 1] > 0.6) & (records["positions"][:, 0, 1, 1] < 1.2)).all()
