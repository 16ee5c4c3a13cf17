"""Labels as text: they come back as they were, and what a person gets wrong is one line."""

from __future__ import annotations

import numpy as np
import pytest

from features import label_files
from features.labels import GAITS, Labels
from motion.dancecard import CONTACTS, generate
from motion.dancecard import labels as generated
from motion.errors import UserError

GOOD = """frame,left_heel,left_toe,right_heel,right_toe,phase,gait
0,1,1,0,1,0.02094,stand
1,1,0,0,1,0.06283,stand 0.8 walk 0.2
2,0,0,1,1,6.28319,Walk
"""


def some(phase: bool = True) -> Labels:
    rng = np.random.default_rng(0)
    gait = rng.dirichlet(np.full(6, 0.3), 200).astype(np.float32)
    contacts = rng.integers(0, 2, (200, 4), dtype=np.uint8)
    turns = (2 * np.pi * rng.random(200)).astype(np.float32) if phase else None
    return Labels(CONTACTS, contacts, turns, gait)


@pytest.mark.parametrize("phase", [True, False])
def test_they_come_back(tmp_path, phase):
    labels = some(phase)
    label_files.write(tmp_path / "a.csv", labels)
    found = label_files.read(tmp_path / "a.csv", frames=200)
    assert found.names == labels.names
    np.testing.assert_array_equal(found.contacts, labels.contacts)
    np.testing.assert_allclose(found.gait, labels.gait, atol=2e-3)
    np.testing.assert_allclose(found.gait.sum(axis=1), 1, atol=1e-6)
    if phase:
        np.testing.assert_allclose(found.phase, labels.phase, atol=1e-5)
    else:
        assert found.phase is None
    label_files.write(tmp_path / "b.csv", found)
    again = label_files.read(tmp_path / "b.csv")
    np.testing.assert_array_equal(again.contacts, found.contacts)


def test_what_a_person_writes(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(GOOD)
    found = label_files.read(path)
    assert found.contacts.tolist() == [[1, 1, 0, 1], [1, 0, 0, 1], [0, 0, 1, 1]]
    np.testing.assert_allclose(found.phase, [0.02094, 0.06283, 0], atol=1e-6)
    np.testing.assert_allclose(found.gait[:, :2], [[1, 0], [0.8, 0.2], [0, 1]], atol=1e-6)


def test_what_spreadsheets_write(tmp_path):
    path = tmp_path / "a.csv"
    text = GOOD.replace("\n", "\r\n").replace("2,0,0,1,1", "2.0, 0.0,0, 1 ,1") + ",,,,,,\r\n"
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert len(label_files.read(path, frames=3)) == 3


def test_the_generators_files(tmp_path):
    passage = generate(8)[0]
    generated.write(tmp_path / "a.labels.csv", passage.labels)
    found = label_files.read(tmp_path / "a.labels.csv", frames=len(passage.clip))
    np.testing.assert_array_equal(found.contacts, passage.labels.contacts)
    off = np.angle(np.exp(1j * (found.phase - passage.labels.phase)))
    np.testing.assert_allclose(off, 0, atol=1e-4)
    np.testing.assert_array_equal(found.gait.argmax(axis=1), passage.labels.gait)
    assert GAITS[: len(generated.GAITS)] == generated.GAITS


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        (
            "right_toe",
            "right_thumb",
            1,
            "header 'frame,left_heel,left_toe,right_heel,right_thumb,phase,gait'",
        ),
        ("phase,gait", "gait,phase", 1, "header"),
        ("frame,", "", 1, "header"),
        (",gait", "", 1, "header"),
        ("right_toe", "left_foot", 1, "expected pairs of left and right"),
        (",", ";", 1, "columns apart by semicolons"),
        ("0.06283", "fast", 3, "phase 'fast' is not a number"),
        ("0.06283", "nan", 3, "phase 'nan' is not a number"),
        ("0.06283", "-0.1", 3, "phase -0.1, expected radians from 0 to 6.28319"),
        ("6.28319", "6.3", 4, "phase 6.3, expected radians"),
        ("2,0,0,1,1", "2,0,0,1,x", 4, "contact 'x' is not a number"),
        ("2,0,0,1,1", "2,0,0,1,0.5", 4, "contacts '0,0,1,0.5', expected 0 or 1 each"),
        ("2,0,0,1,1", "2,0,0,1", 4, "6 columns, the header has 7"),
        ("2,0,0,1,1", "3,0,0,1,1", 4, "frame '3', expected 2"),
        ("Walk", "amble", 4, "gait 'amble'; write one of stand, walk, jog, crouch, jump, other"),
        ("Walk", "", 4, "gait ''"),
        ("0.8 walk 0.2", "0.8 walk", 3, "gait 'stand 0.8 walk'"),
        ("0.8 walk 0.2", "0.8 walk 0.7", 3, "weights from 0 to 1 that sum to 1"),
        ("0.8 walk 0.2", "1.8 walk -0.8", 3, "weights from 0 to 1"),
        ("0.8 walk 0.2", "0.8 stand 0.2", 3, "gait 'stand 0.8 stand 0.2'"),
        ("0.8 walk 0.2", "0.8 walk much", 3, "weight 'much' is not a number"),
    ],
)
def test_faults_name_the_line(tmp_path, old, new, line, message):
    path = tmp_path / "a.csv"
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(UserError) as caught:
        label_files.read(path)
    assert str(caught.value).startswith(f"{path}:{line}: ") and message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_another_number_of_frames(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(GOOD)
    with pytest.raises(UserError, match="labels of 3 frames, but the clip has 4"):
        label_files.read(path, frames=4)
    for text, message in (("", "header"), (GOOD.splitlines()[0], "labels of 0 frames")):
        path.write_text(text)
        with pytest.raises(UserError, match=message):
            label_files.read(path)
    with pytest.raises(UserError, match="No such file"):
        label_files.read(tmp_path / "none.csv")
