"""The controller: compiled kernels against their twin, N against 1, and what a user sees of a character."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import synthetic

from features import normalise
from mm import kernels, kernels_numpy
from mm.build import build
from mm.characters import CHARACTER
from mm.control import Command
from mm.controller import Controller, box, circle
from mm.search import terms
from mm.settings import Settings
from motion import bvh, kinematics, springs
from motion.errors import UserError
from motion.pose import Poses


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


def user(frame: int, count: int) -> Command:
    """Somebody who walks, turns about, faces elsewhere, and stops."""
    command = Command.still(count)
    speed = 0.0 if frame < 20 or frame > 260 else 1.2
    heading = 0.02 * frame if frame < 150 else 2.5 - 0.01 * frame
    command.velocity[:] = speed * np.array([np.sin(heading), np.cos(heading)])
    command.yaw[:] = springs.wrap(heading if frame < 200 else heading + 1.5)
    command.turn_rate[:] = 0.3 if 80 < frame < 120 else 0
    return command


def drive(controller: Controller, frames: int, commands=user) -> list[dict]:
    records = []
    for frame in range(frames):
        controller.step(commands(frame, controller.count))
        records.append(controller.record())
    return records


def stack(records: list[dict], name: str) -> np.ndarray:
    return np.stack([record[name] for record in records])


def touching(database, records: list[dict]) -> np.ndarray:
    """World positions [T, N, C, 3] of the joints that touch the ground."""
    world, _ = kinematics.forward(
        database.skeleton,
        stack(records, "positions").astype(float),
        stack(records, "rotations").astype(float),
    )
    return world[:, :, [database.skeleton.roles[role] for role in database.contact_roles]]


@pytest.fixture(scope="module", params=["mm27", "o3de59"])
def uneven(request, tmp_path_factory):
    """Walks of which no two strides are alike, so that no two frames cost the same."""
    folder = tmp_path_factory.mktemp("uneven")
    for i, speed in enumerate((0.8, 1.1, 1.5)):

        def turn(time, i=i):
            return np.sin((0.7 + 0.2 * i) * time + i) + 0.4 * np.sin(1.9 * time)

        bvh.write(folder / f"{i}.bvh", synthetic.walk(f"{i}", speed=speed, turn=turn, seconds=8))
    return build([folder], jobs=1, schema=request.param, mirror=False)


@pytest.mark.parametrize("synchronization", ["adjust+clamp", "data", "none"])
def test_compiled_kernels_equal_their_numpy_twin(uneven, synchronization):
    settings = Settings(synchronization=synchronization, continuing_bias=0)
    obstacles = [box(1.5, 1.0, 1.0, 0.5), circle(-0.5, 3.0, 0.6)]
    runs = [
        drive(
            Controller(
                uneven, count=3, index="brute", settings=settings, obstacles=obstacles, compiled=compiled
            ),
            200,
        )
        for compiled in (True, False)
    ]
    for name in ("frame", "searched", "forced", "transition", "locked", "contacts"):
        np.testing.assert_array_equal(stack(runs[0], name), stack(runs[1], name), err_msg=name)
    for name in ("positions", "rotations", "simulation_position", "simulation_yaw", "query", "trajectory"):
        np.testing.assert_allclose(stack(runs[0], name), stack(runs[1], name), atol=1e-4, err_msg=name)
    assert stack(runs[0], "transition").sum() > 5
    assert stack(runs[0], "locked").any()


def test_dividing_tags_are_those_of_the_twin():
    rng = np.random.default_rng(0)
    flags, tag = rng.random(64) < 0.5, np.uint32(4)
    required, forbidden = rng.integers(0, 8, (2, 64)).astype(np.uint32)
    found = np.zeros((2, 2, 64), np.uint32)
    kernels.divide(flags, tag, required, forbidden, *found[0])
    kernels_numpy.divide(flags, tag, required, forbidden, *found[1])
    np.testing.assert_array_equal(found[0], found[1])
    want, avoid = found[0] & tag, required & tag
    np.testing.assert_array_equal(want[0] > 0, (flags & (forbidden & tag == 0)) | (avoid > 0))
    np.testing.assert_array_equal(found[0] & ~tag, [required & ~tag, forbidden & ~tag])


def test_what_is_asked_has_the_price_of_playing_on_unless_that_cannot_be(uneven):
    """By tags required and forbidden, and by ends of clips, for some of the characters."""
    rng, schema = np.random.default_rng(0), uneven.schema
    characters, who = np.zeros(6, CHARACTER), np.array([1, 2, 3, 5])
    features = rng.standard_normal((4, schema.size)).astype(np.float32)
    tags = np.array([1, 1, 0, 2], np.uint32)
    required, forbidden = np.array([[9, 1, 0, 1, 9, 0], [9, 0, 1, 0, 9, 4]], np.uint32)
    ended = np.array([True, False, False, False, True, True])
    layout = schema.trajectory()
    trajectory = rng.standard_normal((6, len(layout), 3)).astype(np.float32)
    given = (
        characters, who, features, tags, required, forbidden, ended, trajectory,
        layout.position_columns.astype(np.int64), layout.direction_columns.astype(np.int64),
        uneven.offset, uneven.scale, terms.of_schema(schema), np.float32(0.75),
    )  # fmt: skip
    for module in (kernels, kernels_numpy):
        queries, asked = np.zeros((4, schema.size), np.float32), np.zeros((2, 4), np.uint32)
        forced, (costs, bounds) = np.zeros(4, np.bool_), np.zeros((2, 4), np.float32)
        module.ask(*given, queries, *asked, forced, costs, bounds)
        np.testing.assert_array_equal(asked, [required[who], forbidden[who]])
        assert forced.tolist() == [False, True, True, True]  # plays it, forbidden, lacking, ended
        expected = normalise.total_costs(schema, queries, features)
        np.testing.assert_allclose(costs, np.where(forced, np.inf, expected), rtol=1e-5)
        np.testing.assert_array_equal(bounds, costs * np.float32(0.75))
        assert expected.min() > 1


def test_frames_play_to_the_end_of_their_range():
    last, frames = np.array([2, 2, 2, 4, 4], np.int32), np.array([0, 2, 3, 4], np.int32)
    for module in (kernels, kernels_numpy):
        ended, playing = np.zeros((3, 4), np.bool_), frames.copy()
        for row in ended:
            module.at_ends(playing, last, row)
            module.play_on(playing, last)
        assert playing.tolist() == [2, 2, 4, 4]
        assert ended.T.tolist() == [[0, 0, 1], [1, 1, 1], [0, 1, 1], [1, 1, 1]]


def test_many_characters_do_what_one_does(database):
    """Same commands, same poses: in a crowd of different ones, too."""

    def crowd(frame, count):
        command = user(frame, count)
        speed = 1 + 0.1 * (np.arange(count, dtype=np.float32) % 7)
        command.velocity *= speed[:, None]
        return command

    many = drive(Controller(database, count=1024), 90, crowd)
    for who in (0, 6, 1023):
        one = drive(Controller(database), 90, lambda f, n, who=who: pick(crowd(f, 1024), who))
        for name in ("frame", "positions", "rotations", "cost_candidate"):
            np.testing.assert_array_equal(stack(one, name)[:, 0], stack(many, name)[:, who], err_msg=name)


def pick(command: Command, who: int) -> Command:
    return Command(*(getattr(command, name)[who : who + 1] for name in command.__dataclass_fields__))


def test_exact_search_drives_as_brute_force_does(database):
    a, b = (drive(Controller(database, index=index), 250) for index in ("exact", "brute"))
    np.testing.assert_allclose(stack(a, "cost_candidate"), stack(b, "cost_candidate"), rtol=1e-5)


def test_searches_come_every_interval_and_when_the_command_changed_abruptly(database):
    def turn_back(frame, count):
        command = Command.still(count)
        command.velocity[:, 1] = 1.2 if frame < 51 else -1.2
        return command

    records = drive(Controller(database, settings=Settings(search_interval=0.2)), 120, turn_back)
    searched, forced = stack(records, "searched")[:, 0], stack(records, "forced")[:, 0]
    # The first frame's change from rest is abrupt as well; a search is forced when the change is over.
    assert np.flatnonzero(forced).tolist() == [1, 52]
    # Where a clip ended, the search came early, too.
    early = np.concatenate([[True], np.isin(stack(records, "frame")[:-1, 0], database.stops - 1)]) | forced
    for before, after in pairwise(np.flatnonzero(searched)):
        assert after - before == 12 or (after - before < 12 and early[after])


def test_a_transition_shows_no_jump(database):
    """At a jump a joint moves no further than its speeds before and after allow, plus the spring's pull."""
    records = drive(Controller(database, settings=Settings(foot_lock=False)), 300)
    positions, rotations = stack(records, "positions")[:, 0], stack(records, "rotations")[:, 0]
    positions[:, 0], rotations[:, 0] = 0, (1, 0, 0, 0)
    world, _ = kinematics.forward(database.skeleton, positions.astype(float), rotations.astype(float))
    step = np.linalg.norm(np.diff(world, axis=0), axis=-1).max(axis=-1)
    jumps = stack(records, "transition")[1:, 0]
    assert jumps.sum() > 5
    # The clips' own joints move up to so much a frame.
    own = kinematics.forward(database.skeleton, *(a.astype(float) for a in at_origin(database.poses)))[0]
    usual = np.linalg.norm(np.diff(own, axis=0), axis=-1).max(axis=-1)
    inner = np.ones(len(own) - 1, bool)
    inner[database.stops[:-1] - 1] = False
    assert step[jumps].max() < 1.5 * usual[inner].max()


def at_origin(poses: Poses) -> tuple[np.ndarray, np.ndarray]:
    positions, rotations = poses.positions.copy(), poses.rotations.copy()
    positions[:, 0], rotations[:, 0] = 0, (1, 0, 0, 0)
    return positions, rotations


def test_without_jumps_the_root_walks_the_clip(database):
    """Playing on, in the world, is the clip itself."""
    settings = Settings(synchronization="none", search_interval=1e6, foot_lock=False)
    controller = Controller(database, settings=settings)
    start = int(database.starts[0])
    controller.reset(database.poses.positions[start : start + 1, 0][:, [0, 2]], yaw_of(database, start))
    controller.state.index[:] = start
    controller.characters["until_search"] = 1e6
    records = drive(controller, 200, lambda frame, count: Command.still(count))
    expected = database.poses.positions[start + 1 : start + 201, 0]
    np.testing.assert_array_equal(stack(records, "frame")[:, 0], np.arange(start + 1, start + 201))
    np.testing.assert_allclose(stack(records, "positions")[:, 0, 0], expected, atol=2e-4)


def yaw_of(database, frame: int) -> np.ndarray:
    rotation = database.poses.rotations[frame, 0]
    return np.array([2 * np.arctan2(rotation[2], rotation[0])], np.float32)


def test_clamp_and_data_synchronization(database):
    clamped = drive(Controller(database, settings=Settings(synchronization="adjust+clamp")), 300)
    apart = np.linalg.norm(
        stack(clamped, "positions")[:, :, 0, ::2] - stack(clamped, "simulation_position"), axis=-1
    )
    assert apart.max() <= 0.15 + 1e-5
    assert apart.max() > 0.01
    driven = drive(Controller(database, settings=Settings(synchronization="data")), 100)
    root, object_ = stack(driven, "positions")[:, :, 0, ::2], stack(driven, "simulation_position")
    np.testing.assert_allclose(root, object_, atol=1e-6)


def test_a_locked_foot_stands_still_on_the_ground(database):
    records = drive(Controller(database), 300)
    feet, locked = touching(database, records)[:, 0], stack(records, "locked")[:, 0]
    heights = Controller(database)._legs.heights
    checked = 0
    for c in range(locked.shape[1]):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], locked[:, c], [0]])))
        for start, stop in edges.reshape(-1, 2):
            # After the blend into the lock, and before a leg that is left behind reaches its full length.
            held = feet[start + 24 : stop - 6, c]
            if len(held) > 2:
                checked += 1
                assert np.all(held[:, 1] > heights[c, 0] - 4e-3)
                assert np.all(held[:, 1] < heights[c, 1] + 4e-3)
                assert np.ptp(held, axis=0).max() < 6e-3
    assert checked >= 3
    free = drive(Controller(database, settings=Settings(foot_lock=False)), 300)
    slide = [
        np.linalg.norm(np.diff(touching(database, r)[:, 0][..., [0, 2]], axis=0), axis=-1)
        for r in (records, free)
    ]
    contact = stack(records, "locked")[1:, 0]
    assert slide[0][contact].mean() < 0.6 * slide[1][contact].mean()


def test_obstacles_are_not_entered(database):
    def straight(frame, count):
        command = Command.still(count)
        command.velocity[:] = (0.05, 1.2)
        return command

    settings = Settings(body_radius=0.3)
    records = drive(Controller(database, obstacles=[circle(0, 2, 0.5)], settings=settings), 300, straight)
    place = stack(records, "simulation_position")[:, 0]
    assert np.linalg.norm(place - (0, 2), axis=-1).min() > 0.8 - 1e-4
    assert place[-1, 1] > 3


def test_tags_limit_the_search(database):
    tags = np.zeros(len(database), np.uint32)
    wanted = [i for i, name in enumerate(database.names) if name == "straight"]
    for i in wanted:
        tags[database.starts[i] : database.stops[i]] = 1
    database = type(database)(**(vars(database) | {"tags": tags, "tag_names": ("straight",)}))

    def only_straight(frame, count):
        command = user(frame, count)
        command.required_tags[:] = database.tag_mask(["straight"])
        return command

    records = drive(Controller(database), 150, only_straight)
    ranges = database.ranges()[stack(records, "frame")[:, 0]]
    # Obeyed at once, whatever it costs.
    assert set(ranges) == set(wanted)

    def impossible(frame, count):
        command = only_straight(frame, count)
        command.forbidden_tags[:] = 1 if frame == 30 else 0
        return command

    with pytest.raises(UserError, match="tags that no frame bears"):
        drive(Controller(database), 40, impossible)
    with pytest.raises(UserError, match=r"no tag 'dance'.*straight"):
        database.tag_mask(["dance"])


def test_who_is_to_crouch_plays_frames_of_that_tag_and_others_none(database):
    low = np.array(database.names)[database.ranges()] == "left_turn"
    tags = low.astype(np.uint32)
    tagged = type(database)(**(vars(database) | {"tags": tags, "tag_names": ("crouch",)}))

    def commands(frame: int, count: int) -> Command:
        command = user(frame, count)
        command.crouch[:] = [frame >= 60, False]
        return command

    records = drive(Controller(tagged, count=2), 120, commands)
    crouched = low[stack(records, "frame")]
    assert not crouched[2:60].any() and crouched[62:, 0].all() and not crouched[:, 1].any()

    def forbidding(frame: int, count: int) -> Command:
        command = commands(frame, count)
        command.forbidden_tags[:] = 1
        return command

    assert not low[stack(drive(Controller(tagged, count=2), 90, forbidding), "frame")][2:].any()


def test_a_continuing_bias_jumps_less_often(database):
    plain, biased = (
        stack(drive(Controller(database, settings=Settings(continuing_bias=b)), 300), "transition").sum()
        for b in (0.0, 0.6)
    )
    assert 0 < biased < plain


def test_nobody_turns_back_at_once_to_what_was_left(database):
    """Jumps to within the radius of the frame that the one before left come later than so many frames."""

    def returns(settings: Settings) -> np.ndarray:
        records = drive(Controller(database, count=8, settings=settings), 600)
        names = ("transition", "source", "candidate", "cost_current")
        moved, source, found, playing = (stack(records, name) for name in names)
        out = []
        for who in range(8):
            for before, jump in pairwise(np.flatnonzero(moved[:, who])):
                near = abs(found[jump, who] - source[before, who]) < 20
                if near and np.isfinite(playing[jump, who]):  # who can play on
                    out.append(jump - before)
        return np.array(out)

    free = Settings(reselect_time=0, continuing_bias=0)
    held = Settings(reselect_time=1.0, continuing_bias=0)
    assert returns(free).min() < 60 <= returns(held).min(initial=600)


def test_turning_back_is_kept_off_but_from_where_nothing_goes_on():
    characters = np.zeros(7, CHARACTER)
    characters["left"], characters["until_back"] = 100, [0.2, 0.2, 0.2, 0.2, 0.2, 0.0, 0.2]
    characters["left"][6] = -1  # what a network made up
    frames = np.array([104, 105, 96, -1, 100, 100, 1], np.int32)
    who, forced = np.arange(7), np.arange(7) == 4
    for module in (kernels, kernels_numpy):
        found = np.ones(7, np.bool_)
        module.turn_back(characters, who, frames, forced, 5, 1 / 60, found)
        assert found.tolist() == [False, True, False, True, True, True, True]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"search_interval": -1}, "search_interval"),
        ({"continuing_bias": 1.0}, "continuing_bias"),
        ({"velocity_halflife": float("nan")}, "velocity_halflife"),
        ({"synchronization": "magnet"}, "adjust, clamp"),
    ],
)
def test_settings_out_of_range_are_named(change, message):
    with pytest.raises(UserError, match=message):
        Settings(**change)


def test_foot_locking_without_legs_is_refused_with_the_remedy(database):
    skeleton = database.skeleton.with_roles(
        {role: j for role, j in database.skeleton.roles.items() if role != "left_leg"}
    )
    legless = type(database)(**(vars(database) | {"skeleton": skeleton}))
    with pytest.raises(UserError, match="turn foot locking off"):
        Controller(legless)
    Controller(legless, settings=Settings(foot_lock=False))


def test_no_characters_are_refused(database):
    with pytest.raises(UserError, match="0 characters"):
        Controller(database, count=0)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_broken_command_names_its_character_and_moves_nobody(database, compiled):
    controller = Controller(database, count=3, compiled=compiled)
    before = controller.characters.copy()
    command = Command.still(3)
    command.yaw[1] = np.nan
    with pytest.raises(UserError, match="character 1 is not finite"):
        controller.step(command)
    np.testing.assert_array_equal(controller.characters, before)
    with pytest.raises(UserError, match=r"velocity \(2, 2\)"):
        controller.step(Command.still(2))
