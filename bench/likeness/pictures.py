"""Film strips of two sources above each other, and mean joint angles over the gait cycle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mm import metrics
from motion import quat
from motion.skeleton import Skeleton

from .. import strips
from .body import SIDES
from .compare import Likeness, Side
from .measures import CURVES, POINTS, curves, over_cycle
from .moves import Passage, unit

Array = NDArray[np.floating]

VIEWS = ("side", "front", "top")
POSES = 11  # 0 to 100 per cent of a cycle
A_COLOUR, B_COLOUR = "#d1495b", "#2e86ab"
WIDTH = 15.0  # inches
TITLE = 0.55  # inches
FEWEST = 2  # cycles from which a mean curve is drawn


def strip(likeness: Likeness, move: str) -> Any:
    """A figure with the most typical passage of each source, from the side, the front and the top.

    A stands above B. A cycle is shown from the left foot's strike to its next, at the same shares of it;
    other passages at the same times from their beginnings (turns: the same shares of them).
    """
    from matplotlib.figure import Figure

    theirs = likeness.b.typical(move)
    pairs = [("A", likeness.a.typical(move, theirs)), ("B", theirs)]
    instants, labels = _instants([passage for _, passage in pairs])
    films = [Film.of(passage, frames) for (_, passage), frames in zip(pairs, instants, strict=True)]
    tall = 1.04 * max(film.size("side")[1] for film in films)
    cell = max(0.6 * tall, 0.08 + max(film.size(view)[0] for film in films for view in VIEWS))
    heights = {"side": 1.22 * tall, "front": 1.1 * tall, "top": max(f.size("top")[1] for f in films) + 0.1}
    scale, total = WIDTH / (cell * POSES), 2 * sum(heights.values())
    picture = Figure(figsize=(WIDTH, scale * total + TITLE))
    rows = picture.subplots(6, 1, height_ratios=[heights[view] for view in VIEWS for _ in films])
    picture.subplots_adjust(0, 0, 1, 1 - TITLE / (scale * total + TITLE), hspace=0)
    for i, axes in enumerate(rows):
        view, (name, passage), film = VIEWS[i // 2], pairs[i % 2], films[i % 2]
        film.draw(axes, view, cell, heights[view])
        _write(axes, 0.004, f"{name}  {view}", A_COLOUR if name == "A" else B_COLOUR, "bold")
        if view == "side":
            what = (
                f"{passage.name}: {passage.speed:.2f} m/s, {passage.turn:+.0f} °/s, {passage.seconds:.2f} s"
            )
            _write(axes, 0.07, what, "#444444", "normal")
    for s, label in enumerate(labels):
        rows[0].text(s * cell, 0.93 * heights["side"], label, ha="center", va="bottom", fontsize=9)
    title = f"{unit(move)}     A: {likeness.a.name}     B: {likeness.b.name}"
    picture.suptitle(title, x=0.004, y=1 - 0.06 / picture.get_figheight(), ha="left", va="top", fontsize=12)
    return picture


def _write(axes: Any, x: float, text: str, colour: str, weight: str) -> None:
    place = {"transform": axes.transAxes, "va": "top", "fontsize": 10}
    axes.text(x, 0.985, text, color=colour, weight=weight, **place)


def _instants(passages: list[Passage]) -> tuple[list[Array], list[str]]:
    """The frames at which each passage is shown, and what is written over the columns."""
    share: Array = np.linspace(0, 1, POSES)
    if all(p.side for p in passages) or any(p.move == "turn" for p in passages):
        frames: list[Array] = [p.start + share * (p.stop - p.start) for p in passages]
        return frames, [f"{100 * s:.0f} %" for s in share]
    seconds = min(p.seconds for p in passages)
    return [p.start + share * seconds * p.body.fps for p in passages], [f"{s * seconds:.2f} s" for s in share]


@dataclass(frozen=True, eq=False)
class Film:
    """S poses of a passage: skeleton, world positions [S, J, 3] whose joint 0 is the eye's place on the
    ground, where the eye takes the front to be, yaws [S], and seen from the top, up [S], and which feet
    (joints) stand, low [S, 2]."""

    skeleton: Skeleton
    poses: Array
    yaws: Array
    up: Array
    low: NDArray[np.bool_]
    feet: list[int]

    @staticmethod
    def of(passage: Passage, frames: Array) -> Film:
        """The poses at frames, which need not be whole.

        A steady eye goes with a cycle, on the straight line and with the even turn that lead from its first
        frame to its last: so what sways, leans and rotates is seen to. With other passages it goes the
        smoothed way; it keeps its direction but for turns on the spot, with which it turns. From the top it
        does not, so that a turn shows.
        """
        body = passage.body
        at = np.clip(np.round(frames).astype(np.int64), 0, len(body) - 1)
        skeleton, poses = with_tips(body.skeleton, body.positions[at], body.rotations[at])
        if passage.side:
            whole = np.linspace(0, 1, at[-1] - at[0] + 1)[:, None]
            path = np.column_stack([body.path, body.yaw])[at[0] : at[-1] + 1]
            line = path[0] + whole * (path[-1] - path[0])
            way, yaws = np.split((line + (path - line).mean(axis=0))[at - at[0]], [2], axis=1)
            yaws = yaws[:, 0]
        else:
            way = metrics.smooth(body.path, body.fps, 0.5)[at]
            yaws = body.heading[at]
            yaws = yaws if passage.move == "turn" else np.full(len(at), float(yaws.mean()))
        poses[:, 0] = np.stack([way[:, 0], 0 * way[:, 0], way[:, 1]], axis=-1)
        feet = [body.skeleton.role(body.toe(side)) for side in SIDES]
        up = yaws if passage.side else np.full(len(at), yaws[0])
        return Film(skeleton, poses, yaws, up, body.stands[at], feet)

    def size(self, view: str) -> tuple[float, float]:
        """Metres that the widest pose takes, and the tallest from the ground (from the top: all about it)."""
        yaws = self.up if view == "top" else self.yaws
        flat = np.stack([strips.project(p, yaw, view)[1:] for p, yaw in zip(self.poses, yaws, strict=True)])
        tall = 2 * np.abs(flat[..., 1]).max() if view == "top" else flat[..., 1].max()
        return float(np.ptp(flat[..., 0], axis=1).max()), float(tall)

    def draw(self, axes: Any, view: str, cell: float, height: float) -> None:
        """On matplotlib axes; see `bench.strips.draw`."""
        shown = {"low": self.low, "feet": self.feet, "view": view, "cell": cell, "height": height}
        yaws = self.up if view == "top" else self.yaws
        strips.draw(axes, self.skeleton, self.poses, yaws, **shown)  # type: ignore[arg-type]


def with_tips(skeleton: Skeleton, positions: Array, rotations: Array) -> tuple[Skeleton, Array]:
    """A skeleton and world positions [S, J, 3] with the end sites as further joints: toes and heads show."""
    tips = {joint: offset for joint, offset in skeleton.end_sites.items() if np.linalg.norm(offset) > 1e-3}
    joints = list(tips)
    names = (*skeleton.names, *(f"{skeleton.names[joint]} tip" for joint in joints))
    offsets = np.array([tips[joint] for joint in joints]).reshape(-1, 3)
    longer = replace(
        skeleton,
        names=names,
        parents=np.concatenate([skeleton.parents, joints]),
        offsets=np.concatenate([skeleton.offsets, offsets]),
        end_sites={},
    )
    points = positions[:, joints] + quat.rotate(rotations[:, joints], offsets)
    return longer, np.concatenate([positions, points], axis=1)


PANELS = (
    *("hip", "knee", "ankle", "foot"),
    *("shoulder", "elbow", "pelvis_rotation", "thorax_rotation"),
    *("pelvis_obliquity", "pelvis_tilt", "hip_abduction", "toe"),
    *("pelvis_height", "pelvis_side", "trunk_lean", "head_pitch"),
)


def cycle_curves(side: Side, move: str) -> dict[str, Array]:
    """Curves [cycles, 101] of all cycles of a move."""
    found: dict[str, list[Array]] = {}
    for passage in side.passages[move]:
        if passage.side:
            for name, curve in curves(side.gauges[passage.body], passage).items():
                found.setdefault(name, []).append(over_cycle(curve))
    return {name: np.stack(rows) for name, rows in found.items() if not name.startswith("_")}


def curves_figure(likeness: Likeness, move: str) -> Any:
    """Mean joint angles over the gait cycle: A a line, with a thin band; B a line in a band, mean ± sd.

    None for moves that are no cycles.
    """
    from matplotlib.figure import Figure

    both = [cycle_curves(side, move) for side in (likeness.a, likeness.b)]
    if any(len(next(iter(found.values()), ())) < FEWEST for found in both):
        return None
    picture = Figure(figsize=(15, 12))
    grid = picture.subplots(4, 4, sharex=True)
    picture.subplots_adjust(0.025, 0.045, 0.99, 0.93, wspace=0.13, hspace=0.16)
    percent = np.linspace(0, 100, POINTS)
    for axes, name in zip(grid.flat, PANELS, strict=True):
        for label, found, colour, shade in zip("AB", both, (A_COLOUR, B_COLOUR), (0.12, 0.28), strict=True):
            if name in found:
                mean, sd = found[name].mean(axis=0), found[name].std(axis=0)
                axes.fill_between(percent, mean - sd, mean + sd, color=colour, alpha=shade, linewidth=0)
                count = len(found[name])
                axes.plot(percent, mean, color=colour, linewidth=1.8, label=f"{label}, {count} cycles")
        axes.set_title(CURVES[name], fontsize=10, loc="left")
        axes.axhline(0, color="#999999", linewidth=0.6, zorder=0)
        axes.grid(True, color="#dddddd", linewidth=0.5)
        axes.set_xlim(0, 100)
        axes.set_xticks(range(0, 101, 20))
        axes.locator_params(axis="y", nbins=5)
        axes.tick_params(labelsize=8)
        for duty, colour in zip(_duties(likeness, move), (A_COLOUR, B_COLOUR), strict=True):
            axes.axvline(duty, color=colour, linewidth=0.9, linestyle=(0, (4, 3)))
    for axes in grid[-1]:
        axes.set_xlabel("% of the cycle, from strike to strike; dashed: toe-off", fontsize=9)
    handles, labels = grid.flat[0].get_legend_handles_labels()
    picture.suptitle(f"{unit(move)}     A: {likeness.a.name}     B: {likeness.b.name}", x=0.01, ha="left")
    picture.legend(handles, labels, loc="upper right", ncols=2, frameon=False)
    return picture


def _duties(likeness: Likeness, move: str) -> list[float]:
    return [float(side.numbers[move]["duty"].median()) for side in (likeness.a, likeness.b)]


def spectra_figure(likeness: Likeness, move: str) -> Any:
    """Velocity by frequency band of each joint, A beside B's median and spread."""
    from matplotlib.figure import Figure

    part = likeness.table[
        (likeness.table["move"] == move) & likeness.table["measure"].str.endswith(" Hz")
    ].copy()
    if part.empty:
        return None
    part[["joint", "band"]] = part["measure"].str.extract(r"^(.*) (\S+) Hz$").to_numpy()
    joints = list(dict.fromkeys(part["joint"]))
    rows = -(-len(joints) // 5)
    picture = Figure(figsize=(15, 2.6 * rows + 0.4))
    grid = np.atleast_1d(picture.subplots(rows, 5, sharex=True, sharey=True))
    picture.subplots_adjust(0.045, 0.12 / rows, 0.995, 1 - 0.26 / rows, wspace=0.06, hspace=0.2)
    for axes in grid.flat[len(joints) :]:
        axes.set_axis_off()
    for axes, joint in zip(grid.flat, joints, strict=False):
        bands = part[part["joint"] == joint]
        at = np.arange(len(bands))
        axes.fill_between(at, bands["b_low"], bands["b_high"], color=B_COLOUR, alpha=0.28, linewidth=0)
        axes.plot(at, bands["b"], "o-", color=B_COLOUR, markersize=3, label="B, 10 to 90 %")
        axes.plot(at, bands["a"], "o-", color=A_COLOUR, markersize=3, label="A, median")
        axes.set_yscale("log")
        axes.minorticks_off()
        axes.set_xticks(at, bands["band"])
        axes.set_title(joint, fontsize=10, loc="left")
        axes.grid(True, color="#dddddd", linewidth=0.5)
    grid.flat[0].set_ylabel("m/s, rms")
    picture.suptitle(f"{unit(move)}: joint velocity by band, Hz", x=0.01, ha="left")
    picture.legend(*grid.flat[0].get_legend_handles_labels(), loc="upper right", ncols=2, frameon=False)
    return picture
