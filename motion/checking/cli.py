"""``python -m motion check``: say what is wrong with captures, show it, and write what is good of them."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .. import console, options
from ..errors import UserError

if TYPE_CHECKING:
    from ..clip import Clip
    from ..facts import Book
    from .finding import Finding

MINIMUM = 0.5  # seconds; a search through shorter spans finds nothing that leads anywhere


@click.command(epilog="Example: python -m motion check clips/cmu --trim -o trimmed --plot pictures")
@click.argument("files", nargs=-1, required=True, type=click.Path())
@options.FPS
@click.option("--trim", is_flag=True, help="Write what is good of each clip, with -o.")
@click.option("-o", "--output", type=click.Path(), metavar="FOLDER", help="Where --trim writes BVH files.")
@click.option(
    "--minimum",
    type=console.SECONDS,
    default=MINIMUM,
    show_default=True,
    metavar="SECONDS",
    help="Leave out good spans shorter than this.",
)
@click.option("--plot", type=click.Path(), metavar="FOLDER", help="Write a picture of each clip's findings.")
@options.SOURCE_UNIT
@options.source_axes
@options.ROLES
@console.exclude_option
@console.json_option
def check(
    files: tuple[str, ...],
    fps: float | None,
    trim: bool,
    output: str | None,
    minimum: float,
    plot: str | None,
    source_unit: float | None,
    source_up: str,
    source_forward: str | None,
    source_handedness: str,
    roles: str | None,
    exclude: tuple[str, ...],
    as_json: bool,
) -> None:
    """Find what is wrong with the captures in FILES (folders are searched).

    Bodies that jump, float or sink, joints that flip, limbs that stretch, frames that froze or repeat, rest
    poses amid the motion, swapped sides, wrong axes and frame rates, values that are no numbers. Some
    findings are to be left out, others are remarks. --trim writes the spans of each clip that remain, as
    NAME_0.bvh, NAME_1.bvh and so on, at the rate of --fps if given.

    Exit code: 0 if nothing was found, 1 if something was (with --trim: 0, if all could be read), 2 for wrong
    usage.
    """
    from .. import axes, bvh, facts, sources
    from ..check import check as findings_of
    from ..check import good_spans
    from ..resample import crop
    from ..targets import Targets

    if trim != (output is not None):
        raise click.UsageError("give --trim and -o FOLDER together")
    axis = {"up": source_up, "forward": source_forward, "handedness": source_handedness}
    told = facts.of_all(fps=fps, unit=source_unit, **axis, roles=roles)
    paths = sources.find(files, exclude=exclude)
    book = facts.book(paths, files, common=told)
    paths = [path for path in paths if path not in book.excluded]
    for note in book.notes:
        click.echo(f"note: {note}", err=True)
    targets = Targets(output, files, paths, "_0.bvh") if output is not None else None
    pictures = Targets(plot, files, paths, ".png") if plot is not None else None
    reports, written = [], 0
    for path, clip in _read(paths, book):
        if isinstance(clip, UserError):
            reports.append(Report(path, 0, 0.0, [], [], unreadable=str(clip)))
            continue
        found = findings_of(clip)
        least = max(2, round(minimum * clip.fps))
        good = good_spans(len(clip), found, minimum=least)
        reports.append(Report(path, len(clip), clip.fps, found, good))
        if targets is not None:
            up, forward, handedness = axes.system(*book.of(path).axes)
            theirs = axes.convert(clip, up=up, forward=forward, handedness=handedness)
            for number, (start, stop) in enumerate(good):
                bvh.write(targets.path(path, f"_{number}.bvh"), crop(theirs, start, stop))
                written += 1
        if pictures is not None and found:
            from .picture import save

            save(pictures.path(path, ".png"), clip, found)
    _print(reports, as_json)
    click.echo(_summary(reports), err=True)
    if targets is not None:
        click.echo(f"wrote {written} file{'s' * (written != 1)} to {output}", err=True)
    unread = any(report.unreadable for report in reports)
    if unread or (not trim and any(report.findings for report in reports)):
        click.get_current_context().exit(1)


@dataclasses.dataclass(frozen=True)
class Report:
    """What was found in a file; its good spans, frames [start, stop)."""

    path: Path
    frames: int
    fps: float
    findings: Sequence[Finding]
    good: Sequence[tuple[int, int]]
    unreadable: str = ""


def _read(paths: Sequence[Path], book: Book) -> Iterator[tuple[Path, Clip | UserError]]:
    """The clips at paths, as the book knows them, or why they cannot be read."""
    from .. import facts

    for path in console.progress(paths, label="checking", unit="clips"):
        try:
            clip = facts.read(path, book.of(path))
        except UserError as error:
            yield path, error
        else:
            yield path, clip


def _print(reports: Sequence[Report], as_json: bool) -> None:
    if as_json:
        console.print_json(
            [
                {
                    "file": str(report.path),
                    "frames": report.frames,
                    "fps": round(report.fps, 7),
                    "unreadable": report.unreadable or None,
                    "findings": [dataclasses.asdict(finding) for finding in report.findings],
                    "good": [list(span) for span in report.good],
                }
                for report in reports
            ]
        )
        return
    rows = []
    for report in reports:
        if report.unreadable:
            rows.append(_row(report, "unreadable", None, True, report.unreadable))
        rows += [_row(report, f.kind, (f.start, f.stop), f.fatal, f.what) for f in report.findings]
    if rows:
        console.print_table(rows)


def _row(report: Report, kind: str, span: tuple[int, int] | None, fatal: bool, what: str) -> dict[str, Any]:
    frames = seconds = None
    if span is not None:
        start, stop = span
        frames = f"{start}-{stop - 1}" if stop > start + 1 else f"{start}"
        if stop - start == report.frames:
            frames = "all"
        seconds = f"{start / report.fps:.2f}-{stop / report.fps:.2f}"
    return {
        "file": str(report.path),
        "kind": kind,
        "frames": frames,
        "seconds": seconds,
        "leave_out": "yes" if fatal else "no",
        "what": what,
    }


def _summary(reports: Sequence[Report]) -> str:
    """The last line: how many clips, and how many with what."""
    kinds = Counter(kind for report in reports for kind in {f.kind for f in report.findings})
    unread = sum(bool(report.unreadable) for report in reports)
    clean = sum(not report.findings and not report.unreadable for report in reports)
    parts = [f"{clean} of {len(reports)} clips without findings"]
    if kinds:
        parts.append(", ".join(f"{kind} in {count}" for kind, count in kinds.most_common()))
        lost = sum(report.frames - sum(stop - start for start, stop in report.good) for report in reports)
        total = sum(report.frames for report in reports)
        parts.append(f"{lost:,} of {total:,} frames to leave out ({lost / max(total, 1):.1%})")
    if unread:
        parts.append(f"{unread} cannot be read")
    return "; ".join(parts)
