"""Ready-made schemas, and finding one by its name or file."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import Any

from motion import config, files
from motion.config import choices
from motion.errors import UserError

from .schema import Beyond, Feature, Schema


def names() -> tuple[str, ...]:
    """Names of the ready-made schemas."""
    return tuple(_BUILDERS)


@cache
def get(name: str) -> Schema:
    """A ready-made schema; a UserError lists them."""
    if name not in _BUILDERS:
        raise UserError(f"no schema {name!r}", remedy=choices(_BUILDERS))
    return _BUILDERS[name]()


def load(name_or_path: str | os.PathLike[str]) -> Schema:
    """A ready-made schema by name, or one of a TOML file."""
    if str(name_or_path) in names():
        return get(str(name_or_path))
    path = Path(name_or_path)
    if not path.suffix and files.kind(path) is None:
        raise UserError(f"no schema {str(name_or_path)!r}", remedy=f"{choices(names())}, or give a TOML file")
    return config.load(Schema, path)


def _lmm27(name: str = "lmm27", beyond: Beyond = "clamp") -> Schema:
    """Learned Motion Matching's features (REFERENCE 2.2): 20, 40, 60 frames ahead at 60 Hz."""
    times = (1 / 3, 2 / 3, 1.0)
    return Schema(
        name,
        (
            Feature("left_foot_position", "position", "left_foot", weight=0.75),
            Feature("right_foot_position", "position", "right_foot", weight=0.75),
            Feature("left_foot_velocity", "velocity", "left_foot"),
            Feature("right_foot_velocity", "velocity", "right_foot"),
            Feature("hips_velocity", "velocity", "hips"),
            Feature("trajectory_position", "trajectory_position", times=times, beyond=beyond),
            Feature("trajectory_direction", "trajectory_direction", times=times, weight=1.5, beyond=beyond),
        ),
    )


def _o3de59() -> Schema:
    """O3DE's features (REFERENCE 2.3): 4 past samples over 0.7 s, the present, 6 future ones over 1.2 s.

    Its trajectory cost, weight x (position + step + twice the direction residual), is split by what adds up:

    - "path" is the position and step residual, past and future apart because their weights differ. They
      share a scale, so a metre weighs the same in both.
    - The direction residual is (1 - a.b) / 2 for unit vectors, and 1 - a.b = |a - b|^2 / 2. So twice it,
      times weight w, is |a - b|^2 with "squared" residual, raw units and a weight of sqrt(w / 2), exactly.

    What differs: scales are shared within a block (REFERENCE 2.2) where O3DE scales each column; columns
    stand feature by feature, not sample by sample; the steps from the last past sample to the present and
    from there to the first future one are not counted (the present being the origin, they would repeat the
    position residual).
    """
    past = (-0.7, -0.525, -0.35, -0.175)
    future = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)
    now = (0.0,)
    raw: dict[str, Any] = {"scaler": "none", "kind": "trajectory_direction"}
    path: dict[str, Any] = {"residual": "path", "kind": "trajectory_position", "group": "trajectory"}
    joint: dict[str, Any] = {"residual": "absolute"}
    return Schema(
        "o3de59",
        (
            Feature("past_position", times=past, weight=0.5, **path),
            Feature("past_direction", times=past, weight=0.25**0.5, **raw),
            Feature("present_position", "trajectory_position", times=now),
            Feature("present_direction", times=now, **raw),
            Feature("future_position", times=future, weight=0.75, **path),
            Feature("future_direction", times=future, weight=0.375**0.5, **raw),
            Feature("left_foot_position", "position", "left_foot", **joint),
            Feature("right_foot_position", "position", "right_foot", **joint),
            Feature("left_foot_velocity", "velocity", "left_foot", weight=0.75, **joint),
            Feature("right_foot_velocity", "velocity", "right_foot", weight=0.75, **joint),
            Feature("hips_velocity", "velocity", "hips", **joint),
        ),
    )


def _mm27() -> Schema:
    """The same 27 numbers, but trajectories go on where a clip ends.

    Clamped ones tell of a stop that is none: a character that should stand then walks on the spot at the end
    of some clip, and short clips of steady motion are never found by their speed.
    """
    return _lmm27("mm27", "continue")


def _quadruped39() -> Schema:
    """The 39 numbers of four feet: as mm27, with the front paws. A quadruped's front legs are its arms."""
    feet = [f"{side}_{part}" for part in ("foot", "hand") for side in ("left", "right")]
    *_, hips, position, direction = _mm27().features
    return Schema(
        "quadruped39",
        (
            *(Feature(f"{foot}_position", "position", foot, weight=0.75) for foot in feet),
            *(Feature(f"{foot}_velocity", "velocity", foot) for foot in feet),
            *(hips, position, direction),
        ),
    )


_BUILDERS = {"mm27": _mm27, "lmm27": _lmm27, "o3de59": _o3de59, "quadruped39": _quadruped39}
