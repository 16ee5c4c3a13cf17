"""Learned systems in the harness: mixtures beside motion matching, what they hold, how near they come."""

from __future__ import annotations

import json
from dataclasses import replace

import linear_models
import numpy as np
import pytest
from click.testing import CliRunner

from bench import compare, crowd, report, systems
from bench import models as learning
from bench.cli import main
from lmm import lanes
from lmm.evaluator import products_here
from mm.build import build
from mm.description import Description
from motion.errors import UserError

MIXTURES = ("PSD", "SD", "PD", "PS", "D", "S", "P")
IN_CROWDS = ["mm-brute", "lmm-PSD", *(["lmm-PSD-bf16"] if "bfloat16" in products_here() else [])]


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


@pytest.fixture(scope="module")
def model(database):
    return linear_models.fitted(database)


@pytest.fixture(scope="module")
def compared(database, model):
    return compare(
        database,
        courses=["circle"],
        systems=["mm-exact*", "lmm"],
        models={"lmm": model},
        seconds=2,
        timed_seconds=0.1,
    )


@pytest.fixture(scope="module")
def rows(compared):
    return compared.summary.set_index("system")


def test_all_mixtures_are_rows_of_one_family(compared, rows, model):
    names = ["mm-exact", "mm-exact-free", *(f"lmm-{letters}" for letters in MIXTURES)]
    assert rows.index.tolist()[1:] == names
    assert not [note for note in compared.notes[1:] if "the machine did other things" not in note]
    assert {entry.family for entry in systems.learned({"lmm": model})} == {"lmm"}
    about = {entry.name: entry.about for entry in systems.learned({"lmm": model})}
    assert about["lmm-SD"] == "stepping and decompression by networks"


def test_a_mixture_holds_only_what_it_needs(rows, database, model):
    """Who gathers poses needs them, who converts needs features and latents; networks alone need nothing."""

    def held(letters, part):
        return rows[f"memory_{part}_mb"].get(f"lmm-{letters}")

    for letters in MIXTURES:
        assert np.isnan(held(letters, "poses")) == ("D" in letters)
        assert np.isnan(held(letters, "index")) == ("P" in letters)
        for letter, network in zip("PSD", ("projector", "stepper", "decompressor"), strict=True):
            assert (held(letters, network) > 0) == (letter in letters)
    alone = rows.loc["lmm-PSD"]
    for part in ("features", "latents", "lookup", "ranges", "tags", "root_motion"):
        assert np.isnan(alone[f"memory_{part}_mb"])
    assert alone["memory_mb"] < model.decompressor.nbytes / 1e6 * 4
    frames = len(database)
    assert held("D", "latents") == pytest.approx(2 * model.L * frames / 1e6)
    assert held("D", "features") == pytest.approx(4 * model.F * frames / 1e6)


def test_poses_are_held_against_motion_matching_and_the_data(rows, compared):
    exact = rows.loc["mm-exact"]
    assert exact["mm_cm"] == exact["mm_near_cm"] == 0
    # Unlocked feet are all that differs.
    assert 0 < rows.loc["mm-exact-free", "mm_cm"] < 3
    assert rows.loc["mm-exact-free", "real_cm"] < exact["real_cm"] < 3
    # The same search finds the same frames: what differs is the decompressor, which is near to perfect here.
    assert 0 < rows.loc["lmm-D", "mm_cm"] < 0.5
    for letters in MIXTURES:
        row = rows.loc[f"lmm-{letters}"]
        assert row["mm_near_cm"] <= row["mm_cm"] and row["real_cm"] > 0
        assert row["projection_us"] > 0 and row["frame_us"] > 0
    assert rows.loc["lmm-PSD", "mm_cm"] > rows.loc["lmm-D", "mm_cm"]
    lines = report.brief(compared.summary)
    assert lines[1]["near mm cm"] == 0 and "real pose cm" in lines[0]


def test_costs_are_told_beside_those_of_all_networks(rows, compared):
    own = rows.loc["lmm-PSD"]
    for share, of in (("of_lmm_memory", "memory_mb"), ("of_lmm_mean", "frame_mean_us")):
        assert own[share] == 1 and np.isnan(rows[share].iloc[0])  # the clips cost nothing
        assert rows[share]["mm-exact"] == pytest.approx(rows[of]["mm-exact"] / own[of])
    told = report.brief(compared.summary)[1]
    assert told["memory × LMM"] == round(rows["of_lmm_memory"]["mm-exact"], 2)


def test_it_is_told_what_a_frame_allocates(rows):
    """A frame of nobody who searches no arrays of its own."""
    assert (rows["frame_bytes"].iloc[1:] < 2500).all() and (rows["frame_bytes"].iloc[1:] > 0).all()
    assert (rows["search_bytes"].iloc[1:] > rows["frame_bytes"].iloc[1:]).all()
    assert "frame_bytes_ci95" not in rows


def test_without_models_nothing_is_held_against_anything(database):
    plain = compare(database, courses=["still"], systems=["mm-brute"], seconds=0.2, timed_seconds=0.1)
    assert "of_lmm_memory" not in plain.summary
    assert "real_cm" not in plain.summary and "real pose cm" not in report.brief(plain.summary)[0]
    assert plain.models == {}


def test_a_model_without_its_compressor_still_runs_alone(database, model):
    bare = replace(model, compressor=None)
    found = compare(
        database,
        courses=["still"],
        systems=["lmm-PSD", "lmm-D"],
        models={"lmm": bare},
        seconds=0.2,
        timed_seconds=0.1,
    )
    assert found.summary["system"].tolist()[1:] == ["lmm-PSD"]
    assert any(note.startswith("lmm-D is left out: ") and "compressor" in note for note in found.notes)


@pytest.fixture(scope="module")
def without_legs(database, model):
    """The same on a skeleton that nobody found a knee in."""
    skeleton = database.skeleton
    roles = {role: joint for role, joint in skeleton.roles.items() if role != "left_leg"}
    bare = replace(database, skeleton=skeleton.with_roles(roles))
    return bare, replace(model, description=Description.of(bare))


def test_without_whole_legs_those_that_hold_no_feet_run(without_legs):
    database, model = without_legs
    brief = {"models": {"lmm": model}, "courses": ["still"], "seconds": 0.3, "timed_seconds": 0.1}
    found = compare(database, indexes=["exact", "brute"], **brief)
    free = ["mm-exact-free", "mm-brute-free", *(f"lmm-{letters}-free" for letters in MIXTURES)]
    assert found.summary["system"].tolist()[1:] == free
    (note,) = (note for note in found.notes if "left_toe" in note)
    assert "only systems that do not hold the feet" in note and "\n" not in note
    matching = found.summary.set_index("system").loc["mm-exact-free"]
    assert matching["mm_cm"] == 0 and matching["real_cm"] < 3
    some = compare(database, systems=["lmm", "mm-ex*"], **brief)
    assert some.summary["system"].tolist()[1:] == [free[0], *free[2:]]
    for name in ("mm-exact", "lmm-PSD"):
        with pytest.raises(UserError, match="foot locking needs the whole leg of the contact 'left_toe'"):
            compare(database, systems=["mm-exact-free", name], **brief)
    rows = crowd.measure(database, counts=(2,), index="brute", models={"lmm": model}, seconds=0.1, repeats=1)
    assert [row["system"] for row in rows] == [f"{name}-free" for name in IN_CROWDS]


def test_learned_systems_that_hold_no_feet_come_by_name(database, model):
    def names(*patterns, legs=True):
        chosen = systems.choose(patterns or None, indexes=["exact"], models={"lmm": model}, legs=legs)
        return [entry.name for entry in chosen]

    held = [f"lmm-{letters}" for letters in MIXTURES]
    assert names() == ["mm-exact", "mm-exact-free", *held] and names("lmm") == held
    assert names("lmm-SD-free", "mm-exact") == ["mm-exact", "lmm-SD-free"]
    assert names("lmm-*-free") == [f"{name}-free" for name in held]
    assert names("lmm-PSD-*16") == ["lmm-PSD-bf16", "lmm-PSD-fp16"]
    assert names("lmm-*-bf16") == ["lmm-PSD-bf16"] and names("lmm-PSD-bf16-free") == ["lmm-PSD-bf16-free"]
    assert not any("bf16" in name for name in (*names(legs=False), *names("lmm", legs=False)))
    free = {entry.name: entry for entry in systems.learned({"lmm": model})}["lmm-PSD-free"]
    system = free.make(database, 1)
    assert system.name == "lmm-PSD-free" and not system.settings.foot_lock


def test_bfloat16_products_are_compared_where_the_processor_has_them(database, model, monkeypatch):
    def compared():
        short = {"courses": ["still"], "seconds": 0.3, "timed_seconds": 0.1}
        return compare(database, systems=["lmm-PSD", "lmm-*-bf16"], models={"lmm": model}, **short)

    if "bfloat16" in products_here():
        rows = compared().summary.set_index("system")
        plain, rounded = rows.loc["lmm-PSD"], rows.loc["lmm-PSD-bf16"]
        assert plain["memory_state_mb"] == rounded["memory_state_mb"]
        assert plain["memory_projector_mb"] != rounded["memory_projector_mb"]
        assert abs(plain["mm_cm"] - rounded["mm_cm"]) > 0
    monkeypatch.setattr(lanes, "MULTIPLIES_PAIRS", False)
    found = compared()
    assert found.summary["system"].tolist()[1:] == ["lmm-PSD"]
    told = "lmm-PSD-bf16 is left out: this processor does not multiply bfloat16 numbers"
    assert any(note.startswith(told) for note in found.notes)


def test_crowds_of_networks_stand_beside_motion_matching(database, model):
    found = crowd.measure(
        database, counts=(1, 4), index="brute", models={"lmm": model}, seconds=0.1, repeats=1
    )
    assert [(row["system"], row["characters"]) for row in found] == [
        (system, count) for system in IN_CROWDS for count in (1, 4)
    ]
    for row in found:
        assert row["us"] <= row["p99_us"] and row["decompression_us"] > 0


@pytest.fixture(scope="module")
def files(database, model, walker_files, tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    database.save(folder / "walker.mmdb")
    model.save(folder / "walker.lmm")
    model.as_type("int8").save(folder / "small.lmm")
    build([walker_files], jobs=1, fps=30).save(folder / "slow.mmdb")
    (folder / "again").mkdir()
    model.save(folder / "again" / "small.lmm")
    return folder


def bench(*arguments, code=0):
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + result.stderr
    return result


def test_several_models_are_told_apart(files, model, tmp_path):
    done = bench(
        *("compare", files / "walker.mmdb", "--model", files / "walker.lmm", "--model", files / "small.lmm"),
        *("--systems", "lmm-*-PSD", "--courses", "still", "--seconds", "0.2", "--json", "-o", tmp_path),
        *("--no-crowds", "--repeats", "1"),
    )
    found = json.loads(done.stdout)
    assert [row["system"] for row in found["summary"][1:]] == ["lmm-walker-PSD", "lmm-small-PSD"]
    assert found["models"]["lmm-small"]["weights"]["projector"] == "int8"
    assert found["summary"][2]["memory_mb"] < found["summary"][1]["memory_mb"]
    assert found["models"]["lmm-walker"]["parameters"] == model.parameters
    assert f"{model.parameters:,} parameters" in (tmp_path / "report.html").read_text()


def test_crowds_from_the_command_line(files):
    arguments = ("--counts", "2", "--index", "brute", "--seconds", "0.1", "--model", files / "walker.lmm")
    found = json.loads(bench("crowd", files / "walker.mmdb", *arguments, "--json").stdout)
    assert [row["system"] for row in found] == IN_CROWDS


def test_without_whole_legs_from_the_command_line(without_legs, tmp_path):
    path, short = tmp_path / "bare.mmdb", ("--seconds", "0.2")
    once = (*short, "--no-crowds", "--repeats", "1")
    without_legs[0].save(path)
    done = bench("compare", path, "--courses", "still", "--systems", "mm", "--indexes", "brute", *once)
    assert done.stdout.count("only systems that do not hold the feet run") == 1
    done = bench("crowd", path, "--counts", "2", "--index", "brute", *short)
    assert "mm-brute-free" in done.stdout
    assert "note: no system holds the feet: foot locking" in done.stderr
    failed = bench("compare", path, "--courses", "still", "--systems", "mm-brute", *short, code=2)
    assert failed.stderr.startswith("error: foot locking needs") and failed.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("compare", "slow.mmdb", "--model", "walker.lmm"), "give the database that it was trained from"),
        (("crowd", "slow.mmdb", "--model", "walker.lmm"), "give the database that it was trained from"),
        (("compare", "walker.mmdb", "--model", "walker.mmdb"), "no model of any kind that `lmm train` makes"),
        (("compare", "walker.mmdb", "--systems", "lmm-PSD"), "no system 'lmm-PSD' without a model; give one"),
        (
            ("compare", "walker.mmdb", "--model", "small.lmm", "--systems", "lmm-X"),
            "no system 'lmm-X'; choose from mm-brute",
        ),
        (
            ("compare", "walker.mmdb", "--model", "small.lmm", "--model", "again/small.lmm"),
            "two models are called 'small'; rename one file",
        ),
    ],
)
def test_faults_are_one_line(files, monkeypatch, arguments, message):
    monkeypatch.chdir(files)
    result = bench(*arguments, "--seconds", "0.1", code=2)
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1 and message in result.stderr


def test_a_model_of_other_data_is_no_system_of_it(database, model):
    other = replace(model, frames=7)
    with pytest.raises(UserError, match="the database that it was trained from"):
        systems.learned({"lmm": other})[0].make(database, 1)


def test_models_of_a_folder_are_those_of_the_database(files, database):
    noted = []
    found = learning.within(files, database, note=noted.append)
    assert [path.rsplit("/", 1)[1] for path in found] == ["small.lmm", "walker.lmm"] and not noted
    (files / "other").mkdir()
    replace(linear_models.fitted(database), frames=7).save(files / "other" / "other.lmm")
    assert learning.within(files / "other", database, note=noted.append) == []
    assert len(noted) == 1 and noted[0].startswith("other.lmm is left out: ")
    assert learning.within(files / "nowhere", database, note=noted.append) == []
    with pytest.raises(UserError, match="expected a folder of models"):
        learning.within(files / "walker.lmm", database, note=noted.append)


def test_kinds_that_are_asked_for_and_not_there_are_lacking(files):
    assert learning.lacking(None, [files / "walker.lmm"]) == ["pfnn", "mann"]
    assert learning.lacking(("mm", "lmm-PSD", "mann-4"), []) == ["lmm", "mann"]
    assert learning.lacking(("mm",), []) == []


def test_compare_takes_the_models_of_a_folder_and_trains_what_lacks(files, tmp_path, monkeypatch):
    trained = []

    def train(database, kind, path, preset, *, note):
        trained.append((kind, path.name, preset))
        linear_models.fitted(database).save(path)
        return str(path)

    monkeypatch.setattr(learning, "train", train)
    short = (
        "--courses",
        "still",
        "--seconds",
        "0.2",
        "--repeats",
        "1",
        "--no-crowds",
        "--systems",
        "lmm-PSD",
    )
    line = ("compare", files / "walker.mmdb", *short, "--json", "--models", tmp_path / "new")
    assert "without a model" in bench(*line, code=2).stderr
    found = json.loads(bench(*line, "--train", "smoke").stdout)
    assert trained == [("lmm", "walker.lmm", "smoke")]
    assert [row["system"] for row in found["summary"][1:]] == ["lmm-PSD"]
    assert found["verdict"]["reference"] is None and found["published"][0]["system"] == "lmm-PSD"
    bench(*line, "--train", "smoke")  # it is there now
    assert len(trained) == 1
    assert "give --models FOLDER or -o FOLDER" in bench(*line[:-2], "--train", "smoke", code=2).stderr
