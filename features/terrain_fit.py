"""Grounds for motion that was captured without: patches that meet its feet, corrected until they touch.

Of many patches those are chosen that meet the feet best where they are in contact and stay below them where
they are not; then a smooth correction, a radial basis function, lets every contact touch (REFERENCE 4.2;
Holden, Komura and Saito, Phase-Functioned Neural Networks for Character Control, 2017, section 4.2).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motion import console, kinematics
from motion.clip import Clip
from motion.errors import UserError

from . import contacts as touching
from .labels import Labels
from .patches import Patches
from .terrain import Ground

Array = NDArray[np.floating]

COUNT = 10  # patches for each stretch (REFERENCE 4.2)
STRETCH, REACH = 2.0, 1.0  # seconds of a stretch; of the trajectory before and after each of its frames
ASIDE = 0.25  # metres from the trajectory to the heights beside it
# Contacts weigh less in the choice than what the correction cannot mend: feet that swing through the ground.
DOWN = 0.1
GAP = 0.3  # metres: who jumps has no ground further below than that
SELECT = 100  # frames that the choice looks at
CELL, MOST_KNOTS = 0.01, 150  # metres: contacts closer to each other are one knot of the correction
SMOOTHING = 1e-4
# Feet off contact may be this deep in the ground; deeper, the correction takes them in, but for those right
# beside a contact. They are looked at by cells, each by its lowest foot.
SINK, BESIDE, UP_CELL = 0.005, 0.01, 0.02  # metres
ROUNDS = 4
# Contacts on one level lie this close together (metres); a level has so many of them, measured by the most.
_NEAR, _LEVEL = 0.05, 1 / 3


@dataclass(frozen=True, eq=False)
class Grounds:
    """K grounds fitted to one stretch of motion.

    Attributes
    ----------
    patches : the K patches chosen, best first.
    errors : float64 [K], how badly each met the feet before its correction, m^2.
    middle : float64 [2], x, z of the patches' middles in the world.
    levels : float64 [K], heights at which the patches are laid, metres.
    knots : float64 [M, 2], x, z of the correction's knots, from the middle.
    weights : float64 [M, K], of each knot's distance; constants : float64 [K].
    """

    patches: Patches
    errors: NDArray[np.float64]
    middle: NDArray[np.float64]
    levels: NDArray[np.float64]
    knots: NDArray[np.float64]
    weights: NDArray[np.float64]
    constants: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.levels)

    def __call__(self, x: Array, z: Array) -> NDArray[np.float32]:
        """Heights [K, ..], metres, of every ground at x and z [..] in the world."""
        points = self._points(x, z)
        added = self.constants[:, None] - (_distances(points, self.knots) @ self.weights).T
        return (self._laid(points) + added).reshape(len(self), *np.shape(x)).astype(np.float32)

    def laid(self, x: Array, z: Array) -> NDArray[np.float32]:
        """Heights [K, ..] of every patch where it was laid, before its correction."""
        return self._laid(self._points(x, z)).reshape(len(self), *np.shape(x)).astype(np.float32)

    def _points(self, x: Array, z: Array) -> NDArray[np.float64]:
        return np.stack([np.ravel(x), np.ravel(z)], axis=-1).astype(np.float64) - self.middle

    def _laid(self, points: Array) -> NDArray[np.float64]:
        return self.patches.heights(points) + self.levels[:, None]

    def only(self, k: int) -> Ground:
        """The k-th ground alone, a function of heights [..]."""
        one = Grounds(
            self.patches[k],
            self.errors[[k]],
            self.middle,
            self.levels[[k]],
            self.knots,
            np.ascontiguousarray(self.weights[:, [k]]),
            self.constants[[k]],
        )
        return lambda x, z: one(x, z)[0]


def rest_heights(places: Array, contacts: NDArray) -> NDArray[np.float64]:
    """How high what touches the ground lies when it rests on the lowest level, metres [C].

    places [T, C, 3] are world positions of what touches (`features.contacts.points`), contacts [T, C]. The
    lowest level is one on which a good share of all contacts lie: a few flawed frames below are none. What
    never touches is taken to rest as the others do.
    """
    out = np.full(places.shape[1], np.nan)
    for c in range(places.shape[1]):
        heights = np.sort(places[contacts[:, c] != 0, c, 1])
        if len(heights):
            counts = np.searchsorted(heights, heights + _NEAR, side="right") - np.arange(len(heights))
            first = int(np.argmax(counts >= _LEVEL * counts.max()))
            out[c] = np.median(heights[first : first + counts[first]])
    return np.where(np.isnan(out), np.nanmean(out) if np.isfinite(out).any() else 0.0, out)


def soles(places: Array, contacts: NDArray) -> NDArray[np.float64]:
    """Where the ground would be under places [T, C, 3] that rested: they, lowered by `rest_heights`."""
    lowered = np.array(places, np.float64)
    lowered[..., 1] -= rest_heights(places, contacts)
    return lowered


def soles_of(clip: Clip, labels: Labels) -> NDArray[np.float64]:
    """The `soles` [T, C, 3], metres, of what a clip's labels name."""
    world = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    return soles(touching.points(clip.skeleton, clip.fps, *world, labels.names), labels.contacts)


def fit(
    patches: Patches, feet: Array, contacts: NDArray, *, count: int = COUNT, jumping: NDArray | None = None
) -> Grounds:
    """The count patches that suit a stretch of motion best, each corrected.

    Parameters
    ----------
    patches : to choose from.
    feet : [T, C, 3], metres, world positions of the feet's `soles`.
    contacts : [T, C], nonzero where they are on the ground.
    jumping : [T], how much a frame is of a jump, 0 to 1; under a jump ground is wanted near the feet.

    Without any contact grounds are the patches as they are, laid below the lowest foot.
    """
    feet, down = np.asarray(feet, np.float64), np.asarray(contacts) != 0
    if not 0 < count <= len(patches):
        raise UserError(f"{count} grounds of {len(patches)} patches", remedy="ask for fewer, or cut more")
    if feet.shape != (*down.shape, 3):
        raise ValueError(f"feet {feet.shape} and contacts {down.shape}, expected [T, C, 3] and [T, C]")
    if not np.all(np.isfinite(feet)):
        raise UserError("feet whose positions are not finite", remedy="check the clip")
    if not down.any():
        down = feet[..., 1] <= feet[..., 1].min()
    middle = feet[down][:, [0, 2]].mean(axis=0)
    feet = feet - [middle[0], 0, middle[1]]
    errors = _errors(patches, feet, down, jumping)
    best = np.argsort(errors, kind="stable")[:count]
    chosen, on = patches[best], feet[down]
    levels = on[:, 1].mean() - chosen.heights(on[:, [0, 2]]).mean(axis=1)
    knots, weights, constants = _correct(chosen, levels, on, feet[~down])
    return Grounds(chosen, errors[best], middle, levels, knots, weights, constants)


def stretches(frames: int, fps: float, *, seconds: float = STRETCH) -> list[tuple[slice, slice]]:
    """Stretches of a clip: the frames of each, and those that its trajectories reach, to fit it to."""
    count = max(1, round(frames / (seconds * fps)))
    edges = np.linspace(0, frames, count + 1).round().astype(int)
    reach = round(REACH * fps)
    return [
        (slice(int(a), int(b)), slice(max(0, int(a) - reach), min(frames, int(b) + reach)))
        for a, b in itertools.pairwise(edges)
        if b > a
    ]


def fit_clip(
    patches: Patches,
    feet: Array,
    contacts: NDArray,
    fps: float,
    *,
    count: int = COUNT,
    jumping: NDArray | None = None,
    seconds: float = STRETCH,
    progress: Callable[..., Iterable] = console.silent,
) -> Iterator[tuple[slice, Grounds]]:
    """The frames of each stretch of a clip, and its grounds; what is given (see `fit`) is of all frames."""
    parts = stretches(len(feet), fps, seconds=seconds)
    for own, reached in progress(parts, label="terrain", unit="stretches"):
        jumps = None if jumping is None else jumping[reached]
        yield own, fit(patches, feet[reached], contacts[reached], count=count, jumping=jumps)


def beside(points: Array, directions: Array, aside: float = ASIDE) -> Array:
    """Places x, z [.., 3, 2] right of, on and left of trajectories: points and unit directions [.., 2]."""
    left = np.stack([directions[..., 1], -directions[..., 0]], axis=-1)
    return points[..., None, :] + aside * np.array([-1.0, 0.0, 1.0])[:, None] * left[..., None, :]


def along(ground: Ground | Grounds, points: Array, directions: Array) -> Array:
    """Heights, metres, [.., 3] (of `Grounds` [K, .., 3]) at the places that `beside` gives."""
    places = beside(points, directions)
    return ground(places[..., 0], places[..., 1])


def _errors(
    patches: Patches, feet: Array, down: NDArray[np.bool_], jumping: NDArray | None
) -> NDArray[np.float64]:
    """How badly every patch meets feet, at some of the frames."""
    step = max(1, len(feet) // SELECT)
    some = slice(None, None, step) if down[::step].any() else slice(None)
    feet, down = feet[some], down[some]
    jumps = np.zeros(len(feet)) if jumping is None else np.asarray(jumping, np.float64)[some]
    over = np.broadcast_to(jumps[:, None], down.shape)[~down]
    on, off = feet[down], feet[~down]
    mean = on[:, 1].mean()
    return patches.misfits(
        on[:, [0, 2]], on[:, 1] - mean, off[:, [0, 2]], off[:, 1] - mean, over, weight=DOWN, gap=GAP
    )


def _correct(
    patches: Patches, levels: Array, on: Array, off: Array
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Knots [M, 2], weights [M, K] and constants [K] by which K patches, laid at levels, meet feet.

    on [D, 3] touch; off [U, 3] come to lie no deeper than `SINK`, where no contact is right beside them.
    """
    knots, residuals = _merged(on[:, [0, 2]], on[:, 1] - patches.heights(on[:, [0, 2]]) - levels[:, None])
    low = _lowest(off)
    low = low[_distances(low[:, [0, 2]], knots).min(axis=1, initial=np.inf) > BESIDE]
    # What the ground, before its correction, would have to rise by to touch the lowest feet off contact.
    room = low[:, 1] - patches.heights(low[:, [0, 2]]) - levels[:, None]
    fixed, everything = len(knots), np.concatenate([knots, low[:, [0, 2]]])
    distances, values = _distances(everything, everything), np.concatenate([residuals, room], axis=1)
    weights, constants = np.zeros((len(everything), len(levels))), np.zeros(len(levels))
    used = np.zeros((len(levels), len(everything)), bool)
    used[:, :fixed] = True
    weights[:fixed], constants[:] = _solve(distances[:fixed, :fixed], residuals.T)
    for _ in range(ROUNDS):
        raised = (constants - distances[fixed:] @ weights).T
        fresh = (raised - room > SINK) & ~used[:, fixed:]
        if not fresh.any():
            break
        used[:, fixed:] |= fresh
        for k in np.flatnonzero(fresh.any(axis=1)):
            own = np.flatnonzero(used[k])
            solved, constant = _solve(distances[np.ix_(own, own)], values[k, own, None])
            weights[own, k], constants[k] = solved[:, 0], constant[0]
    kept = used.any(axis=0)
    return everything[kept], np.ascontiguousarray(weights[kept]), constants


def _solve(distances: Array, values: Array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weights [M, K] and constants [K] of f(x) = constant - sum of weight |x - knot|, nearly values [M, K].

    distances [M, M] are those of the knots. The kernel -r is conditionally positive definite: with weights
    that sum to 0 the system has one solution (Micchelli, Constructive Approximation 2, 1986).
    """
    count = len(distances)
    system = np.ones((count + 1, count + 1))
    system[:count, :count] = -distances + SMOOTHING * np.eye(count)
    system[count, count] = 0
    solved = np.linalg.solve(system, np.concatenate([values, np.zeros((1, values.shape[1]))]))
    return solved[:count], solved[count]


def _merged(points: Array, values: Array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means of points [D, 2] and values [K, D] by cells, wide enough that there are not too many."""
    cell = CELL
    while True:
        _, which, counts = np.unique(np.floor(points / cell), axis=0, return_inverse=True, return_counts=True)
        if len(counts) <= MOST_KNOTS:
            break
        cell *= 1.3
    which = which.ravel()
    means = [np.bincount(which, row, len(counts)) / counts for row in (*points.T, *values)]
    return np.stack(means[:2], axis=-1), np.stack(means[2:])


def _lowest(off: Array) -> NDArray[np.float64]:
    """The lowest of feet [U, 3] in each cell."""
    order = np.asarray(off[np.argsort(off[:, 1], kind="stable")], np.float64)
    _, first = np.unique(np.floor(order[:, [0, 2]] / UP_CELL), axis=0, return_index=True)
    return order[first]


def _distances(a: Array, b: Array) -> NDArray[np.float64]:
    """Distances [A, B] of points [A, 2] from points [B, 2]."""
    away = a[:, None] - b
    return np.sqrt(away[..., 0] ** 2 + away[..., 1] ** 2)
