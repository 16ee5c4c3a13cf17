"""``python -m bench`` from the outside: each command on a small synthetic database, and bad input."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from click.testing import CliRunner

from bench.cli import main
from features import terrain, terrain_made


@pytest.fixture(scope="module")
def db(walker_mmdb):
    return walker_mmdb


def bench(*arguments, code=0):
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + result.stderr
    return result


QUICK = ("--courses", "circle", "--indexes", "brute", "--seconds", "1", "--repeats", "1", "--no-crowds")


def test_compare_clips_builds_a_database_and_writes_a_report(walker_files, tmp_path):
    out = tmp_path / "report"
    shown = bench("compare", walker_files, *QUICK, "--jobs", 1, "-o", out).stdout
    assert "mm-brute-free" in shown and "scaled to the data" in shown
    assert {p.name for p in out.iterdir()} == {
        "database.mmdb",
        "summary.csv",
        "summary.json",
        "courses.csv",
        "report.html",
        "tables",
        "work",
    }
    facts = json.loads((out / "summary.json").read_text())
    assert facts["database"]["mirrored_ranges"] == 5
    assert len(list((out / "work").iterdir())) == 2  # with feet held, and not
    # The database it kept gives the same numbers.
    again = json.loads(bench("compare", out / "database.mmdb", *QUICK, "--json").stdout)
    assert again["database"]["fingerprint"] == facts["database"]["fingerprint"]
    assert again["courses"][0]["skate_cm_s"] == facts["courses"][0]["skate_cm_s"]


def test_search_prints_what_each_index_finds(db):
    rows = json.loads(bench("search", db, "--indexes", "brute,aabb", "--queries", 60, "--json").stdout)
    by_name = {row["index"]: row for row in rows}
    assert set(by_name) == {"brute", "aabb"}
    assert set(rows[0]) >= {"index", "recall", "cost_regret", "median_us", "p99_us", "build_s", "bytes"}
    assert by_name["aabb"]["recall"] == 1 and by_name["aabb"]["cost_regret"] == pytest.approx(0, abs=1e-6)


def test_crowd_gives_a_row_a_count(db):
    rows = json.loads(
        bench("crowd", db, "--counts", "1,5", "--index", "brute", "--seconds", 0.3, "--json").stdout
    )
    assert [row["characters"] for row in rows] == [1, 5]
    for row in rows:
        assert row["no_search_us"] > 0 and row["us"] <= row["p99_us"] and 0 < row["frame_bytes"] < 20_000
        assert {"prediction_us", "projection_us", "foot_lock_us"} <= set(row)


def test_reading_measures_our_reader(walker_files):
    rows = json.loads(bench("reading", walker_files, "--repeats", 1, "--json").stdout)
    assert rows[0]["reader"].startswith("motion.bvh.parse")
    assert rows[0]["files"] == 5
    size = sum(p.stat().st_size for p in walker_files.glob("*.bvh")) / 1e6
    assert rows[0]["mb"] == pytest.approx(size)
    assert rows[0]["mb_per_s"] == pytest.approx(size / rows[0]["seconds"])


def test_build_measures_a_new_process_and_a_warm_one(walker_files):
    rows = json.loads(
        bench(
            "build",
            walker_files,
            "--repeats",
            1,
            "--no-mirror",
            "--exclude",
            "run",
            "--exclude",
            "*turn",
            "--json",
        ).stdout
    )
    assert [row["process"] for row in rows] == ["new", "warm"]
    for row in rows:
        assert row["clips"] == 2
        assert row["times_real_time"] == pytest.approx(60 * row["minutes"] / row["seconds"])


def test_compare_walks_on_a_heightmap(db, tmp_path):
    terrain.save(tmp_path / "hills.txt", terrain_made.make(4, "hills", size=(10, 10)))
    walk = ("compare", db, *QUICK, "--systems", "mm-brute", "--heights", tmp_path / "hills.txt")
    facts = json.loads(bench(*walk, "--json").stdout)
    assert facts["ground"]["size_m"] == pytest.approx([10, 10], abs=0.05)
    assert facts["summary"][1]["sink_cm"] >= 0 and facts["summary"][1]["memory_ground_mb"] > 0
    wide = json.loads(bench(*walk, "--heights-spacing", 2 * terrain.SPACING, "--json").stdout)
    assert wide["ground"]["size_m"] == pytest.approx([20, 20], abs=0.1)


BAD = {
    "unknown index": (("compare", "{db}", "--indexes", "nope"), "no search index 'nope'; choose from brute"),
    "unknown system": (("compare", "{db}", "--systems", "nope"), "no system 'nope'; choose from mm-brute"),
    "unknown course": (
        ("compare", "{db}", "--courses", "nope"),
        "no course 'nope'; give a TOML file or choose",
    ),
    "no such clips": (("compare", "{no}"), "no such file"),
    "no such database": (("search", "{no}"), "nothing-here"),
    "a folder as database": (("crowd", "{folder}"), "expected a database"),
    "not a database": (("search", "{text}"), "not a motion database"),
    "no seconds": (("compare", "{db}", "--seconds", "0"), "give a number above 0"),
    "a seed of those trained on": (("compare", "{db}", "--seed", str(2**32)), "not in the range"),
    "counts": (("crowd", "{db}", "--counts", "1,x"), "'1,x' is not a list of numbers"),
    "no characters": (("crowd", "{db}", "--counts", "0"), "not in the range 1<=x"),
    "nothing listed": (("compare", "{db}", "--courses", ","), "an empty list"),
    "a skeleton for a database": (("compare", "{db}", "--skeleton", "dancecard"), "leave out --skeleton"),
    "a rate for a database": (("coverage", "{db}", "--fps", "30"), "leave out --fps"),
    "no mirroring for a database": (("compare", "{db}", "--no-mirror"), "leave out --no-mirror"),
    "rules for a database": (("coverage", "{db}", "--clips", "{text}"), "leave out --clips"),
    "excluded from a database": (("compare", "{db}", "--exclude", "run"), "is built already"),
    "no heightmap": (("compare", "{db}", "--heights", "{no}"), "nothing-here: cannot read"),
    "what is no heightmap": (("compare", "{db}", "--heights", "{text}"), "text.mmdb:1: 'not' is no height"),
    "a spacing alone": (("compare", "{db}", "--heights-spacing", "1"), "give --heights FILE too"),
    "no BVH": (("reading", "{no}"), "no such file"),
    "report over a file": (("compare", "{db}", "-o", "{text}"), "cannot write: it is a file"),
    "no sources": (("compare",), "Missing argument"),
    "unknown search index": (("search", "{db}", "--indexes", "nope"), "no search index 'nope'; choose"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_clear_line(case, db, tmp_path):
    arguments, expected = BAD[case]
    (tmp_path / "text.mmdb").write_text("not a database, not a clip, nothing of the kind")
    places = {"db": db, "no": tmp_path / "nothing-here", "folder": tmp_path, "text": tmp_path / "text.mmdb"}
    before = sorted(tmp_path.iterdir())
    result = bench(*(a.format(**places) for a in arguments), code=2)
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1, result.stderr
    assert expected in result.stderr
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    "command", ["compare", "likeness", "coverage", "search", "crowd", "reading", "build"]
)
def test_help_ends_with_an_example(command):
    shown = bench(command, "--help").stdout
    assert f"Example: python -m bench {command}" in " ".join(shown.split())


def test_help_is_fast_because_it_imports_little():
    slow = "{'numba', 'matplotlib', 'pandas', 'scipy', 'faiss'}"
    code = f"import bench.cli, sys; print(sorted({slow} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_retarget_measures_a_large_rig(db):
    rows = json.loads(
        bench(
            "retarget", db, "--joints", 60, "--counts", "1,4", "--index", "brute", "--seconds", 0.2, "--json"
        ).stdout
    )
    assert [row["characters"] for row in rows] == [1, 4]
    for row in rows:
        assert row["joints"] == 60
        assert row["us"] > 0 and row["twin_ratio"] == pytest.approx(row["twin_us"] / row["us"])
        assert row["share"] == pytest.approx(row["us"] / (row["us"] + row["controller_us"]))
    assert "a rig of 5 joints" in bench("retarget", db, "--joints", 5, code=2).stderr
