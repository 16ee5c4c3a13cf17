"""Compressed databases in the engine: the same characters, or nearly so."""

from __future__ import annotations

import numpy as np
import pytest

from mm import nearness, quality
from mm.codecs.codec import parse
from mm.codecs.compressed import compress
from mm.codecs.stages import controller
from mm.control import Command
from mm.controller import Controller
from mm.database import Database
from motion import springs

CODECS = (
    "float16",
    "recomputed",
    "quantised-16",
    "quantised-11",
    "keyframes-0.5",
    "keyframes-1+quantised-11",
)


@pytest.fixture(scope="module")
def database(walker_database: Database) -> Database:
    return walker_database


def drive(system: Controller, frames: int = 240) -> dict[str, np.ndarray]:
    """Somebody who stands, walks a bend, and stands again; each character a little faster than the last."""
    records = []
    for frame in range(frames):
        command = Command.still(system.count)
        speed = 0.0 if frame < 20 or frame > 200 else 1.2
        heading = 0.015 * frame
        command.velocity[:] = speed * np.array([np.sin(heading), np.cos(heading)])
        command.velocity *= 1 + 0.1 * (np.arange(system.count, dtype=np.float32)[:, None] % 5)
        command.yaw[:] = springs.wrap(heading)
        system.step(command)
        records.append(system.record())
    return {name: np.stack([r[name] for r in records]) for name in records[0]}


def test_what_is_not_rounded_plays_as_the_database_itself(database: Database) -> None:
    ours, theirs = (
        drive(controller(compress(database, "float32"), count=2)),
        drive(Controller(database, count=2)),
    )
    assert theirs["transition"].any()
    for name in ("frame", "positions", "rotations", "contacts", "cost_candidate"):
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)


@pytest.mark.parametrize("name", CODECS)
def test_characters_stay_near_those_of_the_database(database: Database, name: str) -> None:
    small = compress(database, parse(name, features="8bit"))
    ours, theirs = drive(controller(small)), drive(Controller(database))
    assert ours["transition"].any()
    at, there = (run["positions"][:, 0, 0, [0, 2]] for run in (ours, theirs))
    assert np.linalg.norm(at - there, axis=-1).max() < 0.15
    local = [
        quality.in_root_space(database.skeleton, run["positions"][:, 0], run["rotations"][:, 0])
        for run in (ours, theirs)
    ]
    assert nearness.difference(*local, window=15).mean() < 2


@pytest.mark.parametrize("name", ["quantised-11", "keyframes-1+quantised-11"])
def test_many_characters_do_what_one_does(database: Database, name: str) -> None:
    small = compress(database, name)
    many, one = drive(controller(small, count=16), 90), drive(controller(small), 90)
    for part in ("frame", "positions", "rotations"):
        for who in (0, 5, 15):
            np.testing.assert_array_equal(many[part][:, who], one[part][:, 0], err_msg=part)


def test_compiled_kernels_equal_their_twin(database: Database) -> None:
    small = compress(database, "keyframes-1+quantised-11")
    ours, twins = (
        drive(controller(small, index="brute", compiled=compiled), 100) for compiled in (True, False)
    )
    np.testing.assert_array_equal(ours["frame"], twins["frame"])
    np.testing.assert_allclose(ours["positions"], twins["positions"], atol=1e-4)


def test_memory_is_what_is_held(database: Database) -> None:
    small = compress(database, parse("quantised-11", features="8bit"))
    held, coded = controller(small).memory(), controller(small, index="coded").memory()
    stored = small.memory()
    assert coded["features"] == stored["features"] and coded["index"] < held["index"] / 4
    for part in ("poses", "root motion", "contacts"):
        assert held[part] == stored[part]
    assert held["features"] == 4 * stored["features"] - 4 * 2 * 4 * small.schema.size
    assert held["index"] > 0 and held["state"] > 0
