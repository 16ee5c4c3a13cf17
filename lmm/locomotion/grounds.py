"""Grounds under a database's motion: fitted to each stretch of it, kept as heights along its trajectory.

Several grounds are fitted to each stretch (REFERENCE 4.2; `features.terrain_fit`), and a network in training
sees a frame on any of them: its inputs tell the heights around, and its joints lie over the ground under the
root. Heights are kept once a frame, from which the samples of all its neighbours are taken.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from features import contacts as touching
from features import patches, terrain, terrain_fit, terrain_made
from features import trajectory as ground_plane
from features.gait import JUMP
from features.labels import Labels
from features.terrain import Heightmap
from features.terrain_fit import Grounds
from mm.database import Database
from mm.work import Work
from motion import files, quat
from motion.errors import UserError

from .labelling import kept, world
from .trajectory import interval
from .window import FUTURE, PRESENT, SIDES, Blocks, beyond

SEEDS = (1, 2, 3)  # of made terrains
SAME = 0.01  # metres that the way of a mirrored copy may be off its original's
# Where hardly any foot rests so far off the lowest level, motion is that of level ground.
STEP, RARE = 0.1, 0.01  # metres, share
LEAST = 3  # frames of a range that has any vectors
TOLD = 10  # of so many contacts one is looked at, to tell how well grounds meet them


@dataclass(frozen=True, eq=False)
class Terrain:
    """What grounds are fitted of.

    Attributes
    ----------
    names : of the heightmaps' files, or kinds of made terrain.
    maps : the heightmaps.
    count : grounds for each stretch.
    """

    names: tuple[str, ...]
    maps: tuple[Heightmap, ...]
    count: int = terrain_fit.COUNT

    @staticmethod
    def of(
        names: Sequence[str], *, spacing: float = terrain.SPACING, count: int = terrain_fit.COUNT
    ) -> Terrain:
        """Terrain of kinds (`features.terrain_made.KINDS`), and of heightmaps' files of this spacing, metres.

        A map that is smaller than a patch is a UserError; faults of files: see `features.terrain.load`.
        """
        maps: list[Heightmap] = []
        for name in names:
            if name not in terrain_made.KINDS and files.kind(name) is None:
                kinds = ", ".join(terrain_made.KINDS)
                raise UserError(f"no terrain {name!r}", remedy=f"choose {kinds}, or name a heightmap's file")
            if name in terrain_made.KINDS:
                maps += [terrain_made.make(seed, name) for seed in SEEDS]  # type: ignore[arg-type]
            else:
                maps.append(_large(terrain.load(name, spacing=spacing), name))
        return Terrain(tuple(Path(name).name for name in names), tuple(maps), count)


def _large(one: Heightmap, path: str | os.PathLike[str]) -> Heightmap:
    if min(one.size) < patches.SIDE:
        x, z = one.size
        raise UserError(
            f"a heightmap of {x:.2f} x {z:.2f} m: too small for motion, a patch is {patches.SIDE:g} m wide",
            path=path,
            remedy="give a larger one, or the spacing of its numbers",
        )
    return one


@dataclass(frozen=True, eq=False)
class GroundTable:
    """Heights of K grounds along the trajectories of a database's T frames.

    Attributes
    ----------
    heights : float16 [H, K, 3], metres over the stretch's level, right of, on and left of the trajectory. Of
        each stretch a row a frame, and before and after them as many as trajectories and runs reach.
    levels : float32 [T], of each frame's own stretch, metres in the world.
    rows : int64 [T], where each frame is in its own stretch; -1 where it is in none.
    mirrored : bool [T], whether that row is of the frame's mirror image, whose right is its left.
    spacing : frames from one sample of the trajectory to the next.
    misfits : millimetres, how well the grounds meet the feet: ``patch_mm`` how far those in contact are off,
        but for one in twenty, before the correction, ``contact_mm`` after it; ``sunk_mm`` how deep others
        are in, but for one in a hundred.
    level : whether feet rest on level ground only.
    """

    heights: NDArray[np.float16]
    levels: NDArray[np.float32]
    rows: NDArray[np.int64]
    mirrored: NDArray[np.bool_]
    spacing: int
    misfits: dict[str, float]
    level: bool

    def __len__(self) -> int:
        return self.heights.shape[1]

    @property
    def nbytes(self) -> int:
        return sum(a.nbytes for a in (self.heights, self.levels, self.rows, self.mirrored))

    def along(
        self, frames: NDArray[np.int64], which: NDArray[np.int64], steps: NDArray[np.int64] | int = 0
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """What characters see on ground which [N] of the stretches of frames [N], so many steps after these.

        Heights [N, 12, 3] over the root's; the root's [N] a frame before; and now: the mean along the middle
        of its trajectory, as `lmm.pfnn.steps.write_heights` has it.
        """
        now = (self.rows[frames] + steps)[:, None] + self.spacing * np.arange(-PRESENT, FUTURE)
        around = self.heights[now, which[:, None]].astype(np.float32)
        before = self.heights[now - 1, which[:, None], SIDES // 2].astype(np.float32).mean(axis=1)
        middle = around[:, :, SIDES // 2].mean(axis=1)
        turned, level = self.mirrored[frames], self.levels[frames]
        around[turned] = around[turned, :, ::-1]
        return around - middle[:, None, None], level + before, level + middle


def lay(x: Any, y: Any, layout: Blocks, heights: Any, before: Any, now: Any) -> None:
    """Put vectors x [N, I] and y [N, O] of level ground on another, in place; arrays or tensors.

    heights [N, 12, 3], before and now [N]: see `GroundTable.along`. Joints of the frame before were over the
    ground of then, as a character's are. Velocities are the world's and stay.
    """
    x[:, layout.inputs["heights"]] = heights.swapaxes(1, 2).reshape(len(x), -1)
    for vectors, blocks, ground in ((x, layout.inputs, before), (y, layout.outputs, now)):
        columns = blocks["positions"]
        vectors[:, columns.start + 1 : columns.stop : 3] -= ground[:, None]


def fit(
    database: Database,
    labels: Labels,
    terrain: Terrain,
    *,
    steps: int,
    seed: int = 0,
    jobs: int | None = None,
    progress: Callable[..., Iterator[Any]] | None = None,
) -> GroundTable:
    """Grounds for all stretches of a database's ranges, from which runs of so many steps begin.

    Mirrored copies have their originals' grounds, mirrored. Feet rest as high as they do in all of the data:
    who stands on a box in one clip stands on the ground in others. labels are of all frames.
    """
    cut = patches.cut(terrain.maps, seed=seed)
    own, twins = _shared(database, labels)
    body, fps = database.skeleton, database.fps
    soles = {r: touching.points(body, fps, *world(database, r), labels.names) for r in own}
    down = {r: labels.contacts[_part(database, r)] != 0 for r in own}
    together = np.concatenate(list(soles.values())), np.concatenate(list(down.values()))
    rest = terrain_fit.rest_heights(*together)
    for places in soles.values():
        places[..., 1] -= rest
    spacing, reach = interval(fps), reaches(fps, steps)

    def one(stretch: _Stretch) -> tuple[NDArray[np.float16], float, tuple[NDArray, ...]]:
        r, frames, reached = stretch
        jumps = labels.gait[_part(database, r), JUMP][reached]
        grounds = terrain_fit.fit(
            cut, soles[r][reached], down[r][reached], count=terrain.count, jumping=jumps
        )
        heights = _heights(grounds, *_root(database, r), frames, reach)
        level = float(np.median(heights))
        misfits = _misfits(grounds, soles[r][frames], down[r][frames])
        return (heights - level).astype(np.float16), level, misfits

    stretches = [_Stretch(r, *frames) for r in own for frames in terrain_fit.stretches(len(soles[r]), fps)]
    levels, rows = np.zeros(len(database), np.float32), np.full(len(database), -1, np.int64)
    found: list[tuple[NDArray[np.float16], float, tuple[NDArray, ...]]] = []
    at = 0
    work = Work.of(jobs, progress=progress).map(one, stretches, label="terrain", unit="stretches")
    for stretch, (heights, level, misfits) in zip(stretches, work, strict=True):
        start = int(database.starts[stretch.r])
        frames = np.arange(start + stretch.frames.start, start + stretch.frames.stop)
        rows[frames], levels[frames] = at + reach[0] + np.arange(len(frames)), level
        found.append((heights, level, misfits))
        at += len(heights)
    mirrored = np.zeros(len(database), bool)
    for r, original in twins.items():
        for array in (rows, levels):
            array[_part(database, r)] = array[_part(database, original)]
        mirrored[_part(database, r)] = True
    resting = (together[0][..., 1] - rest)[together[1]]
    return GroundTable(
        np.concatenate([heights for heights, _, _ in found]),
        levels,
        rows,
        mirrored,
        spacing,
        _told([misfits for _, _, misfits in found]),
        level=not len(resting) or float((np.abs(resting) > STEP).mean()) < RARE,
    )


class _Stretch(NamedTuple):
    """Frames of a range, and those around them that their grounds are fitted to."""

    r: int
    frames: slice
    reached: slice


def nbytes(database: Database, labels: Labels, *, count: int, steps: int) -> int:
    """Bytes of the heights of the table that `fit` makes."""
    own, _ = _shared(database, labels)
    before, after = reaches(database.fps, steps)
    total = 0
    for r in own:
        parts = terrain_fit.stretches(int(database.stops[r] - database.starts[r]), database.fps)
        total += sum(part.stop - part.start + before + after for part, _ in parts)
    return total * count * SIDES * np.dtype(np.float16).itemsize


def reaches(fps: float, steps: int) -> tuple[int, int]:
    """Frames before a stretch and after it whose heights are asked for by runs of so many steps."""
    spacing = interval(fps)
    return PRESENT * spacing + 1, (FUTURE - 1) * spacing + steps


def _part(database: Database, r: int) -> slice:
    return slice(int(database.starts[r]), int(database.stops[r]))


def _root(database: Database, r: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x, z [T, 2] and yaw [T] of a range's root."""
    poses = database.poses[_part(database, r)]
    return poses.positions[:, 0][:, [0, 2]].astype(np.float64), quat.yaw(poses.rotations[:, 0]).astype(float)


def _shared(database: Database, labels: Labels) -> tuple[list[int], dict[int, int]]:
    """Ranges that get grounds of their own, and mirrored copies with the ranges that they are of."""
    own: list[int] = []
    twins: dict[int, int] = {}
    lengths = database.stops.astype(np.int64) - database.starts
    labelled = np.flatnonzero(kept(database, labels) & (lengths >= LEAST)).tolist()
    plain = {(database.names[r], len(_root(database, r)[0])): r for r in labelled if not database.mirrored[r]}
    for r in labelled:
        root, _ = _root(database, r)
        original = plain.get((database.names[r], len(root)))
        if database.mirrored[r] and original is not None:
            other, _ = _root(database, original)
            if np.abs(root * [-1, 1] - other).max(initial=0) <= SAME:
                twins[r] = original
                continue
        own.append(r)
    return own, twins


def _heights(
    grounds: Grounds, root: NDArray, yaw: NDArray, frames: slice, reach: tuple[int, int]
) -> NDArray[np.floating]:
    """Heights [H, K, 3] along the way of some frames of a range, and as far before and after them."""
    wanted = np.arange(frames.start - reach[0], frames.stop + reach[1])
    points, at = beyond(root, wanted)
    return terrain_fit.along(grounds, points, ground_plane.facing(yaw[at])).swapaxes(0, 1)


def _misfits(grounds: Grounds, soles: NDArray, down: NDArray[np.bool_]) -> tuple[NDArray, ...]:
    """How far soles [T, C, 3] are under grounds, metres [..]: before their correction and after those that
    are down [T, C], after it the others."""
    (x, y, z), (up_x, up_y, up_z) = (soles[which][::TOLD].T for which in (down, ~down))
    under = grounds.laid(x, z) - y, grounds(x, z) - y, grounds(up_x, up_z) - up_y
    return tuple(part.ravel() for part in under)


def _told(misfits: list[tuple[NDArray, ...]]) -> dict[str, float]:
    """`GroundTable.misfits` of how far feet are under the ground, metres [..], by stretch."""
    before, after, sunk = (np.concatenate(part) for part in zip(*misfits, strict=True))
    shares = {"patch_mm": (np.abs(before), 95), "contact_mm": (np.abs(after), 95), "sunk_mm": (sunk, 99)}
    return {
        name: round(1e3 * max(float(np.percentile(off, percent)), 0.0), 2)
        for name, (off, percent) in shares.items()
        if len(off)
    }
