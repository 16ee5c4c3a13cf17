"""The interactive window, drawn by Open3D."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..sources import Sources
from ..views import SIDES, View
from . import opening

if TYPE_CHECKING:
    from .app import Window

SIZE, SMALL = (1280, 800), (960, 640)  # pixels; small where a processor draws


def run(
    sources: Sources,
    *,
    size: tuple[int, int] | None = None,
    dark: bool = False,
    view: View | None = None,
    side: str | None = None,
    on_frame: Callable[[Window], bool | None] | None = None,
    clock: Callable[[], float] = time.perf_counter,
    **shown: Any,
) -> None:
    """Open a window and come back when it is closed.

    Parameters
    ----------
    sources, shown : see `viewer.window.players.Players`.
    view, side : how they are seen at first, and from which of `viewer.views.SIDES`: by default who is driven
        by hand from the back, several from the front, one from a quarter.
    on_frame, clock : see `viewer.window.app.Window`.

    Errors: UserError where no window can be opened here.
    """
    software = opening.check()
    from .. import scene
    from .app import Window
    from .players import Players

    behind = None if side is None else side == "back"
    players = Players(sources, theme=scene.DARK if dark else scene.LIGHT, behind=behind, **shown)
    usual = "back" if players.stick else "front" if len(players.stage.shows) > 1 else "quarter"
    seen = replace(view or View(), azimuth=np.radians(SIDES[side or usual]))
    size = size or (SMALL if software else SIZE)
    Window(players, size=size, view=seen, on_frame=on_frame, clock=clock, software=software).run()
