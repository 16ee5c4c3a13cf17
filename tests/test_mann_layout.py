"""lmm.mann.layout: the published sizes, the order spelt out, there and back, the gate's columns."""

from __future__ import annotations

import numpy as np
import pytest
from mann_models import NOWHERE
from scipy.spatial.transform import Rotation

from lmm.mann.layout import Inputs, Layout, Outputs, from_axes, to_axes
from motion import quat

N, J = 3, 5


def numbers(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.standard_normal(shape).astype(np.float32)


def inputs(rng: np.random.Generator) -> Inputs:
    shapes = ((N, 12, 2), (N, 12, 2), (N, 12, 6), (N, 12, 2), (N, 12), (N, J, 3))
    first = (numbers(rng, *shape) for shape in shapes)
    return Inputs(*first, quat.normalize(numbers(rng, N, J, 4)), numbers(rng, N, J, 3))


def outputs(rng: np.random.Generator) -> Outputs:
    facing = numbers(rng, N, 6, 2)
    facing /= np.linalg.norm(facing, axis=-1, keepdims=True)
    return Outputs(
        numbers(rng, N, 2), numbers(rng, N), numbers(rng, N, 4), numbers(rng, N, 6, 2), facing,
        numbers(rng, N, 6, 2), numbers(rng, N, J, 3), quat.normalize(numbers(rng, N, J, 4)),
        numbers(rng, N, J, 3),
    )  # fmt: skip


def test_sizes_are_the_dogs_for_27_joints() -> None:
    """REFERENCE 5."""
    dog = Layout(27)
    assert (dog.input_size, dog.output_size, len(dog.gate_columns([3, 7, 11, 15]))) == (480, 363, 19)


@pytest.mark.parametrize("joints, contacts", [(1, 0), (21, 4), (190, 2)])
def test_blocks_cover_the_vectors(joints: int, contacts: int) -> None:
    layout = Layout(joints, contacts)
    assert layout.output_size == 39 + contacts + 12 * joints
    for blocks in (layout.inputs, layout.outputs):
        stops = [0] + [part.stop for part in blocks.values()]
        assert [part.start for part in blocks.values()] == stops[:-1]


def axes(rotation: np.ndarray) -> list[float]:
    matrix = Rotation.from_quat(rotation, scalar_first=True).as_matrix()
    return [*matrix[:, 2], *matrix[:, 1]]


def test_the_order_of_the_inputs() -> None:
    parts = inputs(np.random.default_rng(0))
    expected: list[float] = []
    for block in (parts.path, parts.facing, parts.gaits, parts.going, parts.speeds[..., None]):
        for component in range(block.shape[2]):
            expected += [*block[1, :, component]]
    for joint in range(J):
        expected += [*parts.positions[1, joint]]
    for joint in range(J):
        expected += axes(parts.rotations[1, joint])
    for joint in range(J):
        expected += [*parts.velocities[1, joint]]
    np.testing.assert_allclose(Layout(J).pack_inputs(parts)[1], expected, atol=1e-6)


def test_the_order_of_the_outputs() -> None:
    parts = outputs(np.random.default_rng(1))
    expected = [*parts.root_velocity[2], parts.turn_rate[2], *parts.contacts[2]]
    for block in (parts.path, parts.facing, parts.going):
        expected += [*block[2, :, 0], *block[2, :, 1]]
    expected += [*parts.positions[2].ravel()]
    for joint in range(J):
        expected += axes(parts.rotations[2, joint])
    expected += [*parts.velocities[2].ravel()]
    np.testing.assert_allclose(Layout(J, 4).pack_outputs(parts)[2], expected, atol=1e-6)


def test_there_and_back() -> None:
    layout, rng = Layout(J, 4), np.random.default_rng(2)
    for parts, pack, unpack in (
        (inputs(rng), layout.pack_inputs, layout.unpack_inputs),
        (outputs(rng), layout.pack_outputs, layout.unpack_outputs),
    ):
        back = unpack(pack(parts))
        for name, array in vars(parts).items():
            if name == "rotations":
                assert quat.angle_between(back.rotations, array).max() < 2e-3
            else:
                np.testing.assert_allclose(getattr(back, name), array, atol=1e-6, err_msg=name)


def test_what_is_no_rotation_becomes_one_that_keeps_forward() -> None:
    rng = np.random.default_rng(3)
    found = to_axes(from_axes(numbers(rng, 9, 6) * 3))
    np.testing.assert_allclose(np.linalg.norm(found.reshape(9, 2, 3), axis=-1), 1, atol=1e-6)
    given = numbers(rng, 9, 6)
    kept = to_axes(from_axes(given))[:, :3]
    np.testing.assert_allclose(kept, given[:, :3] / np.linalg.norm(given[:, :3], axis=1)[:, None], atol=1e-5)


@pytest.mark.parametrize("axes", NOWHERE)
def test_vectors_without_direction_turn_nothing(axes: list[int]) -> None:
    np.testing.assert_array_equal(from_axes(np.float32([axes])), [[1, 0, 0, 0]])


@pytest.mark.parametrize("place", range(6))
def test_what_is_no_number_stays_none(place: int) -> None:
    axes = np.float32([0, 0, 1, 0, 1, 0])
    axes[place] = np.nan
    assert np.isnan(from_axes(axes)).all()


def test_the_gate_sees_ends_speed_and_gaits_of_now() -> None:
    parts = inputs(np.random.default_rng(4))
    layout = Layout(J)
    found = layout.pack_inputs(parts)[:, layout.gate_columns([4, 1])]
    for n in range(N):
        expected = [*parts.velocities[n, 4], *parts.velocities[n, 1], parts.speeds[n, 6], *parts.gaits[n, 6]]
        np.testing.assert_array_equal(found[n], expected)
