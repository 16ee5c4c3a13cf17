"""Which clips are held out: whole ones, about the share asked for, by the seed alone."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lmm.training import split
from lmm.training.settings import Settings
from motion.errors import UserError

SETTINGS = Settings()


def _database(lengths: dict[str, int], *, mirror: bool = True, fps: float = 60.0) -> Any:
    """What of a database counts here: names and lengths of its ranges."""
    names = [name for name in lengths for _ in range(1 + mirror)]
    stops = np.cumsum([lengths[name] for name in names], dtype=np.int32)
    return SimpleNamespace(
        fps=fps, names=tuple(names), starts=np.append(0, stops[:-1]).astype(np.int32), stops=stops
    )


def test_about_the_share_is_held_out_by_seed() -> None:
    rng = np.random.default_rng(4)
    lengths = {f"clip_{i}": int(n) for i, n in enumerate(rng.integers(100, 900, 60))}
    database, found = _database(lengths), set()
    for seed in range(8):
        for share in (0.05, 0.1, 0.3):
            settings = dataclasses.replace(SETTINGS, seed=seed, held_out=share)
            names = split.held_out(database, settings)
            assert names == split.held_out(database, settings)
            assert len(set(names)) == len(names)
            taken = sum(lengths[name] for name in names) / sum(lengths.values())
            assert taken == pytest.approx(share, abs=0.02)
        found.add(names)
    assert len(found) == 8


def test_at_least_one_clip_and_not_all() -> None:
    for lengths in ({"a": 300, "b": 200}, {"a": 300, "b": 200, "c": 5}, {"a": 300, "b": 20}):
        names = split.held_out(_database(lengths), SETTINGS)
        assert names == ("b",)
    database = _database({"a": 300, "b": 300, "c": 10})
    for seed in range(6):
        names = split.held_out(database, dataclasses.replace(SETTINGS, seed=seed, held_out=0.9))
        assert len(names) == 1


def test_pieces_of_a_file_go_together() -> None:
    """Where bad frames were cut out of a clip, what follows them is as good as what went before."""
    assert split.file_of("walk@0-1599") == split.file_of("walk@1600-1918") == split.file_of("walk") == "walk"
    assert split.file_of("me@home-2") == "me@home-2"
    pieces = {f"walk@{30 * i}-{30 * i + 30}": 30 for i in range(9)} | {"walk@270-280": 10}
    database, drawn = _database(pieces | {"run": 100, "turn": 80}), set()
    for seed in range(12):
        for share in (0.1, 0.5):
            settings = dataclasses.replace(SETTINGS, seed=seed, held_out=share)
            names = split.held_out(database, settings)
            assert names and set(names) < {*pieces, "run", "turn"}
            assert len(pieces.keys() & names) in (0, len(pieces))
            drawn |= set(names)
    assert drawn == {*pieces, "run", "turn"}
    with pytest.raises(UserError, match=r"^a database of one clip; "):
        split.held_out(_database(pieces), SETTINGS)


def test_a_window_is_as_long_at_any_rate() -> None:
    """A third of a second, so many frames as it has."""
    for fps, window in ((30.0, 10), (60.0, 20), (120.0, 40), (3.0, 2)):
        names = split.held_out(_database({"a": 300, "b": window}, fps=fps), SETTINGS)
        assert names == ("b",)
        with pytest.raises(UserError, match=f"1 of 2 clips is as long as a window, {window} frames"):
            split.held_out(_database({"a": 300, "b": window - 1}, fps=fps), SETTINGS)


def test_a_share_of_0_holds_nothing_out() -> None:
    everything = dataclasses.replace(SETTINGS, held_out=0.0)
    assert split.held_out(_database({"a": 300}), everything) == ()


def test_of_every_kind_of_motion_something_is_trained_on() -> None:
    database = _database({"a": 300, "b": 200, "c": 250, "d": 100})
    kinds = {"a": {"walk"}, "b": {"crouch"}, "c": {"walk", "crouch"}}
    drawn = set()
    for seed in range(20):
        settings = dataclasses.replace(SETTINGS, seed=seed, held_out=0.9)
        names = split.held_out(database, settings, kinds=kinds)
        drawn |= set(names)
        trained = [found for name, found in kinds.items() if name not in names]
        assert names and set().union(*trained) == {"walk", "crouch"}
    assert drawn == {"a", "b", "c", "d"}
    few = dataclasses.replace(SETTINGS, held_out=0.01)
    assert split.held_out(database, few, kinds=kinds | {"d": {"jump"}}) == ("b",)
    with pytest.raises(UserError, match=r"of 2 clips only one has x, only one has y; .*--held-out 0"):
        split.held_out(_database({"a": 300, "b": 200}), SETTINGS, kinds={"a": {"x"}, "b": {"y"}})


@pytest.mark.parametrize(
    ("lengths", "message"),
    [
        (
            {"a": 300},
            "^a database of one clip; build one of more clips, or train on all of it with --held-out 0",
        ),
        (
            {"a": 300, "b": 19},
            "too small .* to hold a clip out: 1 of 2 clips is as long as a window, 20 frames",
        ),
        (
            {"a": 19, "b": 7},
            "too small a database: no clip is as long as a window, 20 frames; build one of longer",
        ),
        ({"a": 19}, "too small a database: no clip"),
    ],
)
def test_a_database_too_small(lengths: dict[str, int], message: str) -> None:
    with pytest.raises(UserError, match=message):
        split.held_out(_database(lengths), SETTINGS)
