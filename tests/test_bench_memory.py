"""``bench memory``: what systems hold, what it is worth, and what the numbers must agree with."""

from __future__ import annotations

import gc
import json
from dataclasses import replace
from types import FunctionType, ModuleType

import linear_models
import numpy as np
import page_html
import pandas as pd
import pfnn_models
import pytest
from click.testing import CliRunner

from bench import systems
from bench.cli import main
from bench.memory import allocations, measure, page, pareto, plots, published, resident, stored
from lmm.model import Model
from mm.build import build
from mm.codecs import compressed
from mm.description import Description

CODEC = "quantised-11+features-8bit"


@pytest.fixture(scope="module")
def folder(walker_files, tmp_path_factory):
    """A database, a model of all stages that held out a clip, and a phase-functioned network."""
    folder = tmp_path_factory.mktemp("memory")
    database = build([walker_files], jobs=1)
    database.save(folder / "walker.mmdb")
    model = linear_models.fitted(database)
    model.held_out = ("run",)
    model.save(folder / "walker.lmm")
    network = pfnn_models.model(found=Description.of(database))
    replace(network, held_out=("run",)).save(folder / "walker.pfnn")
    return folder


@pytest.fixture(scope="module")
def database(folder):
    from mm.database import Database

    return Database.load(folder / "walker.mmdb")


def bench(*arguments, code=0):
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + result.stderr
    return result


@pytest.mark.parametrize(
    ("costs", "expected"),
    [
        ([[1, 4], [2, 2], [3, 3], [4, 1]], [True, True, False, True]),
        ([[1, 1], [1, 1], [1, 2], [2, 1]], [True, True, False, False]),
        ([[1, np.nan], [2, 2], [np.nan, 0]], [False, True, False]),
        ([[0, 1, 2], [0, 2, 1], [0, 2, 2]], [True, True, False]),
        ([[1, np.inf], [2, 0]], [True, True]),
        (np.zeros((0, 2)), []),
    ],
)
def test_the_front_is_what_nothing_beats(costs, expected):
    assert pareto.front(costs).tolist() == expected


def test_whoever_is_off_the_front_is_beaten_by_someone_on_it():
    costs = np.random.default_rng(0).integers(0, 9, (200, 2)).astype(float)
    best = pareto.front(costs)
    for row in costs[~best]:
        assert any((other <= row).all() and (other < row).any() for other in costs[best])
    order = np.lexsort(costs[best].T[::-1])
    assert (np.diff(costs[best][order][:, 1]) <= 0).all()


def test_parts_of_files_are_what_was_saved(folder, database, tmp_path):
    parts = stored.parts(folder / "walker.mmdb")
    poses = database.poses
    assert parts["poses"] == poses.positions.nbytes + poses.rotations.nbytes
    assert parts["velocities"] == 2 * poses.velocities.nbytes
    assert parts["features"] == database.features.nbytes and parts["tags"] == database.tags.nbytes
    assert sum(parts.values()) == (folder / "walker.mmdb").stat().st_size
    small = compressed.compress(database, CODEC)
    small.save(tmp_path / "small.mmdb")
    parts, known = stored.parts(tmp_path / "small.mmdb"), small.memory()
    for part in ("poses", "velocities", "root motion", "contacts", "features"):
        assert parts.get(part, 0) == known[part]
    parts = stored.parts(folder / "walker.lmm")
    networks = Model.load(folder / "walker.lmm").networks
    assert {name: parts[name] for name in networks} == {name: n.nbytes for name, n in networks.items()}
    assert {"compressor", "statistics", "description"} < set(parts)


class Wasteful:
    """Allocates so much a step, and keeps a part of it; searches in every third step."""

    def __init__(self):
        self.characters = np.zeros(1, [("searching", bool)])
        self.kept, self.steps = [], 0

    def step(self, command):
        self.steps += 1
        self.characters["searching"] = self.steps % 3 == 0
        once = np.ones(100_000 if self.characters["searching"][0] else 10_000, np.uint8)
        self.kept.append(np.ones(1000, np.uint8))
        return once[0]


def test_allocations_are_counted():
    found = allocations.of_steps(Wasteful(), range(allocations.WARM + 60))
    assert found.frame_bytes == pytest.approx(11_000, rel=0.1)
    assert found.search_bytes == pytest.approx(101_000, rel=0.02)
    assert found.kept_bytes == pytest.approx(60_000, rel=0.2)
    assert found.blocks == 0


def test_frames_allocate_nothing_for_their_characters(folder, database):
    """What remains are handles that calls need: of the arrays given to a kernel, whatever they hold.

    A frame that searches has a few arrays of its own; all are freed.
    """
    paths = [str(folder / name) for name in ("walker.lmm", "walker.pfnn")]
    chosen = systems.choose(
        ["mm-exact", f"mm-coded-{CODEC}", "lmm-PSD", "lmm-D", "pfnn-cubic"], models=systems.load_models(paths)
    )
    assert len(chosen) == 5
    for entry in chosen:
        found, many = (
            allocations.of_steps(entry.make(database, count), allocations.wander(count)) for count in (1, 12)
        )
        assert max(found.kept_bytes, many.kept_bytes) < 30_000, entry.name  # a pose each frame were 200_000
        assert max(found.frame_bytes, many.frame_bytes) < 2500, entry.name
        assert many.frame_bytes < found.frame_bytes + 100, entry.name
        assert not found.search_bytes > 12_000, entry.name


def held(system):
    """Bytes of all arrays that can be reached from a system, each byte once."""
    stack, seen, spans = [system], set(), []
    ours = ("bench", "mm", "lmm", "features", "motion", "builtins", "functools", "numpy", "collections")
    while stack:
        one = stack.pop()
        if id(one) in seen or isinstance(one, type | ModuleType | FunctionType):
            continue
        seen.add(id(one))
        if isinstance(one, np.ndarray):  # and not its base, which may be all of a file
            low = one.__array_interface__["data"][0]
            last = sum((n - 1) * step for n, step in zip(one.shape, one.strides, strict=True))
            spans += [(low, low + last + one.itemsize)] * bool(one.size)
        elif type(one).__module__.partition(".")[0] in ours:
            stack += gc.get_referents(one)
    total = end = 0
    for low, high in sorted(spans):
        total, end = total + max(0, high - max(low, end)), max(end, high)
    return total


@pytest.mark.parametrize(
    "name", ["mm-exact", "mm-aabb", f"mm-exact-{CODEC}", f"mm-coded-{CODEC}", "lmm-D", "lmm-PSD", "pfnn"]
)
def test_what_systems_say_that_they_hold_is_what_they_hold(name, folder, database):
    paths = [str(folder / name) for name in ("walker.lmm", "walker.pfnn")]
    for entry in systems.choose([name], models=systems.load_models(paths)):
        system = entry.make(database, 1)
        for command in allocations.wander(1, frames=20):
            system.step(command)
        told, found = sum(system.memory().values()), held(system)
        assert 0.999 * told <= found <= 1.001 * told + 20_000, entry.name


@pytest.mark.skipif(not resident.known_here(), reason="no /proc/self/clear_refs")
def test_what_is_resident_is_what_is_read_and_built(database, tmp_path):
    """A large database takes what its file does, whatever its process takes besides."""
    from mm.enlarged import enlarged

    path = tmp_path / "large.mmdb"
    enlarged(database, 300).save(path)
    found = resident.measure(resident.Subject("mm-brute", str(path)))
    assert found.kept == pytest.approx(path.stat().st_size, rel=0.25)
    assert found.peak >= found.kept and found.base > 2e7


@pytest.fixture(scope="module")
def report(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("report") / "memory"
    models = [f"--model={folder / name}" for name in ("walker.lmm", "walker.pfnn")]
    systems = f"mm-exact,mm-*-{CODEC},lmm-D,lmm-PSD,lmm-PSD-int8,pfnn,mm-exact-fine"
    done = bench(
        "memory", folder / "walker.mmdb", *models, "--systems", systems, "--counts", "2", "--no-peak",
        "--codecs", "quantised-16", "-o", out, code=2,
    )  # fmt: skip
    assert "no system 'mm-exact-fine'" in done.stderr
    systems = systems.removesuffix(",mm-exact-fine")
    shown = bench(
        "memory", folder / "walker.mmdb", *models, "--systems", systems, "--counts", "2", "--no-peak",
        "-o", out,
    )  # fmt: skip
    return out, shown.stdout


def test_the_report_is_a_table_a_plot_and_a_page(report, folder):
    out, shown = report
    assert page_html.files(out) == {"memory.csv", "memory.json", "pareto.png", "report.html"}
    rows = pd.read_csv(out / "memory.csv").set_index("system")
    assert rows.index.tolist() == [
        *("mm-exact", f"mm-exact-{CODEC}", f"mm-coded-{CODEC}", "lmm-PSD", "lmm-D", "lmm-PSD-int8"),
        *("pfnn-cubic", "pfnn-linear", "pfnn-constant"),
    ]
    assert set(rows["kind"]) == set(measure.KINDS.values()) - {"MANN"}
    parts = [c for c in rows if c.startswith("memory_") and c != "memory_mb"]
    assert rows[parts].sum(axis=1).to_numpy() == pytest.approx(rows["memory_mb"].to_numpy())
    assert rows["stored_mb"]["mm-exact"] == pytest.approx((folder / "walker.mmdb").stat().st_size / 1e6)
    assert rows["stored_mb"]["lmm-PSD"] < rows["stored_mb"]["lmm-D"]
    assert rows["stored_mb"]["lmm-PSD-int8"] < 0.5 * rows["stored_mb"]["lmm-PSD"]
    assert rows["stored_mb"]["pfnn-cubic"] == rows["stored_mb"]["pfnn-constant"]
    assert (
        rows["memory_mb"]["pfnn-cubic"]
        < rows["memory_mb"]["pfnn-linear"]
        < rows["memory_mb"]["pfnn-constant"]
    )
    assert rows["error"].tolist() == ["decoded"] * 6 + ["one step"] * 3
    assert rows["pose_cm"].notna().all() and rows["pose_held_cm"].notna().all()
    assert rows["drift_cm"].notna().sum() == rows["drift_held_cm"].notna().sum() == 2
    assert rows["pose_cm"]["lmm-PSD"] < rows["drift_cm"]["lmm-PSD"]
    assert rows["front"]["mm-exact"] and not rows["front"][["pfnn-cubic", f"mm-exact-{CODEC}"]].any()
    assert (rows[["frame_bytes_2", "blocks_2"]] > 0).all(axis=None)
    assert shown.count("*") > 2 and "poses are the data's own: mm-exact, " in shown
    text = (out / "report.html").read_text()
    page_html.check(text)
    assert "O3DE" in text and "lmm-PSD-int8" in text
    facts = json.loads((out / "memory.json").read_text())
    assert facts["database"]["held_out"] == ["run"] and set(facts["models"]) == {"lmm", "pfnn"}


def test_models_of_several_sizes_stand_in_one_picture(folder, database, tmp_path):
    """Each a line of the formats of its weights, and named; the smaller one is worse."""
    linear_models.fitted(database, latents=6).save(tmp_path / "narrow.lmm")
    models = systems.load_models([str(folder / "walker.lmm"), str(tmp_path / "narrow.lmm")])
    found = measure.measure(
        database, str(folder / "walker.mmdb"), models=models, peaks=False, counts=(1,),
        systems=["mm-exact", *(f"lmm-*-PSD{ending}" for ending in ("", "-fp16", "-int8"))],
    ).systems  # fmt: skip
    rows = found.set_index("system")
    assert {"lmm-walker-PSD", "lmm-narrow-PSD", "lmm-narrow-PSD-int8"} < set(rows.index)
    wide, narrow = rows.loc["lmm-walker-PSD"], rows.loc["lmm-narrow-PSD"]
    assert (narrow["source"], narrow["way"]) == ("lmm-narrow", "PSD")
    assert narrow["memory_mb"] < wide["memory_mb"] and narrow["pose_cm"] > 2 * wide["pose_cm"]
    axes = plots.against_error(found).axes[0]
    assert {"lmm-walker-PSD", "lmm-narrow-PSD"} < {text.get_text() for text in axes.texts}
    drawn = [sorted(line.get_xdata()) for line in axes.lines]
    for own in ("lmm-walker", "lmm-narrow"):
        assert sorted(found[found["source"] == own]["memory_mb"]) in drawn


def test_the_smallest_within_each_error_is_named():
    rows = pd.DataFrame(
        {
            "system": ["raw", "half", "small", "worse", "step"],
            "memory_mb": [10.0, 5.0, 2.0, 3.0, 0.1],
            "pose_cm": [0, 0.04, 0.3, 0.4, 0.01],
            "error": ["decoded"] * 4 + ["one step"],
        }
    )
    assert page.smallest(rows, "pose_cm") == [
        "the data's own: raw, 10 MB",
        "within 0.05 cm: half, 5 MB",
        "within 0.5 cm: small, 2 MB",
    ]


def test_features_of_an_hour_beside_those_of_o3de(database):
    """REFERENCE 2.3: 108,000 frames of 59 float32 are 24.3 MiB."""
    o3de, ours, eight, product = published.features(database)
    assert o3de["mb_an_hour"] * 1e6 / 2**20 == pytest.approx(24.3, abs=0.05)
    assert ours["mb_an_hour"] == pytest.approx(27 * 4 * 60 * 3600 / 1e6)
    assert eight["mb_an_hour"] == ours["mb_an_hour"] / 4 and product["mb_an_hour"] == ours["mb_an_hour"] / 12


def test_bad_input(folder, tmp_path):
    (tmp_path / "report").write_text("")
    db = folder / "walker.mmdb"
    for arguments, message in (
        ((db, "-o", tmp_path / "report"), "it is a file"),
        ((tmp_path / "no.mmdb",), "No such file"),
        ((db, "--codecs", "zip"), "no codec 'zip'"),
        ((db, "--counts", "0"), "0"),
        ((db, "--systems", "lmm"), "without a model"),
        ((db, "--systems", "mm-aabb-quantised-11"), "no system"),
    ):
        stderr = bench("memory", *arguments, code=2).stderr
        assert message in stderr, stderr
