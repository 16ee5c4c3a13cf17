"""What every command of the project shares: errors on one line, progress, tables, JSON."""

from __future__ import annotations

import functools
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

import click

from .errors import UserError

T = TypeVar("T")


class Group(click.Group):
    """A click group whose commands report a `UserError` as ``error: ...`` and exit with 2."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        kwargs["standalone_mode"] = False
        try:
            code = super().main(*args, **kwargs)
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
        except (click.Abort, KeyboardInterrupt):
            message, code = "interrupted; nothing half-written was left", 130
        except MemoryError:
            message, code = "out of memory; give it fewer or shorter inputs", 2
        except BrokenPipeError:
            sys.stderr.close()
            sys.exit(1)
        print("error: " + " ".join(message.split()), file=sys.stderr)
        sys.exit(code)


def group(name: str, summary: str) -> Callable[[Callable], Group]:
    """Decorator: a command group with ``-h`` and ``--help``."""
    settings = {"help_option_names": ["-h", "--help"], "max_content_width": 100}
    return lambda f: click.group(name, cls=Group, help=summary, context_settings=settings)(f)


json_option = click.option("--json", "as_json", is_flag=True, help="Print machine-readable JSON.")
exclude_option = click.option(
    "--exclude",
    multiple=True,
    metavar="PATTERN",
    help="Leave clips of this name, or path in its source, out: 'jump*', '127/*'.  [repeatable]",
)


def print_json(value: Any) -> None:
    """One JSON document on standard output (numbers rounded by the caller, never NaN: null instead)."""
    print(json.dumps(value, indent=1, default=_plain, allow_nan=False))


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    if hasattr(value, "__fspath__"):
        return str(value)
    raise TypeError(f"{type(value).__name__} does not go into JSON")


def print_table(rows: Sequence[Mapping[str, Any]], title: str | None = None) -> None:
    """A table on the terminal: columns are the first row's keys; numbers stand right, None is a dash."""
    from rich.console import Console
    from rich.table import Table

    width = None if sys.stdout.isatty() else 10_000  # in a file or a pipe a row is a line
    table = Table(title=title, title_justify="left", show_edge=False, pad_edge=False)
    if rows:
        for key, value in rows[0].items():
            table.add_column(key, justify="left" if isinstance(value, str) else "right", overflow="fold")
        for row in rows:
            table.add_row(*(format_cell(row.get(key)) for key in rows[0]))
    Console(width=width, highlight=False).print(table)


def format_cell(value: Any) -> str:
    """Text of a table cell: floats with four significant digits, None as a dash."""
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:,.0f}"
    return str(value)


def progress(items: Iterable[T], *, label: str, total: int | None = None, unit: str = "it") -> Iterator[T]:
    """Iterate with a progress bar (rate, remaining time) on a terminal, plain lines elsewhere.

    Both go to standard error. Elsewhere means a line every ten seconds and nothing for shorter work.
    """
    if total is None and hasattr(items, "__len__"):
        total = len(items)  # type: ignore[arg-type]
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(label, total=total, rate="")
            start = time.monotonic()
            for done, item in enumerate(items):
                yield item
                rate = (done + 1) / max(time.monotonic() - start, 1e-9)
                bar.update(task, advance=1, rate=f"{rate:.1f} {unit}/s")
        return
    start = last = time.monotonic()
    for done, item in enumerate(items):
        yield item
        now = time.monotonic()
        if now - last >= 10:
            last, rate = now, (done + 1) / (now - start)
            left = f", {(total - done - 1) / rate:.0f} s left" if total else ""
            share = f"{done + 1}/{total}" if total else str(done + 1)
            print(f"{label}: {share} {unit}, {rate:.1f} {unit}/s{left}", file=sys.stderr, flush=True)


def needs(extra: str, module: str) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Decorator: a missing optional module becomes a UserError with the install hint."""

    def wrap(function: Callable[..., T]) -> Callable[..., T]:
        @functools.wraps(function)
        def inner(*args: Any, **kwargs: Any) -> T:
            try:
                __import__(module)
            except ImportError as error:
                raise UserError(
                    f"{module} is not installed", remedy=f"pip install 'motion-matching[{extra}]'"
                ) from error
            return function(*args, **kwargs)

        return inner

    return wrap
