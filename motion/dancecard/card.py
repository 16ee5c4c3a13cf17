"""The dance card: which moves are danced, so that a controller finds what it will ask for.

A passage is half a minute of one kind of move, from a stand to a stand, after the routines that games with
motion matching were captured with: straight ways at many speeds, curves, starts, stops, turns on the spot,
pivots, side and backward steps in eight directions, changes of gait. One round of the card is ten minutes. In
the next round left and right change places, speeds and turns are others, and someone else dances.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from .path import Move

Moves = list[Move]


def stand(seconds: float, change: float = 1.0) -> Move:
    """Stand still after whatever was before."""
    return Move(seconds, change=change)


def walk_straight() -> Moves:
    speeds = (1.3, 1.0, 0.75, 0.5, 1.15, 1.6, 2.0, 1.75)
    return [stand(0.8), *(Move(3.5, v, change=1.1) for v in speeds), stand(2.0)]


def jog_straight() -> Moves:
    speeds = (2.5, 3.0, 3.5, 4.0, 4.5, 3.75, 2.75)
    return [stand(0.8), *(Move(3.5, v, gait="run", change=1.3) for v in speeds), stand(2.8, 1.7)]


def walk_curves() -> Moves:
    rates = ((30, 3.2), (-30, 3.2), (60, 2.8), (-60, 2.8), (90, 2.4), (-90, 2.4), (120, 2.0), (-120, 2.0))
    return [
        stand(0.8),
        Move(2.0, 1.4),
        *(Move(s, 1.35, turn=r * s) for r, s in rates),
        Move(1.5, 1.4),
        stand(1.8),
    ]


def walk_starts() -> Moves:
    dance: Moves = [stand(1.0)]
    for speed, change in ((1.4, 1.0), (1.8, 0.9), (1.0, 1.0), (1.6, 0.7), (0.7, 0.9), (2.0, 1.0)):
        dance += [Move(1.2 + change, speed, change=change), stand(1.2 + change, change)]
    return dance


def strafes() -> Moves:
    dance: Moves = [stand(0.8)]
    for degrees, speed in ((90, 0.8), (-90, 1.0), (180, 0.9), (45, 1.1), (-135, 0.8), (-45, 1.0), (135, 0.9)):
        dance += [_toward(degrees, speed, 2.6, 0.9), stand(1.2, 0.8)]
    return dance


def turns_on_the_spot() -> Moves:
    dance: Moves = [stand(0.8)]
    for degrees, seconds in zip(
        (90, -90, 45, -180, 135, 180, -45, -135, -90),
        (1.1, 1.0, 0.8, 1.6, 1.2, 1.25, 0.7, 1.0, 0.8),
        strict=True,
    ):
        dance += [Move(seconds + 0.2, turn=degrees, pivot=True, change=seconds * 1.25), stand(1.6)]
    return [*dance, Move(3.0, turn=180), stand(0.6)]


def starts_to_all_sides() -> Moves:
    dance: Moves = [stand(0.8)]
    for degrees, speed in ((45, 1.4), (-90, 1.4), (135, 1.3), (180, 1.4), (-45, 1.7), (90, 1.7)):
        dance += [
            Move(2.4, speed, turn=degrees, pivot=True, change=0.75 + abs(degrees) / 240),
            stand(2.2, 1.0),
        ]
    return dance


def walk_pivots() -> Moves:
    dance: Moves = [stand(0.6), Move(2.2, 1.4)]
    for degrees, speed in zip(
        (90, -90, 135, -180, 180, -135, 60, -45), (1.4, 1.3, 1.4, 1.4, 1.5, 1.6, 1.7, 1.6), strict=True
    ):
        dance += _pivot(degrees, speed, "walk")
    return [*dance, stand(1.6)]


def gait_changes() -> Moves:
    return [
        stand(0.6),
        Move(2.5, 1.4),
        Move(3.0, 3.0, gait="run", change=1.1),
        Move(2.8, 1.6, change=1.1),
        Move(3.0, 4.0, gait="run", change=1.4),
        Move(3.0, 1.2, change=1.5),
        Move(2.6, 2.4, gait="run", change=1.0),
        Move(2.6, 2.0, change=0.9),
        Move(2.6, 3.4, gait="run", change=1.0),
        Move(2.5, 0.9, change=1.3),
        Move(2.6, 2.7, gait="run", change=1.1),
        stand(2.4, 1.2),
    ]


def jog_curves() -> Moves:
    curves = zip(
        (3.0, 3.0, 2.7, 2.7, 3.8, 3.8, 3.5, 3.5, 2.5, 2.5),
        (40, -40, 80, -80, 30, -30, 65, -65, 110, -110),
        (3.0, 3.0, 2.4, 2.4, 3.0, 3.0, 2.6, 2.6, 1.8, 1.8),
        strict=True,
    )
    return [
        stand(0.6),
        Move(2.0, 3.0, gait="run", change=1.2),
        *(Move(s, v, turn=r * s, gait="run") for v, r, s in curves),
        stand(2.2, 1.3),
    ]


def jog_starts() -> Moves:
    dance: Moves = [stand(0.8)]
    for speed, change in ((3.0, 1.2), (3.8, 1.5), (2.5, 1.0), (4.4, 1.8)):
        dance += [Move(1.3 + change, speed, gait="run", change=change), stand(1.7 + change, change)]
    for degrees in (90, -135):
        dance += [Move(2.4, 3.0, turn=degrees, pivot=True, gait="run", change=1.2), stand(2.6, 1.1)]
    return dance


def backward() -> Moves:
    return [
        stand(0.8),
        Move(3.0, -0.6),
        Move(3.0, -1.0),
        Move(2.5, -1.3),
        stand(2.0),
        Move(3.0, -0.9, turn=90),
        Move(3.0, -0.9, turn=-90),
        stand(1.8, 0.8),
        Move(2.2, -0.8, turn=130),
        Move(2.2, -0.8, turn=-130),
        Move(2.0, -1.1, change=0.8),
        Move(2.4, 1.2, change=1.2),
        Move(2.4, -1.0, change=1.2),
        stand(1.8),
    ]


def strafe_changes() -> Moves:
    order = (0, 90, 180, -90, 45, -135, 135, -45, -90, 90, 0, 180)
    return [stand(0.6), *(_toward(d, 1.05 - 0.002 * abs(d), 2.2, 1.1) for d in order), stand(1.6)]


def strafe_turns() -> Moves:
    dance: Moves = [stand(0.8)]
    for degrees, turn in zip(
        (90, -90, 90, -90, 45, -45, 135, -135), (-45, 45, 45, -45, 60, -60, 50, -50), strict=True
    ):
        dance.append(replace(_toward(degrees, 0.9, 3.0, 1.0), turn=turn * 3.0))
    return [*dance, stand(2.0)]


def crouched() -> Moves:
    return [
        stand(0.8),
        Move(1.6, gait="crouch", change=0.9),
        Move(3.0, 0.7, gait="crouch"),
        Move(2.6, 1.1, gait="crouch"),
        Move(2.4, 1.0, turn=100, gait="crouch"),
        Move(2.4, 1.0, turn=-100, gait="crouch"),
        Move(2.4, 0.45, gait="crouch"),
        Move(1.8, gait="crouch"),
        Move(2.4, 1.2, gait="crouch", change=0.8),
        Move(1.8, gait="crouch", change=0.8),
        Move(1.5, turn=90, pivot=True, change=1.1, gait="crouch"),
        Move(1.5, turn=-135, pivot=True, change=1.2, gait="crouch"),
        Move(2.5, 0.9, turn=60, gait="crouch"),
        Move(2.0, 1.4),
        stand(1.6),
    ]


def jog_pivots() -> Moves:
    dance: Moves = [stand(0.6), Move(2.2, 3.0, gait="run", change=1.2)]
    for degrees, speed in zip(
        (90, -90, 135, -135, 180, -180, 45, -60), (3.0, 3.2, 2.8, 3.0, 3.0, 2.7, 3.6, 3.4), strict=True
    ):
        dance += _pivot(degrees, speed, "run")
    return [*dance, stand(2.2, 1.2)]


def slow_ways() -> Moves:
    return [
        stand(0.8),
        Move(3.0, 0.5, turn=60),
        Move(3.0, 0.5, turn=-120),
        Move(2.1, 0.8, turn=230),
        Move(2.1, 0.8, turn=-230),
        stand(1.5),
        Move(2.6, 1.8, turn=80),
        Move(2.6, 1.8, turn=-80),
        Move(2.2, 1.8, turn=150),
        Move(2.2, 1.8, turn=-150),
        Move(2.0, 0.4),
        Move(2.2, 0.9, turn=-20),
        stand(2.0),
    ]


def crouched_aside() -> Moves:
    dance: Moves = [stand(0.6), Move(1.4, gait="crouch", change=0.9)]
    for degrees, speed in ((90, 0.7), (-90, 0.7), (180, 0.7), (45, 0.8), (-135, 0.6), (-45, 0.8), (135, 0.6)):
        dance.append(replace(_toward(degrees, speed, 2.0, 1.0), gait="crouch"))
        dance.append(Move(1.0, gait="crouch", change=0.8))
    return [
        *dance,
        Move(2.2, 2.6, gait="run", change=1.2),
        Move(2.0, 0.9, gait="crouch", change=1.2),
        stand(1.6),
    ]


def quick_aside() -> Moves:
    dance: Moves = [stand(0.6)]
    for degrees, speed in ((90, 1.4), (-90, 1.4), (180, 1.6), (45, 1.7), (-135, 1.4), (-45, 1.7), (135, 1.4)):
        dance.append(_toward(degrees, speed, 2.0, 0.9))
        dance.append(stand(1.0, 0.8))
    return [*dance, Move(2.2, -1.7, change=1.0), Move(2.4, 1.7, turn=180, pivot=True, change=1.3), stand(1.8)]


def jog_aside() -> Moves:
    dance: Moves = [stand(0.6), Move(1.8, 2.6, gait="run", change=1.1)]
    for degrees, speed in zip(
        (30, -30, 50, -50, 90, -90, 135, -135, 180),
        (2.6, 2.8, 2.3, 2.2, 2.0, 2.0, 1.9, 1.9, 2.0),
        strict=True,
    ):
        dance.append(replace(_toward(degrees, speed, 2.2, 1.0), gait="run"))
    return [
        *dance,
        Move(2.0, 2.6, turn=180, pivot=True, swerve=True, gait="run", change=1.1),
        stand(1.8, 1.2),
    ]


def idle() -> Moves:
    return [
        stand(7.0),
        Move(1.0, turn=25, pivot=True, change=1.0),
        stand(4.5),
        Move(1.2, 0.35, change=0.8),
        stand(4.0),
        Move(1.0, turn=-30, pivot=True, change=1.0),
        stand(3.5),
        Move(1.2, -0.3, change=0.8),
        stand(3.5),
    ]


CARD: tuple[Callable[[], Moves], ...] = (
    walk_straight,
    walk_curves,
    jog_straight,
    strafes,
    walk_starts,
    turns_on_the_spot,
    jog_curves,
    gait_changes,
    walk_pivots,
    backward,
    starts_to_all_sides,
    jog_starts,
    strafe_changes,
    crouched,
    jog_pivots,
    slow_ways,
    strafe_turns,
    jog_aside,
    idle,
    crouched_aside,
    quick_aside,
)


def passages(rng: np.random.Generator) -> Iterator[tuple[str, Moves]]:
    """Name and moves of one passage after the other, without end."""
    turn = 0
    while True:
        for dance in CARD:
            hand = -1.0 if turn % 2 else 1.0
            spread = 0.03 if turn == 0 else 0.10
            name = dance.__name__.replace("_", "-") + (f"-{turn + 1}" if turn else "")
            yield name, [_varied(move, hand, spread, rng) for move in dance()]
        turn += 1


def _varied(move: Move, hand: float, spread: float, rng: np.random.Generator) -> Move:
    """The same move at about the same speed and turn, on the hand's side."""
    pace, bend, length = 1 + spread * rng.uniform(-1, 1, 3)
    return replace(
        move,
        seconds=move.seconds * length,
        ahead=move.ahead * pace,
        left=move.left * pace * hand,
        turn=move.turn * bend * hand,
    )


def _toward(degrees: float, speed: float, seconds: float, change: float) -> Move:
    """Go to a side of where one faces, 90 to the left."""
    angle = np.radians(degrees)
    return Move(seconds, float(speed * np.cos(angle)), float(speed * np.sin(angle)), change=change)


def _pivot(degrees: float, speed: float, gait: str) -> Moves:
    """Turn about a planted foot while the body still goes on, and follow."""
    seconds = 0.6 + abs(degrees) * speed / 500
    return [
        Move(seconds + 0.1, speed, turn=degrees, pivot=True, swerve=True, gait=gait, change=seconds),
        Move(1.7, speed, gait=gait, change=0.9),
    ]
