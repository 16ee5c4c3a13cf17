"""viewer.window.players: who is in the window, on what ground, and what sliders do to how they move."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import lmm_models
import mann_models
import numpy as np
import pfnn_models
import pytest

from features.terrain import Heightmap
from mm import courses
from mm.controller import Controller
from mm.recording import record
from motion import bvh, console
from motion.errors import UserError
from viewer import moments, sources
from viewer.controls import of_keys
from viewer.layers.terrain import AHEAD, MARGIN
from viewer.scene import Surface
from viewer.window.players import LANE, Players

HILLS = Heightmap(0.2 * np.sin(np.arange(200, dtype=np.float32))[:, None] * np.ones(200, np.float32), 0.5)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, walker_clips) -> Path:
    folder, data = tmp_path_factory.mktemp("players"), lmm_models.database()
    data.save(folder / "walk.mmdb")
    lmm_models.model(data).save(folder / "walk.lmm")
    bvh.write(folder / "stroll.bvh", walker_clips[0])
    run = record(Controller(data), courses.load("circle"), seconds=0.5, progress=console.silent)
    run.save(folder / "lap.rec")
    return folder


@pytest.fixture
def playing(files: Path) -> Iterator[Callable[..., Players]]:
    made: list[Players] = []

    def play(*names: str, models: dict[str, Any] | None = None, **options: Any) -> Players:
        found = sources.read([files / name for name in names]) if names else sources.Sources()
        found.models |= models or {}
        made.append(Players(found, patience=20.0, **options))
        return made[-1]

    yield play
    for players in made:
        players.close()


def go(players: Players, keys: str = "W", seconds: float = 1.0) -> np.ndarray:
    """Hold keys for a while; where the first one is then."""
    assert players.live is not None
    if players.stick is not None:
        players.stick.hands = of_keys(keys)
    for _ in range(round(30 * seconds)):
        players.move_to(players.live.frame(1 / 30).time)
    return np.array(players.stage.roots[0])


@pytest.mark.parametrize(
    ("names", "options", "shown", "driven"),
    [
        (["stroll.bvh"], {}, ["stroll"], []),
        (["walk.mmdb", "walk.lmm"], {}, ["mm", "lmm"], ["mm", "lmm"]),
        (["stroll.bvh", "walk.mmdb"], {}, ["stroll", "mm"], ["mm"]),
        (["lap.rec", "walk.mmdb"], {}, ["lap"], []),
        (["lap.rec", "walk.mmdb"], {"course": "circle"}, ["lap", "mm"], ["mm"]),
        (["walk.mmdb", "walk.lmm"], {"systems": ["lmm-D"]}, ["lmm-D"], ["lmm-D"]),
    ],
)
def test_who_is_shown_and_who_is_driven(
    names: list[str], options: dict[str, Any], shown: list[str], driven: list[str], playing
) -> None:
    players = playing(*names, **options)
    assert [member.name for member in players.members] == shown
    assert players.names == driven and list(players.tunings) == driven
    assert (players.stick is not None) == (bool(driven) and "course" not in options)


@pytest.mark.parametrize(
    ("names", "options", "says"),
    [
        (["stroll.bvh"], {"course": "circle"}, "nobody is driven over a course; give a database"),
        (["stroll.bvh"], {"ground": HILLS}, "nobody is driven on heights"),
        (["lap.rec", "walk.mmdb"], {"settings": {"mm": "x"}}, "nobody is driven by settings; .*--systems"),
        (
            ["walk.mmdb"],
            {"settings": {"lmm": "x"}},
            "settings for 'lmm', which is not driven; choose from mm",
        ),
        (["walk.mmdb"], {"start": 1.0}, "begins now, and goes on; leave --from and --to out"),
        (["lap.rec"], {"start": 9.0}, "nothing from 9 to 0.48.* s; the longest lasts 0.48 s"),
        (["walk.mmdb"], {"ghost": True}, "a ghost needs two characters, here is one; choose two"),
    ],
)
def test_what_does_not_apply_is_a_line(names: list[str], options: dict[str, Any], says: str, playing) -> None:
    with pytest.raises(UserError, match=says):
        playing(*names, **options)


def test_what_is_recorded_plays_from_a_time_to_another_again_and_again(playing) -> None:
    players = playing("stroll.bvh", start=1.0, stop=2.0)
    start, end = (players.recorded[0].show.pose(t)[0][0, 0, 2] for t in (1.0, 2.0))
    seen = [go(players, seconds=1 / 30)[2] for _ in range(80)]
    assert start - 1e-3 <= min(seen) < max(seen) <= end + 1e-3
    assert sum(after < before for before, after in itertools.pairwise(seen)) == 2


def test_searches_of_who_makes_them_are_explained(playing) -> None:
    players = playing("walk.mmdb", models={"pfnn": pfnn_models.model()}, systems=["pfnn", "mm"])
    go(players, seconds=0.2)
    assert (players.first.name, players.searching.name) == ("pfnn", "mm")
    players.choose(["pfnn"])
    assert players.searching.name == "pfnn" and players.searching.explanation(1.0) is None


def test_jumps_from_between_frames_leave_nothing_out(playing) -> None:
    players = playing("walk.mmdb")
    go(players, seconds=2.0)
    steps = moments.of(players.members[0].timeline)["transition"]
    assert len(steps) > 1
    for step, later in itertools.pairwise(steps.tolist()):
        assert players.jump("transition", step / 60) == pytest.approx(later / 60)
        assert players.jump("transition", (step - 0.3) / 60) == pytest.approx(step / 60)
        assert players.jump("transition", (step + 0.3) / 60, back=True) == pytest.approx(step / 60)
        assert players.jump("transition", later / 60, back=True) == pytest.approx(step / 60)


def test_jumps_stay_within_what_is_played(playing) -> None:
    whole = playing("lap.rec").recorded[0].timeline
    first, last = moments.of(whole)["transition"][[0, -1]] / 60
    assert first < last
    players = playing("lap.rec", start=first + 0.01, stop=last - 0.01)
    assert players.jump("transition", last - 0.011) is None
    assert players.jump("transition", first + 0.011, back=True) is None


def test_a_ghost_stands_in_the_first_ones_place(playing) -> None:
    players = playing("walk.mmdb", "walk.lmm")
    assert len(players.stage.shows) == 2
    players.set_ghost(True)
    go(players, seconds=0.1)
    assert len(players.stage.shows) == 1
    assert any("ghost" in name for name in players.stage.scene.layers)
    players.choose(["mm"])
    assert not players.ghost and len(players.stage.shows) == 1


@pytest.mark.parametrize(
    ("options", "leftmost"), [({}, True), ({"course": "circle"}, False), ({"behind": False}, False)]
)
def test_the_first_one_is_leftmost_from_where_they_are_seen(
    options: dict[str, Any], leftmost: bool, playing
) -> None:
    """Driven by hand from behind, where +X is left; over a course from the front."""
    players = playing("walk.mmdb", "walk.lmm", **options)
    go(players, seconds=0.1)
    first, second = players.stage.roots[:, 0]
    assert (first > second + 0.5) if leftmost else (second > first + 0.5)


def test_all_walk_on_one_ground_that_goes_on_with_them(playing) -> None:
    players = playing("walk.mmdb", "walk.lmm", ground=HILLS)
    go(players, seconds=0.1)
    assert players.stage.roots[:, 0] == pytest.approx([LANE / 2, -LANE / 2], abs=0.1)  # +X is left
    assert players.stage.scene.ground is None

    def laid() -> np.ndarray:
        (ground,) = (layer for layer in players.stage.scene.layers.values() if isinstance(layer, Surface))
        return ground.mesh.vertices

    vertices = laid()
    np.testing.assert_allclose(vertices[:, 1], HILLS(vertices[:, 0], vertices[:, 2]), atol=1e-6)
    here = players.stage.roots[:, 2].max()
    assert vertices[:, 2].max() == pytest.approx(here + AHEAD + MARGIN, abs=0.5)
    players.do(lambda session: session.teleport([0.0, 20.0], 0.0))
    go(players, seconds=0.1)
    assert laid()[:, 2].max() > 20 + AHEAD


@pytest.mark.parametrize(
    ("kind", "setting", "value"),
    [
        ("mm", "velocity_halflife", 0.9),
        ("lmm", "velocity_halflife", 0.9),
        ("pfnn", "position_bias", 8.0),
        ("mann", "joint_smoothing", 0.9),
    ],
)
def test_a_slider_changes_how_they_move(kind: str, setting: str, value: float, playing) -> None:
    models = {"pfnn": pfnn_models.model, "mann": mann_models.model}
    given = {kind: models[kind]()} if kind in models else {}
    names = [] if given else ["walk.mmdb", "walk.lmm"]

    def end(tuned: bool) -> tuple[np.ndarray, np.ndarray]:
        players = playing(*names, models=given, systems=[kind])
        if tuned:
            assert not players.tunings[kind].set(setting, value)
            players.tune(kind, False)
        place = go(players, "W", 0.7)
        return place, players.stage.pose(0, players.session.time)[0]

    (plain, pose), (tuned, other), (again, same) = end(False), end(True), end(False)
    np.testing.assert_array_equal(pose, same)
    assert np.abs(pose - other).max() > 1e-3
    if setting == "velocity_halflife":
        assert tuned[2] < plain[2] == again[2]  # more slowly off


def test_a_slider_that_is_moved_while_another_system_is_made_waits_for_it(playing) -> None:
    players = playing("walk.mmdb")
    tuning = players.tunings["mm"]
    for name, value in (("ignore_end", 0.2), ("velocity_halflife", 0.1)):
        players.tune("mm", tuning.set(name, value))
    while players.session.actors["mm"].system.settings != tuning.settings:
        players.take_made()
        go(players, seconds=1 / 30)
    assert not players.session.look().errors


def test_a_run_that_tells_too_little_is_shown_and_that_is_said(
    playing, monkeypatch: pytest.MonkeyPatch
) -> None:
    players = playing("walk.mmdb", shown=["candidates"], ground=HILLS)
    go(players, seconds=0.5)
    before = np.array(players.stage.roots[0])

    def fails(_: float) -> None:
        raise UserError("the run does not tell source of its searches")

    monkeypatch.setattr(players.first, "explanation", fails)
    players.do(lambda session: session.teleport([0.0, 20.0], 0.0))
    with pytest.raises(UserError, match="does not tell"):
        go(players, seconds=0.1)
    assert players.stage.roots[0, 2] > before[2] + 5
    assert any(layer.mesh.vertices[:, 2].max() > 20 for layer in players.stage.scene.layers.values()
               if isinstance(layer, Surface))  # fmt: skip
