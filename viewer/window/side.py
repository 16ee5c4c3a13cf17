"""The window's side: tabs of systems, settings, what is drawn, why a search ended as it did, and plots."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import open3d as o3d
from numpy.typing import NDArray
from open3d.visualization import gui

from motion.errors import UserError

from .. import export, layers, panel, views
from ..controls import KEYS
from ..gamepad import CONTROLS, Gamepad
from ..scene import DARK, colour, levels
from ..tuning import Slider
from . import searches
from .players import Players
from .watch import Watch

THEME = DARK  # Open3D's widgets are dark
TABS = ("Systems", "Settings", "Show", "Search", "Plots")
SETTINGS = {".toml": "settings (.toml)"}
SCHEMA = {".toml": "schemas with weights (.toml)"}
MOTION = {".bvh": "motion (.bvh)", ".glb": "motion with the body (.glb)", ".rec": "runs (.rec)"}
_ROUNDED = 1e-5  # of a slider's length
_OTHERS = {
    "space": "pause or go on",
    "period, comma": "a step on, a step back",
    "m": "slow motion",
    "r": "begin again",
    "1, 2, 3": "to the next transition, slide, cost peak",
    "mouse": "turn the camera; its wheel: nearer",
    "escape": "close the window",  # Open3D does that, whatever it is told of the key
}


class Side:
    """The tabs.

    Parameters
    ----------
    players : whom they tell of, and change.
    em : pixels of a letter's height.
    watch : tells how long frames take.
    pad : tells whether there is a gamepad.
    camera : which of `viewer.views.KINDS` it is at first.
    on_players : called when others play than before.
    tell : shows a user a line.

    Attributes
    ----------
    sliders : widgets by the names of settings and features; buttons by what stands on them.
    asking : whether a user is asked for a file, and writes its name.
    """

    def __init__(
        self,
        window: Any,
        players: Players,
        em: float,
        *,
        watch: Watch,
        pad: Gamepad,
        camera: str,
        on_players: Callable[[], None],
        on_camera: Callable[[str], None],
        tell: Callable[[str], None],
    ) -> None:
        self._window, self._players, self._em, self._tell = window, players, em, tell
        self._on_players, self._on_camera, self._camera = on_players, on_camera, camera
        self._watch, self._pad = watch, pad
        self.widget = gui.TabControl()
        self.sliders: dict[str, Any] = {}
        self.buttons: dict[str, Any] = {}
        self.asking = False
        self._tuned = players.names[0] if players.names else ""
        self._settings = gui.WidgetProxy()
        self._picture, self._plot = _blank(), _blank()
        self._room, self._room_before = (0, 0), (0, 0)
        for name, made in zip(
            TABS, (self._systems(), self._tuning(), self._show(), self._picture, self._plot), strict=True
        ):
            self.widget.add_tab(name, made)
        if players.shown & set(panel.PARTS):
            self.widget.selected_tab_index = TABS.index("Plots")

    # What is told, a few times a second

    def refresh(self, time: float, errors: Any) -> None:
        """Tell of a time, as far as it is seen."""
        self._state.text = "\n".join([*(f"{n}: {e}" for n, e in errors.items()), *self._working()])
        self._pads.text = self._pad.state
        tab = TABS[self.widget.selected_tab_index]
        if tab == "Search":
            self._put(self._picture, partial(self._searched, time))
        elif tab == "Plots":
            self._put(self._plot, partial(self.plots, time))

    def _searched(self, time: float, size: tuple[int, int]) -> Any:
        who = self._players.searching
        try:
            found = who.explanation(time)
        except UserError as error:
            self._tell(str(error))
            found = None
        name = who.name if len(self._players.members) > 1 else ""
        return searches.drawn(found, THEME, size, self._em / 15, name=name)

    def plots(self, time: float, size: tuple[int, int]) -> Any:
        """The panels of all and of the window, one below the other, as large as there is room for in (width,
        height), uint8 [H, W, 3]."""
        players = self._players
        parts = [part for part in panel.PARTS if part in players.shown]
        parts = parts or list(panel.PARTS)[: 1 if len(players.members) > 1 else None]
        told = [self._watch.told()]
        for member in players.members:
            since = member.timeline.step_at(time - panel.HISTORY - 1)
            told.append(panel.Gauge(member, parts, since=since).at(time))
        scale = panel.fitted(told, size)
        return np.concatenate([panel.drawn(each, THEME, scale)[..., :3] for each in told])[: size[1]]

    def _put(self, widget: Any, draw: Callable[[tuple[int, int]], Any]) -> None:
        """Draw a picture that fills a widget."""
        size = max(widget.frame.width, 64), max(widget.frame.height, 64)
        # A picture of another size is a new texture, and the old ones are kept: wait until the size stays.
        if self._room != size and self._room_before != size:
            self._room_before = size
            return
        self._room = size
        picture = draw(size)
        room = np.broadcast_to(picture[-1, -1], (size[1], size[0], 3)).copy()
        room[: len(picture), : picture.shape[1]] = picture[:, : size[0]]
        widget.update_image(_image(room))

    def _working(self) -> list[str]:
        return [f"{name}: being made anew" for name in self._players.workshop.busy]

    # Tabs

    def _column(self) -> Any:
        return gui.Vert(0.4 * self._em, gui.Margins(*[0.5 * self._em] * 4))

    def _systems(self) -> Any:
        column = self._column()
        for name in self._players.tunings:
            box = gui.Checkbox(name)
            box.checked = name in self._players.names
            box.set_on_checked(partial(self._choose, name))
            column.add_child(box)
        for member in self._players.recorded:
            column.add_child(gui.Label(member.name))
        self.buttons["Export..."] = _button("Export...", self._export)
        column.add_child(self.buttons["Export..."])
        self._state = gui.Label("")
        column.add_child(self._state)
        keys: dict[str, str] = {}
        for key, binding in KEYS.items():
            keys[binding.about] = ", ".join(filter(None, [keys.get(binding.about), key.lower()]))
        told = [f"{key}: {about}" for about, key in keys.items()]
        told += [f"{key}: {about}" for key, about in _OTHERS.items()]
        column.add_child(gui.Label("\n".join(told)))
        self._pads = gui.Label(self._pad.state)
        column.add_child(self._pads)
        column.add_child(gui.Label("\n".join(f"{part}: {about}" for part, about in CONTROLS.items())))
        return column

    def _choose(self, name: str, on: bool) -> None:
        players = self._players
        wanted = [n for n in players.tunings if (on if n == name else n in players.names)]
        if not wanted and not players.recorded:
            self._tell("one system has to stay")
            return
        players.choose(wanted)
        self._ghost.checked = players.ghost
        self._on_players()

    def _show(self) -> Any:
        column = self._column()
        self.shown: dict[str, Any] = {}
        for name, (about, _) in layers.DRAWN.items():
            box = self.shown[name] = gui.Checkbox(name)
            box.checked, box.tooltip = name in self._players.shown, about
            box.set_on_checked(partial(self.show, name))
            column.add_child(box)
        self._ghost = gui.Checkbox("ghost: the second of two in the first one's place")
        self._ghost.checked = self._players.ghost
        self._ghost.set_on_checked(self._set_ghost)
        column.add_child(self._ghost)
        column.add_child(gui.Label("camera"))
        kinds = gui.Combobox()
        for kind in views.KINDS:
            kinds.add_item(kind)
        kinds.selected_text = self._camera
        kinds.set_on_selection_changed(lambda name, _: self._on_camera(name))
        column.add_child(kinds)
        return column

    def show(self, name: str, on: bool) -> None:
        """Draw something about characters, or no more."""
        (self._players.shown.add if on else self._players.shown.discard)(name)
        self._players.dress()

    def _set_ghost(self, on: bool) -> None:
        try:
            self._players.set_ghost(on)
        except UserError as error:
            self._ghost.checked = False
            self._tell(str(error))

    def _tuning(self) -> Any:
        column = self._column()
        if not self._players.tunings:
            column.add_child(gui.Label("nobody is driven"))
            return column
        who = gui.Combobox()
        for name in self._players.tunings:
            who.add_item(name)
        who.selected_text = self._tuned
        who.set_on_selection_changed(lambda name, _: self._tune(name))
        buttons = gui.Horiz(0.3 * self._em)
        whats = {"Reset": self._reset, "Load...": self._load, "Save...": self._save}
        for words, what in (whats | {"Save weights...": self._save_weights}).items():
            self.buttons[words] = _button(words, what)
            buttons.add_child(self.buttons[words])
        for child in (who, buttons, self._settings):
            column.add_child(child)
        self._tune(self._tuned)
        return column

    def _tune(self, name: str) -> None:
        """The sliders of a system."""
        self._tuned, self.sliders = name, {}
        tuning = self._players.tunings[name]
        self.buttons["Save weights..."].enabled = bool(tuning.weight_sliders)
        rows = gui.VGrid(2, 0.3 * self._em)
        for slider in tuning.sliders:
            self._row(rows, slider, getattr(tuning.settings, slider.name), tuning.set)
        for slider in tuning.weight_sliders:
            weight = tuning.weights.get(slider.name, slider.default)
            self._row(rows, slider, weight, tuning.set_weight, "weight of ")
        self._settings.set_widget(rows)

    def _row(
        self, rows: Any, slider: Slider, value: Any, change: Callable[[str, Any], bool], what: str = ""
    ) -> None:
        def moved(now: Any) -> None:
            try:
                rebuilds = change(slider.name, now)
            except UserError as error:
                self._tell(str(error))
                return
            self._players.tune(self._tuned, rebuilds)

        unit = f" ({slider.unit})" if slider.unit else ""
        words = what + slider.name.replace("_", " ") + ("" if value is not None else ": told by the data")
        widget: Any
        if slider.kind == "switch":
            widget = gui.Checkbox("")
            widget.checked = bool(value)
            widget.set_on_checked(moved)
        elif slider.kind == "choice":
            widget = gui.Combobox()
            for choice in slider.choices:
                widget.add_item(str(choice))
            widget.selected_text = str(value)
            widget.set_on_selection_changed(lambda text, _: moved(text))
        else:
            widget = _number(slider, slider.low if value is None else float(value), moved)
        title = gui.Label(words + unit)
        title.tooltip = widget.tooltip = slider.about
        self.sliders[slider.name] = widget
        rows.add_child(title)
        rows.add_child(widget)

    def _reset(self) -> None:
        rebuilds = self._players.tunings[self._tuned].reset()
        self._tuned_anew(rebuilds)

    def _tuned_anew(self, rebuilds: bool) -> None:
        self._players.tune(self._tuned, rebuilds)
        self._tune(self._tuned)

    # Files

    def _load(self) -> None:
        def load(path: str) -> None:
            self._tuned_anew(self._players.tunings[self._tuned].load(path))
            self._tell(f"{self._tuned} goes by {path}")

        self._ask(gui.FileDialog.OPEN, "Settings to load", SETTINGS, load)

    def _save(self) -> None:
        def save(path: str) -> None:
            self._players.tunings[self._tuned].save(path)
            self._tell(f"wrote {path}")

        self._ask(gui.FileDialog.SAVE, "Where to save the settings", SETTINGS, save)

    def _save_weights(self) -> None:
        def save(path: str) -> None:
            self._players.tunings[self._tuned].save_schema(path)
            self._tell(f"wrote {path}, for --schema of `mm build`")

        self._ask(gui.FileDialog.SAVE, "Where to save the features' weights", SCHEMA, save)

    def _export(self) -> None:
        def write(path: str) -> None:
            made = export.write([self._players.remembered(each) for each in self._players.members], path)
            self._tell(f"wrote {', '.join(map(str, made))}")

        self._ask(gui.FileDialog.SAVE, "Where to write what they did", MOTION, write)

    def _ask(self, mode: Any, title: str, kinds: dict[str, str], then: Callable[[str], None]) -> None:
        """Have a file named."""

        def done(path: str) -> None:
            close()
            try:
                then(path)
            except UserError as error:
                self._tell(str(error))

        def close() -> None:
            self.asking = False
            self._window.close_dialog()

        dialog = gui.FileDialog(mode, title, self._window.theme)
        for suffix, about in kinds.items():
            dialog.add_filter(suffix, about)
        dialog.set_on_cancel(close)
        dialog.set_on_done(done)
        self.asking = True
        self._window.show_dialog(dialog)


def _image(picture: NDArray[np.uint8]) -> Any:
    image: Any = o3d.geometry.Image  # its stubs do not know arrays for buffers
    return image(picture)


def _blank() -> Any:
    """A picture that is still to come: of none Open3D would say in red that it could not be loaded."""
    return gui.ImageWidget(_image(np.full((64, 64, 3), levels(colour(THEME.floor)), np.uint8)))


def _button(words: str, what: Callable[[], None]) -> Any:
    made = gui.Button(words)
    made.set_on_clicked(what)
    made.vertical_padding_em = 0.0
    return made


def _number(slider: Slider, value: float, moved: Callable[[Any], None]) -> Any:
    def slid(now: Any) -> None:
        nonlocal value
        if abs(now - value) > _ROUNDED * (slider.high - slider.low):  # it also tells of what it was set to
            value = now
            moved(now)

    made = gui.Slider(gui.Slider.DOUBLE)
    made.set_limits(slider.low, slider.high)
    made.double_value = value
    made.set_on_value_changed(slid)
    return made
