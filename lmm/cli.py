"""``python -m lmm``: train the networks of Learned Motion Matching, judge, exchange and run them."""

from __future__ import annotations

from motion import console


@console.group("lmm", "Learned Motion Matching: train networks from a motion database, judge and run them.")
def main() -> None:
    pass
