"""``python -m viewer``: clips and recorded runs as pictures and films."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import click

from motion import console
from motion.errors import UserError
from motion.options import TIME

if TYPE_CHECKING:
    from .shows import Show

SIZE, CELL = (1280, 720), (200, 400)
LARGEST = 8192
RATES = {".gif": 25.0}
VIEWS, CAMERAS = ("front", "side", "quarter", "back"), ("follow", "orbit", "fixed")


class Size(click.ParamType):
    """Width and height in pixels, as 1280x720."""

    name = "size"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"(\d{1,5})[xX](\d{1,5})", value)
        size = (int(match[1]), int(match[2])) if match else (0, 0)
        if not all(16 <= side <= LARGEST for side in size):
            self.fail(f"{value!r} is no size; give pixels as 1280x720, 16 to {LARGEST} each", param, ctx)
        return size


@console.command(
    "viewer", epilog="Example: python -m viewer walk.bvh lap.rec --offscreen walk.mp4 --from 2 --to 7 --dark"
)
@click.argument("sources", nargs=-1, required=True, metavar="CLIP|RUN...", type=click.Path())
@click.option(
    "--offscreen",
    required=True,
    type=click.Path(),
    metavar="OUT",
    help="Picture or film to write: .png, .mp4, .gif.",
)
@click.option(
    "--filmstrip",
    type=click.IntRange(2, 60),
    metavar="N",
    help="N poses at even times side by side, in one .png.",
)
@click.option("--size", type=Size(), metavar="WxH", help="Pixels.  [default: 1280x720; of a strip 400 high]")
@click.option(
    "--from", "start", type=TIME, default=0.0, metavar="S", help="Begin there; where a .png is taken."
)
@click.option("--to", "stop", type=TIME, metavar="S", help="Stop there.  [default: the longest one's end]")
@click.option("--fps", type=console.Number(1, 120), help="Pictures a second.  [default: 30; .gif: 25]")
@click.option("--camera", type=click.Choice(CAMERAS), default="follow", show_default=True,
              help="Move along, go around too, or stand where all of the way is seen.")  # fmt: skip
@click.option("--view", type=click.Choice(VIEWS),
              help="The side seen at the start.  [default: quarter; of several front]")  # fmt: skip
@click.option(
    "--elevation", type=console.Number(-10, 89), default=12.0, show_default=True, help="Degrees above level."
)
@click.option(
    "--distance", type=console.SIZE, metavar="M", help="Metres to the camera.  [default: shows all]"
)
@click.option("--turn", type=console.SECONDS, default=8.0, show_default=True, help="Seconds of one orbit.")
@click.option("--no-skin", is_flag=True, help="Made bodies also where a glTF file has its own.")
@click.option("--dark", is_flag=True, help="Dark background.")
@click.option("--names/--no-names", default=None, help="Names above the characters.  [default: of several]")
def main(
    sources: tuple[str, ...],
    offscreen: str,
    filmstrip: int | None,
    size: tuple[int, int] | None,
    start: float,
    stop: float | None,
    fps: float | None,
    camera: str,
    view: str | None,
    elevation: float,
    distance: float | None,
    turn: float,
    no_skin: bool,
    dark: bool,
    names: bool | None,
) -> None:
    """Look at motion: clips (BVH, AMC, NPZ, glTF) and recorded runs (`python -m mm run --record`).

    Several are shown side by side, each beginning at its own place. The left of a body is red, the right
    blue. Neither a window nor a graphics card is needed.
    """
    import numpy as np

    from motion import files

    from . import film, scene, views
    from .stage import Stage

    form = film.suffix(offscreen)
    if filmstrip and form != ".png":
        raise UserError("a film strip is one picture", path=offscreen, remedy="name it *.png")
    files.check_output(offscreen, inputs=sources)
    if form == ".mp4":
        film.check_mp4()
    shows = _load(sources, skinned=not no_skin)
    stage = Stage(
        shows, theme=scene.DARK if dark else scene.LIGHT, names=len(shows) > 1 if names is None else names
    )
    end = stage.seconds or 0.0
    stop = end if stop is None else min(stop, end)
    if start > end or (stop < start if form == ".png" else stop <= start):
        raise UserError(f"nothing from {start:g} to {stop:g} s", remedy=f"the longest lasts {end:.2f} s")
    side = view or ("front" if len(shows) > 1 else "quarter")
    seen = views.View(camera, np.radians(views.SIDES[side]), np.radians(elevation), distance, turn)
    rate = fps or RATES.get(form, 30.0)
    if filmstrip:
        times = np.linspace(start, stop, filmstrip).tolist()
        whole = size or (CELL[0] * filmstrip, CELL[1])
        cells = console.progress(
            views.strip(stage, times, whole, seen), label="drawing", total=filmstrip, unit="poses"
        )
        pictures = iter([views.joined(cells)])
    else:
        times = [start] if form == ".png" else np.arange(start, stop + 1e-6, 1 / rate).tolist()
        frames = views.film(stage, times, size or SIZE, seen)
        pictures = console.progress(frames, label="filming", total=len(times), unit="pictures")
    count = film.write(offscreen, pictures, fps=rate)
    click.echo(f"wrote {count} picture{'s' * (count != 1)} to {offscreen}", err=True)


def _load(sources: tuple[str, ...], *, skinned: bool) -> list[Show]:
    from . import shows

    return [
        shows.load(path, skinned=skinned) for path in console.progress(sources, label="reading", unit="files")
    ]
