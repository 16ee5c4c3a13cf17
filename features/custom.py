"""Custom features: callables known by name, so that a schema in a file can refer to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motion.errors import UserError

from .context import Context

Function = Callable[[Context], NDArray[np.floating]]


@dataclass(frozen=True)
class Custom:
    """A registered callable: takes `features.context.Context` of T frames, returns [T, len(columns)]."""

    function: Function
    columns: tuple[str, ...]


_registry: dict[str, Custom] = {}


def register(name: str, function: Function, *, columns: Sequence[str]) -> None:
    """Make a callable known to schemas under a name; registering a name again replaces it."""
    if isinstance(columns, str) or not columns or len(set(columns)) != len(columns):
        raise ValueError(f"custom feature {name!r}: columns {columns!r}, expected distinct names")
    _registry[name] = Custom(function, tuple(columns))


def names() -> tuple[str, ...]:
    """Names registered so far."""
    return tuple(sorted(_registry))


def find(name: str) -> Custom:
    """The callable of a name; a UserError lists those known."""
    if name not in _registry:
        known = ", ".join(names()) or "none"
        raise UserError(
            f"no custom feature function {name!r} is registered (known: {known})",
            remedy="call features.schema.register(name, function, columns=...) first",
        )
    return _registry[name]
