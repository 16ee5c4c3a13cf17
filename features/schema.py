"""The feature schema: what the numbers are that describe a frame to a search or a network."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from motion import config, files
from motion.config import ConfigError, choices
from motion.roles import ROLES

from . import custom
from .custom import register

__all__ = ["KINDS", "TRAJECTORY", "Feature", "Schema", "TrajectoryLayout", "register"]

Kind = Literal[
    "position",
    "velocity",
    "angular_velocity",
    "trajectory_position",
    "trajectory_direction",
    "heading",
    "height",
    "custom",
]
Residual = Literal["squared", "absolute", "path"]
Beyond = Literal["clamp", "continue"]
Scaler = Literal["standard", "minmax", "none"]
Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]

KINDS: tuple[str, ...] = get_args(Kind)
TRAJECTORY = ("trajectory_position", "trajectory_direction")
MOST_SECONDS = 10.0
_WEIGHTS = "give 0, or a number from 0.000001 to 1,000,000"
_COMPONENTS = {
    "position": ("x", "y", "z"),
    "velocity": ("x", "y", "z"),
    "angular_velocity": ("x", "y", "z"),
    "heading": ("x", "z"),
    "height": (),
}


@dataclass(frozen=True)
class Feature:
    """One block of columns.

    Attributes
    ----------
    name : unique in its schema.
    kind : what it measures, all in the frame of the ground root (origin on the ground, +Z the facing):
        "position", "velocity", "angular_velocity" of a joint (x, y, z; m, m/s, rad/s; the rates are the
        world's, expressed in the root's frame), "heading" (x, z of a joint's forward axis), "height" of a
        joint (m), "trajectory_position", "trajectory_direction" (x, z of the ground root and of its facing
        at `times`), or "custom".
    role : the joint, for the kinds that have one.
    times : seconds from now, for the trajectory kinds: past negative, present 0, future positive.
    weight : divides the scale, so that it multiplies differences (REFERENCE 2.2); 0: does not count.
    residual : how a difference d of normalised values becomes a cost: "squared" |d|^2, "absolute" |d|, and
        for trajectory positions "path": the sum of |d| over the samples and over the steps between them.
    group : features of one group share their scale; by default each feature has its own.
    scaler : "standard", "minmax" or "none" (raw units), see `features.normalise`.
    beyond : trajectory samples beyond the clip's end: "clamp" to its end frame (REFERENCE 2.2), or "continue"
        at the speed and turn rate that it ends with, which keeps short clips of steady motion usable.
    axis : the joint's own axis that is its forward, for "heading".
    function : name under which `register` knows a custom feature.
    columns : a custom feature's column names; taken from the registration when left out.
    """

    name: str
    kind: Kind
    role: str | None = None
    times: tuple[float, ...] = ()
    weight: float = 1.0
    residual: Residual = "squared"
    group: str | None = None
    scaler: Scaler = "standard"
    beyond: Beyond = "clamp"
    axis: Axis = "+z"
    function: str | None = None
    columns: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        config.validate(self)
        if not self.name:
            raise ConfigError("name", "a feature needs a name")
        if not (self.weight == 0 or 1e-6 <= self.weight <= 1e6):
            raise ConfigError("weight", f"expected 0 or more, found {self.weight:g}", remedy=_WEIGHTS)
        allowed = {"role": self.kind in _COMPONENTS, "times": self.kind in TRAJECTORY}
        allowed |= {"function": self.kind == "custom", "columns": self.kind == "custom"}
        for key, wanted in allowed.items():
            given = bool(getattr(self, key))
            if given and not wanted:
                raise ConfigError(key, f"a {self.kind!r} feature has no {key}")
            if wanted and not given and key != "columns":
                raise ConfigError(key, f"a {self.kind!r} feature needs a {key}", remedy=_remedy(key))
        if self.role is not None and self.role not in ROLES:
            raise ConfigError("role", f"{self.role!r} is no joint role", remedy=choices(ROLES))
        if not np.all(np.isfinite(self.times)) or np.any(np.diff(self.times) <= 0):
            raise ConfigError("times", "expected increasing finite numbers of seconds")
        if np.any(np.abs(self.times) > MOST_SECONDS):
            raise ConfigError("times", f"expected at most {MOST_SECONDS:g} s from now")
        if self.residual == "path" and self.kind != "trajectory_position":
            remedy = choices(("squared", "absolute"))
            raise ConfigError("residual", '"path" is for trajectory_position', remedy=remedy)
        if self.beyond != "clamp" and self.kind not in TRAJECTORY:
            raise ConfigError("beyond", f"a {self.kind!r} feature has no beyond")
        if self.axis != "+z" and self.kind != "heading":
            raise ConfigError("axis", f"a {self.kind!r} feature has no axis")
        if self.function is not None and not self.columns:
            if self.function not in custom.names():
                what = f"no custom feature function {self.function!r} is registered"
                raise ConfigError("function", what, remedy=choices(custom.names()))
            object.__setattr__(self, "columns", custom.find(self.function).columns)

    def column_names(self) -> tuple[str, ...]:
        """Names such as ``left_foot.position.x`` and ``trajectory.direction[+0.667].z``."""
        if self.kind == "custom":
            return tuple(f"{self.name}.{column}" for column in self.columns)
        if self.kind in TRAJECTORY:
            what = self.kind.removeprefix("trajectory_")
            return tuple(f"trajectory.{what}[{t + 0.0:+.3f}].{axis}" for t in self.times for axis in "xz")
        stem = f"{self.role}.{self.kind}"
        return tuple(f"{stem}.{axis}" for axis in _COMPONENTS[self.kind]) or (stem,)

    def to_dict(self) -> dict[str, Any]:
        """Plain data without what is at its default."""
        defaults = {f.name: f.default for f in dataclasses.fields(self)}
        return {key: value for key, value in config.to_dict(self).items() if _differs(value, defaults[key])}


@dataclass(frozen=True)
class TrajectoryLayout:
    """Where a schema's trajectory samples stand.

    Attributes
    ----------
    times : float64 [K], seconds from now, increasing; every time that any trajectory feature samples.
    position_columns, direction_columns : int64 [K], the column of x (z is the next one), -1: not sampled.
    """

    times: NDArray[np.float64]
    position_columns: NDArray[np.int64]
    direction_columns: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.times)


@dataclass(frozen=True)
class Schema:
    """Named features in column order."""

    name: str
    features: tuple[Feature, ...] = field(default_factory=tuple)

    def __post_init__(self) -> None:
        config.validate(self)
        if not self.features:
            raise ConfigError("features", "a schema needs at least one feature")
        seen: dict[str, str] = {}
        scalers: dict[str, str] = {}
        for i, feature in enumerate(self.features):
            if feature.name in [f.name for f in self.features[:i]]:
                raise ConfigError(("features", i, "name"), f"two features are named {feature.name!r}")
            for column in feature.column_names():
                if column in seen:
                    what = f"features {seen[column]!r} and {feature.name!r} both have the column {column}"
                    raise ConfigError(("features", i), what)
                seen[column] = feature.name
            if scalers.setdefault(feature.group or feature.name, feature.scaler) != feature.scaler:
                what = f"the group {feature.group or feature.name!r} mixes scalers"
                raise ConfigError(("features", i, "scaler"), what)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """F column names."""
        return tuple(column for feature in self.features for column in feature.column_names())

    @property
    def size(self) -> int:
        """F, the number of columns."""
        return len(self.columns)

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Columns of each feature, by its name, in order."""
        slices, start = {}, 0
        for feature in self.features:
            stop = start + len(feature.column_names())
            slices[feature.name] = slice(start, stop)
            start = stop
        return slices

    def groups(self) -> dict[str, tuple[Feature, ...]]:
        """Features that share their scale, by group name (a feature on its own: its name)."""
        groups: dict[str, tuple[Feature, ...]] = {}
        for feature in self.features:
            name = feature.group or feature.name
            groups[name] = (*groups.get(name, ()), feature)
        return groups

    def pose_columns(self) -> NDArray[np.int64]:
        """Columns that describe the pose: all but the trajectory's."""
        return self._columns_of(lambda feature: feature.kind not in TRAJECTORY)

    def trajectory_columns(self) -> NDArray[np.int64]:
        """Columns of the trajectory features."""
        return self._columns_of(lambda feature: feature.kind in TRAJECTORY)

    def _columns_of(self, wanted: Callable[[Feature], bool]) -> NDArray[np.int64]:
        found = [np.arange(self.size)[self.slices[f.name]] for f in self.features if wanted(f)]
        return np.concatenate(found) if found else np.zeros(0, np.int64)

    def trajectory(self) -> TrajectoryLayout:
        """Where the trajectory samples stand; times that print alike to the millisecond are one."""
        at: dict[int, list] = {}
        for feature in self.features:
            if feature.kind in TRAJECTORY:
                for i, time in enumerate(feature.times):
                    entry = at.setdefault(round(1000 * time), [time, -1, -1])
                    entry[1 + TRAJECTORY.index(feature.kind)] = self.slices[feature.name].start + 2 * i
        rows = [at[key] for key in sorted(at)]
        return TrajectoryLayout(
            np.array([row[0] for row in rows], np.float64),
            np.array([row[1] for row in rows], np.int64),
            np.array([row[2] for row in rows], np.int64),
        )

    def roles(self) -> tuple[str, ...]:
        """Joint roles that the features name, each once."""
        return tuple(dict.fromkeys(feature.role for feature in self.features if feature.role is not None))

    @property
    def euclidean(self) -> bool:
        """Whether the total cost is the squared Euclidean distance of normalised vectors."""
        return all(feature.residual == "squared" for feature in self.features)

    @property
    def fingerprint(self) -> str:
        """Hash (hex) of the whole description."""
        return files.fingerprint({}, self.to_dict())

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as TOML holds it; `from_dict` reads it back."""
        return {"name": self.name, "features": [feature.to_dict() for feature in self.features]}

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Schema:
        return config.from_dict(Schema, data)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write as TOML, atomically."""
        config.dump(self.to_dict(), path)


def _differs(value: Any, default: Any) -> bool:
    return value != (list(default) if isinstance(default, tuple) else default)


def _remedy(key: str) -> str:
    if key == "role":
        return choices(ROLES)
    if key == "function":
        return choices(custom.names())
    return "give seconds from now, such as times = [0.2, 0.4]"
