"""Compressed databases as systems: what they are called, what they hold, how exact they say they are."""

from __future__ import annotations

import linear_models
import lmm_models
import numpy as np
import pytest
from click.testing import CliRunner

from bench import compare, pose_error, systems
from bench.cli import main
from bench.entry import as_stored
from mm.codecs import compressed, errors
from motion.errors import UserError

BEST = "keyframes-0.5+quantised-11+features-8bit"


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


def test_codecs_come_by_name_by_pattern_or_asked(database):
    def names(*patterns, **options):
        return [entry.name for entry in systems.choose(patterns or None, indexes=["exact"], **options)]

    assert names() == names("mm") == ["mm-exact", "mm-exact-free"] == names("mm-exact*")
    assert names("mm-exact-quantised-11") == ["mm-exact-quantised-11"]
    assert names("mm-exact-quantised-11-free") == ["mm-exact-quantised-11-free"]
    assert names("mm-coded-*key*-0.5*") == [f"mm-coded-{BEST}"]
    assert names("mm-coded-*key*-0.5*", legs=False) == [f"mm-coded-{BEST}-free"]
    asked = names(codecs=["keyframes-3+quantised-9", "features-8bit"])
    small = ["mm-exact-keyframes-3+quantised-9", "mm-exact-float32+features-8bit"]
    assert asked == ["mm-exact", "mm-exact-free", *small, "mm-coded-float32+features-8bit"]
    with pytest.raises(UserError, match="no codec 'zip'"):
        names(codecs=["zip"])


def test_rows_of_codecs_have_all_that_others_have(database, tmp_path):
    path = tmp_path / "mine.mmdb"
    compressed.compress(database, BEST).save(path)
    found = compare(
        database,
        systems=["mm-exact", "mm-exact-quantised-11", "mm-*-mine"],
        codecs=[str(path)],
        courses=["circle"],
        seconds=1,
        timed_seconds=0.2,
    )
    rows = found.summary.set_index("system").iloc[1:]
    assert rows.index.tolist() == ["mm-exact", "mm-exact-mine", "mm-coded-mine", "mm-exact-quantised-11"]
    assert (rows["decompression_us"] > 0).all() and rows["skate_cm_s"].notna().all()
    assert rows["real_cm"].notna().all() and rows["mm_near_cm"]["mm-exact"] == 0
    assert rows["pose_cm"]["mm-exact"] == 0 and rows["pose_deg"]["mm-exact"] < 1e-6
    assert 0 < rows["pose_cm"]["mm-exact-quantised-11"] < rows["pose_cm"]["mm-exact-mine"] < 0.5
    assert (
        rows["memory_mb"]["mm-coded-mine"]
        < rows["memory_mb"]["mm-exact-mine"]
        < rows["memory_mb"]["mm-exact"]
    )
    assert "pose_held_cm" not in rows


def test_what_is_no_codec_is_an_error_before_the_work(walker_files):
    result = CliRunner().invoke(main, ["compare", str(walker_files), "--codecs", "quantised-11,zip"])
    assert result.exit_code == 2 and "no codec 'zip'" in result.stderr


def test_a_file_of_another_database_is_left_out(database, tmp_path):
    path = tmp_path / "other.mmdb"
    compressed.compress(lmm_models.database(), "quantised-11").save(path)
    (entry,) = systems.choose(["mm-exact-other"], codecs=[str(path)])
    assert entry.alone and entry.make(None, 2).count == 2
    with pytest.raises(UserError, match="from another database"):
        entry.make(database, 1)


def test_errors_are_those_that_codecs_are_measured_by(database):
    """Two programs that share nothing but forward kinematics: positions and rotations are defined alike."""
    small = compressed.compress(database, BEST, rigs=False)
    known = errors.measure(database, small)
    found = pose_error.PoseErrors(database).of(lambda _, frames: small.decode(frames)[0])
    for mine, its in (("pose_cm", "position_cm"), ("pose_deg", "rotation_deg")):
        assert found[mine] == pytest.approx(known[its]["mean"], rel=1e-3)
    assert found["pose_p99_cm"] == pytest.approx(known["position_cm"]["p99"], rel=1e-3)
    assert found["pose_cm"] < found["pose_worst_cm"] < known["position_cm"]["max"]


def test_learned_decompressors_are_measured_on_clips_held_out_by_themselves(database):
    model = linear_models.fitted(database)
    model.held_out = ("run",)
    entries = {entry.name: entry for entry in systems.learned({"lmm": model})}
    measured = pose_error.PoseErrors(database, pose_error.held_by_all([model.held_out]))
    rows = {name: measured.of(entry.decoder) for name, entry in entries.items()}
    assert rows["lmm-PSD"] is rows["lmm-D-free"] and entries["lmm-PS"].decoder is as_stored
    assert max(rows["lmm-S"].values()) < 1e-6 and "pose_held_cm" in rows["lmm-S"]
    exact, coarse = rows["lmm-PSD"], rows["lmm-PSD-int8"]
    assert 0 < exact["pose_cm"] < coarse["pose_cm"]
    assert exact["pose_cm"] == pytest.approx(rows["lmm-PSD-fp32"]["pose_cm"])
    parts = {part: pose_error.PoseErrors(database, held) for part, held in (("all", ()), ("none", ["run"]))}
    whole = parts["all"].of(entries["lmm-D"].decoder)["pose_cm"]
    low, high = sorted((exact["pose_cm"], exact["pose_held_cm"]))
    assert low < whole < high


def test_stretches_lie_within_ranges_and_are_evenly_spread():
    starts, stops = np.array([0, 100, 130], np.int32), np.array([100, 130, 1000], np.int32)
    frames, begins = pose_error.stretches(starts, stops, 10, 1000)
    assert frames.tolist() == list(range(1000)) and begins.tolist() == [0, 100, 130]
    frames, begins = pose_error.stretches(starts[[0, 2]], stops[[0, 2]], 10, 200)
    assert len(frames) == 200 and begins.tolist() == list(range(0, 200, 10))
    pieces = frames.reshape(20, 10)
    assert (np.diff(pieces) == 1).all() and pieces[0, 0] == 0 and pieces[-1, -1] == 999
    assert not np.isin(frames, np.arange(100, 130)).any()
    assert np.ptp(np.diff(pieces[:, 0])) <= 40


def test_what_no_model_was_trained_on_is_what_all_held_out():
    assert pose_error.held_by_all([("a", "b"), ("b", "c")]) == {"b"} and pose_error.held_by_all([]) == set()
