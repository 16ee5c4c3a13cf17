"""The pose losses: the compiled pass against autograd, kinematics against the reader's own, formulas."""

from __future__ import annotations

import lmm_models
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from lmm.layout import Layout, columns  # noqa: E402
from lmm.training.pose_kernels import TERMS  # noqa: E402
from lmm.training.pose_loss import PUBLISHED, PoseLoss, joints  # noqa: E402
from lmm.training.rotations import ForwardKinematics, orthonormal  # noqa: E402
from motion import kinematics, quat  # noqa: E402
from motion.skeleton import Skeleton  # noqa: E402

TREES = {
    "chain": [-1, 0, 1, 2, 3, 4],
    "star": [-1, 0, 0, 0, 0],
    "body": [-1, 0, 1, 1, 2, 3, 4, 5, 1, 8, 8, 8, 9, 10, 11],
    "one joint": [-1, 0],
}
FPS = 30.0


def skeleton(tree: list[int]) -> Skeleton:
    names = tuple(f"joint_{j}" for j in range(len(tree)))
    return Skeleton(names, np.array(tree), np.zeros((len(tree), 3)))


def vectors(rng: np.random.Generator, frames: int, layout: Layout) -> np.ndarray:
    """Poses [T, D] with proper rotations."""
    found = rng.standard_normal((frames, layout.size)).astype(np.float32)
    turns = quat.normalize(rng.standard_normal((frames, layout.joints - 1, 4)))
    found[:, layout.slices["rotations"]] = columns(turns).reshape(frames, -1)
    return found


@pytest.fixture(params=TREES)
def example(request):
    rng = np.random.default_rng(len(request.param))
    tree = skeleton(TREES[request.param])
    layout = Layout(len(tree), 2)
    return tree, layout, vectors(rng, 40, layout), rng


def test_levels_of_matrices_go_where_quaternions_go(example):
    tree, layout, truth, _ = example
    parts, n = layout.slices, layout.joints - 1
    local = {name: truth[:, parts[name]] for name in parts}
    quaternions = np.zeros((len(truth), n + 1, 4))
    quaternions[:, 0, 0] = 1
    matrices = orthonormal(torch.from_numpy(local["rotations"].reshape(-1, n, 3, 2)))
    quaternions[:, 1:] = quat.from_matrix(matrices.numpy().astype(np.float64))
    flat = [
        np.concatenate([np.zeros((len(truth), 1, 3)), local[name].reshape(-1, n, 3)], axis=1)
        for name in ("positions", "velocities", "angular_velocities")
    ]
    expected = kinematics.forward_velocities(tree, flat[0], quaternions, flat[1], flat[2])
    x, r, v, w = ForwardKinematics(tree)(
        *(torch.from_numpy(a) if isinstance(a, np.ndarray) else a for a in (
            local["positions"].reshape(-1, n, 3), matrices,
            local["velocities"].reshape(-1, n, 3), local["angular_velocities"].reshape(-1, n, 3),
        ))
    )  # fmt: skip
    for found, goal in ((x, expected[0]), (v, expected[2]), (w, expected[3])):
        np.testing.assert_allclose(found.numpy(), goal[:, 1:], atol=2e-5, rtol=1e-5)
    np.testing.assert_allclose(r.numpy(), quat.to_matrix(expected[1][:, 1:]), atol=2e-5)


@pytest.mark.parametrize("window", [1, 2, 4])
@pytest.mark.parametrize("threads", [1, 3])
def test_the_compiled_pass_has_the_terms_and_the_gradient_of_autograd(example, window, threads):
    tree, layout, truth, rng = example
    loss = PoseLoss(tree, 2, FPS, truth, threads=threads)
    first = rng.integers(0, len(truth) - window + 1, 100)
    rows = (first[:, None] + np.arange(window)).reshape(-1)
    noise = 0.3 * rng.standard_normal((len(rows), layout.size)).astype(np.float32)
    gradients, terms = [], []
    for way in (loss.compiled, loss.plain):
        predicted = torch.from_numpy(truth[rows] + noise).requires_grad_()
        found = way(predicted, first, window)
        torch.stack(list(found.values())).sum().backward()
        gradients.append(predicted.grad.numpy())
        terms.append({name: float(value.detach()) for name, value in found.items()})
    assert tuple(terms[0]) == tuple(terms[1]) == TERMS
    np.testing.assert_allclose(list(terms[0].values()), list(terms[1].values()), rtol=2e-4, atol=1e-6)
    size = np.abs(gradients[1]).max()
    # Where a difference is nearly zero its sign, and so the slope, may differ by rounding.
    wrong = np.abs(gradients[0] - gradients[1]) > 1e-3 * size
    assert wrong.mean() < 1e-3


def test_the_truth_costs_nothing_and_terms_are_weighted_means(example):
    tree, layout, truth, _ = example
    loss = PoseLoss(tree, 2, FPS, truth)
    first = np.arange(0, 30)
    rows = (first[:, None] + np.arange(2)).reshape(-1)
    exact = loss.compiled(torch.from_numpy(truth[rows]), first, 2)
    assert max(float(term) for term in exact.values()) < 1e-3
    shifted = truth[rows].copy()
    shifted[:, layout.slices["positions"]] += 0.1
    shifted[:, layout.slices["root_velocity"]] += 0.5
    shifted[:, layout.slices["contacts"]] -= 0.25
    found = {name: float(v) for name, v in loss.compiled(torch.from_numpy(shifted), first, 2).items()}
    weights = dict(zip(TERMS, PUBLISHED, strict=True))
    assert found["position"] == pytest.approx(0.1 * weights["position"], rel=1e-4)
    assert found["root velocity"] == pytest.approx(0.5 * weights["root velocity"], rel=1e-4)
    assert found["contact"] == pytest.approx(0.25 * weights["contact"], rel=1e-4)
    assert found["position rate"] == pytest.approx(0, abs=1e-3)


def test_what_is_no_number_is_not_hidden(example):
    """A network that has come to nothing must not look like one without error."""
    tree, layout, truth, _ = example
    loss = PoseLoss(tree, 2, FPS, truth)
    first, parts = np.arange(0, 30), layout.slices
    for block, own in (
        ("positions", "position"),
        ("contacts", "contact"),
        ("rotations", "character rotation"),
    ):
        predicted = truth[(first[:, None] + np.arange(2)).reshape(-1)] + np.float32(0.1)
        predicted[7, parts[block].start] = np.nan
        lost = [
            {name for name, term in way(torch.from_numpy(predicted), first, 2).items() if torch.isnan(term)}
            for way in (loss.compiled, loss.plain)
        ]
        assert own in lost[0] and lost[0] == lost[1]


def test_true_joints_are_those_of_a_databases_clips():
    database = lmm_models.database()
    layout = Layout(len(database.skeleton), len(database.contact_roles))
    found, *_ = joints(database.skeleton.parents.astype(np.int32), layout.pack(database))
    positions, rotations = (
        np.array(a, np.float64) for a in (database.poses.positions, database.poses.rotations)
    )
    positions[:, 0], rotations[:, 0] = 0, [1, 0, 0, 0]
    expected, _ = kinematics.forward(database.skeleton, positions, rotations)
    np.testing.assert_allclose(found, expected, atol=1e-5)
