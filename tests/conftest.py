"""Fixtures for every test: real clips where they stand beside the checkout, synthetic motion anywhere."""

from __future__ import annotations

import os
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

import hypothesis
import pytest
import synthetic

from motion.clip import Clip

if TYPE_CHECKING:
    from mm.database import Database

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
REQUIRE_DATA = os.environ.get("REQUIRE_DATA") == "1"

# How long an example takes depends on what else the machine does.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")


@pytest.fixture(scope="session", autouse=True)
def _no_waiting_for_the_disk() -> Generator[None]:
    """What tests write need not outlast a loss of power, which thousands of files would wait for."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda file: None)
        yield


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real clips and oracles, ``../shared/data`` beside the checkout; skips without it."""
    if not (DATA / "manifest.csv").is_file():
        pytest.skip(f"no real clips: {DATA} is absent or has no manifest.csv")
    return DATA


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what reads the real clips, so that ``-m "not data"`` leaves it out."""
    for item in items:
        if "data" in getattr(item, "fixturenames", ()):
            item.add_marker("data")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """With REQUIRE_DATA=1, a test of the real clips that skips has failed, whatever its reason."""
    report = yield
    skipped = report.skipped and not hasattr(report, "wasxfail")
    if REQUIRE_DATA and skipped and item.get_closest_marker("data"):
        report.outcome = "failed"
        report.longrepr = f"REQUIRE_DATA=1, but {item.nodeid} skipped: {report.longrepr}"
    return report


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


@pytest.fixture(scope="session")
def walker_mmdb(walker_files: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The database of those five, with mirrored copies, as a file. It is shared: write nothing beside it."""
    from mm.build import build

    path = tmp_path_factory.mktemp("walker_mmdb") / "walker.mmdb"
    build([walker_files], jobs=1).save(path)
    return path


@pytest.fixture(scope="session")
def walker_database(walker_mmdb: Path) -> Database:
    """That database, whose arrays cannot be written to."""
    from mm.database import Database

    return Database.load(walker_mmdb)
