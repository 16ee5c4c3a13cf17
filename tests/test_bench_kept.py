"""A comparison that goes on where it was interrupted, and takes nothing that was found of something else."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench import comparison as comparing
from bench import crowd, kept, systems, tables, timing
from bench.comparison import compare
from bench.runs import Run, Variant
from features.terrain import Heightmap
from mm import courses
from mm.build import build
from mm.controller import Controller
from mm.course import Course, VelocityKey, Waypoint
from motion.errors import NotFinite, UserError

STRAIGHT = Course(
    name="straight",
    waypoints=(Waypoint(position=(0.0, 0.0), speed=1.5), Waypoint(position=(0.0, 20.0), speed=1.5)),
)
TURNS = Course(
    name="turns",
    velocity=(VelocityKey(time=0.0, velocity=(0.0, 1.0)), VelocityKey(time=0.5, velocity=(1.0, 0.0))),
    seconds=1.0,
)
HILLS = Heightmap(0.1 * np.random.default_rng(0).random((40, 40), np.float32))


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


class Counted:
    """Makes motion matching that is named otherwise, and counts how often steps are recorded of it."""

    def __init__(self, name="counted", made_of="one", stop_after=None):
        self.made, self.stop_after = 0, stop_after
        self.entry = systems.Entry(name, self.make, made_of=made_of)

    def make(self, database, count, *, obstacles=()):
        self.made += 1
        if self.stop_after is not None and self.made > self.stop_after:
            raise KeyboardInterrupt
        return Controller(database, count=count, index="brute")


def run(database, work, *entries, **options):
    options = {"courses": [TURNS, STRAIGHT], "seconds": 0.5, "timed_seconds": 0.1, "scale": False} | options
    return compare(database, systems=[e.entry for e in entries], work=work, **options)


def test_who_is_interrupted_goes_on_and_finds_the_same(database, tmp_path):
    whole = run(database, None, Counted("first"), Counted("second"), repeats=2)
    first, second = Counted("first"), Counted("second", stop_after=0)
    with pytest.raises(KeyboardInterrupt):
        run(database, tmp_path, first, second, repeats=2)
    assert first.made == 1 and len(list(tmp_path.iterdir())) == 3  # two seeds of one course, one of the other
    first, second = Counted("first"), Counted("second")
    resumed = run(database, tmp_path, first, second, repeats=2)
    assert first.made == 0 and second.made == 1
    metrics = [c for c in whole.runs if not c.endswith(("_us", "_bytes"))]
    pd.testing.assert_frame_equal(resumed.runs[metrics], whole.runs[metrics])
    assert all(trace.same(other) for trace, other in zip(resumed.traces, whole.traces, strict=True))
    # All of it is found again, times as well, and more systems measure themselves alone.
    more = Counted("more")
    again = run(database, tmp_path, Counted("first"), Counted("second"), more, repeats=2)
    assert more.made == 1
    pd.testing.assert_frame_equal(again.runs[again.runs["system"] != "more"], resumed.runs)
    pd.testing.assert_frame_equal(
        again.summary.iloc[1:3][["frame_us"]], resumed.summary.iloc[1:3][["frame_us"]]
    )


OTHERS = {
    "model": (lambda m: None, {"made_of": "another"}, {}),
    "seconds": (lambda m: None, {}, {"seconds": 0.4}),
    "timed": (lambda m: None, {}, {"timed_seconds": 0.05}),
    "course": (lambda m: None, {}, {"courses": [replace(c, size=2.0) for c in (TURNS, STRAIGHT)]}),
    "code": (lambda m: m.setattr(kept, "code", lambda: "another"), {}, {}),
    "ground": (lambda m: None, {}, {"ground": HILLS}),
    "ground elsewhere": (lambda m: None, {}, {"ground": replace(HILLS, origin=(1.0, 0.0))}),
    "machine": (lambda m: m.setattr(timing, "machine", lambda: {"processor": "another"}), {}, {}),
}  # fmt: skip


@pytest.mark.parametrize("what", OTHERS)
def test_results_of_anything_else_are_not_taken(what, database, tmp_path, monkeypatch):
    run(database, tmp_path, Counted(), ground=HILLS if what == "ground elsewhere" else None)
    change, of, options = OTHERS[what]
    change(monkeypatch)
    other = Counted(**of)
    run(database, tmp_path, other, **options)
    assert other.made == 1 and len(list(tmp_path.iterdir())) == 4


def test_results_of_another_database_are_not_taken(database, tmp_path, walker_files):
    slow = build([walker_files], jobs=1, fps=30)
    slow.save(tmp_path / "slow.mmdb")
    work = tmp_path / "work"
    run(database, work, Counted())
    other = Counted()
    run(slow, work, other)
    assert other.made == 1


def test_what_is_made_of_nobody_knows_what_is_not_kept(database, tmp_path):
    run(database, tmp_path, Counted(made_of=None))
    assert not list(tmp_path.iterdir())
    with pytest.raises(UserError, match="without a fingerprint cannot be kept; save it first"):
        run(replace(database, fingerprint=""), tmp_path, Counted())


def test_damaged_files_are_made_again(database, tmp_path):
    run(database, tmp_path, Counted())
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:-40])
    again = Counted()
    run(database, tmp_path, again)
    assert again.made == 1


def test_crowds_are_kept_too(database, tmp_path):
    store = kept.Kept(tmp_path, {"database": database.fingerprint})
    options = {"counts": (1, 3), "seconds": 0.1, "repeats": 2, "kept": store}
    found = crowd.of_entries(database, [Counted("a").entry], **options)
    assert [row["characters"] for row in found] == [1, 3]
    for row in found:
        assert 0 < row["us"] <= row["least_us"] <= row["most_us"] and row["median_us"] <= row["p99_us"]
    again = Counted("a")
    assert crowd.of_entries(database, [again.entry], **options) == found and again.made == 0
    assert all(row["frame_bytes"] >= 0 for row in found)
    crowd.of_entries(database, [again.entry], **options | {"repeats": 3})
    assert again.made == 2


def test_the_code_is_known_by_its_source(tmp_path, monkeypatch):
    before = kept.code.__wrapped__()
    assert before == kept.code.__wrapped__()
    (tmp_path / "more.py").write_text("x = 1\n")
    real = kept.resources.files
    monkeypatch.setattr(kept.resources, "files", lambda name: tmp_path if name == "mm" else real(name))
    assert kept.code.__wrapped__() != before


def test_a_run_comes_back_as_it_went(database):
    result = run(database, None, Counted(), courses=[TURNS])
    one = Run({"system": "a", "x": np.float64("nan")}, None, result.traces[0])
    back = Run.unpacked(*one.packed())
    assert np.isnan(back.row["x"]) and back.cost is None
    assert back.trace.same(one.trace) and back.trace.skeleton.names == one.trace.skeleton.names


def test_seeds_begin_elsewhere_or_are_other_users():
    circle, random, still = (courses.load(name) for name in ("circle", "random", "obstacles"))
    variants = Variant.of(circle, 4)
    assert variants[0].course is circle and variants[0].begin == 0
    begins = sorted(variant.begin for variant in variants)
    assert min(np.diff([*begins, 1.0])) > 0.1  # they are spread
    users = [variant.course.random.seed for variant in Variant.of(random, 3)]
    assert users == [random.random.seed + k for k in range(3)]
    assert len(Variant.of(still, 4)) == 1  # an open way
    assert [v.facts() for v in Variant.of(circle, 2)] == [v.facts() for v in variants[:2]]


def test_tables_of_several_seeds(database, tmp_path):
    found = run(database, None, Counted("a"), Counted("b"), repeats=3)
    assert found.runs.groupby("course")["seed"].nunique().to_dict() == {"turns": 3, "straight": 1}
    assert len(found.courses) == 4 and len(found.traces) == 4
    turns = found.runs[(found.runs["system"] == "a") & (found.runs["course"] == "turns")]
    row = found.courses.iloc[0]
    assert row["heading_deg"] == pytest.approx(turns["heading_deg"].mean())
    assert row["pop_cm"] == pytest.approx(turns["pop_cm"].max(), nan_ok=True)
    assert turns["frame_us"].notna().tolist() == [True, False, False]
    assert turns["heading_deg"].nunique() > 1
    assert found.summary["heading_deg_ci95"].iloc[1] > 0 and found.summary["runs"].iloc[1] == 4
    files = tables.contents(found, command="x")
    assert {"summary.csv", "courses.csv", "summary.json", "tables/runs.csv"} <= set(files)
    if tables.has_parquet():
        (tmp_path / "runs.parquet").write_bytes(files["tables/runs.parquet"])
        read = pd.read_parquet(tmp_path / "runs.parquet")
        np.testing.assert_array_equal(read["heading_deg"], found.runs["heading_deg"])
        assert np.isnan(read["frame_us"].iloc[1])


class Lost(Controller):
    """Its poses are no numbers from the tenth step on."""

    def step(self, command):
        poses = super().step(command)
        self.steps = getattr(self, "steps", 0) + 1
        if self.steps > 10:
            raise NotFinite("lost")
        return poses


def test_who_breaks_has_a_row_that_says_so(database, tmp_path):
    lost = systems.Entry("lost", lambda db, n, obstacles=(): Lost(db, count=n, index="brute"), made_of="")
    sound = Counted("mm-exact").entry
    for _ in range(2):  # measured, and kept
        found = compare(
            database, courses=[TURNS], systems=[sound, lost], seconds=0.5, timed_seconds=0.1, work=tmp_path
        )
        assert found.runs["broke"].tolist() == [0, 1] and np.isnan(found.runs["path_cm"].iloc[1])
        assert [trace.system for trace in found.traces] == ["mm-exact"]
        assert found.verdict.breaks["lost"] == "shows poses that are no numbers on turns"
        assert any(note.startswith("lost broke") for note in found.notes)


def test_a_busy_machine_is_told():
    rows = pd.DataFrame({"frame_mean_us": [math.nan, 50.0, 80.0], "frame_spread_us": [math.nan, 4.0, 9.0]})
    assert comparing._busy(rows) == [] and comparing._busy(rows[["frame_mean_us"]]) == []
    rows["frame_spread_us"] *= 20
    assert "by up to 225 % of their mean" in comparing._busy(rows)[0]


def test_crowds_are_of_one_of_each_kind(database):
    def named(name, source="", way=""):
        return replace(Counted(name).entry, source=source, way=way)

    chosen = [
        *(named("mm-brute"), named("mm-exact"), named("mm-exact-free")),
        *(named(f"lmm-{way}", "lmm", way) for way in ("PSD", "D")),
        *(named(f"pfnn-{way}", "pfnn", way) for way in ("cubic", "constant")),
        named("mann-4", "mann", "4"),
    ]
    names = [entry.name for entry in comparing._in_crowds(chosen, None)]
    assert names == ["mm-exact", "lmm-PSD", "pfnn-constant", "mann-4"]
    assert [entry.name for entry in comparing._in_crowds(chosen, ["lmm", "*-4"])] == [
        "lmm-PSD",
        "lmm-D",
        "mann-4",
    ]
    with pytest.raises(UserError, match="none of the systems is called gnn; choose from mm-brute"):
        comparing._in_crowds(chosen, ["gnn"])
