"""Motion cut into passages by what the character does, told from the motion itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .body import Body

Array = NDArray[np.floating]

WALKS = (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0)  # m/s, middles of the bins
RUNS = (2.0, 2.5, 3.0, 3.5, 4.0, 4.5)
WALK_BIN, RUN_BIN = 0.125, 0.25  # half their widths
TURNING = 20.0  # degrees a second: below, it goes straight
TURNS = {45.0: "30", 90.0: "60", 180.0: "120"}  # turning faster than that has no name; what it is called
AHEAD, BACK, ASIDE = 20.0, 150.0, (60.0, 120.0)  # degrees between facing and travel
CROUCH = 0.85  # hip joints lower than this share of the leg; walks have 0.92 to 0.98
CYCLE = (0.4, 2.2)  # seconds that a stride may take
SLOWEST = 0.2  # m/s below which nobody walks
FLIGHT, SLOWEST_RUN = 0.04, 1.5  # share of a cycle in the air, and m/s, from which it is a run
HOP = 0.25  # slower than a run, but in the air for so much of the cycle: no walk either
STEADY = 0.4  # share of the speed, or of 1 m/s, by which it may change within a cycle

STAND_SPEED, STAND_TURN = 0.12, 15.0
STAND_SECONDS = 2.0  # pieces in which standing is compared
PIVOT_SPEED, PIVOT_TURN, PIVOT_SECONDS = 0.4, 45.0, 0.5
REST_SPEED, GO_SPEED, REST_SECONDS = 0.2, 0.7, 0.25  # a start leads from rest to at least go
BEFORE, AFTER = 0.4, 1.4  # seconds around the instant at which a start or a stop crosses the speed of rest


@dataclass(frozen=True, eq=False)
class Passage:
    """Frames [start, stop) of a body that do one move; a cycle goes from a strike to the same foot's next.

    speed m/s, turn degrees a second (left is positive) and angle, degrees between facing and travel (left is
    positive), are means. side is the foot that strikes where it is a cycle, else empty.
    """

    move: str
    body: Body
    start: int
    stop: int
    speed: float
    turn: float
    angle: float
    side: str = ""

    @property
    def seconds(self) -> float:
        return (self.stop - self.start) / self.body.fps

    @property
    def name(self) -> str:
        return f"{self.body.clip.name} at {self.start / self.body.fps:.1f} s"


def passages(body: Body) -> list[Passage]:
    """All that one body does that has a name, in no order."""
    return [*_cycles(body), *_stands(body), *_pivots(body), *_starts(body)]


def order(move: str) -> tuple[int, float, str]:
    """A key that puts moves as a reader expects them."""
    kinds = (
        *("stand", "walk", "run", "start", "stop", "start-run", "stop-run"),
        *("turn", "walk-turn", "run-turn"),
    )
    kind, _, speed = move.partition(" ")
    return (kinds.index(kind) if kind in kinds else len(kinds), float(speed or 0), move)


def unit(move: str) -> str:
    """A move's name with the unit of its number."""
    return move + (" °/s" if "-turn" in move else " m/s" if move[-1].isdigit() else "")


def strikes(body: Body, side: str) -> NDArray[np.int64]:
    """Frames at which a foot strikes.

    The instant at which the ankle is farthest ahead of the hips along the way travelled (Zeni et al. 2008:
    two simple methods for determining gait events, Gait & Posture 27), which holds in any direction; moved to
    the foot's nearest landing where there is one within 0.15 s.
    """
    from scipy.signal import find_peaks

    from mm import metrics

    fps = body.fps
    speed = np.linalg.norm(body.velocity, axis=-1)
    way = body.velocity / np.maximum(speed, 1e-6)[:, None]
    ahead = np.einsum("tc,tc->t", body.at(f"{side}_foot")[:, [0, 2]] - body.path, way)
    peaks, _ = find_peaks(
        metrics.smooth(ahead, fps, 0.08), distance=round(0.75 * CYCLE[0] * fps), prominence=0.08 * body.leg
    )
    peaks = peaks[speed[peaks] > SLOWEST]
    stands = body.stands[:, ("left", "right").index(side)]
    landings = np.flatnonzero(stands[1:] & ~stands[:-1]) + 1
    if len(landings):
        nearest = landings[np.argmin(np.abs(landings[:, None] - peaks), axis=0)]
        peaks = np.where(np.abs(nearest - peaks) <= 0.15 * fps, nearest, peaks)
    return np.unique(peaks)


def _cycles(body: Body) -> Iterator[Passage]:
    both = {side: strikes(body, side) for side in ("left", "right")}
    for side, other in (("left", "right"), ("right", "left")):
        for start, stop in zip(both[side][:-1], both[side][1:], strict=True):
            between = both[other][(both[other] > start) & (both[other] < stop)]
            share = (between - start) / (stop - start)
            whole = len(between) == 1 and 0.35 < share[0] < 0.65
            if whole and CYCLE[0] < (stop - start) / body.fps < CYCLE[1]:
                found = _cycle(body, int(start), int(stop), side)
                if found is not None:
                    yield found


def _cycle(body: Body, start: int, stop: int, side: str) -> Passage | None:
    """A cycle with the name of what it does; None where it is between two moves, or changes its speed."""
    seconds = (stop - start) / body.fps
    way = body.path[stop] - body.path[start]
    # At the same phase the hips are turned alike: what is left between the two is the turn.
    turn = np.degrees(body.yaw[stop] - body.yaw[start]) / seconds
    speeds = np.linalg.norm(body.velocity[start : stop + 1], axis=-1)
    speed = float(speeds.mean()) if abs(turn) > TURNING else float(np.linalg.norm(way)) / seconds
    angle = float(np.degrees(np.mean(_angles(body, start, stop + 1))))
    if speed < SLOWEST or np.ptp(speeds) > STEADY * max(speed, 1.0):
        return None
    stands = body.stands[start:stop]
    flies = float((~stands.any(axis=1)).mean())
    low = body.positions[start:stop, [body.skeleton.role(f"{s}_up_leg") for s in ("left", "right")], 1]
    gait = "run" if flies > FLIGHT and speed > SLOWEST_RUN else "walk"
    if low.mean() < CROUCH * body.leg and gait == "walk":
        gait = "crouch"
    if gait == "walk" and flies > HOP:
        return None
    move = _name(gait, speed, float(turn), abs(angle))
    return Passage(move, body, start, stop, speed, float(turn), angle, side) if move else None


def _name(gait: str, speed: float, turn: float, angle: float) -> str | None:
    if abs(turn) > TURNING:
        rate = next((name for most, name in TURNS.items() if abs(turn) < most), None)
        return f"{gait}-turn {rate}" if rate and angle < 45 and gait != "crouch" else None
    if angle > AHEAD:
        aside = "sidestep" if ASIDE[0] < angle < ASIDE[1] else "backward" if angle > BACK else None
        return aside and {"walk": aside, "run": f"{aside}-run"}.get(gait)
    if gait == "crouch":
        return "crouch"
    middles, half = (WALKS, WALK_BIN) if gait == "walk" else (RUNS, RUN_BIN)
    near = min(middles, key=lambda middle: abs(middle - speed))
    return f"{gait} {near:g}" if abs(near - speed) <= half else None


def _angles(body: Body, start: int, stop: int) -> Array:
    """From facing to travel, radians, about its circular mean so that backward does not jump."""
    velocity = body.velocity[start:stop]
    angle = np.arctan2(velocity[:, 0], velocity[:, 1]) - body.heading[start:stop]
    mean = np.arctan2(np.sin(angle).mean(), np.cos(angle).mean())
    return mean + (angle - mean + np.pi) % (2 * np.pi) - np.pi


def _rates(body: Body) -> tuple[Array, Array]:
    """Speed [T], m/s, and turn rate [T], degrees a second, averages over half a second."""
    from mm import metrics
    from motion import kinematics

    rate = metrics.smooth(kinematics.velocities(body.yaw[:, None], body.fps), body.fps, 0.5)[:, 0]
    return np.linalg.norm(body.velocity, axis=-1), np.degrees(rate)


def _stands(body: Body) -> Iterator[Passage]:
    speed, turn = _rates(body)
    size = round(STAND_SECONDS * body.fps)
    for first, last in runs((speed < STAND_SPEED) & (np.abs(turn) < STAND_TURN)):
        for start in range(first, last - size + 1, size):
            yield _plain("stand", body, start, start + size, speed, turn)


def _pivots(body: Body) -> Iterator[Passage]:
    speed, turn = _rates(body)
    for sign in (1, -1):
        for first, last in runs((speed < PIVOT_SPEED) & (sign * turn > PIVOT_TURN)):
            if last - first >= PIVOT_SECONDS * body.fps:
                yield _plain("turn", body, first, last, speed, turn)


def _starts(body: Body) -> Iterator[Passage]:
    """Starts and stops: at rest on one side of the crossing, up to speed on the other, going ahead."""
    speed, turn = _rates(body)
    rest = round(REST_SECONDS * body.fps)
    slow = speed < REST_SPEED
    for name, crossings in (
        ("start", np.flatnonzero(slow[:-1] & ~slow[1:])),
        ("stop", np.flatnonzero(~slow[:-1] & slow[1:])),
    ):
        for frame in map(int, crossings):
            ahead, behind = (AFTER, BEFORE) if name == "start" else (BEFORE, AFTER)
            start, stop = frame - round(behind * body.fps), frame + round(ahead * body.fps)
            if start < 0 or stop > len(body):
                continue
            still = slow[frame - rest : frame] if name == "start" else slow[frame + 1 : frame + rest]
            moving = speed[frame:stop] if name == "start" else speed[start:frame]
            fast = moving > GO_SPEED
            if not still.all() or not fast.any() or np.abs(np.mean(turn[start:stop])) > TURNING:
                continue
            fastest = float(moving.max())
            found = _plain(name + "-run" * (fastest > WALKS[-1]), body, start, stop, speed, turn, fastest)
            if abs(found.angle) < 30:
                yield found


def _plain(
    move: str, body: Body, start: int, stop: int, speed: Array, turn: Array, fastest: float | None = None
) -> Passage:
    """A passage that is no cycle; a start's or a stop's speed is the one it goes to or comes from."""
    mean = float(speed[start:stop].mean()) if fastest is None else fastest
    velocity = body.velocity[start:stop].sum(axis=0)
    angle = np.arctan2(*velocity) - float(body.heading[start:stop].mean())
    return Passage(
        move,
        body,
        start,
        stop,
        mean,
        float(turn[start:stop].mean()),
        float(np.degrees((angle + np.pi) % (2 * np.pi) - np.pi)),
    )


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Where flags [T] are true without a break, as [start, stop)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
