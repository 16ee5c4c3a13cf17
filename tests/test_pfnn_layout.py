"""lmm.pfnn.layout: the order of the published vectors, spelt out; there and back; rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from features import labels
from lmm.pfnn import layout as layouts
from lmm.pfnn.layout import Inputs, Layout, Outputs
from motion import quat

N, J = 3, 5


def inputs(rng: np.random.Generator) -> Inputs:
    shapes = ((N, 12, 2), (N, 12, 2), (N, 12, 6), (N, J, 3), (N, J, 3), (N, 12, 3))
    return Inputs(*(rng.standard_normal(shape).astype(np.float32) for shape in shapes))


def outputs(rng: np.random.Generator) -> Outputs:
    def numbers(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape).astype(np.float32)

    facing = numbers(N, 6, 2)
    facing /= np.linalg.norm(facing, axis=-1, keepdims=True)
    rotations = quat.normalize(numbers(N, J, 4))
    return Outputs(
        numbers(N, 2), numbers(N), numbers(N), numbers(N, 4), numbers(N, 6, 2), facing, numbers(N, J, 3),
        numbers(N, J, 3), rotations,
    )  # fmt: skip


def test_gaits_are_those_of_the_labels() -> None:
    assert layouts.GAITS == labels.GAITS


def test_sizes_are_the_published_ones_for_31_joints() -> None:
    assert (Layout(31).input_size, Layout(31).output_size) == (342, 311)


@pytest.mark.parametrize("joints, contacts", [(1, 2), (31, 4), (190, 4)])
def test_blocks_cover_the_vectors(joints: int, contacts: int) -> None:
    layout = Layout(joints, contacts)
    assert layout.input_size == 48 + 72 + 6 * joints + 36
    assert layout.output_size == 3 + 1 + contacts + 24 + 9 * joints
    for blocks in (layout.inputs, layout.outputs):
        stops = [0] + [part.stop for part in blocks.values()]
        assert [part.start for part in blocks.values()] == stops[:-1]


def test_the_order_of_the_inputs() -> None:
    parts = inputs(np.random.default_rng(0))
    vector = Layout(J).pack_inputs(parts)[1]
    expected = [
        *parts.path[1, :, 0], *parts.path[1, :, 1], *parts.facing[1, :, 0], *parts.facing[1, :, 1],
    ]  # fmt: skip
    for gait in range(6):
        expected += [*parts.gaits[1, :, gait]]
    for block in (parts.positions, parts.velocities):
        for joint in range(J):
            expected += [*block[1, joint]]
    for side in range(3):
        expected += [*parts.heights[1, :, side]]
    assert vector.tolist() == expected


def test_the_order_of_the_outputs() -> None:
    parts = outputs(np.random.default_rng(1))
    vector = Layout(J).pack_outputs(parts)[2]
    expected = [*parts.root_velocity[2], parts.turn_rate[2], parts.phase_rate[2], *parts.contacts[2]]
    expected += [*parts.path[2, :, 0], *parts.path[2, :, 1], *parts.facing[2, :, 0], *parts.facing[2, :, 1]]
    for block in (parts.positions, parts.velocities):
        for joint in range(J):
            expected += [*block[2, joint]]
    assert vector[: -3 * J].tolist() == expected
    # SciPy's rotation vectors are the whole angle, of the shorter of the two ways.
    short = np.where(parts.rotations[2, :, :1] < 0, -1, 1) * parts.rotations[2]
    maps = vector[-3 * J :].reshape(J, 3)
    found = Rotation.from_rotvec(2 * maps).as_quat(scalar_first=True)
    np.testing.assert_allclose(np.abs(np.sum(found * short, axis=-1)), 1, atol=1e-6)


def test_there_and_back() -> None:
    layout, rng = Layout(J), np.random.default_rng(2)
    for parts, pack, unpack in (
        (inputs(rng), layout.pack_inputs, layout.unpack_inputs),
        (outputs(rng), layout.pack_outputs, layout.unpack_outputs),
    ):
        back = unpack(pack(parts))
        for name, array in vars(parts).items():
            np.testing.assert_allclose(getattr(back, name), array, atol=1e-6, err_msg=name)


def test_rotations_keep_their_sign_so_that_maps_are_continuous() -> None:
    angles = np.linspace(0, 1.9 * np.pi, 50)
    parts = outputs(np.random.default_rng(3))
    rotations = np.zeros((50, J, 4), np.float32)
    rotations[:, :, 0], rotations[:, :, 2] = np.cos(angles / 2)[:, None], np.sin(angles / 2)[:, None]
    many = Outputs(
        *(np.repeat(a[:1], 50, axis=0) for name, a in vars(parts).items() if name != "rotations"), rotations
    )
    maps = Layout(J).pack_outputs(many)[:, -3 * J :].reshape(50, J, 3)
    np.testing.assert_allclose(maps[:, 0], angles[:, None] / 2 * [0, 1, 0], atol=1e-5)


def test_directions_come_back_unit_even_of_nothing() -> None:
    layout = Layout(J)
    back = layout.unpack_outputs(np.zeros((1, layout.output_size), np.float32))
    assert np.isfinite(back.facing).all()
    np.testing.assert_array_equal(back.rotations[0, :, 0], 1)
