"""What every command of the project shares: errors on one line, progress, tables, JSON."""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TextIO, TypeVar

import click

from .errors import Note, UserError

T = TypeVar("T")


class Told(click.Command):
    """A click command that reports a `UserError` as ``error: ...`` and exits with 2."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        kwargs["standalone_mode"] = False
        try:
            _cache_compiled_code()
            _show_notes()
            code = super().main(*args, **kwargs)
            if sys.stdout is not None:
                sys.stdout.flush()  # at exit it would be too late to report a full disk
            sys.exit(code if isinstance(code, int) else 0)
        except UserError as error:
            message, code = str(error), 2
        except click.exceptions.NoArgsIsHelpError as error:
            error.show()
            sys.exit(2)
        except click.UsageError as error:
            where = error.ctx.command_path if error.ctx else ""
            message, code = f"{error.format_message().rstrip('.')} (see {where} --help)", 2
        except click.ClickException as error:
            message, code = error.format_message(), 2
        except (click.Abort, KeyboardInterrupt) as error:
            # click puts an Abort in place of what was raised, and names that as its cause.
            told = str(error.__cause__ or error)
            message, code = told or "interrupted; nothing half-written was left", 130
        except MemoryError:
            message, code = "out of memory; give it fewer or shorter inputs", 2
        except BrokenPipeError:
            _silence(sys.stdout, sys.stderr)
            sys.exit(1)
        except OSError as error:
            # Without a file's name it is standard output, whose rest cannot be written either.
            message, code = f"{error.filename or 'standard output'}: {error.strerror or error}", 2
            if error.filename is None:
                _silence(sys.stdout)
        with contextlib.suppress(OSError, ValueError):
            if sys.stderr is not None:  # print would take standard output instead
                print("error: " + " ".join(message.split()), file=sys.stderr)
        sys.exit(code)


class Group(Told, click.Group):
    """A group of such commands."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """What each command does, folded where it is longer than a line; click would cut it off there."""
        told = [
            (name, self.commands[name].get_short_help_str(limit=1000)) for name in self.list_commands(ctx)
        ]
        with formatter.section("Commands"):
            formatter.write_dl(told)


def _show_notes() -> None:
    """Print each `Note` once, as a line of its own, not as a warning with its place in the source."""
    plain, shown = getattr(warnings.showwarning, "plain", warnings.showwarning), set[str]()

    def show(message: Any, category: type[Warning], *place: Any, **more: Any) -> None:
        if not issubclass(category, Note):
            plain(message, category, *place, **more)
        elif sys.stderr is not None and str(message) not in shown:
            shown.add(str(message))
            print(f"note: {message}", file=sys.stderr)

    show.plain = plain  # type: ignore[attr-defined]
    warnings.showwarning = show


def _cache_compiled_code() -> None:
    """Give numba a folder of its own for this run where it may write neither beside the source nor at home.

    It would refuse to import the kernels otherwise.
    """
    folders = (os.path.dirname(__file__), os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    if "NUMBA_CACHE_DIR" in os.environ or any(map(_writable, folders)):
        return
    os.environ["NUMBA_CACHE_DIR"] = folder = tempfile.mkdtemp(prefix="numba-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)


def _writable(folder: str) -> bool:
    while not os.path.lexists(folder) and os.path.dirname(folder) != folder:
        folder = os.path.dirname(folder)
    return os.access(folder, os.W_OK | os.X_OK)


def _silence(*streams: TextIO | None) -> None:
    """Point streams that cannot be written to nowhere, or Python would complain about them at exit."""
    with contextlib.suppress(OSError, ValueError), open(os.devnull, "w") as nowhere:
        for stream in filter(None, streams):
            os.dup2(nowhere.fileno(), stream.fileno())


class Number(click.ParamType):
    """A finite number from least to most; above least where it is 0 and above_0 is set."""

    name = "number"

    def __init__(self, least: float, most: float, *, above_0: bool = False) -> None:
        self.least, self.most, self.above_0 = least, most, above_0

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            number = float(value)
        except (TypeError, ValueError):
            self.fail(f"{value!r} is not a number", param, ctx)
        if not self.least <= number <= self.most or (self.above_0 and number <= 0):
            start = (
                f"above 0, at most {self.most:,g}" if self.above_0 else f"{self.least:g} to {self.most:,g}"
            )
            self.fail(f"{value} is out of range; give a number {start}", param, ctx)
        return number


# Limits far beyond any use, but below what fills a memory or overflows.
RATE = Number(1, 1000)
SECONDS = Number(0, 1e5, above_0=True)
SPEED = Number(0, 100, above_0=True)
SIZE = Number(1e-3, 1e3)
COUNT = click.IntRange(1, 1_000_000)


_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


def group(name: str, summary: str) -> Callable[[Callable], Group]:
    """Decorator: a command group with ``-h`` and ``--help``."""
    return lambda f: click.group(name, cls=Group, help=summary, context_settings=_SETTINGS)(f)


def command(name: str, *, epilog: str) -> Callable[[Callable], Told]:
    """Decorator: a program of one command, with ``-h`` and ``--help`` that ends with the epilog."""
    return lambda f: click.command(name, cls=Told, epilog=epilog, context_settings=_SETTINGS)(f)


json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON, for other programs.")
exclude_option = click.option(
    "--exclude",
    multiple=True,
    metavar="PATTERN",
    help="Leave out clips by name or path: 'jump*', '127/*'.  [repeatable]",
)


def is_terminal(stream: TextIO | None) -> bool:
    """Whether a stream, which is None where it was closed, is a terminal."""
    return stream is not None and stream.isatty()


def print_json(value: Any) -> None:
    """One JSON document on standard output (numbers rounded by the caller, never NaN: null instead)."""
    print(json.dumps(value, indent=1, default=_plain, allow_nan=False))


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    if hasattr(value, "__fspath__"):
        return str(value)
    raise TypeError(f"{type(value).__name__} does not go into JSON")


READABLE = 24  # letters a line that text in a cell may be folded to


def print_table(rows: Sequence[Mapping[str, Any]], title: str | None = None) -> None:
    """A table: columns are the first row's keys; numbers stand right, None is a dash.

    In a file or a pipe a row is a line. On a terminal too narrow for it, text is folded, numbers and headers
    are not: columns that do not fit follow in further tables, each with the first column again.
    """
    from rich.console import Console

    console = Console(width=None if is_terminal(sys.stdout) else 10_000, highlight=False, markup=False)
    cells = {key: [format_cell(row.get(key)) for row in rows] for key in (rows[0] if rows else ())}
    texts = {key for key in cells if any(isinstance(row.get(key), str) for row in rows)}
    least = {
        key: max(len(key), min(max(map(len, column)), READABLE if key in texts else console.width))
        for key, column in cells.items()
    }
    for i, keys in enumerate(_fitting(least, console.width)):
        if i:
            console.print()
        _print_columns(console, keys, cells, texts, None if i else title)


def _fitting(widths: Mapping[str, int], available: int) -> list[list[str]]:
    """Columns in groups that fit, each begun by the first column."""
    keys = list(widths)
    groups = [keys[:1]]
    for key in keys[1:]:
        group = [*groups[-1], key]
        if sum(widths[k] + 3 for k in group) - 3 <= available or len(groups[-1]) == 1:
            groups[-1] = group
        else:
            groups.append([keys[0], key])
    return groups


def _print_columns(
    console: Any, keys: Sequence[str], cells: Mapping[str, list[str]], texts: set[str], title: str | None
) -> None:
    from rich.table import Table

    if title:
        console.print(title, style="italic", soft_wrap=True)  # a table would fold it to its own width
    table = Table(show_edge=False, pad_edge=False)
    for key in keys:
        text = key in texts
        table.add_column(key, justify="left" if text else "right", overflow="fold", no_wrap=not text)
    for row in zip(*(cells[key] for key in keys), strict=True):
        table.add_row(*row)
    console.print(table)


def format_cell(value: Any) -> str:
    """Text of a table cell: floats with four significant digits, thousands apart from 10,000 on, None as a
    dash."""
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:,.0f}"
    if isinstance(value, int) and abs(value) >= 1e4:
        return f"{value:,}"
    return str(value)


def silent(items: Iterable[T], **_: Any) -> Iterator[T]:
    """What `progress` is where nobody looks."""
    return iter(items)


def progress(
    items: Iterable[T],
    *,
    label: str,
    total: int | None = None,
    unit: str = "it",
    first: int = 0,
    note: Callable[[], str] | None = None,
) -> Iterator[T]:
    """Iterate with a progress bar (rate, remaining time) on a terminal, plain lines elsewhere.

    Both go to standard error. Elsewhere means a line every ten seconds and nothing for shorter work. first
    items of the total were done before; note tells more whenever something is shown.
    """
    if total is None and hasattr(items, "__len__"):
        total = first + len(items)  # type: ignore[arg-type]
    if is_terminal(sys.stderr):
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = [
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
        ]
        columns += [TextColumn("{task.fields[note]}")] * (note is not None)
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(label, total=total, completed=first, rate="", note="")
            start = time.monotonic()
            for done, item in enumerate(items, 1):
                yield item
                pace = _pace((time.monotonic() - start) / done, unit)
                told = note() if note else ""
                bar.update(task, advance=1, rate=pace, note=told)
        return
    start = last = time.monotonic()
    for done, item in enumerate(items, 1):
        yield item
        now = time.monotonic()
        if done == 1:
            start = now  # the first one may have compiled code, and says nothing about the others
        if now - last >= 10:
            last, left = now, ""
            if done > 1:
                each = (now - start) / (done - 1)
                left = f", {_pace(each, unit)}"
                left += f", {_duration((total - first - done) * each)} left" if total else ""
            share = f"{first + done}/{total}" if total else str(first + done)
            told = f"; {note()}" if note else ""
            print(f"{label}: {share} {unit}{left}{told}", file=sys.stderr, flush=True)


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 600 else f"{seconds / 60:.0f} min"


def _pace(each: float, unit: str) -> str:
    """How fast work goes of which one takes so many seconds."""
    return f"{1 / each:.1f} {unit}/s" if 0 < each <= 1 else f"{each:,.{int(each < 100)}f} s each"


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """An interrupt from the keyboard waits until this is done: compiled modules that are loaded by half make
    other errors of it, or end the program their own way."""
    came: list[int] = []
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if came:
        raise KeyboardInterrupt


def needs(extra: str, module: str) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Decorator: an optional module that is missing or broken becomes a UserError with the install hint."""

    def wrap(function: Callable[..., T]) -> Callable[..., T]:
        @functools.wraps(function)
        def inner(*args: Any, **kwargs: Any) -> T:
            try:
                with _uninterrupted():
                    __import__(module)
            except ImportError as error:
                absent = isinstance(error, ModuleNotFoundError) and error.name == module
                what = "is not installed" if absent else f"cannot be imported: {error}"
                remedy = f"pip install 'motion-matching[{extra}]'"
                raise UserError(f"{module} {what}", remedy=remedy) from error
            return function(*args, **kwargs)

        return inner

    return wrap
