"""The interactive window, drawn by Open3D."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from features.terrain import Ground

from ..sources import Sources
from . import opening

if TYPE_CHECKING:
    from .app import Window

SIZE = (1280, 800)


def run(
    sources: Sources,
    *,
    systems: Sequence[str] | None = None,
    course: str | None = None,
    settings: Mapping[str, str] | None = None,
    ground: Ground | None = None,
    shown: Sequence[str] | None = None,
    ghost: bool = False,
    size: tuple[int, int] | None = None,
    dark: bool = False,
    on_frame: Callable[[Window], bool | None] | None = None,
    **options: Any,
) -> None:
    """Open a window and come back when it is closed.

    Parameters
    ----------
    sources, systems, course, settings, ground, shown, ghost : see `viewer.window.players.Players`; without a
        course whoever is driven is so by keys or a gamepad.
    on_frame : see `viewer.window.app.Window`.

    Errors: UserError where no window can be opened here.
    """
    software = opening.check()
    from .. import scene
    from .app import Window
    from .players import SHOWN, Players

    theme = scene.DARK if dark else scene.LIGHT
    players = Players(
        sources,
        systems=systems,
        course=course,
        settings=settings,
        ground=ground,
        shown=SHOWN if shown is None else shown,
        ghost=ghost,
        theme=theme,
        patience=options.pop("patience", None),
    )
    Window(players, size=size or SIZE, on_frame=on_frame, software=software, **options).run()
