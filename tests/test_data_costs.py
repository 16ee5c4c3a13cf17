"""Glitches and costs of a run: what is put into a motion is found, costs are those of the search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench.data import costs, glitches
from bench.data.clips import Clips
from bench.data.glitches import Bounds
from features import normalise
from mm import courses, quality
from mm.controller import Controller
from mm.quality import Feet
from mm.recording import record
from motion.errors import UserError

FAR = Bounds(cost=1e9, pop_cm=1e9, slip_cm=1e9)


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


@pytest.fixture(scope="module")
def feet(database):
    return Feet.of(database)


@pytest.fixture(scope="module")
def recording(database):
    return record(Controller(database, count=2), courses.load("random"), seconds=5)


def test_a_stance_slips_by_what_its_foot_slides():
    feet = np.zeros((40, 2, 3))
    feet[:, 1] = [0, 0.5, 0]  # high up: whatever it does is no slip
    feet[:, 1, 0] = np.arange(40)
    feet[12:17, 0, 2] = 0.01 * np.arange(5)
    feet[17:, 0, 2] = 0.04
    feet[30:, 0, 2] += 1.0  # not on the ground then
    touching = np.zeros((40, 2), np.uint8)
    touching[2:10], touching[11:30] = 1, 1
    table = glitches.stances(feet, touching, 60.0, np.zeros(2))
    left = table[table["foot"] == 0]
    assert left[["start", "stop"]].values.tolist() == [[2, 10], [11, 30]]
    np.testing.assert_allclose(left["slip_cm"], [0, 4.0], atol=1e-9)
    assert 13 <= left["worst"].iloc[1] <= 16
    np.testing.assert_allclose(table[table["foot"] == 1]["slip_cm"], 0)


def test_bounds_are_what_the_clips_stay_below():
    bounds = glitches.bounds(np.append(np.arange(1001.0), np.inf), np.arange(2001.0), np.arange(101.0))
    assert (bounds.cost, bounds.pop_cm, bounds.slip_cm) == pytest.approx((999, 1998, 99))
    still = glitches.bounds(np.array([np.inf]), np.zeros(3), np.zeros(0))
    assert np.isinf(still.cost) and still.slip_cm == glitches.SEEN_CM


def test_leaps_are_told_with_clip_second_and_joint(database):
    own = Clips.of(database)
    poses = database.poses[own.frames]
    local = quality.in_root_space(database.skeleton, poses.positions, poses.rotations)
    head = database.skeleton.names[1:].index("Head") if "Head" in database.skeleton.names else 4
    local[own.starts[1] + 30, head] += [0, 0.3, 0]
    pops = glitches.pops(local, own)
    assert all((pops[start : start + 2] == 0).all() for start in own.starts)
    table = glitches.leaps(local, pops, own, 20.0, database.skeleton.names[1:])
    assert len(table) == 1
    row = table.iloc[0]
    assert (row["clip"], row["joint"]) == (own.names[1], database.skeleton.names[1 + head])
    assert row["at_s"] == pytest.approx(0.5, abs=0.04)
    assert row["pop_cm"] == pytest.approx(60, rel=0.1)  # there and back: twice the leap
    assert row["frame"] == pytest.approx(database.starts[2] + 30, abs=2)


def test_costs_are_those_of_the_search(database, feet, recording):
    run = costs.of_run(recording, database, feet, FAR, character=1)
    assert len(run) == len(recording) and run.features == tuple(f.name for f in database.schema.features)
    at = np.flatnonzero(run.searched)
    # What plays has gone on by the one frame that is shown.
    playing = database.features[recording["frame"][at, 1] - 1]
    truth = normalise.total_costs(database.schema, recording["query"][at, 1], playing)
    np.testing.assert_allclose(run.total[at], truth, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(run.total[at[2] : at[3]], run.total[at[2]])
    table = costs.by_feature(run)
    assert table["share"].sum() == pytest.approx(1) and table["share_at_peaks"].isna().all()
    assert table["mean"].sum() == pytest.approx(run.total[at].mean())
    frames = costs.over_time(run)
    np.testing.assert_allclose(frames[[*run.features]].sum(axis=1), frames["cost"], rtol=1e-6)
    assert frames["transition"].sum() == recording["transition"][:, 1].sum() > 0


def test_ordinary_walking_is_below_high_bounds(database, feet, recording):
    run = costs.of_run(recording, database, feet, FAR)
    assert len(run.moments) == 0 and list(run.moments.columns) == costs.MOMENT
    assert (costs.by_kind(run)["moments"] == 0).all()


def test_glitches_that_are_put_in_are_found(database, feet, recording):
    arrays = {name: np.array(array) for name, array in recording.arrays.items()}
    hand = 1 + database.skeleton.names[1:].index("LeftHand") if "LeftHand" in database.skeleton.names else 5
    arrays["positions"][100, 0, hand] += [0, 0.5, 0]
    at = int(np.flatnonzero(arrays["searched"][:, 0])[5])
    arrays["feature_costs"][at, 0, 2] = 5000
    arrays["transition"][:, 0] = False
    arrays["transition"][95, 0] = True
    # A foot that is said to stand while the character is carried along.
    arrays["contacts"][:] = 0
    arrays["contacts"][200:230, 0] = 1
    arrays["positions"][200:230, 0, 0, 0] += 0.02 * np.arange(30)
    run = costs.of_run(
        replace(recording, arrays=arrays), database, feet, Bounds(cost=2000, pop_cm=40, slip_cm=10)
    )
    by_kind = {kind: rows for kind, rows in run.moments.groupby("kind")}
    assert set(by_kind) == {"cost", "pop", "slip"}
    cost, pop = by_kind["cost"].iloc[0], by_kind["pop"].iloc[0]
    assert len(by_kind["cost"]) == len(by_kind["pop"]) == 1
    assert cost["at_s"] == pytest.approx(at / 60) and cost["what"].startswith(run.features[2])
    assert cost["times"] == pytest.approx(cost["value"] / 2000) and cost["times"] > 2.5
    assert pop["at_s"] == pytest.approx(101 / 60, abs=0.02)
    assert pop["after_s"] == pytest.approx(pop["at_s"] - 95 / 60)
    assert pop["what"] == database.skeleton.names[hand]
    slip = by_kind["slip"]
    assert slip["from_s"].min() == pytest.approx(200 / 60) and slip["to_s"].max() == pytest.approx(230 / 60)
    assert slip["value"].max() > 10 and set(slip["what"]) <= set(database.contact_roles)
    frame = int(arrays["frame"][round(pop["at_s"] * 60), 0])
    which = database.ranges()[frame]
    assert pop["clip"].split()[0] == database.names[which]
    assert pop["clip_s"] == pytest.approx((frame - database.starts[which]) / database.fps)
    assert run.moments["times"].is_monotonic_decreasing
    assert run.blended == pytest.approx(22 / len(run))  # 0.35 s from frame 95 on
    kinds = costs.by_kind(run).set_index("kind")
    assert kinds.loc["pop", ["moments", "after_transition"]].tolist() == [1, 1]
    assert kinds.loc["cost", "per_minute"] == pytest.approx(12)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"arrays": ()}, "makes no searches"),
        ({"database": "another"}, "another database"),
        ({"skeleton": True}, "another skeleton"),
    ],
)
def test_recordings_that_do_not_belong_are_refused(database, recording, change, expected):
    if "arrays" in change:
        change = {"arrays": {k: v for k, v in recording.arrays.items() if k != "feature_costs"}}
    if "skeleton" in change:
        names = tuple(f"{name}2" for name in recording.skeleton.names)
        change = {"skeleton": replace(recording.skeleton, names=names)}
    with pytest.raises(UserError, match=expected):
        costs.check(replace(recording, **change), database, "run.rec")
    costs.check(recording, database, "run.rec", character=1)
    with pytest.raises(UserError, match="no character 2"):
        costs.check(recording, database, "run.rec", character=2)


def test_a_table_without_stances_is_a_table():
    table = glitches.stances(np.zeros((3, 1, 3)), np.zeros((3, 1)), 60.0, np.zeros(1))
    assert isinstance(table, pd.DataFrame) and len(table) == 0 and list(table) == glitches.STANCE
