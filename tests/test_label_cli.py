"""``features label``: what it writes and prints, and how it fails."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import synthetic

from features import label_files
from features.cli import main
from features.labels import label_clip
from motion import bvh, sources


@pytest.fixture
def run(capsys):
    """Run the command; returns exit code, standard output and standard error."""

    def call(*arguments):
        with pytest.raises(SystemExit) as stop:
            main(["label", *map(str, arguments)])
        out = capsys.readouterr()
        return int(stop.value.code or 0), out.out, out.err

    return call


@pytest.fixture
def glides(tmp_path):
    """A file of a body that glides without a contact."""
    clip = synthetic.walk("glides", gait="stand", speed=0.0)
    positions = clip.positions.copy()
    positions[:, 0, 2] += 3 * np.arange(len(clip)) / 60
    bvh.write(tmp_path / "in" / "glides.bvh", clip.replace(positions=positions))
    return tmp_path / "in" / "glides.bvh"


def test_writes_labels_and_sums_them_up(run, walker_files, tmp_path):
    code, out, err = run(walker_files, "-o", tmp_path / "labels", "--json")
    assert code == 0 and "wrote labels of 5 clips" in err
    rows = {Path(row["file"]).stem: row for row in json.loads(out)}
    assert rows["stand"]["stand"] > 0.99 and rows["run"]["jog"] > 0.95 and rows["straight"]["walk"] > 0.99
    assert rows["straight"]["steps"] in (9, 10) and rows["straight"]["contacts"].startswith(
        "left_heel left_toe"
    )
    for row in rows.values():
        found = label_files.read(row["labels"], frames=row["frames"])
        known = label_clip(sources.load(row["file"]))
        np.testing.assert_array_equal(found.contacts, known.contacts)
        np.testing.assert_allclose(found.phase, known.phase, atol=1e-5)
    table = run(walker_files, "-o", tmp_path / "labels")[1]
    assert "straight.bvh" in table and "crouch" in table.splitlines()[0]


def test_draws(run, walker_files, tmp_path):
    assert run(walker_files / "run.bvh", "-o", tmp_path / "l", "--plot", tmp_path / "p")[0] == 0
    assert (tmp_path / "p" / "run.png").read_bytes()[:4] == b"\x89PNG"
    code, *_ = run(walker_files / "run.bvh", "-o", tmp_path / "l", "--plot", tmp_path / "p", "--no-phase")
    assert code == 0 and label_files.read(tmp_path / "l" / "run.labels.csv").phase is None


def test_corrected_contacts_make_a_new_phase(run, walker_files, tmp_path):
    clip = walker_files / "straight.bvh"
    run(clip, "-o", tmp_path / "a")
    text = (tmp_path / "a" / "straight.labels.csv").read_text().splitlines()
    cells = [line.split(",") for line in text]
    for row in cells[1:]:  # left and right exchanged
        row[1:5] = row[3], row[4], row[1], row[2]
    (tmp_path / "a" / "straight.labels.csv").write_text("\n".join(",".join(row) for row in cells))
    assert run(clip, "-o", tmp_path / "b", "--corrected", tmp_path / "a")[0] == 0
    found, known = label_files.read(tmp_path / "b" / "straight.labels.csv"), label_clip(sources.load(clip))
    off = np.angle(np.exp(1j * (found.phase.astype(np.float64) - known.phase - np.pi)))
    assert np.abs(off).max() < 1e-3
    np.testing.assert_array_equal(found.contacts, known.mirrored().contacts)
    code, _, err = run(walker_files / "run.bvh", "-o", tmp_path / "b", "--corrected", tmp_path / "a")
    assert code == 2 and err.startswith("error: ") and "run.labels.csv" in err


def test_what_has_no_phase_is_one_line(run, glides, tmp_path, walker_files):
    code, out, err = run(glides, "-o", tmp_path / "l")
    assert (code, out) == (2, "")
    assert err.startswith(f"error: {glides}: neither foot touches the ground") and err.count("\n") == 1
    assert not (tmp_path / "l").exists()
    assert run(glides, "-o", tmp_path / "l", "--no-phase")[0] == 0
    code, out, err = run(glides, walker_files / "run.bvh", "-o", tmp_path / "l", "--skip-bad", "--json")
    assert code == 0 and len(json.loads(out)) == 1 and f"note: left out: {glides}: neither foot" in err
    code, _, err = run(glides, "-o", tmp_path / "l", "--skip-bad")
    assert code == 2 and "error: none of 1 clips can be labelled" in err


def test_usage(run, walker_files, tmp_path):
    (tmp_path / "taken").write_text("")
    for arguments, message in (
        ([tmp_path / "none.bvh", "-o", tmp_path / "l"], "no such file or folder"),
        ([walker_files], "Missing option '-o'"),
        ([walker_files, "-o", tmp_path / "taken"], "not a folder"),
        ([walker_files, "-o", tmp_path / "l", "--exclude", "nothing*"], "no clip to exclude"),
    ):
        code, out, err = run(*arguments)
        assert (code, out) == (2, "") and err.startswith("error: ") and message in err


def test_help_ends_with_an_example(run):
    last = run("--help")[1].strip().split("\n\n")[-1]
    assert last.strip().startswith("Example: python -m features label")
