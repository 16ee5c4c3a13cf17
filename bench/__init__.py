"""The harness: memory, cost per frame and quality of every system on the same data.

``bench.compare(database, models={"lmm": model})`` measures; the `bench.comparison.Comparison` that it returns
holds tables as pandas has them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .comparison import compare

__all__ = ["compare"]


def __getattr__(name: str) -> Any:
    """What is public, imported as it is asked for: commands that compare nothing start without it."""
    if name in __all__:
        from . import comparison

        return getattr(comparison, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
