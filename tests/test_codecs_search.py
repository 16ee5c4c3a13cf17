"""Search in codes: brute's answers on what is decoded of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mm import search
from mm.build import build
from mm.codecs.codec import parse
from mm.codecs.compressed import Compressed, compress
from mm.codecs.search import Coded, CodedRows
from mm.codecs.stages import controller
from mm.control import Command
from motion.errors import UserError


@pytest.fixture(scope="module")
def small(walker_files: Path, tmp_path_factory: pytest.TempPathFactory) -> Compressed:
    tags = tmp_path_factory.mktemp("tags") / "tags.csv"
    tags.write_text("tag,clips\nturn,*_turn\nrun,run\n")
    return compress(build([walker_files], jobs=1, tags=tags), parse("quantised-11", features="8bit"))


@pytest.mark.parametrize("k", [1, 5])
@pytest.mark.parametrize("limits", ["none", "bound", "excluded"])
def test_answers_are_those_of_brute(small: Compressed, k: int, limits: str) -> None:
    index = Coded(small, ignore_end=20)
    brute = search.build("brute", small.features, small.starts, small.stops, ignore_end=20, tags=small.tags)
    rng = np.random.default_rng(4)
    frames = rng.integers(0, len(small), 50).astype(np.int32)
    queries = (small.features[frames] + 0.3 * rng.standard_normal((50, small.schema.size))).astype(np.float32)
    queries[:3] *= 100  # far from all that there is
    chosen: dict = {"k": k}
    if limits == "bound":
        chosen["bound"] = rng.uniform(0, 5, 50).astype(np.float32)
    if limits == "excluded":
        tags = np.full(50, 1, np.uint32), rng.integers(0, 2, 50).astype(np.uint32) * 2
        chosen["exclude"] = search.Exclusions(frames, 20, *tags)
    found, costs = index.search(queries, **chosen)
    expected, expected_costs = brute.search(queries, **chosen)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(costs, expected_costs, rtol=1e-6)
    assert (found >= 0).any()


def test_rows_are_what_is_decoded(small: Compressed) -> None:
    frames = np.array([0, 17, 2999])
    np.testing.assert_array_equal(CodedRows(small)[frames], small.features[frames])


def test_a_controller_plays_what_it_plays_on_features_decoded(small: Compressed) -> None:
    played = []
    for index in ("coded", "brute"):
        system = controller(small, count=3, index=index)
        for frame in range(90):
            command = Command.still(3)
            command.velocity[:] = [np.sin(0.02 * frame), 1.0]
            system.step(command)
        played.append(system.record())
    np.testing.assert_array_equal(played[0]["frame"], played[1]["frame"])
    np.testing.assert_array_equal(played[0]["positions"], played[1]["positions"])


def test_other_features_have_no_codes(small: Compressed, walker_files: Path) -> None:
    database = small.decoded()
    with pytest.raises(UserError, match=r"features of float16 .*--features 8bit"):
        controller(compress(database, parse("quantised-11", features="float16")), index="coded")
    with pytest.raises(UserError, match="no search index 'kodiert'"):
        controller(small, index="kodiert")
    other = build([walker_files], jobs=1, schema="o3de59", mirror=False)
    with pytest.raises(UserError, match="not squared Euclidean"):
        controller(compress(other, parse("quantised-11", features="8bit")), index="coded")
