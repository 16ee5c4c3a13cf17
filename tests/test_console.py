"""The face of every command: one-line errors, exit codes, JSON, tables, progress."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner, Result

from motion import console
from motion.errors import UserError


@console.group("tool", "A tool for the tests.")
def tool() -> None:
    pass


@tool.command()
@click.argument("kind")
def fail(kind: str) -> None:
    """Fail in one of the ways there are."""
    failures = {
        "user": UserError("bad\n  number 'x'", path="walk.bvh", line=7, remedy="write\na number"),
        "click": click.ClickException("no such thing"),
        "interrupt": KeyboardInterrupt(),
        "stopped": KeyboardInterrupt("stopped at iteration 7; go on with --resume"),
        "memory": MemoryError(),
        "file": PermissionError(13, "Permission denied", "a/secret"),
        "pipe": OSError(28, "No space left on device"),
        "bug": ZeroDivisionError("a fault of ours"),
    }
    raise failures[kind]


@tool.command()
@console.json_option
def show(as_json: bool) -> None:
    """Print a little."""
    if as_json:
        console.print_json({"frames": np.int32(3), "rates": np.array([0.5, 1.0]), "path": Path("a/b")})
    else:
        click.echo("three frames")


@tool.command()
def many() -> None:
    """Do much, and say so in a sentence that does not fit into a line of a terminal's 80 letters.

    More of it.
    """


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def run(*arguments: str) -> Result:
    return CliRunner().invoke(tool, list(arguments))


def test_a_user_error_is_one_line_and_exit_code_2() -> None:
    result = run("fail", "user")
    assert result.stderr == "error: walk.bvh:7: bad number 'x'; write a number\n"
    assert result.stdout == ""
    assert result.exit_code == 2


@pytest.mark.parametrize(
    ("kind", "code", "word"),
    [
        ("click", 2, "no such thing"),
        ("interrupt", 130, "interrupted; nothing"),
        ("stopped", 130, "stopped at iteration 7"),
        ("memory", 2, "out of memory"),
    ],
)
def test_other_faults_are_one_line_too(kind: str, code: int, word: str) -> None:
    result = run("fail", kind)
    message = result.stderr.lstrip("\n")  # after Ctrl-C the terminal's cursor stands behind a ^C
    assert message.startswith("error: ")
    assert word in message
    assert message.count("\n") == 1
    assert result.exit_code == code


def test_a_bug_is_not_disguised_as_a_fault_of_the_user() -> None:
    assert isinstance(run("fail", "bug").exception, ZeroDivisionError)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [(["fail"], "KIND"), (["fall"], "fall"), (["show", "--jsn"], "--jsn"), (["show", "extra"], "extra")],
)
def test_wrong_usage_is_one_line_that_points_at_help(arguments: list[str], word: str) -> None:
    result = run(*arguments)
    assert result.stderr.startswith("error: ")
    assert word in result.stderr
    assert result.stderr.endswith("--help)\n")
    assert result.stderr.count("\n") == 1
    assert result.exit_code == 2


def test_what_commands_do_is_listed_whole() -> None:
    listed = " ".join(run("--help").stdout.split())
    assert (
        "many Do much, and say so in a sentence that does not fit into a line of a terminal's 80 letters."
        in listed
    )
    assert "..." not in listed.partition("Commands:")[2]


def test_without_a_command_the_help_appears() -> None:
    result = run()
    assert result.exit_code == 2
    assert result.stderr.startswith("Usage: ")
    assert {"fail", "show"} <= set(result.stderr.split())


@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_both_help_flags_work_everywhere(flag: str) -> None:
    assert run(flag).exit_code == 0
    assert "Print a little." in run("show", flag).stdout


def test_success_exits_with_0() -> None:
    result = run("show")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "three frames\n", "")


def test_json_takes_arrays_numbers_and_paths() -> None:
    value = json.loads(run("show", "--json").stdout)
    assert value == {"frames": 3, "rates": [0.5, 1.0], "path": str(Path("a/b"))}


@pytest.mark.parametrize("value", [float("nan"), float("inf"), np.float32("nan"), np.array([0.0, np.nan])])
def test_json_refuses_what_is_no_json_number(value: object) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        console.print_json({"value": value})


def test_json_refuses_unknown_types() -> None:
    with pytest.raises(TypeError, match="object does not go into JSON"):
        console.print_json(object())


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "-"),
        (0.123456, "0.1235"),
        (1234567.8, "1,234,568"),
        (-2e9, "-2,000,000,000"),
        (42, "42"),
        (9999, "9999"),
        (-10_000, "-10,000"),
        (True, "True"),
        ("a", "a"),
    ],
)
def test_cells(value: object, text: str) -> None:
    assert console.format_cell(value) == text


def test_a_table_has_the_first_rows_columns_and_every_row(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [{"clip": "walk", "fps": 60.0}, {"clip": "a rather long name of a clip", "fps": None}]
    console.print_table(rows, title="Clips")
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].strip() == "Clips"
    assert lines[1].replace("┃", " ").split() == ["clip", "fps"]
    body = [line.replace("│", " ").split() for line in lines[-2:]]
    assert body == [["walk", "60"], ["a", "rather", "long", "name", "of", "a", "clip", "-"]]
    assert len({len(line) for line in lines[-2:]}) == 1


def test_off_a_terminal_a_row_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    row = {"clip": "a/long/path/" * 20} | {f"column_{i}": i for i in range(20)}
    console.print_table([row])
    assert row["clip"] in capsys.readouterr().out.splitlines()[-1]


def printed(monkeypatch: pytest.MonkeyPatch, *table: Any) -> list[str]:
    """What `print_table` shows on a terminal of 80 columns."""
    terminal = Terminal()
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setattr(sys, "stdout", terminal)
    console.print_table(*table)
    return terminal.getvalue().splitlines()


def test_a_narrow_terminal_splits_the_columns_and_wraps_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = {f"mean_speed_{i}_mps": 1234.0 + i for i in range(9)}
    lines = printed(monkeypatch, [{"clip": "walk"} | numbers, {"clip": "run"} | numbers], "Clips")
    assert max(map(len, lines)) <= 80
    words = " ".join(lines).replace("┃", " ").replace("│", " ").split()
    # 16 letters a header: three fit beside the first column, so three tables, each with it again.
    assert [words.count(word) for word in ("Clips", "clip", "walk", "run")] == [1, 3, 3, 3]
    assert all(words.count(name) == 1 for name in numbers)
    assert all(words.count(console.format_cell(value)) == 2 for value in numbers.values())


def test_a_narrow_terminal_folds_text_only(monkeypatch: pytest.MonkeyPatch) -> None:
    row = {"name": "circle", "metres": 12345.678, "description": "round and " * 20 + "[end]"}
    lines = [line.split("│") for line in printed(monkeypatch, [row])[2:]]
    assert len(lines) > 3 and max(len("│".join(line)) for line in lines) <= 80
    assert [cell.strip() for cell in lines[0][:2]] == ["circle", "12,346"]
    text = " ".join(line[2].strip() for line in lines)
    assert text == "round and " * 20 + "[end]"


def test_an_empty_table_is_no_fault(capsys: pytest.CaptureFixture[str]) -> None:
    console.print_table([], title="Nothing")
    assert "error" not in capsys.readouterr().err


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """A clock that the test sets; `console` reads it as time.monotonic."""
    now = [0.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    yield now


def test_progress_off_a_terminal_is_a_line_every_ten_seconds(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in console.progress(range(10), label="reading", unit="files"):
        clock[0] += 4.0
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "reading: 3/10 files, 4.0 s each, 28 s left",
        "reading: 6/10 files, 4.0 s each, 16 s left",
        "reading: 9/10 files, 4.0 s each, 4 s left",
    ]


def test_a_first_item_that_takes_long_is_no_measure_of_the_others(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    for i in console.progress(range(100), label="reading", unit="files"):
        clock[0] += 0.25 if i else 60.0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "reading: 1/100 files"
    assert lines[1] == "reading: 41/100 files, 4.0 files/s, 15 s left"


def test_short_work_makes_no_lines(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    assert list(console.progress(iter("abc"), label="reading")) == ["a", "b", "c"]
    assert capsys.readouterr().err == ""


def test_progress_without_a_total_counts_up(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    for _ in console.progress(iter(range(2)), label="training"):
        clock[0] += 10.0
    assert capsys.readouterr().err.splitlines()[-1] == "training: 2 it, 10.0 s each"


def test_progress_goes_on_where_it_stopped_and_tells_more(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in console.progress(range(6, 10), label="training", first=6, note=lambda: "loss 0.5"):
        clock[0] += 1000.0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "training: 7/10 it; loss 0.5"
    assert lines[1] == "training: 8/10 it, 1,000 s each, 33 min left; loss 0.5"
    assert lines[-1] == "training: 10/10 it, 1,000 s each, 0 s left; loss 0.5"


def test_progress_on_a_terminal_tells_more(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal)
    assert list(console.progress(range(6, 9), label="x", first=6, note=lambda: "loss")) == [6, 7, 8]
    assert "9/9" in terminal.getvalue() and "loss" in terminal.getvalue()


def test_progress_on_a_terminal_keeps_to_standard_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal)
    assert list(console.progress([1, 2, 3], label="building")) == [1, 2, 3]
    assert "building" in terminal.getvalue()
    assert capsys.readouterr().out == ""


def test_a_title_is_a_line_however_narrow_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    console.print_table([{"a": 1}], title="much longer than the table is wide")
    assert capsys.readouterr().out.splitlines()[0] == "much longer than the table is wide"


def test_a_missing_extra_names_the_install_command() -> None:
    @console.needs("viewer", "no_such_module_at_all")
    def window() -> None:
        raise AssertionError("never called")

    with pytest.raises(UserError, match=r"pip install 'motion-matching\[viewer\]'"):
        window()


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (
            "import no_such_module_at_all",
            r"half cannot be imported: No module named 'no_such_module_at_all'; pip install",
        ),
        ("raise ImportError('libGL.so.1 is missing')", "half cannot be imported: libGL.so.1 is"),
    ],
)
def test_an_extra_that_is_not_loaded_says_why(
    source: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "half.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UserError, match=said):
        console.needs("viewer", "half")(lambda: None)()


def test_an_interrupt_waits_until_an_extra_is_loaded_as_a_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "whole.py").write_text("import signal\nsignal.raise_signal(signal.SIGINT)\nloaded = True\n")
    monkeypatch.syspath_prepend(tmp_path)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # what runs behind others ignores it
    try:
        with pytest.raises(KeyboardInterrupt):
            console.needs("viewer", "whole")(lambda: None)()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert sys.modules["whole"].loaded


def test_a_present_extra_is_used() -> None:
    @console.needs("dev", "pytest")
    def answer(number: int) -> int:
        """The docstring stays."""
        return number + 1

    assert answer(1) == 2
    assert answer.__doc__ == "The docstring stays."


def test_a_file_error_that_nobody_foresaw_is_one_line(capfd: pytest.CaptureFixture[str]) -> None:
    result = run("fail", "file")
    assert result.exit_code == 2 and result.stderr == "error: a/secret: Permission denied\n"


COMMAND = """
import click, sys
from motion import console
@console.group("tool", "A tool.")
def tool(): pass
@tool.command()
def many():
    console.print_table([{"a": 1}])
    for _ in console.progress(range(3), label="x"): pass
@tool.command()
def bad(): raise console.UserError("no")
tool([sys.argv[1]])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs a shell and /dev/full")
@pytest.mark.parametrize(
    ("command", "streams", "code", "word"),
    [
        ("many", ">/dev/full", 2, "error: standard output: No space left on device"),
        ("many", ">&-", 0, ""),
        ("many", "2>&-", 0, "1"),
        ("many", ">&- 2>&-", 0, ""),
        ("bad", "2>&-", 2, ""),
        ("bad", "2>/dev/full", 2, ""),
    ],
)
def test_streams_that_are_full_or_closed(command: str, streams: str, code: int, word: str) -> None:
    line = f'exec "$0" -c "$1" {command} {streams}'
    root = Path(__file__).resolve().parents[1]
    done = subprocess.run(
        ["sh", "-c", line, sys.executable, COMMAND], cwd=root, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == code
    assert "Traceback" not in done.stderr and (word in done.stdout + done.stderr)
    assert word or not done.stdout + done.stderr


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "-1", "0", "1e6", "x", ""])
def test_numbers_out_of_range_are_refused(value: str) -> None:
    with pytest.raises(click.BadParameter):
        console.SECONDS.convert(value, None, None)


def test_numbers_in_range_are_taken() -> None:
    assert console.SECONDS.convert("1e5", None, None) == 1e5
    assert console.RATE.convert("1", None, None) == 1
    assert console.Number(0, 5).convert(0, None, None) == 0


def test_compiled_code_goes_to_a_folder_of_the_run_where_no_other_can_be_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")  # so that it is put back
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    console._cache_compiled_code()
    assert "NUMBA_CACHE_DIR" not in os.environ
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    monkeypatch.setattr(console.atexit, "register", lambda function, *args, **kwargs: made.extend(args))
    made: list[str] = []
    console._cache_compiled_code()
    assert os.environ["NUMBA_CACHE_DIR"] == made[0] and Path(made[0]).is_dir()
    os.rmdir(made[0])
