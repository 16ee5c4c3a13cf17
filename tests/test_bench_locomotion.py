"""Networks of locomotion in the harness: their rows, what they hold, crowds of them, strips, refusals."""

from __future__ import annotations

import json
from dataclasses import replace

import lmm_models
import mann_models
import numpy as np
import pfnn_models
import pytest
from click.testing import CliRunner

from bench import compare, crowd, plots, report, systems
from bench.cli import main
from lmm.evaluator import products_here
from lmm.pfnn.spline import SETS
from motion.errors import UserError

NETWORKS = ["pfnn-cubic", "pfnn-linear", "pfnn-constant", "mann-4"]
SHORT = {"courses": ["start-stop"], "seconds": 1.0, "timed_seconds": 0.1}


@pytest.fixture(scope="module")
def database():
    return lmm_models.database()


@pytest.fixture(scope="module")
def models():
    return {"pfnn": pfnn_models.model(), "mann": mann_models.model()}


@pytest.fixture(scope="module")
def compared(database, models):
    return compare(database, systems=["mm-exact", "pfnn", "mann", "mann-?-free"], models=models, **SHORT)


def test_each_way_to_run_a_network_is_a_row(compared, database, models):
    rows = compared.summary.set_index("system")
    free = [f"{name}-free" for name in NETWORKS]
    assert rows.index.tolist()[1:] == ["mm-exact", *NETWORKS[:3], "mann-4", "mann-4-free"]
    entries = systems.learned(models)
    assert [entry.name for entry in entries if entry.locked and not entry.asked] == NETWORKS
    asked = {e.name for e in entries if e.locked and e.asked}
    assert asked == {f"{name}-{held}" for name in NETWORKS for held in ("bf16", "fp32", "fp16")}
    assert [entry.name for entry in entries if entry.spare and not entry.asked] == free
    assert {entry.family for entry in entries} == {"pfnn", "mann"}
    assert entries[1].about == "phase-functioned network, cubic, feet as they come"
    system = entries[1].make(database, 1)
    assert system.name == "pfnn-cubic-free" and not system.settings.foot_lock
    assert entries[0].make(database, 1).settings.foot_lock


def test_memory_is_that_of_the_mode(compared, models):
    rows = compared.summary.set_index("system")
    for mode in SETS:
        row, network = rows.loc[f"pfnn-{mode}"], models["pfnn"].network
        assert row["memory_network_mb"] == pytest.approx(network.weight_bytes(mode) / 1e6)
        assert row["memory_statistics_mb"] > 0 and np.isnan(row["memory_poses_mb"])
    assert rows.loc["mann-4", "memory_gate_mb"] > 0 and np.isnan(rows.loc["pfnn-cubic", "memory_gate_mb"])
    assert compared.models["mann"]["weights"] == {"mann": "float32"}
    assert compared.models["pfnn"]["parameters"] == models["pfnn"].parameters


def test_metrics_that_apply_are_there_and_others_are_not(compared):
    rows = compared.summary.set_index("system")
    for name in NETWORKS:
        row = rows.loc[name]
        for column in ("skate_cm_s", "heading_deg", "jerk_m_s3", "real_cm", "mm_cm", "mm_near_cm"):
            assert np.isfinite(row[column]), column
        assert row["frame_us"] > 0 and row["network_us"] > 0 and row["foot_lock_us"] > 0
        # It searches nothing and jumps nowhere.
        for column in ("transitions_per_s", "pop_cm", "search_us", "projection_us"):
            assert np.isnan(row[column]), column
    assert rows.loc["mm-exact", "mm_cm"] == 0 < rows.loc["pfnn-cubic", "mm_near_cm"]
    told = {line["system"]: line for line in report.brief(compared.summary)}
    assert told["pfnn-cubic"]["trans/s"] is None and told["mm-exact"]["trans/s"] is not None


def test_the_page_shows_a_strip_of_each_family(compared, tmp_path):
    (page,) = (path for path in report.save(compared, tmp_path, command="bench") if path.suffix == ".html")
    text = page.read_text()
    for caption in ("mm-exact", "pfnn-cubic", "mann-4"):
        assert f"<figcaption>{caption}" in text
    for stage in ("trajectory", "network", "pose"):
        assert f">{stage}<" in text


@pytest.mark.parametrize(("draw", "least"), [(plots.costs, 11), (plots.memory, 5)])
def test_legends_of_many_parts_leave_room_for_the_bars(compared, draw, least):
    picture = draw(compared.summary)
    picture.draw_without_rendering()
    (axes,) = picture.axes
    assert len(axes.get_legend().get_texts()) >= least and axes.get_position().width > 0.6


class _Went:
    def __init__(self, system, way):
        self.system, self.way = system, way

    def same(self, other, *, poses=True):
        assert not poses
        return self.way == other.way


def test_strips_are_of_all_that_differ_those_of_each_family_first():
    went = (
        ("mm-exact", 0),
        ("mm-brute", 0),
        ("mm-aabb", 1),
        ("mm-kdtree", 2),
        ("mm-kdtree-free", 3),
        ("pfnn-cubic", 0),
        ("pfnn-linear", 0),
    )
    a, b, c, d, e, cubic, linear = traces = [_Went(*each) for each in went]
    assert report.families(traces) == [([[a, b], [c]], [[d], [e]]), ([[cubic, linear]], [])]
    assert report.families(traces[:5]) == [([[a, b], [c], [d]], [[e]])]
    more = [_Went(name, 0) for name in ("mm-exact-float16", "lmm-PSD", "lmm-D", "mann-4")]
    shown = [own for own, _ in report.families([*traces, *more])]
    assert shown == [[[a, b]], [[cubic, linear]], [more[:1]], [more[1:3]], [more[3:]]]


def test_crowds_of_networks(database, models):
    found = crowd.measure(database, counts=(1, 3), index="brute", models=models, seconds=0.1, repeats=1)
    paired = [f"{name}-bf16" for name in NETWORKS] if "bfloat16" in products_here() else []
    expected = {"mm-brute", *NETWORKS, *paired}
    assert {row["system"] for row in found} == expected and len(found) == 2 * len(expected)
    for row in found:
        assert 0 < row["us"] <= row["p99_us"]
        assert (row["no_search_us"] is None) == ("network_us" in row) == (row["system"] != "mm-brute")


def test_without_whole_legs_networks_run_that_hold_no_feet(database, models):
    roles = {role: joint for role, joint in database.skeleton.roles.items() if role != "left_leg"}
    bare = replace(database, skeleton=database.skeleton.with_roles(roles))
    found = compare(bare, indexes=["exact"], models=models, **SHORT | {"courses": ["still"]})
    free = [f"{name}-free" for name in NETWORKS]
    assert found.summary["system"].tolist()[1:] == ["mm-exact-free", *free]


@pytest.fixture(scope="module")
def folder(database, models, tmp_path_factory):
    folder = tmp_path_factory.mktemp("locomotion")
    database.save(folder / "walk.mmdb")
    models["pfnn"].save(folder / "walk.pfnn")
    pfnn_models.model(seed=1).save(folder / "other.pfnn")
    models["mann"].save(folder / "walk.mann")
    pfnn_models.model(fps=30.0).save(folder / "slow.pfnn")
    lmm_models.database(fps=30.0).save(folder / "slow.mmdb")
    joints = database.skeleton
    longer = joints.offsets.copy()
    longer[joints.role("left_leg")] *= 1.1
    about = models["pfnn"].description
    tall = replace(about, skeleton=replace(joints, offsets=longer))
    replace(models["pfnn"], description=tall).save(folder / "tall.pfnn")
    names = tuple(f"{name}_" for name in joints.names)
    foreign = replace(about, skeleton=replace(joints, names=names))
    replace(models["pfnn"], description=foreign).save(folder / "foreign.pfnn")
    return folder


def bench(*arguments, code=0):
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + result.stderr
    return result


def test_models_of_all_kinds_from_the_command_line(folder, monkeypatch):
    monkeypatch.chdir(folder)
    asked = ("--model", "walk.pfnn", "--model", "other.pfnn", "--model", "walk.mann")
    short = ("--courses", "still", "--seconds", "0.2", "--repeats", "1", "--counts", "2", "--json")
    done = bench("compare", "walk.mmdb", *asked, "--systems", "pfnn-*-linear,mann", *short)
    rows = json.loads(done.stdout)["summary"][1:]
    assert [row["system"] for row in rows] == ["pfnn-walk-linear", "pfnn-other-linear", "mann-4"]
    assert rows[0]["transitions_per_s"] is None
    table = bench("crowd", "walk.mmdb", "--model", "walk.mann", "--counts", "2", "--seconds", "0.1").stdout
    assert "mann-4" in table and "network_us" in table and "projection_us" in table


FAULTS = [
    (
        ("walk.mmdb", "--model", "foreign.pfnn"),
        "foreign.pfnn: the model is not of this database: other joints",
    ),
    (("walk.mmdb", "--model", "tall.pfnn"), "bones of other lengths; give the database that it was"),
    (("slow.mmdb", "--model", "walk.mann"), "60 frames per second, not 30"),
    (("walk.mmdb", "--model", "slow.pfnn"), "30 frames per second, not 60"),
    (("walk.mmdb", "--systems", "pfnn-cubic"), "no system 'pfnn-cubic' without a model; give one"),
    (("walk.mmdb", "--model", "walk.mann", "--systems", "pfnn"), "no system 'pfnn' without a model"),
    (
        ("walk.mmdb", "--model", "walk.pfnn", "--systems", "pfnn-square"),
        "no system 'pfnn-square'; choose",
    ),
    (("walk.mmdb", "--model", "walk.mmdb"), "no model of any kind that `lmm train` makes"),
]


@pytest.mark.parametrize(
    ("command", "arguments", "message"),
    [("compare", *fault) for fault in FAULTS] + [("crowd", *f) for f in FAULTS if "--systems" not in f[0]],
)
def test_faults_are_one_line(folder, monkeypatch, command, arguments, message):
    monkeypatch.chdir(folder)
    result = bench(command, *arguments, "--seconds", "0.1", code=2)
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1 and message in result.stderr


def test_a_network_is_checked_before_it_drives(models):
    database = lmm_models.database(fps=30.0)
    with pytest.raises(UserError, match="60 frames per second, not 30"):
        systems.learned(models)[0].make(database, 1)


def test_a_database_with_mirrored_copies_is_of_the_same_skeleton(database, models):
    """What mirrors clips puts the hips over the root; bones stay as long as they are."""
    skeleton = database.skeleton
    offsets = skeleton.offsets.copy()
    offsets[skeleton.role("hips"), 0] += 0.02
    about = replace(models["pfnn"].description, skeleton=replace(skeleton, offsets=offsets))
    replace(models["pfnn"], description=about).check(database)
    offsets[skeleton.role("left_leg"), 1] += 0.02
    with pytest.raises(UserError, match="bones of other lengths"):
        replace(models["pfnn"], description=about).check(database)
