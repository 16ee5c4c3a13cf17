"""The vector of a pose: every number where it is said to be, and back."""

from __future__ import annotations

import lmm_models
import numpy as np
import pytest

from lmm.layout import Layout, columns, rotations
from mm import interchange, stages
from mm.database import Database
from motion import quat

FPS = 60


def _layout(db: Database) -> Layout:
    return Layout(len(db.skeleton), len(db.contact_roles))


def _same_rotations(one: np.ndarray, other: np.ndarray, degrees: float) -> None:
    assert np.degrees(quat.angle_between(one.astype(float), other.astype(float))).max() < degrees


@pytest.mark.parametrize(("joints", "contacts", "size"), [(23, 2, 338), (2, 0, 21), (22, 4, 325)])
def test_blocks_stand_one_after_another(joints: int, contacts: int, size: int) -> None:
    layout = Layout(joints, contacts)
    edges = [part.start for part in layout.slices.values()] + [layout.size]
    assert layout.size == size and edges[0] == 0 and edges == sorted(edges)
    assert all(part.stop == edge for part, edge in zip(layout.slices.values(), edges[1:], strict=True))


def test_every_number_stands_where_it_is_said_to_be() -> None:
    """Against loops over joints and axes, in the order of the public reference (REFERENCE 3.1)."""
    db = lmm_models.database()
    frames = np.array([3, 250, 470])
    vectors = _layout(db).pack(db, frames)
    joints, poses = len(db.skeleton), db.poses
    for vector, frame in zip(vectors, frames, strict=True):
        matrices = quat.to_matrix(np.asarray(poses.rotations[frame], np.float64))
        back = matrices[0].T
        expected: list[float] = []
        for j in range(1, joints):
            expected += poses.positions[frame, j].tolist()
        for j in range(1, joints):
            for axis in range(3):
                expected += [matrices[j][axis, 0], matrices[j][axis, 1]]
        for array in (poses.velocities, poses.angular_velocities):
            for j in range(1, joints):
                expected += array[frame, j].tolist()
        expected += (back @ poses.velocities[frame, 0]).tolist()
        expected += (back @ poses.angular_velocities[frame, 0]).tolist()
        expected += db.contacts[frame].tolist()
        np.testing.assert_allclose(vector, expected, atol=2e-6)


def test_poses_come_back() -> None:
    db = lmm_models.database()
    layout = _layout(db)
    vectors = layout.pack(db)
    poses, contacts = layout.unpack(vectors, db.fps)
    for name in ("positions", "velocities", "angular_velocities"):
        np.testing.assert_array_equal(poses.arrays()[name][:, 1:], db.poses.arrays()[name][:, 1:])
    _same_rotations(poses.rotations[:, 1:], db.poses.rotations[:, 1:], 0.05)
    np.testing.assert_allclose(np.linalg.norm(poses.rotations, axis=-1), 1, atol=1e-5)
    np.testing.assert_array_equal(contacts, db.contacts)
    assert contacts.dtype == np.uint8 and 0.1 < contacts.mean() < 0.9
    some = layout.pack(db, slice(10, 20))
    np.testing.assert_array_equal(some, vectors[10:20])


def test_the_root_moves_as_the_database_s_does() -> None:
    """Steps and rates against what the classical decompression puts out, away from the edges of clips."""
    db = lmm_models.database()
    poses, _ = _layout(db).unpack(_layout(db).pack(db), db.fps)
    expected = stages.root_steps(db)
    inner = np.setdiff1d(np.arange(len(db)), np.concatenate([db.starts, db.starts + 1, db.stops - 1]))
    found = np.concatenate(
        [
            poses.positions[:, 0][:, [0, 2]],
            2 * np.arctan2(poses.rotations[:, 0, 2:3], poses.rotations[:, 0, :1]),
            poses.velocities[:, 0][:, [0, 2]],
            poses.angular_velocities[:, 0, 1:2],
        ],
        axis=1,
    )
    np.testing.assert_allclose(found[:, 3:], expected[:, 3:], atol=1e-5)
    # A velocity is the mean of the step before and after, so steps agree but for accelerations.
    assert np.abs(found - expected)[inner, :2].max() < 0.002 and np.ptp(expected[:, 1]) > 0.02
    assert np.degrees(np.abs(found - expected)[inner, 2].max()) < 0.3
    assert not np.any(poses.positions[:, 0, 1])


def test_a_circle_is_closed() -> None:
    """Constant speed and turn, stepped around: the root comes back to where it began."""
    layout, steps = Layout(2, 0), 240
    vector = np.zeros((1, layout.size), np.float32)
    vector[0, layout.slices["root_velocity"]] = (0.5, 9.0, 1.5)  # what is vertical, or no turn, is dropped
    vector[0, layout.slices["root_angular_velocity"]] = (7.0, 2 * np.pi * FPS / steps, 7.0)
    poses, _ = layout.unpack(vector, FPS)
    step, turn = poses.positions[0, 0].astype(float), poses.rotations[0, 0].astype(float)
    np.testing.assert_allclose(turn[[1, 3]], 0, atol=1e-7)
    place, heading, places = np.zeros(3), np.array([1.0, 0, 0, 0]), []
    for _ in range(steps):
        place = place + quat.rotate(heading, step)
        heading = quat.mul(heading, turn)
        places.append(place)
    np.testing.assert_allclose(place, 0, atol=1e-4)
    _same_rotations(heading[None], np.array([[1.0, 0, 0, 0]]), 0.01)
    # Seen from the root the velocity stays what it was: the circle's radius is speed / turn rate.
    radius = np.hypot(0.5, 1.5) * steps / FPS / (2 * np.pi)
    distances = np.linalg.norm(np.array(places) - np.mean(places, axis=0), axis=-1)
    np.testing.assert_allclose(distances, radius, rtol=1e-3)
    np.testing.assert_allclose(places[0], np.array([0.5, 0, 1.5]) / FPS, atol=4e-4)  # but for half a turn


def test_any_vector_makes_a_pose() -> None:
    """What a network may put out: rough columns, columns of no length, parallel ones, huge ones."""
    layout = Layout(7, 2)
    vectors = np.random.default_rng(4).standard_normal((6, layout.size)).astype(np.float32)
    part = vectors[:, layout.slices["rotations"]].reshape(6, 6, 3, 2)
    part[1] = 0
    part[2, ..., 1] = 2 * part[2, ..., 0]
    part[3] *= 1e12
    part[4] *= 1e-12
    part[5, ..., 0] = 0
    vectors[:, layout.slices["rotations"]] = part.reshape(6, -1)
    poses, contacts = layout.unpack(vectors, FPS)
    np.testing.assert_allclose(np.linalg.norm(poses.rotations, axis=-1), 1, atol=1e-5)
    assert set(np.unique(contacts)) <= {0, 1}
    np.testing.assert_allclose(
        quat.to_matrix(poses.rotations[:1, 1:])[..., 0],
        part[:1, ..., 0] / np.linalg.norm(part[:1, ..., 0], axis=-1, keepdims=True),
        atol=1e-5,
    )


def test_columns_and_rotations_are_inverse() -> None:
    rng = np.random.default_rng(5)
    q = rng.standard_normal((500, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    xy = columns(q)
    assert xy.shape == (500, 3, 2)
    _same_rotations(rotations(xy), q, 0.05)
    # Scale, and what of the second column lies along the first, do not matter.
    bent = xy * rng.uniform(0.2, 3, (500, 1, 2)).astype(np.float32)
    bent[..., 1] += 0.4 * bent[..., 0]
    _same_rotations(rotations(bent), q, 0.05)


def test_the_reference_s_database_has_the_reference_s_width(data) -> None:
    db = interchange.import_directory(data / "reference" / "oracle")
    assert _layout(db).pack(db, slice(0, 5)).shape == (5, 338)
