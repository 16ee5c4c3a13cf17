"""``python -m viewer``: clips, recorded runs and driven characters in a window, as pictures and as films."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import click

from mm.options import on_heights
from motion import console
from motion.errors import UserError
from motion.options import TIME

if TYPE_CHECKING:
    from features.terrain import Heightmap

    from .cast import Member
    from .sources import Sources

SIZE, CELL = (1280, 720), (200, 400)
LARGEST = 8192
RATES = {".gif": 25.0}
VIEWS, CAMERAS = ("front", "side", "quarter", "back"), ("follow", "orbit", "fixed")
COURSE, USUAL, NOTHING = "thesis", ("trajectory", "panel"), "none"
PAST = 0.1  # seconds that are driven beyond the time of a picture
LEAST = 8  # pixels that a pose of a strip is wide
UNSEEN = ("filmstrip", "fps", "apart")  # in a window


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


class Names(click.ParamType):
    """Names separated by commas."""

    name = "names"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[str, ...]:
        if isinstance(value, tuple):
            return value
        return tuple(name.strip() for name in value.split(",") if name.strip())


@console.command(
    "viewer",
    epilog="Example: python -m viewer walk.mmdb walk.lmm --course turn-180 --offscreen turn.mp4",
)
@click.argument("sources", nargs=-1, metavar="[CLIP|DB|MODEL|RUN]...", type=click.Path())
@click.option(
    "--systems",
    type=Names(),
    metavar="NAMES",
    help="Systems to drive, as mm,lmm,lmm-D; letters name the stages that networks do.  [default: all]",
)
@click.option(
    "--course",
    metavar="NAME|FILE",
    help="Course to drive them over (`python -m mm courses` lists them), or a recorded run.  "
    f"[default: {COURSE}]",
)
@click.option(
    "--settings",
    multiple=True,
    metavar="[NAME=]FILE",
    help="TOML file with a controller's settings; NAME= gives them to that system only.  [repeatable]",
)
@on_heights
@click.option(
    "--offscreen",
    type=click.Path(),
    metavar="OUT",
    help="Picture or film to write instead of a window: .png, .mp4, .gif.",
)
@click.option(
    "--export",
    type=click.Path(),
    metavar="OUT",
    help="Write the motion shown: .bvh, .glb (with the body), .rec; several as OUT-NAME.",
)
@click.option(
    "--filmstrip",
    type=click.IntRange(2, 60),
    metavar="N",
    help="Draw N poses at even times side by side, in one .png.",
)
@click.option(
    "--show",
    type=Names(),
    metavar="NAMES",
    help="What to draw about the characters, see below; none for nothing.  "
    "[default: for runs trajectory,panel]",
)
@click.option(
    "--ghost",
    is_flag=True,
    help="Draw the second character transparent in the place of the first, coloured by how far joints are "
    "apart.",
)
@click.option(
    "--apart/--together",
    default=None,
    help="A picture for each, or all in one.  [default: apart where they are driven or on heights]",
)
@click.option(
    "--size", type=Size(), metavar="WxH", help="Size in pixels.  [default: 1280x720; a strip is 400 high]"
)
@click.option(
    "--from",
    "start",
    type=TIME,
    default=0.0,
    metavar="S",
    help="Begin at this time; for a .png the time of the picture.",
)
@click.option(
    "--to", "stop", type=TIME, metavar="S", help="Stop at this time.  [default: end of the longest]"
)
@click.option("--fps", type=console.Number(1, 120), help="Pictures a second.  [default: 30; .gif: 25]")
@click.option(
    "--camera",
    type=click.Choice(CAMERAS),
    default="follow",
    show_default=True,
    help="Move along, go around too, or stand where all of the way is seen.",
)
@click.option(
    "--view",
    type=click.Choice(VIEWS),
    help="Side seen at the start.  [default: quarter; front for several together]",
)
@click.option(
    "--elevation",
    type=console.Number(-10, 89),
    default=12.0,
    show_default=True,
    help="Height of the camera in degrees above level.",
)
@click.option(
    "--distance",
    type=console.SIZE,
    metavar="M",
    help="Distance of the camera in metres.  [default: far enough to show all]",
)
@click.option(
    "--turn",
    type=console.SECONDS,
    default=8.0,
    show_default=True,
    help="Seconds that one orbit of --camera orbit takes.",
)
@click.option("--no-skin", is_flag=True, help="Draw made bodies even where a glTF file has its own.")
@click.option("--dark", is_flag=True, help="Dark background.")
@click.option(
    "--names/--no-names",
    default=None,
    help="Names above the characters.  [default: of several in one picture]",
)
def main(
    sources: tuple[str, ...],
    systems: tuple[str, ...] | None,
    course: str | None,
    settings: tuple[str, ...],
    heights: str | None,
    heights_spacing: float | None,
    no_skin: bool,
    offscreen: str | None,
    export: str | None,
    **seen: Any,
) -> None:
    """Look at motion: clips (BVH, AMC, NPZ, glTF), recorded runs (`python -m mm run --record`), and
    characters that databases and models drive.

    Several are shown side by side. The left of a body is red, the right blue. Without arguments the built-in
    data and the networks that ship are shown. A database or model that is given with a run explains the run's
    searches; with --systems or --course it drives a character beside it. --offscreen needs neither a window
    nor a graphics card.

    In a window characters are driven by keys or a gamepad, which its first tab tells of, or over a --course.
    --from and --to are of what is recorded, --show panel opens the plots; --filmstrip, --fps and --apart are
    not for it. Gamepads (on Linux, the first of /dev/input/js*, also one plugged in later): the left stick or
    cross is where to go, the right stick turns the camera, the right trigger or A runs, the left trigger
    faces where the camera looks, B crouches.

    \b
    What --show names:
      trajectory  what is asked (orange) and predicted (violet), with facings
      match       the way of the frame that plays
      features    the last search's query against what answered it
      contacts    feet that touch (yellow), feet that are held (red)
      candidates  what the last search might have chosen, green to red by cost
      boxes       those of 16 frames around them
      samples     where the ground's height is asked for
      panel       name, cost, speed, skate, time of a step, phase and gait
      costs       of the frame that plays, by feature
    """
    from mm.options import heightmap

    from . import sources as things

    outputs = [out for out in (offscreen, export) if out is not None]
    files_of = [_file_of(setting) for setting in settings]
    _check(outputs, [*sources, *files_of, *([heights] if heights else [])], offscreen, export, seen)
    ground = heightmap(heights, heights_spacing)
    found = things.read(sources, skinned=not no_skin)
    if not sources:
        found.databases[things.BUILT_IN] = things.built_in(progress=console.progress)
    tuned = {_name_of(setting): _file_of(setting) for setting in settings}
    if not outputs:
        _window(found, systems=systems, course=course, settings=tuned, ground=ground, **seen)
        return
    members = _members(found, systems, course, tuned, ground, _until(seen, outputs), ghost=seen["ghost"])
    if offscreen is not None:
        _draw(members, offscreen, **seen)
    if export is not None:
        _export(members, export, seen["start"], seen["stop"])


def _check(
    outputs: list[str], inputs: list[str], offscreen: str | None, export: str | None, seen: Any
) -> None:
    """Faults in what is to be written and shown, before the work."""
    from motion import files

    from . import export as exporting
    from . import film
    from .offscreen import DRAWABLE

    if not outputs:
        for name in UNSEEN:
            if seen[name]:
                remedy = "leave it out, or draw without one: --offscreen OUT"
                raise UserError(f"--{name} is nothing for a window", remedy=remedy)
    start, stop = seen["start"], seen["stop"]
    if stop is not None and stop < start:
        raise UserError(f"--to {stop:g} is before --from {start:g}", remedy="exchange them")
    form = film.suffix(offscreen) if offscreen else None
    if seen["filmstrip"] and form != ".png":
        raise UserError("a film strip is one picture", path=offscreen, remedy="name it *.png")
    if seen["filmstrip"] and seen["size"] and seen["size"][0] < (wide := LEAST * seen["filmstrip"]):
        remedy = f"give it {wide} pixels or fewer poses"
        raise UserError(
            f"--size {seen['size'][0]} is too narrow for {seen['filmstrip']} poses", remedy=remedy
        )
    if export:
        exporting.check(export)
    for output in outputs:
        files.check_output(output, inputs=inputs)
    if form == ".mp4":
        film.check_mp4()
    for name in seen["show"] or ():
        if name not in DRAWABLE and name != NOTHING:
            raise UserError(f"nothing is called {name!r} that could be shown", remedy=_choices(DRAWABLE))
        if name == NOTHING and len(seen["show"]) > 1:
            raise UserError("--show names things to draw, and none", remedy="leave none out, or the others")


def _until(seen: Any, outputs: list[str]) -> float | None:
    """How long there is something to see, seconds; None: as long as a course lasts."""
    stop: float | None = seen["stop"]
    single = [out.lower().endswith(".png") for out in outputs] == [True] and not seen["filmstrip"]
    return seen["start"] + PAST if single and stop is None else stop


def _members(
    found: Sources,
    systems: tuple[str, ...] | None,
    course: str | None,
    settings: dict[str, str],
    ground: Heightmap | None,
    seconds: float | None,
    *,
    ghost: bool,
) -> list[Member]:
    """Who is shown: clips and runs, then who is driven."""
    from mm import courses

    from . import cast

    parts = cast.chosen(found, systems, course=course, settings=settings, ground=ground)
    members = cast.given(found, ground=ground)
    if ghost:
        cast.check_ghost(len(members) + len(parts))
    if not parts:
        return members
    way = courses.load(course or COURSE)
    return members + cast.driven(parts, way, seconds=seconds, settings=settings, ground=ground)


def _draw(
    members: list[Member],
    offscreen: str,
    *,
    filmstrip: int | None,
    show: tuple[str, ...] | None,
    ghost: bool,
    apart: bool | None,
    size: tuple[int, int] | None,
    start: float,
    stop: float | None,
    fps: float | None,
    camera: str,
    view: str | None,
    elevation: float,
    distance: float | None,
    turn: float,
    dark: bool,
    names: bool | None,
) -> None:
    import numpy as np

    from . import film, scene, views
    from . import offscreen as pictures
    from .panel import PARTS

    form, several = film.suffix(offscreen), len(members) > 1
    runs = [each for each in members if each.run is not None]
    shown = [name for name in (USUAL if show is None and runs else show or ()) if name != NOTHING]
    if filmstrip and show is None:
        shown = []
    panels = not filmstrip and bool(set(shown) & set(PARTS))
    if apart is None:
        apart = several and not ghost and not filmstrip and len(runs) == len(members)
    look = pictures.Look(
        theme=scene.DARK if dark else scene.LIGHT,
        shown=shown,
        names=(several and not ghost and not (panels and apart)) if names is None else names,
        apart=apart,
        ghost=ghost,
    )
    end = max(each.show.seconds or 0.0 for each in members)
    stop = end if stop is None else min(stop, end)
    if start > end or (stop < start if form == ".png" else stop <= start):
        raise UserError(f"nothing from {start:g} to {stop:g} s", remedy=f"the longest lasts {end:.2f} s")
    side = view or ("front" if several and not apart and not ghost else "quarter")
    angles = np.radians(views.SIDES[side]), np.radians(elevation)
    seen = views.View(camera, *angles, distance, turn)
    rate = fps or RATES.get(form, 30.0)
    if filmstrip:
        times = np.linspace(start, stop, filmstrip).tolist()
        rows = len(members) if apart else 1
        cells = pictures.strip(members, look, times, size or (CELL[0] * filmstrip, CELL[1] * rows), seen)
        poses = console.progress(cells, label="drawing", total=filmstrip, unit="poses")
        drawn = iter([pictures.joined(poses, look)])
    else:
        times = [start] if form == ".png" else np.arange(start, stop + 1e-6, 1 / rate).tolist()
        frames = pictures.filmed(members, look, times, size or SIZE, seen)
        drawn = console.progress(frames, label="filming", total=len(times), unit="pictures")
    count = film.write(offscreen, drawn, fps=rate)
    click.echo(f"wrote {count} picture{'s' * (count != 1)} to {offscreen}", err=True)


def _export(members: list[Member], output: str, start: float, stop: float | None) -> None:
    from . import export

    for path in export.write(members, output, start=start, stop=stop):
        click.echo(f"wrote {path}", err=True)


def _window(
    found: Sources,
    *,
    show: tuple[str, ...] | None,
    view: str | None,
    camera: str,
    elevation: float,
    distance: float | None,
    turn: float,
    **given: Any,
) -> None:
    """Open the window on what was given: the one place where it is."""
    import numpy as np

    from . import views, window

    shown = None if show is None else [name for name in show if name != NOTHING]
    seen = views.View(camera, elevation=np.radians(elevation), distance=distance, turn=turn)
    given = {name: value for name, value in given.items() if name not in UNSEEN}
    window.run(found, shown=shown, view=seen, side=view, **given)


def _name_of(setting: str) -> str:
    """mm of mm=fast.toml; nothing where a file is for all."""
    return setting.partition("=")[0] if "=" in setting else ""


def _file_of(setting: str) -> str:
    return setting.partition("=")[2] if "=" in setting else setting


def _choices(names: Iterable[str]) -> str:
    return f"choose from {', '.join(names)}"
