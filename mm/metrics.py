"""What is measured of a motion: pure functions on arrays, time along axis 0.

Lengths go in as metres and come out as centimetres where a name ends in ``_cm`` or the docstring says so;
formulas are those of REFERENCE section 6 unless another source is named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from features.terrain import Ground
from motion import kinematics, quat

Array = NDArray[np.floating]

SKATE_HEIGHT = 0.025  # H of the foot-skate formula, metres
CONTACT_HEIGHT, SKATE_SPEED = 0.05, 0.5  # skate ratio: metres, m/s
MOVING, FEWEST = 0.25, 10  # the root's speed, m/s, and the frames from which a foot's resting height is known
# Ways out of the ground to the side: metres, and to how many sides.
ASIDE, DIRECTIONS = (0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2), 12
SMOOTHING = 0.2  # seconds over which the root's speed and heading are averaged
# Metres back and ahead along the path that the next frame's nearest point may lie: a runner may turn nearly
# 2 m before a sharp corner, and then has gone over to the way behind it.
PATH_WINDOW = (0.5, 6.0)


@dataclass(frozen=True)
class Errors:
    """Statistics of an error over frames and joints, in the unit of the function that returns them."""

    mean: float
    std: float
    p99: float
    worst: float
    worst_joint: int


def errors(values: Array) -> Errors:
    """Of values [..., J]; the worst joint is the one with the largest mean error, which `worst` gives."""
    joints = values.reshape(-1, values.shape[-1]).mean(axis=0)
    joint = int(np.argmax(joints))
    p99 = float(np.percentile(values, 99))
    return Errors(float(values.mean()), float(values.std()), p99, float(joints[joint]), joint)


def joint_position_error(truth: Array, found: Array) -> Errors:
    """Distance |truth - found| of joint positions [..., J, 3] (metres, after forward kinematics), in cm.

    Roots aligned: give positions in the ground root's space, without the root itself.
    """
    return errors(100 * np.linalg.norm(np.asarray(found) - truth, axis=-1))


def rotation_error(truth: Array, found: Array) -> Errors:
    """Angle 2 acos |truth . found| between unit quaternions [..., J, 4], in degrees."""
    return errors(np.degrees(quat.angle_between(np.asarray(truth), np.asarray(found))))


def velocity_error(truth: Array, found: Array, fps: float, *, starts: ArrayLike = ()) -> Errors:
    """Difference of the finite-difference velocities of joint positions [T, ..., J, 3], in cm/s.

    starts: frames that begin a clip; no step leads to them.
    """
    moved = np.diff(np.asarray(found, np.float64) - truth, axis=0)
    steps = np.delete(moved, [start - 1 for start in np.asarray(starts, np.int64) if start > 0], axis=0)
    return errors(100 * fps * np.linalg.norm(steps, axis=-1))


def resting_heights(
    feet: Array,
    contacts: ArrayLike | None = None,
    speed: ArrayLike | None = None,
    *,
    moving: float = MOVING,
    percentile: float = 5,
    share: float = 25,
) -> Array:
    """Height [C] at which each foot joint stands while the character walks.

    A percentile (share) of y of feet [T, C, 3] over the frames in contact (contacts [T, C]) while the root
    is faster than moving (speed [T], m/s): whoever sits or lies rests a foot joint lower than it ever
    stands. Feet with
    fewer than 10 such frames, and all feet where contacts or speed are not given, take a low percentile over
    all frames; not the minimum, so that capture noise and a few frames below the floor do not set it.

    Skeletons differ: a toe joint stands at 1 to 4 cm, an ankle at 7 to 12 cm, a dog's hock at 12 cm.
    """
    y = np.asarray(feet, np.float64)[..., 1]
    heights = np.percentile(y, percentile, axis=0)
    if contacts is None or speed is None:
        return heights
    steps = np.asarray(contacts, bool) & (np.asarray(speed) > moving)[:, None]
    for c in np.flatnonzero(steps.sum(axis=0) >= FEWEST):
        heights[c] = np.percentile(y[steps[:, c], c], share)
    return heights


def relative_error(truth: Array, found: Array) -> Array:
    """The thesis's error |t - p| / |t| [...] of joint positions [..., 3]; 0.01 is an error of 1 %.

    Formula 3.1 there, whose mean over joints and frames is a file's. Positions are in the space of a root on
    the ground, so what is far from it counts less: the same centimetre is less of a head than of a foot.
    """
    truth = np.asarray(truth, np.float64)
    away = np.linalg.norm(np.asarray(found, np.float64) - truth, axis=-1)
    return away / np.maximum(np.linalg.norm(truth, axis=-1), 1e-6)


def significance(a: ArrayLike, b: ArrayLike) -> float:
    """The thesis's measure of how two series differ: 2 |mean a - mean b| / (sd a + sd b), its formula 3.2.

    That is the difference of the means in mean standard deviations, those of samples. NaN where a series has
    fewer than two numbers.
    """
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if min(a.size, b.size) < 2:
        return float("nan")
    spread = a.std(ddof=1) + b.std(ddof=1)
    apart = 2 * abs(a.mean() - b.mean())
    return float(apart / spread) if spread > 0 else (float("inf") if apart > 0 else 0.0)


def _steps(feet: Array, fps: float, rest: ArrayLike) -> tuple[Array, Array]:
    """Horizontal speed [T-1, ..., C] (m/s) of each step between frames, and height above rest [T, ..., C]."""
    feet = np.asarray(feet, np.float64)
    speed = fps * np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1)
    return speed, feet[..., 1] - np.asarray(rest)


def skate(feet: Array, fps: float, rest: ArrayLike = 0.0, *, height: float = SKATE_HEIGHT) -> Array:
    """Foot skate [T-1, ..., C] of every step between frames and foot joint, in cm/s.

        s = v (2 - 2^(h / H)),   h clamped to [0, H]

    feet [T, ..., C, 3] world positions, metres; v horizontal speed; h the mean of the two frames' heights
    above rest [C] (`resting_heights`). It is all of v on the ground and nothing at H and above. Divide by
    fps for cm a frame, the unit of the MANN paper.
    """
    speed, above = _steps(feet, fps, rest)
    h = np.clip((above[1:] + above[:-1]) / 2, 0, height)
    return 100 * speed * (2 - 2 ** (h / height))


def foot_skate(feet: Array, fps: float, rest: ArrayLike = 0.0, *, height: float = SKATE_HEIGHT) -> float:
    """Mean of `skate` over frames and feet, cm/s; NaN without feet or without two frames."""
    return mean(skate(feet, fps, rest, height=height))


def skate_ratio(
    feet: Array,
    fps: float,
    rest: ArrayLike = 0.0,
    *,
    height: float = CONTACT_HEIGHT,
    speed: float = SKATE_SPEED,
) -> float:
    """Share of steps between frames in which any foot of feet [T, ..., C, 3] skates.

    A foot skates when it is lower than height (above rest) in both frames and its horizontal speed between
    them exceeds speed. NaN without feet or without two frames.
    """
    moved, above = _steps(feet, fps, rest)
    low = above < height
    skates = low[1:] & low[:-1] & (moved > speed)
    return float(skates.any(axis=-1).mean()) if skates.size else float("nan")


def airborne_share(feet: Array, rest: ArrayLike = 0.0, *, height: float = CONTACT_HEIGHT) -> float:
    """Share of frames in which every foot of feet [T, ..., C, 3] is higher than height above rest.

    Running has flight, walking none: a walk that is matched by hops shows here and not in skate. NaN without
    feet.
    """
    above = np.asarray(feet, np.float64)[..., 1] - np.asarray(rest) > height
    return float(above.all(axis=-1).mean()) if above.size else float("nan")


def glide_share(feet: Array, root: Array, fps: float, *, speed: float = 0.3, share: float = 0.5) -> float:
    """Share of frames that glide: the root travels, but no foot goes back under it as the ground does.

    feet [T, ..., C, 3] and root [T, ..., 2] in the world, metres. A foot that stands moves at the root's
    speed relative to the root. A frame glides when the root is faster than speed (m/s) and every foot's
    horizontal velocity relative to it is below share of that; averages over 0.2 s. This sees what skate
    cannot: a pose that is carried along with its feet in the air. NaN without feet.
    """
    feet = np.asarray(feet, np.float64)[..., [0, 2]]
    if feet.size == 0:
        return float("nan")
    root = np.asarray(root, np.float64)
    travel = root_speed(root, fps)
    under = root_speed(feet - root[..., None, :], fps).max(axis=-1)
    return float(((travel > speed) & (under < share * travel)).mean())


def longest_stall(
    feet: Array, root: Array, asked: Array, fps: float, *, speed: float = 0.3, share: float = 0.25
) -> float:
    """Seconds for which a character that was asked to go did not step, the longest time of all.

    feet [T, ..., C, 3] and root [T, ..., 2] in the world, metres; asked [T, ..., 2], velocities, m/s. Who
    steps moves a foot against the root, about as fast as it is asked to go. A frame is without a step when
    more than speed (m/s) is asked for and every foot's horizontal velocity relative to the root is below
    share of that, on average over half a second. A network that died out stands, or is carried along in one
    pose: both show. NaN without feet.
    """
    feet = np.asarray(feet, np.float64)[..., [0, 2]]
    if feet.size == 0:
        return float("nan")
    under = smooth(root_speed(feet - np.asarray(root, np.float64)[..., None, :], fps), fps, 0.5).max(axis=-1)
    wanted = np.linalg.norm(np.asarray(asked, np.float64), axis=-1)
    stalled = ((wanted > speed) & (under < share * wanted)).reshape(len(feet), -1)
    run, longest = np.zeros(stalled.shape[1], np.int64), 0
    for frame in stalled:
        run = np.where(frame, run + 1, 0)
        longest = max(longest, int(run.max()))
    return longest / fps


def over_ground(points: Array, ground: Ground) -> Array:
    """Points [..., 3] with y above the ground beneath each, as all heights of feet are meant on a ground."""
    points = np.array(points, np.float64)
    points[..., 1] -= ground(points[..., 0], points[..., 2])
    return points


def sink(soles: Array, ground: Ground, rest: ArrayLike = 0.0) -> Array:
    """How deep [T, ...] the deepest sole is in the ground, cm; 0 where none is, NaN without feet.

    soles [T, ..., C, P, 3] are P points of each of C feet in the world, metres, which rest so high above the
    ground, rest [C, P]. The depth is the shortest way out, straight up or to the side (as `ASIDE` has it): a
    heel that is 3 cm in the riser of a stair is 3 cm deep, however high the stair.
    """
    soles = np.array(soles, np.float64)
    soles[..., 1] -= np.asarray(rest)
    depth = np.maximum(-over_ground(soles, ground)[..., 1], 0)
    inside = depth > 0
    x, y, z = soles[inside].T
    for away in ASIDE:
        for angle in 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
            up = ground(x + away * np.sin(angle), z + away * np.cos(angle)) - y
            depth[inside] = np.minimum(depth[inside], np.hypot(away, np.maximum(up, 0)))
    depth = depth.reshape(*depth.shape[:-2], -1)
    return 100 * depth.max(axis=-1) if depth.size else np.full(depth.shape[:-1], np.nan)


def hover(soles: Array, ground: Ground, planted: ArrayLike, rest: ArrayLike = 0.0) -> float:
    """Mean height of a planted foot's lowest sole over where it rests, cm, nothing where that is lower.

    soles, ground and rest as of `sink`; planted [T, ..., C] are the feet that are to be on the ground. NaN
    where none is.
    """
    above = (over_ground(soles, ground)[..., 1] - np.asarray(rest))[np.asarray(planted, bool)]
    return 100 * mean(np.maximum(above, 0).min(axis=-1)) if len(above) else float("nan")


def smooth(values: Array, fps: float, seconds: float = SMOOTHING) -> Array:
    """Centred moving average over axis 0 of values [T, ...]; near the ends of what there is."""
    values = np.asarray(values, np.float64)
    half = round(seconds * fps) // 2
    if half == 0 or len(values) == 0:
        return values.copy()
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    index = np.arange(len(values))
    first, last = np.maximum(index - half, 0), np.minimum(index + half + 1, len(values))
    return (total[last] - total[first]) / (last - first).reshape(-1, *[1] * (values.ndim - 1))


def wrap(angle: ArrayLike) -> Array:
    """Angles brought into [-pi, pi)."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def root_speed(positions: Array, fps: float, *, seconds: float = SMOOTHING) -> Array:
    """Speed [T, ...] in m/s of ground positions [T, ..., 2], velocity smoothed over seconds."""
    velocity = kinematics.velocities(np.asarray(positions, np.float64), fps)
    return np.linalg.norm(smooth(velocity, fps, seconds), axis=-1)


def path_length(positions: Array) -> Array:
    """Metres [...] walked along ground positions [T, ..., 2]."""
    return np.linalg.norm(np.diff(positions, axis=0), axis=-1).sum(axis=0)


def speed_ratio(positions: Array, command_velocity: Array, fps: float) -> float:
    """Metres walked over metres commanded: sum of the speeds of positions [T, ..., 2], smoothed over 0.2 s,
    over that of the commanded velocities [T, ..., 2]. NaN when nothing was commanded."""
    asked = np.linalg.norm(np.asarray(command_velocity, np.float64), axis=-1).sum()
    return float(root_speed(positions, fps).sum() / asked) if asked > 0 else float("nan")


def nearest_on_path(
    positions: Array,
    path: Array,
    *,
    window: tuple[float, float] = PATH_WINDOW,
    spacing: float = 0.02,
) -> tuple[Array, Array]:
    """Windowed nearest points of a polyline: distance [T, ...] in metres, and the path's direction there.

    positions [T, ..., 2], path [P, 2]; the direction [T, ...] is an angle, atan2(x, z). A frame's nearest
    point is sought between window[0] metres before and window[1] metres after the last frame's, measured
    along the path, so that where a path crosses itself or doubles back the other branch does not count.
    The first frame's point is the nearest of all; who begins where two branches meet is on the one to which
    they keep. A path that ends where it began goes round.
    """
    points, closed = _respace(np.asarray(path, np.float64), spacing)
    positions = np.asarray(positions, np.float64)
    flat = positions.reshape(len(positions), -1, 2)
    count, step = len(points), np.linalg.norm(points[1] - points[0])
    offsets = np.arange(-int(window[0] / step), int(window[1] / step) + 1)
    within = (lambda at: at % count) if closed else (lambda at: np.clip(at, 0, count - 1))

    def follow(first: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
        at, squares = np.empty(flat.shape[:2], np.int64), np.empty(flat.shape[:2])
        for t, here in enumerate(flat):
            candidates = within(at[t - 1][:, None] + offsets) if t else first[:, None]
            away = np.sum((points[candidates] - here[:, None]) ** 2, axis=-1)
            best = np.argmin(away, axis=-1)[:, None]
            at[t], squares[t] = (np.take_along_axis(a, best, axis=-1)[:, 0] for a in (candidates, away))
        return at, squares.sum(axis=0)

    away = np.linalg.norm(points - flat[0][:, None], axis=-1)
    first = np.argmin(away, axis=-1)
    at, off = follow(first)
    for i, nearest in enumerate(first):
        away[i, within(nearest + offsets)] = np.inf
    near = away.min(axis=-1) < window[0]
    if np.any(near):
        others, further = follow(np.where(near, np.argmin(away, axis=-1), first))
        at = np.where(further < off, others, at)
    # The exact nearest point lies on one of the two short segments that meet at the point found.
    other = [within(at + side) for side in (-1, 1)]
    distance = np.minimum(*(_distance_to_segment(flat, points[at], points[o]) for o in other))
    along = points[other[1]] - points[other[0]]
    shape = positions.shape[:-1]
    return distance.reshape(shape), np.arctan2(along[..., 0], along[..., 1]).reshape(shape)


def _respace(path: Array, spacing: float) -> tuple[Array, bool]:
    """Points at equal arc distances of about spacing along a polyline, and whether it is closed.

    A closed one is returned without its repeated last point.
    """
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=-1))])
    if len(path) < 2 or length[-1] <= 0:
        raise ValueError(f"a path of {len(path)} points, {length[-1]:.3f} m long, has no direction")
    closed = len(path) > 2 and bool(np.allclose(path[0], path[-1], atol=1e-6))
    arc = np.linspace(0, length[-1], max(2, round(length[-1] / spacing)) + 1)
    points = np.stack([np.interp(arc, length, path[:, axis]) for axis in (0, 1)], axis=-1)
    return (points[:-1], True) if closed else (points, False)


def _distance_to_segment(p: Array, a: Array, b: Array) -> Array:
    along = b - a
    square = np.sum(along * along, axis=-1)
    share = np.sum((p - a) * along, axis=-1) / np.where(square > 0, square, 1)
    return np.linalg.norm(p - a - np.clip(share, 0, 1)[..., None] * along, axis=-1)


@dataclass(frozen=True)
class TrajectoryErrors:
    """Distance from the commanded path (cm) and facing's difference from the commanded one (degrees)."""

    mean_cm: float
    p95_cm: float
    max_cm: float
    heading_deg: float


def trajectory_error(
    positions: Array,
    yaws: Array,
    command_yaw: Array,
    path: Array | None,
    *,
    window: tuple[float, float] = PATH_WINDOW,
) -> TrajectoryErrors:
    """How well a walk kept to what was commanded.

    positions [T, ..., 2] of the ground root, its facing yaws [T, ...] and the commanded facing (radians), the
    commanded path [P, 2]: distance to the windowed nearest point of the path (`nearest_on_path`), NaN without
    a path, and mean absolute difference of facing.
    """
    heading = float(np.degrees(np.abs(wrap(np.asarray(yaws) - command_yaw)).mean()))
    if path is None:
        return TrajectoryErrors(float("nan"), float("nan"), float("nan"), heading)
    distance = 100 * nearest_on_path(positions, path, window=window)[0]
    furthest = float(distance.max())
    return TrajectoryErrors(float(distance.mean()), float(np.percentile(distance, 95)), furthest, heading)


def command_path(command_velocity: Array, start: ArrayLike, fps: float) -> Array:
    """The path [T, 2] that a perfectly obedient character would walk from start: the commanded velocity
    [T, 2], integrated. What stick courses, which have no path of their own, are drawn against."""
    return np.asarray(start) + np.cumsum(np.asarray(command_velocity, np.float64), axis=0) / fps


def step_response(
    command: Array,
    actual: Array,
    fps: float,
    *,
    minimum: float,
    share: float = 0.9,
    hold: float = 0.5,
    angular: bool = False,
) -> Array:
    """Seconds [S] from each step in a command [T] until the actual value [T] has made share of the step.

    A step is a change of more than minimum from one frame to the next that is followed by no other for
    hold seconds. It is answered at the first frame whose difference from the command of that frame is at
    most (1 - share) of the step, or beyond the goal. NaN where the next step or the end comes first. Frame
    t's pose is what frame t's command led to, so the fastest answer takes 1 / fps. angular: the values are
    angles in radians and wrap.
    """
    command, actual = np.asarray(command, np.float64), np.asarray(actual, np.float64)
    step = np.diff(command)
    step = wrap(step) if angular else step
    frames = np.flatnonzero(np.abs(step) > minimum) + 1
    ends = np.append(frames, len(command))[1:]
    answers = []
    for start, end in zip(frames, ends, strict=True):
        if end - start < hold * fps:
            continue
        size, left = step[start - 1], command[start:end] - actual[start:end]
        left = np.abs(wrap(left)) if angular else left * np.sign(size)
        reached = np.flatnonzero(left <= (1 - share) * abs(size) + 1e-9)
        answers.append((reached[0] + 1) / fps if len(reached) else np.nan)
    return np.array(answers)


@dataclass(frozen=True)
class Responsiveness:
    """Mean seconds to 90 % of a step in speed and in heading (NaN: no step, or none answered), the number of
    steps, and the share of them that were answered (NaN: no step)."""

    speed_s: float
    heading_s: float
    speed_steps: int
    heading_steps: int
    answered: float


def responsiveness(
    command_velocity: Array,
    command_yaw: Array,
    positions: Array,
    yaws: Array,
    fps: float,
    *,
    speed_step: float = 0.5,
    heading_step: float = np.radians(30),
) -> Responsiveness:
    """Time from a step in the command to 90 % of the new speed, and of the new heading (`step_response`).

    command_velocity [T, N, 2] m/s, command_yaw [T, N] radians, positions [T, N, 2] and yaws [T, N] of the
    ground root. The root's velocity and heading are averages over 0.2 s around each frame. Steps smaller
    than speed_step (m/s) and heading_step (radians) do not count.
    """
    asked = np.linalg.norm(np.asarray(command_velocity), axis=-1)
    speed = root_speed(positions, fps)
    yaws = smooth(np.unwrap(np.asarray(yaws, np.float64), axis=0), fps)
    speeds, headings = [], []
    for n in range(asked.shape[1]):
        speeds.append(step_response(asked[:, n], speed[:, n], fps, minimum=speed_step))
        headings.append(step_response(command_yaw[:, n], yaws[:, n], fps, minimum=heading_step, angular=True))
    of_speed, of_heading = np.concatenate(speeds), np.concatenate(headings)
    both = np.concatenate([of_speed, of_heading])
    return Responsiveness(
        nanmean(of_speed),
        nanmean(of_heading),
        len(of_speed),
        len(of_heading),
        float(np.isfinite(both).mean()) if len(both) else float("nan"),
    )


def or_infinite(values: ArrayLike) -> Array:
    """Errors, infinite where they are no number: nothing could be further off."""
    return np.nan_to_num(values, nan=np.inf, posinf=np.inf)


def mean(values: Array) -> float:
    """Mean of all values; NaN when there are none."""
    return float(values.mean()) if values.size else float("nan")


def nanmean(values: ArrayLike) -> float:
    """Mean of what is not NaN; NaN when nothing is left."""
    numbers = np.asarray(values, np.float64)
    numbers = numbers[np.isfinite(numbers)]
    return float(numbers.mean()) if len(numbers) else float("nan")


def jerk(positions: Array, fps: float) -> float:
    """Mean norm of the third difference of joint positions [T, ..., J, 3] (world, metres) x fps^3, m/s^3."""
    third = np.diff(np.asarray(positions, np.float64), n=3, axis=0)
    return float(np.linalg.norm(third, axis=-1).mean() * fps**3) if len(third) else 0.0


def pops(positions: Array) -> Array:
    """How far [T, ...] the most displaced joint lies from where its velocity would have put it, cm.

        max over joints of |x_t - (2 x_t-1 - x_t-2)|

    positions [T, ..., J, 3] in the ground root's space, metres. Frames 0 and 1 are 0. Ordinary motion is not
    zero: a joint that accelerates at 36 m/s^2 makes 1 cm at 60 frames a second.
    """
    positions = np.asarray(positions, np.float64)
    out = np.zeros(positions.shape[:-2])
    out[2:] = 100 * np.linalg.norm(np.diff(positions, n=2, axis=0), axis=-1).max(axis=-1)
    return out


def largest_pop(positions: Array, transition: NDArray[np.bool_]) -> float:
    """Largest of `pops` at the frames of transitions [T, ...] or the frame after, cm; NaN without one.

    The frame after belongs to it because a velocity that jumps at a transition shows one frame later.
    """
    at = np.asarray(transition, bool).copy()
    at[1:] |= np.asarray(transition, bool)[:-1]
    values = pops(positions)[at]
    return float(values.max()) if len(values) else float("nan")
