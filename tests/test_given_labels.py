"""lmm.locomotion.given_labels: which file is for which clip, at which rate; and what is wrong with others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import lmm_models
import numpy as np
import pytest

from features import label_files
from features.labels import GAITS, Labels
from lmm.locomotion import given_labels
from mm.database import Database
from motion import resample
from motion.errors import UserError

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")
FPS, FRAMES = 60.0, 120


@pytest.fixture(scope="module")
def database() -> Database:
    found = lmm_models.database()
    assert found.fps == FPS and (found.stops - found.starts == FRAMES).all()
    return found


def some(frames: int, *, names: tuple[str, ...] = NAMES) -> Labels:
    """Steps of a quarter of the clip, walking that turns into a jog."""
    time = np.arange(frames) / frames
    contacts = np.stack([(time * 4 + k / 4) % 1 < 0.6 for k in range(len(names))], axis=-1)
    gait = np.zeros((frames, 6), np.float32)
    gait[:, 1], gait[:, 2] = 1 - time, time
    return Labels(names, contacts.astype(np.uint8), (2 * np.pi * time).astype(np.float32), gait)


def write(folder: Path, name: str, labels: Labels) -> Path:
    path = folder / f"{name}.labels.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    label_files.write(path, labels)
    return path


def renamed(database: Database, *names: str) -> Database:
    return replace(database, names=names)


def test_a_clip_has_the_labels_of_its_name(database: Database, tmp_path: Path) -> None:
    given = some(FRAMES)
    write(tmp_path / "below", "run", given)
    (tmp_path / "notes.txt").write_text("not labels")
    found = given_labels.read(tmp_path, database)
    assert list(found) == ["run"] and found["run"].names == NAMES
    np.testing.assert_array_equal(found["run"].contacts, given.contacts)
    np.testing.assert_allclose(found["run"].gait, given.gait, atol=2e-3)


@pytest.mark.parametrize("fps", [120, 30, 24, 30 / 1.001, 119.88])
def test_labels_at_the_rate_of_a_clip_are_at_the_databases_instants(tmp_path: Path, fps: float) -> None:
    count, step = 200, resample.frame_step(fps, FPS)
    instants = resample.sample_times(count, step)
    database: Any = SimpleNamespace(
        names=("run",), starts=[0], stops=[len(instants)], fps=FPS, contact_roles=("left_toe", "right_toe")
    )
    whole = some(count)
    write(tmp_path, "run", whole)
    found = given_labels.read(tmp_path, database)["run"]
    assert len(found) == len(instants)
    # Of short clips 29.97 a second may be taken for 30: less than a frame at the end.
    np.testing.assert_allclose(found.phase, 2 * np.pi * instants / count, atol=2 * np.pi / count)
    at = np.floor(instants + 0.5).astype(int)
    assert np.mean(found.contacts == whole.contacts[at]) > 0.98
    write(tmp_path, "run", some(count - 7))
    with pytest.raises(UserError, match="labels of 193 frames, but run has"):
        given_labels.read(tmp_path, database)


def test_a_rest_pose_before_the_capture_is_left_out(database: Database, tmp_path: Path) -> None:
    own, rest = some(FRAMES), 5
    before = np.repeat(own.contacts[:1], rest, axis=0)
    other = np.eye(6, dtype=np.float32)[np.full(rest, GAITS.index("other"))]
    whole = Labels(NAMES, np.concatenate([before, own.contacts]), None, np.concatenate([other, own.gait]))
    write(tmp_path, "run", whole)
    np.testing.assert_array_equal(given_labels.read(tmp_path, database)["run"].contacts, own.contacts)


def test_clips_that_are_cut_out_of_a_file_share_its_labels(database: Database, tmp_path: Path) -> None:
    """At the file's rate, 120: the frames that their names tell."""
    cut = renamed(database, "a/run@10-249", "a/run@10-249", "a/run@300-539", "a/run@300-539")
    whole = some(600)
    write(tmp_path, "a/run", whole)
    found = given_labels.read(tmp_path, cut)
    assert list(found) == ["a/run@10-249", "a/run@300-539"]
    np.testing.assert_array_equal(found["a/run@10-249"].contacts, whole.contacts[10:249:2])
    np.testing.assert_array_equal(found["a/run@300-539"].contacts, whole.contacts[300:539:2])
    own = some(FRAMES)
    path = write(tmp_path / "other", "a/run@10-249", own)
    found = given_labels.read(tmp_path / "other", cut)
    np.testing.assert_array_equal(found["a/run@10-249"].contacts, own.contacts)
    path.unlink()
    write(tmp_path / "other", "a/run", some(400))
    with pytest.raises(UserError, match=r"labels of 400 frames, but a/run@300-539 is cut from more"):
        given_labels.read(tmp_path / "other", cut)


def test_folders_tell_clips_of_one_name_apart(database: Database, tmp_path: Path) -> None:
    two = renamed(database, "a/run", "a/run", "b/run", "b/run")
    for folder, frames in (("a", FRAMES), ("b", 2 * FRAMES)):
        write(tmp_path / "labels" / folder, "run", some(frames))
    found = given_labels.read(tmp_path / "labels", two)
    np.testing.assert_array_equal(found["a/run"].contacts, some(FRAMES).contacts)
    np.testing.assert_array_equal(found["b/run"].contacts, some(2 * FRAMES).contacts[::2])


def test_faults_are_one_line_each(database: Database, tmp_path: Path) -> None:
    def told(folder: Path, db: Database = database) -> str:
        with pytest.raises(UserError) as caught:
            given_labels.read(folder, db)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    assert "not a folder" in told(tmp_path / "nowhere")
    assert "no labels (NAME.labels.csv) of any clip" in told(tmp_path)
    path = write(tmp_path, "run", some(FRAMES - 1))
    assert f"{path}: labels of 119 frames, but run has 120 at 60 a second" in told(tmp_path)
    path.write_text("frame,left_toe\n")
    assert f"{path}:1: " in told(tmp_path)
    write(tmp_path, "run", some(FRAMES, names=("left_hand", "right_hand")))
    assert f"{path}: no contact of the left foot among left_hand, right_hand" in told(tmp_path)
    write(tmp_path, "run", some(FRAMES))
    again = write(tmp_path / "x", "run", some(FRAMES))
    assert "the clip run has labels in" in told(tmp_path) and str(again) in told(tmp_path)
    again.unlink()
    path = write(tmp_path, "jump", some(FRAMES))
    assert f"{path}: labels for no clip of the database; its clips are run, straight" in told(tmp_path)
