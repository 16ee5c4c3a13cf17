"""viewer.explain: on driven courses its winner is the engine's, its costs add up, its reasons are true."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import lmm_models
import numpy as np
import pytest
import synthetic

from features import normalise
from lmm import controller as controllers
from lmm.model import Model
from mm.build import build
from mm.codecs import stages as compressed_stages
from mm.codecs.compressed import compress
from mm.controller import Controller
from mm.course import Course, RandomUser
from mm.database import Database
from mm.driving import at_data_speeds
from mm.settings import Settings
from motion import bvh
from motion.errors import UserError
from viewer import explain
from viewer.controls import on_course
from viewer.scene import DARK
from viewer.session import Session
from viewer.timeline import Timeline
from viewer.window import searches as pictures


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Walks of which no two strides are alike, one of them tagged as crouched."""
    folder = tmp_path_factory.mktemp("uneven")
    for i, speed in enumerate((0.8, 1.1, 1.5)):

        def turn(time, i=i):
            return np.sin((0.7 + 0.2 * i) * time + i) + 0.4 * np.sin(1.9 * time)

        bvh.write(folder / f"w{i}.bvh", synthetic.walk(f"w{i}", speed=speed, turn=turn, seconds=6))
    (folder / "tags.csv").write_text("tag,clips,start,stop\ncrouch,w0,,\nfast,w2,,\n")
    return folder


def built(walks: Path, schema: str) -> Database:
    return build([walks], jobs=1, schema=schema, mirror=False, tags=walks / "tags.csv")


@pytest.fixture(scope="module")
def database(walks: Path) -> Database:
    return built(walks, "mm27")


def drive(system: Any, data: Any, seconds: float = 6.0, crouch: float = 0.3) -> Session:
    user = RandomUser(seed=4, crouch=crouch, hold=(0.3, 1.0))
    course = at_data_speeds(Course(name="user", random=user, seconds=seconds), data)
    found = Session({"it": system}, on_course(course))
    while found.time < seconds:
        found.advance(0.1)
    return found


def searches(timeline: Timeline) -> np.ndarray:
    return timeline.first + np.flatnonzero(timeline.stack("searched"))


def explained(timeline: Timeline, data: Any, **options: Any) -> list[explain.Explanation]:
    found = []
    for step in searches(timeline):
        settings, _ = timeline.made_by(step)
        found.append(explain.explain(data, timeline.record(step), settings, **options))
    return found


@pytest.mark.parametrize("schema", ["mm27", "o3de59"])
def test_at_every_search_of_a_course_the_winner_is_the_engines(walks: Path, schema: str) -> None:
    database = built(walks, schema)
    timeline = drive(Controller(database), database).actors["it"].timeline
    found = explained(timeline, database, count=4)
    assert len(found) > 50
    for each in found:
        assert each.agrees, (each.winner, each.found)
        assert each.winner_cost == each.found_cost
    jumps = [each for each in found if each.chosen]
    assert len(jumps) == timeline.stack("transition").sum() > 10
    assert all(each.chosen.frame == each.winner for each in jumps)
    assert any(each.winner < 0 for each in found)


@pytest.mark.parametrize(
    "settings",
    [Settings(ignore_radius=0.9, ignore_end=0.1, continuing_bias=0.0), Settings(ignore_radius=0.05)],
)
def test_so_it_is_by_any_settings(database: Database, settings: Settings) -> None:
    timeline = drive(Controller(database, settings=settings), database, 4.0).actors["it"].timeline
    found = explained(timeline, database, count=1)
    assert len(found) > 30 and all(each.agrees and each.winner_cost == each.found_cost for each in found)


def test_what_an_index_missed_is_said_to_be_missed(database: Database) -> None:
    timeline = drive(Controller(database), database, 3.0).actors["it"].timeline
    steps = [step for step in searches(timeline) if timeline.record(step)["transition"]]
    record = timeline.record(steps[0])
    exact = explain.explain(database, record, Settings())
    second = next(each for each in exact.candidates if each.verdict == explain.BEATEN)
    record |= {"candidate": np.int32(second.frame), "cost_candidate": np.float32(second.cost)}
    found = explain.explain(database, record, Settings())
    assert not found.agrees and found.winner == exact.found and found.chosen.frame == second.frame
    best = next(each for each in found.candidates if each.frame == exact.found)
    assert best.verdict == explain.MISSED and f"beats {second.cost:.3g}, but was not found" in best.reason


def test_a_jump_that_tags_asked_for_is_no_end_of_a_clip(database: Database) -> None:
    timeline = drive(Controller(database), database, 6.0, crouch=0.5).actors["it"].timeline
    ends, seen = database.stops[database.ranges()] - 1, set()
    for step, each in zip(searches(timeline), explained(timeline, database, count=1), strict=True):
        record = timeline.record(step)
        if not record["transition"] or np.isfinite(record["cost_current"]):
            continue
        ended = ends[record["source"]] == record["source"]
        assert each.chosen.reason.endswith("the clip ended" if ended else "not what was asked for")
        seen.add(ended)
    assert False in seen


def test_the_reasons_are_true(database) -> None:
    settings = Settings(continuing_bias=0.4)
    timeline = drive(Controller(database, settings=settings), database).actors["it"].timeline
    ends, starts = database.stops[database.ranges()], database.starts[database.ranges()]
    seen, jumps = set(), [(-100, -100)]  # steps, and the frames that were left
    for step, each in zip(searches(timeline), explained(timeline, database, count=30), strict=True):
        record = timeline.record(step)
        costs = [candidate.cost for candidate in each.candidates]
        assert costs == sorted(costs)
        assert len({candidate.frame for candidate in each.candidates}) == len(costs)
        for one in each.candidates:
            f, bits = one.frame, database.tags[one.frame]
            parts = normalise.costs(database.schema, record["query"], database.features[f])
            np.testing.assert_array_equal(one.costs, parts)
            assert one.cost == pytest.approx(parts.sum(), rel=1e-4, abs=1e-6)
            assert one.clip == database.names[database.ranges()[f]]
            assert one.seconds == pytest.approx((f - starts[f]) / 60)
            seen.add(one.verdict)
            near = abs(f - int(record["source"])) < 20
            end = ends[f] - f <= 20
            wrong = (record["required_tags"] & ~bits) | (record["forbidden_tags"] & bits)
            if one.verdict == explain.NEAR:
                assert near
            elif one.verdict == explain.END:
                assert end and not near
            elif one.verdict == explain.TAGS:
                assert wrong and not near and not end
                assert "crouch" in one.reason
            elif one.verdict == explain.PLAYING:
                assert f == record["source"]
            else:
                assert not (near or end or wrong)
                bound = {explain.CHOSEN: 0.6, explain.BEATEN: 0.6}.get(one.verdict, 1.0)
                if one.verdict == explain.LEFT:
                    (when, left), bound = jumps[-1], 0.6
                    assert step - when < 20 and abs(f - left) < 20 and not record["transition"]
                if one.verdict in (explain.CHOSEN, explain.LEFT, explain.BEATEN, explain.BIAS):
                    assert one.cost < bound * record["cost_current"] * (1 + 1e-6)
                else:
                    assert one.verdict == explain.DEARER
                    assert one.cost >= record["cost_current"]
        if record["transition"]:
            jumps.append((step, int(record["source"])))
    expected = {explain.CHOSEN, explain.PLAYING, explain.NEAR, explain.TAGS, explain.DEARER, explain.BEATEN}
    assert expected | {explain.BIAS, explain.LEFT} <= seen


def test_a_table_has_a_row_a_candidate_and_a_column_a_feature(database) -> None:
    timeline = drive(Controller(database), database, 2.0).actors["it"].timeline
    each = explained(timeline, database)[-1]
    table = each.table()
    assert len(table) == len(each.candidates) <= explain.COUNT
    names = [feature.name for feature in database.schema.features]
    np.testing.assert_allclose(table[names].sum(axis=1), table["cost"], rtol=1e-4, atol=1e-6)
    assert table["reason"].str.len().min() > 5


def test_frames_of_one_moment_are_one_candidate(database) -> None:
    timeline = drive(Controller(database), database, 2.0).actors["it"].timeline
    for each in explained(timeline, database, count=20):
        for verdict in (explain.DEARER, explain.BEATEN):
            frames = sorted(one.frame for one in each.candidates if one.verdict == verdict)
            assert all(np.diff(frames) > round(explain.DISTINCT * 60) // 2)
    assert any(one.others > 5 for one in each.candidates)


def test_settings_and_weights_of_the_time_explain_what_was_done_then(database) -> None:
    session = drive(Controller(database), database, 3.0)
    weighted = replace(database, features=database.features * np.float32(0.5))
    session.retune("it", Settings(continuing_bias=0.7, ignore_radius=0.0))
    session.advance(0.25)
    for _ in range(12):
        session.advance(0.25)
    session.exchange("it", Controller(weighted))
    for _ in range(12):
        session.advance(0.25)
    timeline = session.actors["it"].timeline
    seen = 0
    for step in searches(timeline):
        each = explain.at(timeline, step / 60, None)
        assert each is not None and each.agrees
        seen += 1
    assert seen > 80
    assert timeline.made_by(timeline.last)[1] is weighted
    assert explain.step_of(timeline, 0.01) == 1  # the first command makes one


@pytest.mark.parametrize(("features", "index"), [("float16", "exact"), ("8bit", "aabb"), ("8bit", "coded")])
def test_a_compressed_database_explains_its_own_searches(features: str, index: str) -> None:
    small = compress(lmm_models.database(), f"float16+features-{features}", rigs=False)
    system = compressed_stages.controller(small, index=index)
    timeline = drive(system, small.decoded(), 3.0, 0.0).actors["it"].timeline
    found = explained(timeline, small)
    assert len(found) > 20 and all(each.agrees for each in found)


@pytest.mark.parametrize("learned", ["S", "D", "SD"])
def test_searches_of_mixtures_are_explained_too(learned: str) -> None:
    data = lmm_models.database()
    system = controllers.controller(lmm_models.model(data), learned=learned, database=data)
    timeline = drive(system, data, 3.0, 0.0).actors["it"].timeline
    found = explained(timeline, data)
    assert len(found) > 20 and all(each.agrees for each in found)


@pytest.mark.parametrize("learned", ["P", "PSD"])
def test_a_projectors_answer_stands_beside_the_exact_one(learned: str) -> None:
    data = lmm_models.database()
    model = lmm_models.linear_model(data)  # its projector answers with the query itself
    system = controllers.controller(model, learned=learned, database=data)
    timeline = drive(system, data, 2.0, 0.0).actors["it"].timeline
    each = explain.at(timeline, timeline.end, data, system=system)
    assert each is not None and each.answer is not None
    assert each.answer.verdict == explain.ANSWER
    assert each.answer.cost == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(each.answer.costs, 0, atol=1e-6)
    assert each.table()["verdict"].iloc[-1] == "answer"
    assert explain.at(timeline, timeline.end, data).answer is None


@pytest.mark.parametrize("learned", ["P", "PSD"])
@pytest.mark.parametrize("make", [lmm_models.model, lmm_models.linear_model])
def test_what_became_of_a_networks_answer_is_told(learned: str, make: Callable[[Database], Model]) -> None:
    """A model of random numbers is hardly ever listened to, one that answers with the query always is."""
    data = lmm_models.database()
    system = controllers.controller(make(data), learned=learned, database=data)
    timeline = drive(system, data, 2.0, 0.0).actors["it"].timeline
    projector, seen = explain.projector_of(system), set()
    for step, each in zip(searches(timeline), explained(timeline, data, projector=projector), strict=True):
        record = timeline.record(step)
        took = record["transition"] and np.isfinite(record["cost_current"])
        cost, current = record["cost_candidate"], record["cost_current"]
        assert each.answer is not None
        if took:
            assert each.answer.reason.startswith(f"taken: {cost:.3g} beats {each.bound:.3g};")
        elif cost >= current:
            assert each.answer.reason.startswith(
                f"not taken: to play on costs {current:.3g}, this {cost:.3g};"
            )
        seen.add(bool(took))
        for one in each.candidates:  # none is said to be beaten by what cost more
            if one.verdict in (explain.BEATEN, explain.MISSED):
                assert (one.verdict == explain.MISSED) == (one.cost < cost)
    assert (make is lmm_models.linear_model) in seen


def test_what_cannot_be_explained() -> None:
    data = lmm_models.database()
    timeline = drive(Controller(data), data, 1.0, 0.0).actors["it"].timeline
    run = Timeline.of_recording(timeline.recording())
    whole = explain.at(run, 0.9, data)
    assert whole is not None and whole.agrees
    assert explain.at(run, 0.9, None) is None
    assert explain.at(run, 0.0, data) is None
    with pytest.raises(UserError, match="not made from this database"):
        explain.at(run, 0.9, lmm_models.database(schema="o3de59"))
    rounded = explain.at(run, 0.9, replace(data, fingerprint="of another machine"))
    assert rounded is not None and rounded.winner == whole.winner
    other = timeline.recording()
    del other.arrays["searched"]
    assert explain.at(Timeline.of_recording(other), 0.9, data) is None
    older = timeline.recording()
    del older.arrays["source"]
    with pytest.raises(UserError, match="record it again"):
        explain.at(Timeline.of_recording(older), 0.9, data)


def test_a_search_is_drawn_with_each_candidates_costs_and_long_reasons_on_lines_of_their_own(
    database: Database,
) -> None:
    timeline = drive(Controller(database), database, 2.0).actors["it"].timeline
    found = explained(timeline, database, count=6)[-1]

    def bars(width: int, height: int) -> np.ndarray:
        """Where the candidates' costs by feature begin, from the top."""
        picture = pictures.drawn(found, DARK, (width, height)).astype(int)
        assert picture.shape == (height, width, 3)
        shades = picture[:, 7].max(axis=-1) - picture[:, 7].min(axis=-1)
        coloured = np.concatenate([[False], shades > 60])  # neither ink nor ground
        return np.flatnonzero(coloured[1:] & ~coloured[:-1])

    assert len(found.candidates) == 6
    wide, narrow = bars(1400, 600), bars(160, 600)
    assert len(wide) == len(narrow) == 6
    assert len(set(np.diff(wide))) == 1
    assert narrow[-1] > wide[-1] + 30
    assert len(bars(1400, wide[3] + 20)) < 6  # those that there is room for
