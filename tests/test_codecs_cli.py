"""``python -m mm compress``, and what takes what it writes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from mm.cli import main
from mm.codecs.compressed import Compressed


def _mm(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def db(walker_files: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("codecs") / "walk.mmdb"
    assert _mm("build", walker_files, "-o", path).exit_code == 0
    return path


@pytest.fixture(scope="module")
def small(db: Path) -> Path:
    out = db.parent / "small.mmdb"
    chain = ("--codec", "quantised-11", "--codec", "keyframes-1")
    result = _mm("compress", db, "-o", out, *chain, "--features", "8bit")
    assert result.exit_code == 0, result.output
    assert "codec keyframes-1+quantised-11, features 8bit, 3,000 frames" in result.stdout
    for row in ("poses", "features", "index", "joint positions, cm", "features, deviations"):
        assert row in result.stdout
    return out


def test_json_has_bytes_and_errors(db: Path, tmp_path: Path) -> None:
    result = _mm("compress", db, "-o", tmp_path / "out", "--json")
    facts = json.loads(result.stdout)
    assert facts["codec"] == "quantised-11" and facts["features_codec"] == "float32"
    assert facts["errors"]["rotation_deg"]["max"] < 0.138 and facts["errors"]["contacts_wrong"] == 0
    assert sum(facts["bytes"].values()) < facts["file_bytes"] < sum(facts["uncompressed_bytes"].values()) / 5
    assert facts["loaded_bytes"]["poses"] == facts["bytes"]["poses"]
    assert Compressed.load(tmp_path / "out").fingerprint == facts["fingerprint"]


def test_info_tells_of_both(small: Path) -> None:
    result = _mm("info", small)
    assert result.exit_code == 0, result.output
    assert (
        "5 clips and 5 mirrored copies" in result.stdout and "codec keyframes-1+quantised-11" in result.stdout
    )
    facts = json.loads(_mm("info", small, "--json").stdout)
    assert facts["clips"] == 5 and facts["errors"]["position_cm"]["max"] <= 1
    assert facts["fingerprint"] == Compressed.load(small).fingerprint != facts["source"]


def test_a_compressed_database_is_driven(small: Path, tmp_path: Path) -> None:
    result = _mm("run", small, "--course", "circle", "--seconds", 2, "-o", tmp_path / "lap.bvh", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["system"] == "mm exact keyframes-1+quantised-11"
    assert (tmp_path / "lap.bvh").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--codec", "zip"), "no codec 'zip'"),
        (("--codec", "float16", "--codec", "quantised-11"), "in two ways"),
        (("--codec", "keyframes-0.01+quantised-6"), "rounding alone"),
        (("--features", "4bit"), "4bit"),
    ],
)
def test_what_cannot_be_is_one_line(db: Path, tmp_path: Path, arguments: tuple, message: str) -> None:
    result = _mm("compress", db, "-o", tmp_path / "out", *arguments)
    assert result.exit_code == 2 and result.stderr.startswith("error: ") and message in result.stderr
    assert not (tmp_path / "out").exists()


def test_it_is_not_written_over_its_source_nor_made_twice(db: Path, small: Path, tmp_path: Path) -> None:
    over = _mm("compress", db, "-o", db)
    assert over.exit_code == 2 and "would be written over" in over.stderr
    twice = _mm("compress", small, "-o", tmp_path / "out")
    assert twice.exit_code == 2 and "expected a motion database" in twice.stderr
