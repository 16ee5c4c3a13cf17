"""Film strips of two sources above each other, and mean joint angles over the gait cycle."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import quat
from motion.skeleton import Skeleton

from .. import metrics, strips
from .body import SIDES
from .compare import Likeness, Side
from .measures import CURVES, POINTS, curves, over_cycle
from .moves import Passage

Array = NDArray[np.floating]

VIEWS = ("side", "front", "top")
POSES = 11  # 0 to 100 per cent of a cycle
A_COLOUR, B_COLOUR = "#d1495b", "#2e86ab"
WIDTH = 15.0  # inches
HEAD = 1.12  # a figure is so many times its head joint's height, tip included
FEWEST = 2  # cycles from which a mean curve is drawn


def strip(likeness: Likeness, move: str) -> Any:
    """A figure with the most typical passage of each source, from the side, the front and the top.

    A stands above B. A cycle is shown from the left foot's strike to its next, at the same shares of it;
    other passages at the same times from their beginnings (turns: the same shares of them).
    """
    from matplotlib.figure import Figure

    speeds = [side.numbers[move]["speed"].median() for side in (likeness.b, likeness.a)]
    pairs = [(name, side.typical(move, speeds[0])) for name, side in (("A", likeness.a), ("B", likeness.b))]
    shares, labels = _instants([passage for _, passage in pairs])
    films = [_film(passage, share) for (_, passage), share in zip(pairs, shares, strict=True)]
    tall = max(float(film[1][..., 1].max()) for film in films) * 1.04
    cell = max(_width(film, view) for film in films for view in VIEWS) + 0.08
    across = {view: max(_depth(film, view) for film in films) for view in VIEWS}
    heights = [1.1 * tall if view != "top" else across[view] + 0.1 for view in VIEWS for _ in films]
    scale = WIDTH / (cell * POSES)
    title = 0.55
    picture = Figure(figsize=(WIDTH, scale * sum(heights) + title))
    rows = picture.subplots(len(heights), 1, height_ratios=heights)
    total = scale * sum(heights) + title
    picture.subplots_adjust(0, 0, 1, 1 - title / total, hspace=0)
    for i, axes in enumerate(rows):
        view, (name, passage), film = VIEWS[i // 2], pairs[i % 2], films[i % 2]
        skeleton, poses, yaws, low, feet = film
        strips.draw(
            axes,
            skeleton,
            poses,
            yaws,
            low=low,
            feet=feet,
            view=view,
            cell=cell,
            height=heights[i],
        )
        colour = A_COLOUR if name == "A" else B_COLOUR
        axes.text(
            0.004,
            0.97,
            f"{name}  {view}",
            transform=axes.transAxes,
            va="top",
            fontsize=10,
            color=colour,
            weight="bold",
        )
        if view == "side":
            where = f"{passage.name}: {passage.speed:.2f} m/s, {passage.turn:+.0f} °/s"
            axes.text(0.07, 0.97, where, transform=axes.transAxes, va="top", fontsize=9, color="#444444")
        if i == 0:
            for s, label in enumerate(labels):
                axes.text(
                    s * cell,
                    1.0 * heights[i] - 0.08 * heights[i],
                    label,
                    ha="center",
                    va="bottom",
                    fontsize=9,
                )
    picture.suptitle(
        f"{move}{' m/s' if move[-1].isdigit() else ''}     A: {likeness.a.name}     B: {likeness.b.name}",
        x=0.004,
        y=1 - 0.06 / total,
        ha="left",
        va="top",
        fontsize=12,
    )
    return picture


def _instants(passages: list[Passage]) -> tuple[list[Array], list[str]]:
    """The frames at which each passage is shown, and what is written over the columns."""
    share = np.linspace(0, 1, POSES)
    if all(p.side for p in passages) or any(p.move == "turn" for p in passages):
        frames = [p.start + share * (p.stop - p.start) for p in passages]
        return frames, [f"{100 * s:.0f} %" for s in share]
    seconds = min(p.seconds for p in passages)
    return [p.start + share * seconds * p.body.fps for p in passages], [f"{s * seconds:.2f} s" for s in share]


def _film(passage: Passage, frames: Array) -> tuple[Skeleton, Array, Array, NDArray[np.bool_], list[int]]:
    """Skeleton, poses [S, J, 3] about the mean way, facings [S], and which of the foot joints stand.

    Cycles and straight passages are seen by a steady eye: it goes the line from the first frame to the last.
    """
    body = passage.body
    at = np.clip(np.round(frames).astype(np.int64), 0, len(body) - 1)
    skeleton, positions = with_tips(body.skeleton, body.positions[at], body.rotations[at])
    line = np.linspace(0, 1, len(at))[:, None]
    first, last = body.path[at[0]], body.path[at[-1]]
    way = first + line * (last - first) if passage.side else metrics.smooth(body.path, body.fps, 0.5)[at]
    if passage.side:
        way = way + (body.path[at] - way).mean(axis=0)
    yaws = body.yaw[at[0]] + line[:, 0] * (body.yaw[at[-1]] - body.yaw[at[0]])
    if passage.side:
        yaws = yaws + float(
            np.mean(body.yaw[at[0] : at[-1] + 1] - np.linspace(yaws[0], yaws[-1], at[-1] + 1 - at[0]))
        )
    elif passage.move != "turn":
        yaws = np.full(len(at), float(body.heading[at].mean()))
    positions[:, 0] = np.stack([way[:, 0], 0 * way[:, 0], way[:, 1]], axis=-1)
    feet = [body.skeleton.role(body.toe(side)) for side in SIDES]
    return skeleton, positions, yaws, body.stands[at], feet


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


def _seen(film: tuple, view: str) -> Array:
    return np.stack([strips.project(pose, yaw, view)[1:] for pose, yaw in zip(film[1], film[2], strict=True)])


def _width(film: tuple, view: str) -> float:
    return float(np.ptp(_seen(film, view)[..., 0], axis=1).max())


def _depth(film: tuple, view: str) -> float:
    return 2 * float(np.abs(_seen(film, view)[..., 1]).max())


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
    picture = Figure(figsize=(15, 12), layout="constrained")
    grid = picture.subplots(4, 4, sharex=True)
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
        for duty, colour in zip(_duties(likeness, move), (A_COLOUR, B_COLOUR), strict=True):
            axes.axvline(duty, color=colour, linewidth=0.9, linestyle=(0, (4, 3)))
    for axes in grid[-1]:
        axes.set_xlabel("% of the cycle, from strike to strike; dashed: toe-off", fontsize=9)
    handles, labels = grid.flat[0].get_legend_handles_labels()
    unit = " m/s" if move[-1].isdigit() else ""
    picture.suptitle(f"{move}{unit}     A: {likeness.a.name}     B: {likeness.b.name}", x=0.01, ha="left")
    picture.legend(handles, labels, loc="outside upper right", ncols=2)
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
    picture = Figure(figsize=(15, 2.6 * -(-len(joints) // 5)), layout="constrained")
    grid = np.atleast_1d(picture.subplots(-(-len(joints) // 5), 5, sharex=True, sharey=True))
    for axes in grid.flat[len(joints) :]:
        axes.set_axis_off()
    for axes, joint in zip(grid.flat, joints, strict=False):
        rows = part[part["joint"] == joint]
        at = np.arange(len(rows))
        axes.fill_between(at, rows["b_low"], rows["b_high"], color=B_COLOUR, alpha=0.28, linewidth=0)
        axes.plot(at, rows["b"], "o-", color=B_COLOUR, markersize=3, label="B, 10 to 90 %")
        axes.plot(at, rows["a"], "o-", color=A_COLOUR, markersize=3, label="A, median")
        axes.set_yscale("log")
        axes.set_xticks(at, rows["band"])
        axes.set_title(joint, fontsize=10, loc="left")
        axes.grid(True, color="#dddddd", linewidth=0.5)
    grid.flat[0].set_ylabel("m/s, rms")
    unit = " m/s" if move[-1].isdigit() else ""
    picture.suptitle(f"{move}{unit}: joint velocity by band, Hz", x=0.01, ha="left")
    picture.legend(*grid.flat[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return picture
