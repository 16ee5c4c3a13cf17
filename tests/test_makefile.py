"""The demo's choice of clips."""

from __future__ import annotations

import csv
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from lmm import pretrained
from motion import sources

ROOT = Path(__file__).resolve().parents[1]


def commands(*arguments: str) -> list[list[str]]:
    """The demo's commands, as words."""
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    environment = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "DATA", "EXCLUDE")}
    command = ["make", "--dry-run", "--no-print-directory", "demo", *arguments]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    lines = done.stdout.replace("\\\n", "").splitlines()
    return [shlex.split(line) for line in lines if " -m " in line]


def excluded(*arguments: str) -> list[str]:
    """The patterns that the demo would give to --exclude."""
    words = next(words for words in commands(*arguments) if "compare" in words)
    return [words[i + 1] for i, word in enumerate(words) if word == "--exclude"]


def test_the_demo_needs_no_data() -> None:
    dance, compare = ([w for w in words if not w.endswith("/python")] for words in commands()[-2:])
    assert dance == ["-m", "motion", "dancecard", "-o", "out/dancecard"]
    assert compare[:4] == ["-m", "bench", "compare", "out/dancecard"] and excluded() == []
    assert [compare[i + 1] for i, word in enumerate(compare) if word == "--model"] == pretrained.names()


def test_other_clips_are_all_taken_unless_told() -> None:
    assert excluded("DATA=elsewhere") == []
    assert "--model" not in commands("DATA=elsewhere")[-1]  # those networks know other data
    assert excluded("DATA=elsewhere", "EXCLUDE=a* b") == ["a*", "b"]


def test_the_demo_leaves_out_what_is_no_locomotion(data: Path) -> None:
    with (data / "manifest.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["set"] == "cmu/asfamc"]
    other = {
        Path(row["file"]).stem for row in rows if re.search(r"jump|dive|duck|over", row["content"], re.I)
    }
    folder = data / "cmu" / "asfamc"
    kept = {path.stem for path in sources.find(folder, exclude=excluded(f"DATA={folder}"))}
    assert kept == {path.stem for path in sources.find(folder)} - other
