"""The controllers' settings as sliders: what they are, where they are, and systems that go by them."""

from __future__ import annotations

import dataclasses
import math
import os
import typing
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal

from features.schema import Schema
from mm import run as of_databases
from mm.control import System
from mm.database import Database
from mm.reweighted import reweighted, with_weights
from motion import config, files, templates
from motion.config import ConfigError
from motion.errors import UserError

from .session import Session
from .sources import Part

# Lowest and highest number that is of use, and the unit.
_HALFLIFE, _SHARE, _SPEED = (0.0, 1.0, "s"), (0.0, 1.0, ""), (0.0, 8.0, "m/s")
RANGES: dict[str, tuple[float, float, str]] = {
    "search_interval": (0.0, 0.5, "s"),
    "ignore_radius": (0.0, 1.0, "s"),
    "reselect_time": (0.0, 1.0, "s"),
    "ignore_end": (0.0, 1.0, "s"),
    "continuing_bias": (0.0, 0.9, ""),
    "forced_search_change": (0.0, 3.0, "m/s or rad"),
    "velocity_halflife": _HALFLIFE,
    "rotation_halflife": _HALFLIFE,
    "inertialization_halflife": (0.0, 0.5, "s"),
    "position_adjustment_halflife": _HALFLIFE,
    "rotation_adjustment_halflife": _HALFLIFE,
    "adjustment_ratio": _SHARE,
    "maximal_distance": (0.0, 1.0, "m"),
    "maximal_angle": (0.0, math.pi, "rad"),
    "foot_halflife": (0.0, 0.5, "s"),
    "unlock_radius": (0.0, 0.5, "m"),
    "foot_height": (0.0, 0.2, "m"),
    "body_radius": (0.0, 1.0, "m"),
    "position_bias": (0.0, 8.0, ""),
    "direction_bias": (0.0, 8.0, ""),
    "facing_halflife": _HALFLIFE,
    "gait_halflife": _HALFLIFE,
    "crouch_halflife": _HALFLIFE,
    "stand_speed": (0.0, 1.0, "m/s"),
    "jog_from": _SPEED,
    "jog_to": _SPEED,
    "joint_smoothing": (0.0, 0.95, ""),
}
MOST_WEIGHT = 5.0
BUILT_IN = ("ignore_end",)  # to a search index: another one takes another index


@dataclass(frozen=True)
class Slider:
    """A setting that can be changed while characters are driven.

    Attributes
    ----------
    name : of the setting, or of the feature whose weight it is.
    kind : a "number" from low to high in a unit, a "switch", or a "choice" of choices.
    default : what a reset gives; None is told by the data.
    about : what it does.
    rebuilds : whether a change takes a new system, which is made in the background.
    """

    name: str
    kind: Literal["number", "switch", "choice"]
    default: Any
    about: str
    low: float = 0.0
    high: float = 1.0
    unit: str = ""
    choices: tuple[str, ...] = ()
    rebuilds: bool = False


def sliders(settings: type) -> tuple[Slider, ...]:
    """Those of a class of settings, in its order."""
    _, about = templates.documentation(settings)
    hints = typing.get_type_hints(settings)
    return tuple(
        _slider(field, hints[field.name], about.get(field.name, "")) for field in dataclasses.fields(settings)
    )


def _slider(field: Any, kind: Any, about: str) -> Slider:
    if kind is bool:
        return Slider(field.name, "switch", field.default, about)
    if typing.get_origin(kind) is Literal:
        return Slider(field.name, "choice", field.default, about, choices=typing.get_args(kind))
    low, high, unit = RANGES[field.name]
    rebuilds = field.name in BUILT_IN
    return Slider(field.name, "number", field.default, about, low, high, unit, rebuilds=rebuilds)


def weight_sliders(schema: Schema) -> tuple[Slider, ...]:
    """Those of the weights of a schema's features."""
    return tuple(
        Slider(
            feature.name,
            "number",
            feature.weight,
            f"weight of {', '.join(feature.column_names())}",
            0.0,
            max(MOST_WEIGHT, 2 * feature.weight),
            rebuilds=True,
        )
        for feature in schema.features
    )


class Tuning:
    """Where one system's sliders are.

    A change is checked, and told to the system by who asks for it: settings at once (`Session.retune`); what
    a search index or features are made of by a new system, that `make` gives and `Workshop` makes in the
    background, and that goes on where the old one is (`take`).

    Attributes
    ----------
    settings : of the class that the part names.
    weights : of features that weigh otherwise than the database has them, by name.
    """

    def __init__(self, part: Part, settings: Any = None) -> None:
        self.part = part
        self.settings = part.driven.settings() if settings is None else settings
        self.weights: dict[str, float] = {}

    @property
    def sliders(self) -> tuple[Slider, ...]:
        return sliders(self.part.driven.settings)

    @property
    def weight_sliders(self) -> tuple[Slider, ...]:
        """None where features are a network's, or compressed."""
        return weight_sliders(self._database.schema) if self._database is not None else ()

    @property
    def _database(self) -> Database | None:
        """The database that a search alone runs on, which may weigh otherwise."""
        data = self.part.data
        return data if isinstance(data, Database) and not self.part.learned else None

    def set(self, name: str, value: Any) -> bool:
        """Move a slider; whether that takes a new system. What it cannot be is a ConfigError."""
        before = self.settings
        given = {key: old for key, old in config.to_dict(before).items() if key != name}
        self.settings = config.from_dict(type(before), given if value is None else {**given, name: value})
        return _differ(before, self.settings)

    def set_weight(self, name: str, weight: float) -> bool:
        """Let a feature weigh otherwise; it takes a new system."""
        if name not in {slider.name for slider in self.weight_sliders}:
            what = "its features cannot weigh otherwise" if not self.weight_sliders else "no such feature"
            raise ConfigError(name, what, remedy=config.choices(s.name for s in self.weight_sliders))
        weights = {**self.weights, name: float(weight)}
        with_weights(self._schema(), weights)
        self.weights = weights
        return True

    def reset(self) -> bool:
        """All sliders back to their defaults; whether that takes a new system."""
        defaults = self.part.driven.settings()
        rebuilds = bool(self.weights) or _differ(self.settings, defaults)
        self.settings, self.weights = defaults, {}
        return rebuilds

    def load(self, path: str | os.PathLike[str]) -> bool:
        """Settings of a TOML file, as `mm run --settings` takes it; whether they take a new system."""
        found = config.load(type(self.settings), path)
        rebuilds = _differ(self.settings, found)
        self.settings = found
        return rebuilds

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the settings as TOML, for `--settings` of the commands that drive characters."""
        files.check_output(path)
        with files.atomic(path, "w") as stream:
            stream.write(templates.explained(self.settings))

    def save_schema(self, path: str | os.PathLike[str]) -> None:
        """Write the schema with its weights as TOML, for `--schema` of the commands that build databases."""
        files.check_output(path)
        with_weights(self._schema(), self.weights).save(path)

    def make(self, **options: Any) -> System:
        """A new system by these settings and weights."""
        part = self.part
        if self.weights and self._database is not None:
            data = reweighted(self._database, self.weights)
            part = dataclasses.replace(part, driven=of_databases.of_data(data), data=data)
        return part.make(self.settings, **options)

    def take(self, session: Session, name: str, system: System) -> None:
        """Let a system that was made go on where the old one is, by what the sliders are at by now."""
        session.exchange(name, system)
        made_by = getattr(system, "settings", self.settings)
        if made_by != self.settings and not _differ(made_by, self.settings):
            session.retune(name, self.settings)

    def _schema(self) -> Schema:
        if self._database is None:
            raise UserError(f"{self.part.name} has no features that may weigh otherwise")
        return self._database.schema


class Workshop:
    """Makes systems in the background, the last one wanted of each name."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="workshop")
        self._work: dict[str, Future[System]] = {}

    def start(self, name: str, tuning: Tuning, **options: Any) -> None:
        """Have a system made by what the sliders are at now."""
        now = Tuning(tuning.part, tuning.settings)
        now.weights = dict(tuning.weights)
        if name in self._work:
            self._work[name].cancel()
        self._work[name] = self._pool.submit(now.make, **options)

    def __contains__(self, name: str) -> bool:
        """Whether a system is being made, or is ready and was not given yet."""
        return name in self._work

    @property
    def busy(self) -> tuple[str, ...]:
        """Names of those that are not ready."""
        return tuple(name for name, work in self._work.items() if not work.done())

    def ready(self) -> dict[str, System]:
        """The systems that are done, each given once. What its making raised is raised here."""
        done = [name for name, work in self._work.items() if work.done()]
        return {name: self._work.pop(name).result() for name in done}

    def close(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)


def _differ(one: Any, other: Any) -> bool:
    """Whether settings differ in what is built into a search index."""
    return any(getattr(one, name, None) != getattr(other, name, None) for name in BUILT_IN)
