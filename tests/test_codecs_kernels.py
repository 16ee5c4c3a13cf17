"""Decoding: compiled as its twin, one frame as many, velocities as the build makes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mm.codecs import kernels, kernels_numpy, smallest_three
from mm.codecs.codec import parse
from mm.codecs.encode import encode
from mm.codecs.tables import Tables
from mm.database import Database
from motion import kinematics, quat
from motion.pose import Poses

CODECS = (
    "float32", "float16", "recomputed", "float16+recomputed", "quantised-6", "quantised-11", "quantised-18",
    "keyframes-2", "keyframes-2+quantised-11", "keyframes-2+float16",
)  # fmt: skip


@pytest.fixture(scope="module")
def database(walker_database: Database) -> Database:
    """Ranges of every length that the ends of ranges care about, and longer ones."""
    whole = walker_database
    lengths = (1, 2, 3, 4, 5, 6, 79, 200)
    stops = np.cumsum(lengths).astype(np.int32)
    starts = (stops - lengths).astype(np.int32)
    poses = whole.poses[slice(0, 300)].copy()
    for start, stop in zip(starts, stops, strict=True):
        piece = slice(start, stop)
        poses.velocities[piece] = kinematics.velocities(poses.positions[piece], whole.fps)
        poses.angular_velocities[piece] = kinematics.angular_velocities(poses.rotations[piece], whole.fps)
    return replace(
        whole,
        poses=poses,
        contacts=whole.contacts[:300],
        features=whole.features[:300],
        starts=starts,
        stops=stops,
        tags=whole.tags[:300],
        names=tuple(map(str, lengths)),
        mirrored=np.zeros(len(lengths), np.bool_),
    )


def decoded(
    tables: Tables, frames: np.ndarray, joints: int, module: object = kernels
) -> tuple[np.ndarray, ...]:
    poses, contacts = Poses.empty(len(frames), joints), np.zeros((len(frames), 2), np.uint8)
    spare = Poses.empty(kernels.SPARE, joints)
    out = (*poses.arrays().values(), contacts)
    module.decode(frames.astype(np.int32), tables, spare.positions, spare.rotations, *out)  # type: ignore[attr-defined]
    return out


@pytest.mark.parametrize("name", CODECS)
def test_compiled_equals_its_twin(database: Database, name: str) -> None:
    tables, joints = encode(database, parse(name)), len(database.skeleton)
    frames = np.arange(len(database))
    ours, twins = (decoded(tables, frames, joints, module) for module in (kernels, kernels_numpy))
    for one, other, tolerance in zip(ours, twins, (1e-6, 1e-6, 1e-5, 1e-4, 0), strict=True):
        np.testing.assert_allclose(one, other, atol=tolerance)


@pytest.mark.parametrize("name", CODECS)
def test_a_frame_alone_is_what_it_is_among_others(database: Database, name: str) -> None:
    tables, joints = encode(database, parse(name)), len(database.skeleton)
    frames = np.random.default_rng(0).permutation(len(database))
    together = decoded(tables, frames, joints)
    for i in range(0, 300, 23):
        for one, all_of_them in zip(decoded(tables, frames[i : i + 1], joints), together, strict=True):
            np.testing.assert_array_equal(one[0], all_of_them[i])


@pytest.mark.parametrize("name", ["float32", "recomputed"])
def test_what_is_not_rounded_comes_back(database: Database, name: str) -> None:
    tables, joints = encode(database, parse(name)), len(database.skeleton)
    out = decoded(tables, np.arange(300), joints)
    for found, (part, truth) in zip(out, database.poses.arrays().items(), strict=False):
        exact = name == "float32" or part in ("positions", "rotations")
        # The ends' velocities, too, which are made otherwise in ranges of up to five frames.
        np.testing.assert_allclose(found[:, 1:], truth[:, 1:], atol=0 if exact else 2e-4, err_msg=part)
    np.testing.assert_array_equal(out[4], database.contacts)


def test_half_floats_are_those_of_numpy(database: Database) -> None:
    out = decoded(encode(database, parse("float16")), np.arange(300), len(database.skeleton))
    truth = database.poses.positions[:, 1:].astype(np.float16)
    np.testing.assert_array_equal(out[0][:, 1:], truth.astype(np.float32))
    every = np.arange(65536, dtype=np.uint16)
    finite = every[np.isfinite(every.view(np.float16))]
    values = np.array([kernels.half(h) for h in finite])
    np.testing.assert_array_equal(values, finite.view(np.float16).astype(np.float32))


@pytest.mark.parametrize("bits", [6, 11, 18])
def test_quantised_rotations_are_within_the_bound_and_translations_in_a_65536th(
    database: Database, bits: int
) -> None:
    tables = encode(database, parse(f"quantised-{bits}"))
    out = decoded(tables, np.arange(300), len(database.skeleton))
    truth = quat.normalize(database.poses.rotations[:, 1:].astype(np.float64))
    off = quat.angle_between(out[1][:, 1:].astype(np.float64), truth)
    assert off.max() <= smallest_three.bound(bits) + 1e-6  # float32's rounding
    apart = np.abs(out[0][:, 1:] - database.poses.positions[:, 1:]).max(axis=0)
    hips = np.ptp(database.poses.positions[:, 1], axis=0)
    assert (
        set(tables.moving) <= {3, 4, 5}
        and (apart[0] <= np.where(hips > 1e-5, hips / 131070 + 1e-6, 1e-5)).all()
    )
    assert apart[1:].max() <= 1e-5  # bones, kept once


def test_joints_that_never_turn_take_no_bits(database: Database) -> None:
    tables = encode(database, parse("quantised-11"))
    still = np.ptp(database.poses.rotations[:, 1:], axis=0).max(axis=-1) < 1e-6
    assert still.any() and len(tables.turning) == (~still).sum()
    assert tables.packed.shape == (300, -(-35 * len(tables.turning) // 8))


def test_words_of_bits() -> None:
    row = np.random.default_rng(1).integers(0, 256, 20).astype(np.uint8)
    number = int.from_bytes(row.tobytes(), "little")
    for at in (0, 3, 7, 8, 70, 96):
        for count in (1, 8, 35, 56):
            assert int(kernels.word(row, at, count)) == number >> at & (1 << count) - 1
