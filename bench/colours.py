"""One colour a system, the same in all figures of a page; those of a family are of one hue and one mark."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable
from typing import NamedTuple


class Shade(NamedTuple):
    """Of a family: its hue (of turns), how dark and light members are, their saturation, and its mark."""

    hue: float
    darkest: float
    lightest: float
    saturation: float
    mark: str


# Such that all are seen on white and on black, and that families are told apart by who sees two colours only.
SHADES = {
    "mm": Shade(0.587, 0.39, 0.71, 0.83, "s"),
    "small": Shade(0.148, 0.27, 0.44, 0.74, "o"),
    "lmm": Shade(0.006, 0.395, 0.755, 0.535, "D"),
    "pfnn": Shade(0.89, 0.315, 0.435, 0.82, "^"),
    "mann": Shade(0.744, 0.53, 0.685, 0.90, "v"),
    "other": Shade(0.4, 0.25, 0.5, 0.5, "P"),
}
SPREAD = 0.05  # of turns, by which the hues of a family's members differ


def family(name: str) -> str:
    """The family of a system by its name: mm in a whole database, small in a compressed one, or a model's."""
    from mm import search

    first, _, rest = name.partition("-")
    if first == "mm":
        return "mm" if rest.removesuffix("-free") in search.names() else "small"
    return first if first in SHADES else "other"


def mark(name: str) -> str:
    """The mark of a system's points, as matplotlib calls it."""
    return SHADES[family(name)].mark


def of(names: Iterable[str]) -> dict[str, str]:
    """Colours by name; members of a family go from dark to light in the order of the names."""
    members: dict[str, list[str]] = {}
    for name in dict.fromkeys(names):
        members.setdefault(family(name), []).append(name)
    out = {}
    for kind, own in members.items():
        shade = SHADES[kind]
        for i, name in enumerate(own):
            share = i / (len(own) - 1) if len(own) > 1 else 0.4
            hue = shade.hue + SPREAD * (share - 0.5)
            light = shade.darkest + (shade.lightest - shade.darkest) * share
            red, green, blue = colorsys.hls_to_rgb(hue % 1, light, shade.saturation)
            out[name] = f"#{round(255 * red):02x}{round(255 * green):02x}{round(255 * blue):02x}"
    return out
