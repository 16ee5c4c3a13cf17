"""``python -m features terrain`` and ``heightmap``: grounds fitted to motion files, and made ones."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from motion import console, files, options

from . import terrain_made
from .terrain import SPACING, UNIT

if TYPE_CHECKING:
    import numpy as np

    from motion.clip import Clip

    from .labels import Labels
    from .patches import Patches
    from .terrain_fit import Grounds

MADE = (1, 2, 3)  # seeds of the terrains that stand in where none is given

_spacing = click.option(
    "--spacing",
    type=console.SIZE,
    default=SPACING,
    show_default="0.0394",
    metavar="M",
    help="Metres between neighbouring numbers.",
)
_unit = click.option(
    "--unit",
    type=console.SIZE,
    default=UNIT,
    show_default=True,
    metavar="M",
    help="Metres that 1 in the file stands for.",
)


@click.command(epilog="Example: python -m features heightmap --kind steps --seed 4 -o stairs.txt")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Text file to write.",
)
@click.option(
    "--kind",
    type=click.Choice(terrain_made.KINDS),
    default="mixed",
    show_default=True,
    help="Kind of ground.",
)
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Another seed, another ground."
)
@click.option(
    "--size",
    type=(console.SIZE, console.SIZE),
    default=(20.0, 12.0),
    metavar="X Z",
    help="Metres along x and along z.  [default: 20 12]",
)
@click.option(
    "--scale", type=console.SIZE, default=1.0, show_default=True, help="Multiply all heights by this."
)
@_spacing
@_unit
def heightmap(
    output: Path,
    kind: terrain_made.Kind,
    seed: int,
    size: tuple[float, float],
    scale: float,
    spacing: float,
    unit: float,
) -> None:
    """Make a random heightmap: smooth hills, slopes, steps, or all of them."""
    from . import terrain

    files.check_output(output)
    made = terrain_made.make(seed, kind, size=size, spacing=spacing, scale=scale)
    terrain.save(output, made, unit=unit)
    rows, columns = made.heights.shape
    click.echo(f"wrote {rows} x {columns} heights of {made!r} to {output}", err=True)


@click.command(epilog="Example: python -m features terrain clips/cmu --map hills.txt --plot pictures")
@click.argument("clips", nargs=-1, required=True, type=click.Path())
@click.option(
    "--map",
    "maps",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Heightmap to fit.  [repeatable]  [default: made ones]",
)
@_spacing
@_unit
@click.option(
    "--patches",
    "count",
    type=click.IntRange(10, 100_000),
    help="Number of patches to choose from.  [default: 1500]",
)
@click.option(
    "--grounds", type=click.IntRange(1, 100), help="Number of grounds to fit to each stretch.  [default: 10]"
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Where patches lie.")
@click.option(
    "--plot", type=click.Path(), metavar="FOLDER", help="Draw each clip's most uneven stretch, on its ground."
)
@options.FPS
@options.SOURCE_UNIT
@options.source_axes
@options.ROLES
@console.exclude_option
@console.json_option
def terrain(
    clips: tuple[str, ...],
    maps: tuple[Path, ...],
    spacing: float,
    unit: float,
    count: int | None,
    grounds: int | None,
    seed: int,
    plot: str | None,
    fps: float | None,
    source_unit: float | None,
    source_up: str,
    source_forward: str | None,
    source_handedness: str,
    roles: str | None,
    exclude: tuple[str, ...],
    as_json: bool,
) -> None:
    """Fit uneven ground under motion files (folders are searched), and tell how well it meets the feet.

    The ground is made of patches of the heightmaps given, or of random ones, which are then corrected until
    they touch the feet. misfit_mm: how far the chosen patches are from the feet before the correction;
    contact_mm (median) and contact_p95_mm: how far the ground is from feet in contact after it; sunk_mm: how
    deep other feet are in the ground (99th percentile). realtime: duration of the motion divided by the time
    that fitting took.
    """
    from motion import facts, sources
    from motion.targets import Targets

    from . import patches, terrain_fit
    from . import terrain as grids
    from .labels import label_clip

    axis = {"up": source_up, "forward": source_forward, "handedness": source_handedness}
    told = facts.of_all(fps=fps, unit=source_unit, **axis, roles=roles)
    paths = sources.find(clips, exclude=exclude)
    book = facts.book(paths, clips, common=told)
    paths = [path for path in paths if path not in book.excluded]
    pictures = Targets(plot, clips, paths, ".png") if plot is not None else None
    given = [grids.load(path, spacing=spacing, unit=unit) for path in maps]
    cut = patches.cut(
        given or [terrain_made.make(number) for number in MADE], count=count or patches.COUNT, seed=seed
    )
    rows = []
    for path in console.progress(paths, label="terrain", unit="clips"):
        with options.about(path):
            clip = facts.read(path, book.of(path))
            row, picture = _fit(clip, label_clip(clip, phase=False), cut, grounds or terrain_fit.COUNT)
        rows.append({"file": str(path), **row})
        if pictures is not None:
            _draw(pictures.path(path, ".png"), clip, *picture)
    if as_json:
        console.print_json(rows)
    else:
        console.print_table(rows)


def _fit(
    clip: Clip, labels: Labels, cut: Patches, count: int
) -> tuple[dict[str, Any], tuple[Grounds, slice, np.ndarray, np.ndarray]]:
    """How well grounds meet a clip's feet; and the grounds, frames, feet and contacts of one stretch."""
    import numpy as np

    from . import terrain_fit
    from .labels import GAITS

    feet, down = terrain_fit.soles_of(clip, labels), labels.contacts != 0
    jumping = labels.gait[:, GAITS.index("jump")]
    off, sunk, misfit, start = [np.zeros(0)], [np.zeros(0)], [], time.perf_counter()
    fitted = list(terrain_fit.fit_clip(cut, feet, down, clip.fps, count=count, jumping=jumping))
    seconds = time.perf_counter() - start
    uneven, most = fitted[0], -1.0
    for own, grounds in fitted:
        gaps = grounds(feet[own][..., 0], feet[own][..., 2]) - feet[own][..., 1]
        off.append(np.abs(gaps[:, down[own]]).ravel())
        sunk.append(gaps[:, ~down[own]].ravel())
        misfit.append(grounds.errors.mean())
        spread = float(np.std(feet[own][down[own]][:, 1])) if down[own].any() else 0.0
        if spread > most:
            uneven, most = (own, grounds), spread

    def millimetres(values: list[np.ndarray], percent: float) -> float | None:
        every = np.concatenate(values)
        return round(1e3 * float(np.percentile(every, percent)), 2) if len(every) else None

    row = {
        "seconds": round(clip.seconds, 3),
        "stretches": len(fitted),
        "misfit_mm": round(1e3 * float(np.sqrt(np.mean(misfit))), 1),
        "contact_mm": millimetres(off, 50),
        "contact_p95_mm": millimetres(off, 95),
        "sunk_mm": millimetres(sunk, 99),
        "realtime": round(clip.seconds / max(seconds, 1e-9), 1),
    }
    own, grounds = uneven
    return row, (grounds, own, feet[own], labels.contacts[own])


def _draw(path: Path, clip: Clip, grounds: Grounds, own: slice, feet: Any, contacts: Any) -> None:
    """A picture of the best ground of a stretch of a clip."""
    from motion import kinematics

    from .terrain_picture import save

    positions, _ = kinematics.forward(clip.skeleton, clip.positions[own], clip.rotations[own])
    title = f"{clip.name}, from {own.start / clip.fps:.1f} s to {own.stop / clip.fps:.1f} s"
    save(path, grounds.only(0), feet, contacts, skeleton=clip.skeleton, positions=positions, title=title)
