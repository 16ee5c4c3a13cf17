"""A picture of a clip's labels over time, so that people can judge them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import figures, files, kinematics
from motion.clip import Clip
from motion.roles import SIDES

from . import contacts as touching
from . import phase as phases
from .labels import GAITS, Labels

INCHES, LEAST, MOST = 0.8, 9.0, 60.0  # of the picture's width: a second; at least and at most
SIDE_COLOURS = dict(zip(SIDES, figures.COLOURS, strict=False))
LEGEND = {"frameon": True, "facecolor": "white", "framealpha": 0.85, "edgecolor": "none"}
GAIT_COLOURS = ("#c9ced2", "#7fb7d1", "#e8a87c", "#9bc49a", "#c39bd3", "#7a8288")


def save(path: Path, clip: Clip, labels: Labels) -> None:
    """Write a PNG: feet and contacts, phase and its rate, speed and gait; whole or not at all."""
    with figures.style("labels"), files.atomic(path) as stream:
        stream.write(figures.png(figure(clip, labels)))


def figure(clip: Clip, labels: Labels) -> Any:
    """A matplotlib figure of labels [T] of a clip of T frames, over seconds."""
    from matplotlib.figure import Figure

    time = np.arange(len(clip)) / clip.fps
    has_phase = labels.phase is not None
    tall = [1.3, 0.9, 1.0, 1.2] if has_phase else [1.3, 0.9, 1.2]
    width = float(np.clip(INCHES * clip.seconds, LEAST, MOST))
    picture = Figure(figsize=(width, 1.6 * len(tall)), layout="constrained")
    axes = list(picture.subplots(len(tall), 1, sharex=True, height_ratios=tall))
    picture.suptitle(f"{clip.name}: {len(clip)} frames at {clip.fps:g} fps", fontsize=9, x=0.01, ha="left")
    positions, rotations = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    _feet(axes[0], time, clip, labels, positions, rotations)
    _contacts(axes[1], clip, labels)
    if has_phase:
        _phase(axes[2], time, clip, labels)
    hips = positions[:, clip.skeleton.role("hips")]
    _gait(axes[-1], time, labels, np.linalg.norm(kinematics.velocities(hips[:, [0, 2]], clip.fps), axis=-1))
    for each in axes:
        each.grid(axis="x")
    axes[-1].set(xlabel="seconds", xlim=(0, max(clip.seconds, 1e-3)))
    frames = axes[0].secondary_xaxis("top", functions=(lambda s: s * clip.fps, lambda f: f / clip.fps))
    frames.set_xlabel("frame")
    return picture


def _feet(
    axes: Any, time: NDArray, clip: Clip, labels: Labels, positions: NDArray, rotations: NDArray
) -> None:
    """Heights of what touches the ground, thick where it does."""
    places = touching.points(clip.skeleton, clip.fps, positions, rotations, labels.names)
    for c, name in enumerate(labels.names):
        side, part = name.split("_")
        style = {"color": SIDE_COLOURS[side], "linestyle": "--" if part == "heel" else "-"}
        height = places[:, c, 1]
        axes.plot(time, height, linewidth=0.8, label=name.replace("_", " "), **style)
        axes.plot(
            time, np.where(labels.contacts[:, c] != 0, height, np.nan), linewidth=3, alpha=0.45, **style
        )
    axes.set_ylabel("height, m")
    axes.legend(loc="upper right", ncols=len(labels.names), fontsize=7, **LEGEND)


def _contacts(axes: Any, clip: Clip, labels: Labels) -> None:
    """A bar for each spell of each contact."""
    for c, name in enumerate(labels.names):
        bars = [
            (start / clip.fps, (stop - start) / clip.fps)
            for start, stop in touching.spans(labels.contacts[:, c] != 0)
        ]
        axes.broken_barh(bars, (c - 0.35, 0.7), color=SIDE_COLOURS[name.split("_")[0]])
    names = [name.replace("_", " ") for name in labels.names]
    axes.set(yticks=range(len(names)), yticklabels=names, ylim=(len(names) - 0.4, -0.6))


def _phase(axes: Any, time: NDArray, clip: Clip, labels: Labels) -> None:
    """The phase, broken where it begins anew, and its rate."""
    assert labels.phase is not None
    shown = labels.phase.astype(np.float64)
    shown[1:][np.diff(shown) < -np.pi] = np.nan
    axes.plot(time, shown, linewidth=1)
    axes.set(ylabel="phase", ylim=(0, 2 * np.pi), yticks=[0, np.pi, 2 * np.pi])
    axes.set_yticklabels(["0 right", "π left", "2π right"])
    rate = axes.twinx()
    rate.plot(time, phases.rate(labels.phase, clip.fps), color=figures.COLOURS[3], linewidth=0.8)
    rate.set_ylabel("rate, rad/s", color=figures.COLOURS[3])
    rate.set_ylim(bottom=0)


def _gait(axes: Any, time: NDArray, labels: Labels, speed: NDArray) -> None:
    """Weights of the gaits, stacked, and the speed over the ground."""
    axes.stackplot(time, labels.gait.T, labels=GAITS, colors=GAIT_COLOURS)
    axes.set(ylabel="gait", ylim=(0, 1), yticks=[0, 1])
    axes.legend(loc="upper right", ncols=len(GAITS), fontsize=7, **LEGEND)
    other = axes.twinx()
    other.plot(time, speed, color="#0f0e0d", linewidth=0.8)
    other.set_ylabel("speed, m/s")
    other.set_ylim(bottom=0)
