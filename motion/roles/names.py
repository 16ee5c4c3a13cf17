"""What the name of a joint says about it."""

from __future__ import annotations

import functools
import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .vocabulary import ARM_WORDS, CENTER_WORDS, FILLER, HELPERS, LEG_WORDS, QUARTERS, SIDE_WORDS, STUCK

MOST_WORDS = 24  # of a name; all runs of its words are looked up


@dataclass(frozen=True)
class Name:
    """What a joint's name says: its side, front or hind, its part's word and how many words are left."""

    side: str | None
    quarter: str | None
    word: str
    left_over: int
    helper: bool


def _tokens(name: str) -> list[str]:
    name = name.rsplit(":", 1)[-1].rsplit("|", 1)[-1]
    words = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+", name)
    return [word.lower() for word in words[:MOST_WORDS]]


@functools.lru_cache(maxsize=4096)
def side_and_rest(name: str) -> tuple[str | None, tuple[str, ...]]:
    """Side that a joint's name states (left, right or None) and its other words, lower case.

    ``LeftUpLeg``, ``thigh_l``, ``Bip01 L Thigh`` and ``lfemur`` all state the left.
    """
    known = {**LEG_WORDS, **ARM_WORDS}
    side, rest = None, []
    for token in _tokens(name):
        if side is None and token in SIDE_WORDS:
            side = SIDE_WORDS[token]
            continue
        if side is None:
            for mark in ("left", "right", "l", "r"):
                front, back = token.removeprefix(mark), token.removesuffix(mark)
                long = len(mark) > 1
                if front != token and (front in known or front in STUCK or (long and front)):
                    side, token = SIDE_WORDS[mark], front
                    break
                if back != token and (back in known or (long and back)):
                    side, token = SIDE_WORDS[mark], back
                    break
        rest.append(token)
    return side, tuple(rest)


def read_names(names: Sequence[str]) -> list[Name]:
    split = [side_and_rest(name) for name in names]
    counts = Counter(t for _, rest in split for t in set(rest))
    common = {t for t, n in counts.items() if len(names) >= 8 and n > 0.6 * len(names)}
    common -= {*LEG_WORDS, *ARM_WORDS}  # all forty joints of two hands may have "hand" in their names
    words = {t for _, rest in split for t in rest}
    quarters: dict[str, tuple[str, str]] = {}
    if "fl" in words and words & {"bl", "hl", "rl"}:
        for kind, (left, right) in QUARTERS.items():
            quarters |= {left: ("left", kind[0]), right: ("right", kind[0])}
    return [_read(side, rest, common, quarters) for side, rest in split]


def _read(
    side: str | None, rest: tuple[str, ...], common: set[str], quarters: Mapping[str, tuple[str, str]]
) -> Name:
    quarter, tokens = None, []
    for token in rest:
        if token in quarters:
            side, quarter = quarters[token]
        elif token in ("front", "fore") and "arm" not in rest:
            quarter = "f"
        elif token in ("hind", "rear", "back") and len(rest) > 1 and set(rest) & {"leg", *LEG_WORDS}:
            quarter = "h"
        elif token == "foreleg":
            quarter = "f"
            tokens.append("leg")
        elif not token.isdigit() and token not in common:
            tokens.append(token)
    useful = [t for t in tokens if t not in FILLER] or tokens
    known = {**LEG_WORDS, **ARM_WORDS, **CENTER_WORDS}
    spans = sorted(itertools.combinations(range(len(useful) + 1), 2), key=lambda s: s[0] - s[1])
    for start, stop in spans:
        word = "".join(useful[start:stop])
        if word in known or (stop - start == 2 and "".join(useful[start:stop][::-1]) in known):
            others = useful[:start] + useful[stop:]
            return Name(side, quarter, word, len(others), bool(set(others) & HELPERS))
    return Name(side, quarter, "", len(useful), bool(set(useful) & HELPERS))
