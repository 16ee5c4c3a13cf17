"""How much a comparison measures: in full within an hour on two cores, or quickly within two minutes."""

from __future__ import annotations

from dataclasses import dataclass

from mm.driving import COURSES, SECONDS


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Attributes are the arguments of `bench.compare` of these names.

    Search indexes and codecs are what is compared where nobody says which systems are.
    """

    courses: tuple[str, ...] = COURSES
    seconds: float = SECONDS
    timed_seconds: float = 5.0
    repeats: int = 3
    crowd: tuple[int, ...] = (1, 16, 256, 1024, 4096)
    crowd_seconds: float = 5.0
    indexes: tuple[str, ...] = ("exact",)
    codecs: tuple[str, ...] = (
        "recomputed",
        "quantised-16+features-8bit",
        "keyframes-0.5+quantised-11+features-8bit",
    )


FULL = Plan()
QUICK = Plan(
    courses=("circle", "star", "start-stop", "random"),
    seconds=10.0,
    timed_seconds=1.0,
    repeats=2,
    crowd=(1, 16, 256),
    crowd_seconds=1.0,
    codecs=("quantised-16+features-8bit",),
)
