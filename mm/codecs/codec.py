"""Which codec: how the numbers are stored, whether rates are, which frames are, and how features are."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from motion.errors import UserError

FEATURES = ("float32", "float16", "8bit", "pq")
FEWEST_BITS, MOST_BITS = 6, 18  # a quaternion and the bits before it in its first byte fit 64
KNOWN = "float32, float16, recomputed, quantised-BITS, keyframes-CM, features-KIND"


@dataclass(frozen=True)
class Codec:
    """How a database is stored.

    Attributes
    ----------
    numbers : float32, float16, or "quantised": rotations as smallest three, translations of 16 bits where
        they are not constant.
    bits : of each of the smallest three; 0 unless quantised.
    recomputed : whether joints' velocities are differences of the poses decoded, or stored.
    keyframes : error in cm within which frames are interpolated (`mm.codecs.keyframes`); None stores all.
    features : float32, float16, 8bit (a column) or pq (product quantisation).
    """

    numbers: str = "float32"
    bits: int = 0
    recomputed: bool = False
    keyframes: float | None = None
    features: str = "float32"

    @property
    def name(self) -> str:
        """The poses' codec, as `parse` takes it."""
        words = []
        if self.keyframes is not None:
            words.append(f"keyframes-{self.keyframes!r}".removesuffix(".0"))
        if self.numbers == "quantised":
            words.append(f"quantised-{self.bits}")
        elif self.numbers != "float32":
            words.append(self.numbers)
        if self.recomputed and self.keyframes is None and self.numbers != "quantised":
            words.append("recomputed")
        return "+".join(words) or "float32"

    @property
    def whole_name(self) -> str:
        """The codec of poses and features, as `parse` takes it."""
        return self.name + (f"+features-{self.features}" if self.features != "float32" else "")


def parse(names: str | Sequence[str], *, features: str = "float32") -> Codec:
    """The codec of names, each one or several with "+" between: "keyframes-0.5+quantised-11+features-8bit".

    quantised and keyframes recompute velocities, too. features are what no name says of them. Unknown names
    and two that exclude each other are UserErrors.
    """
    words = [w for name in ([names] if isinstance(names, str) else names) for w in name.split("+")]
    numbers, bits, recomputed, keyframes, said = "", 0, False, None, ""
    for word in words:
        kind, _, value = word.partition("-")
        if (kind in ("float32", "float16") and not value) or (kind == "quantised" and value.isdecimal()):
            if numbers:
                raise UserError(
                    f"codec {'+'.join(words)!r} stores numbers in two ways", remedy="choose one of them"
                )
            numbers, bits = kind, int(value or 0)
            if kind == "quantised" and not FEWEST_BITS <= bits <= MOST_BITS:
                raise UserError(
                    f"{bits} bits a component", remedy=f"give a number from {FEWEST_BITS} to {MOST_BITS}"
                )
        elif word == "recomputed" and not recomputed:
            recomputed = True
        elif kind == "keyframes" and re.fullmatch(r"\d+(\.\d+)?", value) and keyframes is None:
            keyframes = float(value)
            if not 0.001 <= keyframes <= 100:
                raise UserError(f"an error of {value} cm", remedy="give one from 0.001 to 100")
        elif kind == "features" and value and not said:
            features = said = value
        else:
            raise UserError(f"no codec {word!r}", remedy=f"choose from {KNOWN}, or chain them with +")
    if features not in FEATURES:
        raise UserError(f"no codec of features {features!r}", remedy=f"choose from {', '.join(FEATURES)}")
    numbers = numbers or "float32"
    recomputed = recomputed or numbers == "quantised" or keyframes is not None
    return Codec(numbers, bits, recomputed, keyframes, features)
