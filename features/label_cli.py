"""``python -m features label``: label motion files, as text that people can correct, and draw the labels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from motion import console, options
from motion.errors import UserError

if TYPE_CHECKING:
    from motion.clip import Clip
    from motion.facts import Book

    from .labels import Labels

SUFFIX = ".labels.csv"


@click.command(epilog="Example: python -m features label clips/cmu -o labels --plot pictures")
@click.argument("clips", nargs=-1, required=True, type=click.Path())
@click.option(
    "-o", "--output", required=True, type=click.Path(), metavar="FOLDER", help="Where to write the labels."
)
@click.option("--plot", type=click.Path(), metavar="FOLDER", help="Draw each clip's labels over time.")
@click.option("--no-phase", is_flag=True, help="Write no phase: not all motion has one.")
@click.option(
    "--corrected",
    type=click.Path(),
    metavar="FOLDER",
    help="Read contacts and gaits from the labels in FOLDER, corrected by hand; find the phase anew.",
)
@click.option(
    "--skip-bad",
    is_flag=True,
    help="Leave out clips that cannot be labelled, and name them, instead of stopping.",
)
@options.FPS
@options.SOURCE_UNIT
@options.source_axes
@options.ROLES
@console.exclude_option
@console.json_option
def label(
    clips: tuple[str, ...],
    output: str,
    plot: str | None,
    no_phase: bool,
    corrected: str | None,
    skip_bad: bool,
    fps: float | None,
    source_unit: float | None,
    source_up: str,
    source_forward: str | None,
    source_handedness: str,
    roles: str | None,
    exclude: tuple[str, ...],
    as_json: bool,
) -> None:
    """Label the motion files CLIPS (folders are searched): foot contacts, phase and gait of every frame.

    NAME.labels.csv has a line a frame, to be corrected in an editor or a spreadsheet. The phase is 0 where
    the right foot comes down and pi where the left one does. Gaits are stand, walk, jog, crouch, jump, other,
    or blends such as "walk 0.7 jog 0.3". Steps are footfalls; shares are of the clip's time.
    """
    from motion import facts, sources
    from motion.targets import Targets

    from . import label_files

    axis = {"up": source_up, "forward": source_forward, "handedness": source_handedness}
    told = facts.of_all(fps=fps, unit=source_unit, **axis, roles=roles)
    paths = sources.find(clips, exclude=exclude)
    book = facts.book(paths, clips, common=told)
    paths = [path for path in paths if path not in book.excluded]
    for note in book.notes:
        click.echo(f"note: {note}", err=True)
    targets = Targets(output, clips, paths, SUFFIX)
    pictures = Targets(plot, clips, paths, ".png") if plot is not None else None
    given = Targets(corrected, clips, paths, SUFFIX) if corrected is not None else None
    rows = []
    for path, clip, labels in _labelled(paths, book, given, phase=not no_phase, skip_bad=skip_bad):
        target = targets.path(path, SUFFIX)
        label_files.write(target, labels)
        if pictures is not None:
            from .label_picture import save

            save(pictures.path(path, ".png"), clip, labels)
        rows.append({"file": str(path), **_summary(clip, labels), "labels": str(target)})
    if not rows:
        raise UserError(f"none of {len(paths)} clips can be labelled", remedy="see the notes above")
    if as_json:
        console.print_json(rows)
    else:
        console.print_table([{k: v for k, v in row.items() if k != "labels"} for row in rows])
    click.echo(f"wrote labels of {len(rows)} clip{'s' * (len(rows) != 1)} to {output}", err=True)


def _labelled(
    paths: Sequence[Path], book: Book, given: Any, *, phase: bool, skip_bad: bool
) -> Iterator[tuple[Path, Clip, Labels]]:
    """Clips and their labels; what cannot be labelled is a UserError about its file, or left out and told."""
    from motion import facts

    from . import label_files
    from .labels import label_clip

    for path in console.progress(paths, label="labelling", unit="clips"):
        try:
            with options.about(path):
                clip = facts.read(path, book.of(path))
                if given is None:
                    labels = label_clip(clip, phase=phase)
                else:
                    labels = label_files.read(given.path(path, SUFFIX), frames=len(clip))
                    labels = labels.rephased(clip.fps) if phase else labels
        except UserError as error:
            if not skip_bad:
                raise
            click.echo(f"note: left out: {error}", err=True)
            continue
        yield path, clip, labels


def _summary(clip: Clip, labels: Labels) -> dict[str, Any]:
    """What a clip's labels say in a few numbers."""
    from . import contacts as touching
    from .labels import GAITS

    feet = touching.feet(labels.names, labels.contacts, clip.fps)
    steps = int((feet[1:] & ~feet[:-1]).sum())
    shares = labels.gait.mean(axis=0) if len(labels) else [0.0] * len(GAITS)
    return {
        "frames": len(labels),
        "fps": round(clip.fps, 7),
        "seconds": round(clip.seconds, 4),
        "contacts": " ".join(labels.names),
        "phase": labels.phase is not None,
        "steps": steps,
        **{name: round(float(share), 4) for name, share in zip(GAITS, shares, strict=True)},
    }
