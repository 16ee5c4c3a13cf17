"""Fixtures that every test may use: real data where it stands beside the checkout, synthetic motion anywhere."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import synthetic

from motion.clip import Clip

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real clips and oracles, ``../shared/data`` beside the checkout; skips without it."""
    if not (DATA / "manifest.csv").is_file():
        if os.environ.get("REQUIRE_DATA") == "1":
            pytest.fail(f"REQUIRE_DATA=1, but there is no {DATA / 'manifest.csv'}")
        pytest.skip(f"no real clips: {DATA} is absent")
    return DATA


@pytest.fixture(scope="session")
def walker() -> Clip:
    """A synthetic humanoid that walks a winding path for 5 s at 60 Hz; joint 0 is its hips, roles are set."""
    return synthetic.walk("walker", turn=synthetic.weave)


@pytest.fixture(scope="session")
def walker_clips() -> list[Clip]:
    """Five synthetic clips of the same humanoid: straight, left_turn, right_turn, stand, run."""
    return synthetic.clips()


@pytest.fixture(scope="session")
def walker_files(walker_clips: list[Clip], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with those five as BVH files. It is shared: write nothing into it."""
    from motion import bvh

    folder = tmp_path_factory.mktemp("walker")
    for clip in walker_clips:
        bvh.write(folder / f"{clip.name}.bvh", clip)
    return folder
