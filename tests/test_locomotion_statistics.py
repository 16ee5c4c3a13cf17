"""lmm.locomotion.statistics: deviations by block, weights of joints; as the published network has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pfnn_models

from lmm.locomotion.statistics import joint_weights, statistics
from lmm.pfnn import published
from lmm.pfnn.layout import Layout
from motion.skeleton import Skeleton

LAYOUT = Layout(3)


def vectors() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    sizes = LAYOUT.input_size, LAYOUT.output_size
    x, y = (rng.standard_normal((50, n)).astype(np.float32) * rng.uniform(1, 9, n) + 3 for n in sizes)
    return x.astype(np.float32), y.astype(np.float32)


def test_deviations_are_means_over_blocks() -> None:
    x, y = vectors()
    found = statistics(x, y, LAYOUT, np.ones(3, np.float32))
    np.testing.assert_allclose(found["input_mean"], x.mean(axis=0), rtol=1e-5)
    np.testing.assert_allclose(found["output_mean"], y.mean(axis=0), rtol=1e-5)
    for name, columns, scale in (
        ("input", slice(0, 12), 1),
        ("input", slice(12, 24), 1),
        ("input", slice(24, 36), 1),
        ("input", LAYOUT.inputs["gaits"], 1),
        ("input", LAYOUT.inputs["positions"], 0.1),
        ("input", LAYOUT.inputs["velocities"], 0.1),
        ("input", LAYOUT.inputs["heights"], 1),
        ("output", LAYOUT.outputs["path"], 1),
        ("output", LAYOUT.outputs["root_velocity"], 1),
        ("output", LAYOUT.outputs["rotations"], 1),
    ):
        given = (x if name == "input" else y)[:, columns]
        expected = np.mean([given[:, i].std() for i in range(given.shape[1])]) / scale
        np.testing.assert_allclose(found[f"{name}_std"][columns], expected, rtol=1e-4)


def test_joints_count_by_their_weight_and_not_at_all() -> None:
    x, y = vectors()
    plain = statistics(x, y, LAYOUT, np.ones(3, np.float32))
    found = statistics(x, y, LAYOUT, np.array([1, 0.5, 0], np.float32))
    ratio = (found["input_std"] / plain["input_std"])[LAYOUT.inputs["velocities"]].reshape(3, 3)[:, 0]
    np.testing.assert_allclose(ratio[:2], [1, 2], rtol=1e-6)
    assert ratio[2] > 1e9 and np.isfinite(found["input_std"]).all()
    np.testing.assert_array_equal(found["output_std"], plain["output_std"])


def test_a_block_that_never_varies_is_not_divided_by_nothing() -> None:
    x, y = vectors()
    x[:, LAYOUT.inputs["heights"]] = 0
    found = statistics(x, y, LAYOUT, np.ones(3, np.float32))
    assert (found["input_std"][LAYOUT.inputs["heights"]] == 1).all()


def test_fingers_and_joints_on_their_parents_have_no_weight() -> None:
    parents = [-1, 0, 1, 2, 3, 4, 2, 1]
    names = ("root", "hips", "arm", "hand", "finger", "tip", "twist", "leg")
    offsets = np.array([[0, 0, 0], [0, 0, 0], *[[0, 1, 0]] * 4, [0, 0, 0], [0, -1, 0]], float)
    skeleton = Skeleton(names, np.array(parents), offsets, {"root": 0, "hips": 1, "left_hand": 3})
    assert joint_weights(skeleton).tolist() == [1, 1, 1, 0, 0, 0, 1]
    assert joint_weights(pfnn_models.description().skeleton).min() == 1


def test_the_published_network_leaves_the_same_joints_out(data: Path) -> None:
    raw = published.read(data / "reference" / "pfnn" / "network" / "Xstd.bin", 342)
    skeleton = published.describe(data / "pfnn" / "animations").skeleton
    unseen = raw[Layout(31).inputs["positions"]].reshape(31, 3)[:, 0] > 1e6
    assert 0 < unseen.sum() < 31
    np.testing.assert_array_equal(joint_weights(skeleton) == 0, unseen)
