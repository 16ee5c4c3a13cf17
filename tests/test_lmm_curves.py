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
    assert [axes.get_title() for axes in picture.axes] == ["decompressor", "projector (only ours)"]
    assert (first.get_ylabel(), second.get_ylabel()) == ("error, cm", "regret")
    lines = [(list(line.get_xdata()), list(line.get_ydata())) for line in first.lines]
    assert lines == [([1.0, 2.0], [4.0, 3.5]), ([1.0, 2.0], [3.0, 2.0])] * 2
    assert [len(line.get_xdata()) for line in second.lines] == [2, 2, 0, 0]
    colours = [line.get_color() for line in first.lines]
    assert colours[0] == colours[1] != colours[2] == colours[3]
    (legend,) = picture.legends
    assert [text.get_text() for text in legend.get_texts()] == ["ours", "theirs", "held out", "training"]


def test_a_stage_that_one_log_lacks_and_one_that_hardly_moves() -> None:
    lacking = curves.draw([RECORDS, RECORDS[:2]], ["ours", "theirs $x$"]).axes[1]
    assert lacking.get_title() == "projector (only ours)" and not lacking.texts
    assert [axes.get_xscale() for axes in curves.draw([RECORDS], ["ours"]).axes] == ["linear", "linear"]
    far = [*RECORDS[:2], _record("decompressor", 30, 600, 0.1, 3.0)]
    (axes,) = curves.draw([far], ["ours"]).axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")


FAST = [
    _record("decompressor", 10, 30, 3.0, 6.0),
    _record("decompressor", 20, 36, 3.0, 3.5),
    _record("decompressor", 30, 90, 1.0, 1.0),
    _record("projector", 10, 96, 0.9, 1.0),
    _record("projector", 20, 102, 0.9, 2.0),
    _record("closed_loop", 20, 130, 0.9, 2.0),
]


def test_each_log_is_held_against_the_end_of_the_last() -> None:
    first, second = found = curves.races([FAST, RECORDS], ["ours", "theirs"])
    assert (first.stage, first.part, first.error, first.value) == (
        "decompressor",
        "held_out",
        "error_cm",
        3.5,
    )
    assert (first.minutes, first.other_minutes, first.first) == (0.6, 2.0, False)
    # The last log was as good as it ends with after one minute; at its first evaluation ours was.
    assert (second.minutes, second.other_minutes, second.first) == (0.1, 1.0, True)
    assert curves.told(found) == [
        "decompressor: ours reaches theirs's last held-out error of 3.5 cm after 0.6 minutes; "
        "theirs after 2: 3.3 times sooner",
        "projector: ours reaches theirs's last held-out regret of 1.6 after 0.1 minutes, "
        "its first evaluation; theirs after 1: at least 10.0 times sooner",
        "these 2 stages: ours after 0.7 minutes, theirs after 3: at least 4.3 times sooner",
    ]
    (axes, *_) = curves.draw([FAST, RECORDS], ["ours", "theirs"]).axes
    assert [text.get_text() for text in axes.texts] == ["", "3.3 times sooner"]  # the first is an arrow
    assert axes.texts[0].xy == (0.6, 3.5) and axes.texts[0].xyann == (2.0, 3.5)


def test_a_log_that_never_gets_there_and_one_that_is_later() -> None:
    lost, late = curves.races([RECORDS, FAST], ["slow", "fast"])
    assert lost.minutes is None and lost.sooner == ""
    assert lost.told() == (
        "decompressor: slow does not reach fast's last held-out error of 1 cm: "
        "in 2 minutes it comes to 3.5 cm"
    )
    assert late.minutes == 0.5 and late.told().endswith("fast after 0.1: at most 5.0 times later")
    assert curves.told([lost, late]) == [lost.told(), late.told()]
    assert curves.races([RECORDS], ["alone"]) == []


def test_without_held_out_clips_training_counts() -> None:
    bare = [{**r, "errors": {"training": r["errors"]["training"]}} for r in FAST]
    found = curves.races([bare, RECORDS], ["ours", "theirs"])
    assert [(race.part, race.value, race.minutes) for race in found] == [
        ("training", 2.0, 1.5),
        ("training", 1.25, 0.1),
    ]


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
