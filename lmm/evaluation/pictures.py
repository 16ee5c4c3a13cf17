"""Pictures of an evaluation, of what people would rather look at than read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from motion import figures

from .projector import BINS

PARTS = {"training": "training clips", "held_out": "held-out clips"}
KINDS = {"real": "real queries"} | {part: f"noisy rows of {clips}" for part, clips in PARTS.items()}
DRIVEN = {
    "skate_cm_s": "foot skate, cm/s",
    "path_cm": "distance from the path, cm",
    "heading_deg": "heading's difference, °",
    "jerk_m_s3": "jerk, m/s³",
    "real_cm": "from the nearest real pose, cm",
}


def all_of(found: dict[str, Any]) -> dict[str, bytes]:
    """PNG files by name, of learned motion matching or of a network of locomotion."""
    draw: dict[str, Callable[[dict[str, Any]], Any]] = {"joints.png": joints}
    if "free_run" in found:
        draw |= {"drift.png": free_runs, "files.png": files}
    else:
        draw |= {"drift.png": drift, "regret.png": regret}
    draw["courses.png"] = courses
    out = {}
    for name, picture in draw.items():
        with figures.style(name):
            out[name] = figures.png(picture(found))
    return out


def joints(found: dict[str, Any]) -> Any:
    """Mean position error of each joint, in the skeleton's order, on both parts of the data."""
    errors_of = found.get("decompressor") or found["poses"]
    parts = {name: errors_of[name]["joints"] for name in PARTS if name in errors_of}
    names = list(next(iter(parts.values())))
    picture, (axes,) = figures.figure(7, 1 + 0.17 * len(names))
    at = np.arange(len(names))[::-1]
    height = 0.8 / len(parts)
    for i, (part, errors) in enumerate(parts.items()):
        axes.barh(
            at + 0.4 - height * (i + 0.5), _numbers(list(errors.values())), height=height, label=PARTS[part]
        )
    axes.set_yticks(at, names, fontsize=7)
    axes.set_ylim(-0.7, len(names) - 0.3)
    axes.set_xlabel("mean distance from the true joint, root aligned, cm")
    axes.grid(True, axis="x")
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    return picture


def drift(found: dict[str, Any]) -> Any:
    """Error of the joints, and of the root's path, over the frames of a free run."""
    picture, (left, right) = figures.figure(9, 3.6, 2)
    for i, (part, run) in enumerate(found["stepper"].items()):
        colour, curves = figures.COLOURS[i], run["curves"]
        frames = np.arange(1, 1 + len(curves["joints_cm"]))
        left.plot(frames, _numbers(curves["joints_cm"]), color=colour, label=PARTS[part])
        for name, line in (("decoded_cm", ":"), ("still_cm", "--")):
            left.plot(frames, _numbers(curves[name]), color=colour, linestyle=line, linewidth=0.9)
        right.plot(frames, _numbers(curves["path_cm"]), color=colour, label=PARTS[part])
    left.plot([], [], color=figures.INK, linestyle="--", linewidth=0.9, label="the first pose held")
    left.plot([], [], color=figures.INK, linestyle=":", linewidth=0.9, label="the true state, decompressed")
    left.set_ylabel("distance of joints, root aligned, cm")
    right.set_ylabel("distance of the root from its path, cm")
    for axes in (left, right):
        axes.set_xlabel(_frames(found))
        axes.set_xlim(left=0)
        axes.set_ylim(bottom=0)
        axes.grid(True, axis="y")
    left.legend(fontsize=7, loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    return picture


def free_runs(found: dict[str, Any]) -> Any:
    """Error of the joints, the phase and the root's way over the frames of a network's free run."""
    shown = {
        "joints_cm": "distance of joints in root space, cm",
        "rotation_deg": "difference of their rotations, °",
        "phase_deg": "difference of the phase, °",
        "path_cm": "distance of the root from its path, cm",
    }
    runs = found["free_run"]
    shown = {name: label for name, label in shown.items() if any(name in r["curves"] for r in runs.values())}
    picture, panels = figures.figure(3.3 * len(shown), 3.4, len(shown))
    for axes, (name, label) in zip(panels, shown.items(), strict=True):
        for i, (part, run) in enumerate(runs.items()):
            curves = run["curves"]
            if name not in curves:
                continue
            count = 1 + np.arange(len(curves[name]))
            axes.plot(count, _numbers(curves[name]), color=figures.COLOURS[i], label=PARTS[part])
            if name == "joints_cm":
                still = _numbers(curves["still_cm"])
                axes.plot(count, still, color=figures.COLOURS[i], linestyle="--", linewidth=0.9)
        axes.set_ylabel(label)
        axes.set_xlabel(_frames(found))
        axes.set_xlim(left=0)
        axes.set_ylim(bottom=0)
        axes.grid(True, axis="y")
    panels[0].plot([], [], color=figures.INK, linestyle="--", linewidth=0.9, label="the first pose held")
    picture.legend(*panels[0].get_legend_handles_labels(), fontsize=7, loc="outside upper left", ncols=3)
    return picture


def files(found: dict[str, Any]) -> Any:
    """The thesis's relative error of each file, and over all files (its Figures 5.6 and 5.8)."""
    series = {found["kind"]: found["files"]}
    if "against" in found:
        series["against"] = found["against"]["files"]
    picture, (left, right) = figures.figure(10, 3.6, 2)
    for i, (name, rows) in enumerate(series.items()):
        at, values = np.arange(len(rows)), _numbers([100 * row["relative"] for row in rows])
        left.plot(at, values, ".-", color=figures.COLOURS[i], linewidth=0.9, markersize=4, label=name)
        held = [k for k, row in enumerate(rows) if row["held_out"]]
        left.plot(held, np.array(values)[held], "o", color=figures.COLOURS[i], fillstyle="none")
    left.plot([], [], "o", color=figures.INK, fillstyle="none", label="held-out files")
    left.set_xlabel("file, in the database's order")
    left.legend(fontsize=7, loc="lower left", bbox_to_anchor=(0, 1), ncols=3)
    boxes = [_numbers([100 * row["relative"] for row in rows]) for rows in series.values()]
    right.boxplot(boxes, widths=0.5, medianprops={"color": figures.COLOURS[1]})
    right.set_xticks(1 + np.arange(len(series)), list(series))
    for axes in (left, right):
        axes.set_ylabel("relative error of a step, %")
        axes.set_ylim(bottom=0)
        axes.grid(True, axis="y")
    return picture


def regret(found: dict[str, Any]) -> Any:
    """How often the projector's answer is how much further from the query than the true neighbour."""
    picture, (axes,) = figures.figure(6, 3.4)
    for kind, errors in found["projector"].items():
        of_it = errors["regret"]
        median, p95 = ("-" if of_it[name] is None else f"{of_it[name]:.2f}" for name in ("median", "p95"))
        told = f"{KINDS[kind]}: median {median}, 95 % {p95}"
        axes.stairs(100 * np.array(of_it["shares"]), BINS, label=told, linewidth=1.3)
    axes.axvline(1, color=figures.INK, linewidth=0.8, linestyle=(0, (4, 2)))
    axes.set_xlim(BINS[0], BINS[-1])
    axes.set_xlabel(f"distance of the answer / of the true neighbour (the last bin: {BINS[-2]:g} or more)")
    axes.set_ylabel("share of queries, %")
    axes.legend(fontsize=7, loc="lower left", bbox_to_anchor=(0, 1))
    return picture


def courses(found: dict[str, Any]) -> Any:
    """The model beside motion matching on each course."""
    rows = found["courses"]
    systems = list(dict.fromkeys(row["system"] for row in rows))[:2]
    names = list(dict.fromkeys(row["course"] for row in rows))
    picture, panels = figures.figure(13, 1 + 0.3 * len(names), len(DRIVEN))
    at, height = np.arange(len(names))[::-1], 0.4
    for p, (axes, (column, label)) in enumerate(zip(panels, DRIVEN.items(), strict=True)):
        for i, system in enumerate(systems):
            value = {row["course"]: row.get(column) for row in rows if row["system"] == system}
            axes.barh(
                at + height * (0.5 - i), _numbers([value[n] for n in names]), height=height, label=system
            )
        axes.set_yticks(at, names if p == 0 else [""] * len(names))
        axes.set_xlabel(label)
        axes.grid(True, axis="x")
    panels[0].legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    return picture


def _frames(found: dict[str, Any]) -> str:
    return f"frames of free run, {found['database']['fps']:g} a second"


def _numbers(values: list[float | None]) -> list[float]:
    return [np.nan if value is None else value for value in values]
