"""Pictures of findings, so that a person can judge: a strip of stick figures and curves around each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import files
from ..clip import Clip
from ..stick_figures import bone_colours, project
from . import values
from .body import Body
from .finding import Finding

MOST = 8  # findings a picture
POSES = 11
AROUND = 0.15  # seconds before and after a finding
BAD = "#f6d5d5"


def save(path: Path, clip: Clip, findings: Sequence[Finding]) -> None:
    """Write a PNG with a row for each of a clip's first findings, whole or not at all."""
    picture = figure(clip, findings)
    with files.atomic(path) as stream:
        picture.savefig(stream, format="png", dpi=80)


def figure(clip: Clip, findings: Sequence[Finding]) -> Any:
    """A matplotlib figure: of each finding poses from the side, the hips' speed and the fastest joint's."""
    from matplotlib.figure import Figure

    bad = np.any(values.unusable(clip), axis=1)
    body = Body(values.filled(clip, bad)) if bad.any() and not bad.all() else Body(clip)
    shown = findings[:MOST]
    picture = Figure(figsize=(13, 3.2 * max(len(shown), 1)), layout="constrained")
    grid = picture.subplots(max(len(shown), 1), 2, width_ratios=(2.2, 1), squeeze=False)
    for finding, (left, right) in zip(shown, grid, strict=False):
        margin = max(3, round(AROUND * clip.fps))
        start, stop = max(finding.start - margin, 0), min(finding.stop + margin, len(clip))
        count = min(POSES, stop - start)
        _strip(left, body, np.linspace(start, stop - 1, count).round().astype(int), finding)
        _curves(right, body, start, stop, finding)
        weight = "bold" if finding.fatal else "normal"
        left.set_title(f"{clip.name}, {finding.kind}: {finding.what}", fontsize=9, loc="left", weight=weight)
    if len(findings) > MOST:
        picture.supxlabel(f"and {len(findings) - MOST} more", fontsize=9)
    return picture


def _strip(axes: Any, body: Body, frames: np.ndarray, finding: Finding) -> None:
    """Poses side by side, as far apart as they are wide; those of the finding stand on red."""
    from matplotlib.collections import LineCollection

    facing = np.zeros(3) if body.forward is None else body.forward[frames].mean(axis=0)
    yaw = float(np.arctan2(facing[0], facing[2]))
    poses = np.stack([_page(body.world[frame], body, yaw) for frame in frames])
    cell = 1.2 * float(np.ptp(poses[..., 0], axis=1).max()) + 0.1 * body.leg
    poses[..., 0] += np.arange(len(poses))[:, None] * cell
    parents = body.skeleton.parents
    bones = [(j, int(parents[j])) for j in range(len(parents)) if parents[j] > 0 or body.hips == parents[j]]
    colours = bone_colours(body.skeleton)
    lines = [(pose[j], pose[p]) for pose in poses for j, p in bones]
    axes.add_collection(
        LineCollection(lines, colors=[colours[j] for j, _ in bones] * len(poses), linewidths=1.2)
    )
    low, high = float(poses[..., 1].min()), float(poses[..., 1].max())
    for i, frame in enumerate(frames):
        if finding.start <= frame < finding.stop:
            axes.axvspan((i - 0.5) * cell, (i + 0.5) * cell, color=BAD, zorder=0)
        axes.text(i * cell, low - 0.12 * body.leg, f"{frame}", ha="center", va="top", fontsize=7)
    axes.axhline(0, color="#7a8288", linewidth=0.6)
    axes.set_xlim(-0.6 * cell, (len(frames) - 0.4) * cell)
    axes.set_ylim(low - 0.4 * body.leg, high + 0.1 * body.leg)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _page(pose: np.ndarray, body: Body, yaw: float) -> np.ndarray:
    """A pose [J, 3] from the side, its hips in the middle of its cell, its height as it is."""
    return project(np.concatenate([pose[body.hips : body.hips + 1], pose]), yaw)[1:]


def _curves(axes: Any, body: Body, start: int, stop: int, finding: Finding) -> None:
    """Speed of the hips, and of the joint that turns fastest, between frames."""
    between = np.arange(start, stop - 1) + 0.5
    speeds = np.linalg.norm(np.diff(body.world[start:stop, body.hips], axis=0), axis=-1) * body.fps
    turns = np.linalg.norm(body.rotation_steps[start : stop - 1], axis=-1).max(axis=1) * body.fps
    axes.axvspan(finding.start - 0.5, finding.stop - 0.5, color=BAD, zorder=0)
    axes.plot(between, speeds, ".-", color="#2e86ab", markersize=3, linewidth=1)
    axes.set_ylabel("hips, m/s", color="#2e86ab", fontsize=8)
    other = axes.twinx()
    other.plot(between, turns, ".-", color="#d1495b", markersize=3, linewidth=1)
    other.set_ylabel("fastest joint, rad/s", color="#d1495b", fontsize=8)
    axes.set_xlabel("frame", fontsize=8)
    for each in (axes, other):
        each.tick_params(labelsize=7)
        each.set_ylim(bottom=0)
