"""Curves of training: minutes of the stage's own, both parts of the data, a panel a stage."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from lmm.training import curves
from motion.errors import UserError


def _record(stage: str, iteration: int, seconds: float, training: float, held_out: float) -> dict[str, Any]:
    error = "regret" if stage == "projector" else "error_cm"
    return {
        "stage": stage,
        "iteration": iteration,
        "seconds": seconds,
        "learning_rate": 1e-3,
        "loss": {"position": 2.0},
        "errors": {"training": {error: training, "other": 7.0}, "held_out": {error: held_out}},
    }


RECORDS = [
    _record("decompressor", 10, 60, 3.0, 4.0),
    _record("decompressor", 20, 120, 2.0, 3.5),
    _record("projector", 10, 150, 1.5, 1.7),
    _record("projector", 20, 180, 1.25, 1.6),
]


def test_time_is_the_stages_own() -> None:
    assert curves.series(RECORDS, "decompressor", "held_out", "error_cm") == ([1.0, 2.0], [4.0, 3.5])
    assert curves.series(RECORDS, "projector", "training", "regret") == ([0.5, 1.0], [1.5, 1.25])
    assert curves.series(RECORDS, "stepper", "training", "error_cm") == ([], [])


def test_a_panel_a_stage_and_a_line_a_log_and_part() -> None:
    picture = curves.draw([RECORDS, RECORDS[:2]], ["ours", "theirs"])
    first, second = picture.axes
    assert [axes.get_title() for axes in picture.axes] == ["decompressor", "projector"]
    assert (first.get_ylabel(), second.get_ylabel()) == ("error, cm", "regret")
    lines = [(list(line.get_xdata()), list(line.get_ydata())) for line in first.lines]
    assert lines == [([1.0, 2.0], [4.0, 3.5]), ([1.0, 2.0], [3.0, 2.0])] * 2
    assert [len(line.get_xdata()) for line in second.lines] == [2, 2, 0, 0]
    colours = [line.get_color() for line in first.lines]
    assert colours[0] == colours[1] != colours[2] == colours[3]
    (legend,) = picture.legends
    assert [text.get_text() for text in legend.get_texts()] == ["ours", "theirs", "held out", "training"]


@pytest.mark.parametrize(("suffix", "start"), [(".png", b"\x89PNG"), (".svg", b"<?xml")])
def test_pictures(suffix: str, start: bytes, tmp_path: Path) -> None:
    log, out = tmp_path / "a.jsonl", tmp_path / f"curves{suffix}"
    log.write_text("".join(json.dumps(record) + "\n" for record in RECORDS))
    curves.save(out, [str(log)], ["ours"])
    data = out.read_bytes()
    assert data.startswith(start) and len(data) > 5000
    curves.save(out, [str(log)], ["ours"])
    assert out.read_bytes() == data
    curves.save(out, [str(log)], ["a$x_$"])  # a file's name, no formula


def test_other_pictures_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"curves.gif: unknown form of picture; name a .png or a .svg"):
        curves.check_output(tmp_path / "curves.gif", inputs=[])
    with pytest.raises(UserError, match="it is a folder"):
        curves.check_output(_folder(tmp_path / "curves.png"), inputs=[])
    with pytest.raises(UserError, match="would be written over"):
        curves.check_output(tmp_path / "a.png", inputs=[str(tmp_path / "a.png")])


def _folder(path: Path) -> Path:
    path.mkdir()
    return path
