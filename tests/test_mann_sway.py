"""lmm.mann.sway against closed forms of a Gaussian."""

from __future__ import annotations

import lmm_models
import numpy as np
import pytest

from lmm.locomotion.labelling import labels_of
from lmm.locomotion.window import PRESENT, SAMPLES
from lmm.mann import sway
from lmm.mann.frames import frames
from lmm.mann.layout import Layout
from mm.database import Database

FPS = 60.0


@pytest.fixture(scope="module")
def database() -> Database:
    return lmm_models.database()


def test_a_straight_way_is_smooth_as_it_is_up_to_its_ends() -> None:
    t = np.arange(200) / FPS
    root, yaw = np.stack([0.3 * t, 1.2 * t], axis=-1), 3 + 0.5 * t  # past pi: it is wrapped
    wrapped = (yaw + np.pi) % (2 * np.pi) - np.pi
    inner = slice(80, 120)
    smooth, yaws = sway.smooth(root, wrapped, 18.0)
    np.testing.assert_allclose(smooth, root, atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * yaws[inner]), np.exp(1j * yaw[inner]), atol=1e-9)


@pytest.mark.parametrize("hertz", [0.2, 1.0, 2.0])
def test_of_a_sway_is_left_what_a_gaussian_leaves(hertz) -> None:
    """exp(-2 (pi sigma f)^2) of a sine of frequency f."""
    t = np.arange(1200) / FPS
    root = np.stack([0.05 * np.sin(2 * np.pi * hertz * t), 1.2 * t], axis=-1)
    yaw = 0.1 * np.sin(2 * np.pi * hertz * t)
    left = np.exp(-2 * (np.pi * sway.SMOOTH * hertz) ** 2)
    inner = slice(200, 1000)
    smooth, yaws = sway.smooth(root, yaw, sway.SMOOTH * FPS)
    np.testing.assert_allclose(smooth[inner], root[inner] * [left, 1], atol=5e-4 * 0.05)
    np.testing.assert_allclose(yaws[inner], yaw[inner] * left, atol=5e-4 * 0.1)


def test_what_is_told_less_its_sway_is_a_smooth_way_and_a_turn_is_no_sway(database) -> None:
    labels = labels_of(database, phase=False)
    found, layout = frames(database, labels), Layout(len(database.skeleton) - 1, len(labels.names))
    columns, swayed = sway.columns(layout), sway.sways(database, labels)
    assert swayed.shape == (len(found.x), len(columns)) and swayed.dtype == np.float32

    def away(block: str, rows: np.ndarray) -> np.ndarray:
        """Of a block of two numbers a sample, as far as it sways [N, 12, 2]."""
        of = np.arange(layout.input_size)[layout.inputs[block]]
        part = rows[:, np.searchsorted(columns, of)]
        return np.swapaxes(part.reshape(len(rows), 2, SAMPLES), 1, 2)

    both = np.concatenate([away("path", swayed), away("facing", swayed)], axis=-1)
    furthest = np.linalg.norm(both, axis=-1).max(axis=1)
    assert furthest.max() <= sway.MOST + 1e-6 and furthest.min() < 0.5 * sway.MOST

    small = np.flatnonzero(furthest < 0.99 * sway.MOST)  # all of their sway is told
    calm = found.x.copy()
    calm[:, columns] -= swayed
    facing = away("facing", calm[:, columns])[small]
    np.testing.assert_allclose(np.linalg.norm(facing, axis=-1), 1, atol=1e-5)
    np.testing.assert_allclose(facing[:, PRESENT], [[0, 1]] * len(small), atol=1e-5)
    np.testing.assert_allclose(away("path", calm[:, columns])[small][:, PRESENT], 0, atol=1e-5)


def test_columns_are_those_of_the_way_and_know_their_past() -> None:
    layout = Layout(27, 0)
    columns, past = sway.columns(layout), sway.of_past(layout)
    assert len(columns) == len(past) == 7 * SAMPLES
    other = np.setdiff1d(np.arange(layout.input_size), columns)
    gaits = np.arange(layout.input_size)[layout.inputs["gaits"]]
    joints = np.arange(layout.inputs["positions"].start, layout.input_size)
    np.testing.assert_array_equal(other, np.concatenate([gaits, joints]))
    told = columns[past]
    assert layout.inputs["speeds"].start + PRESENT - 1 in told
    assert layout.inputs["speeds"].start + PRESENT not in told
