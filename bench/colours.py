"""One colour a system, the same in all figures of a page; those of a family are of one hue."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable

# Hue of each family, and how far its members may stand from it; of turns.
HUES = {"mm": 0.56, "small": 0.42, "lmm": 0.06, "pfnn": 0.77, "mann": 0.92, "other": 0.16}
SPREAD, DARKEST, LIGHTEST, SATURATION = 0.05, 0.4, 0.66, 0.62  # such that all are seen on white and on black


def family(name: str) -> str:
    """The family of a system by its name: mm in a whole database, small in a compressed one, or a model's."""
    from mm import search

    first, _, rest = name.partition("-")
    if first == "mm":
        return "mm" if rest.removesuffix("-free") in search.names() else "small"
    return first if first in HUES else "other"


def of(names: Iterable[str]) -> dict[str, str]:
    """Colours by name; members of a family go from dark to light in the order of the names."""
    members: dict[str, list[str]] = {}
    for name in dict.fromkeys(names):
        members.setdefault(family(name), []).append(name)
    out = {}
    for kind, own in members.items():
        for i, name in enumerate(own):
            share = i / max(len(own) - 1, 1) if len(own) > 1 else 0.4
            hue = HUES[kind] + SPREAD * (share - 0.5)
            light = DARKEST + (LIGHTEST - DARKEST) * share
            red, green, blue = colorsys.hls_to_rgb(hue % 1, light, SATURATION)
            out[name] = f"#{round(255 * red):02x}{round(255 * green):02x}{round(255 * blue):02x}"
    return out
