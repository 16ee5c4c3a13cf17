"""What a comparison leaves behind: CSV, JSON, and one page that needs nothing else."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import pandas as pd

from features.terrain import flat
from motion import figures, files

from . import plots, strips
from .compare import DATA, Comparison, plain

# Column, title, digits after the point, what it is.
COLUMNS: tuple[tuple[str, str, int, str], ...] = (
    ("memory_mb", "memory MB", 2, "all that the system holds, 10^6 bytes"),
    ("frame_us", "frame µs", 1, "median of a whole frame, one character, one pinned thread, warm"),
    ("frame_mean_us", "mean µs", 1, "mean of a whole frame, its share of the searches included"),
    ("frame_p99_us", "p99 µs", 0, "99th percentile of a whole frame"),
    ("search_us", "search µs", 1, "median of the projection over the frames that searched"),
    ("skate_cm_s", "skate cm/s", 2, "mean of v (2 - 2^(h/H)), H = 2.5 cm, over frames and feet"),
    ("skate_ratio", "skating", 3, "share of frames with a foot below 5 cm and faster than 0.5 m/s"),
    ("glide_share", "gliding", 3, "share of frames that travel without a foot going back under the root"),
    ("airborne_share", "airborne", 3, "share of frames with every foot over 5 cm above its rest: flight"),
    ("sink_cm", "sink cm", 2, "mean depth of the deepest heel or toe in the ground, the shortest way out"),
    ("sink_p99_cm", "sink p99", 1, "99th percentile of that"),
    ("hover_cm", "hover cm", 2, "how high the lower of heel and toe of a foot in contact is over it, mean"),
    ("path_cm", "path cm", 1, "mean distance from the commanded path, on courses that have one"),
    ("path_p95_cm", "path p95", 1, "95th percentile of that distance"),
    ("path_max_cm", "path max", 1, "the largest of that distance"),
    ("heading_deg", "heading °", 1, "mean difference between the facing and the commanded facing"),
    ("speed_response_s", "speed s", 2, "time from a step in the commanded speed to 90 % of it"),
    ("heading_response_s", "turn s", 2, "time from a step in the commanded facing to 90 % of it"),
    ("response_share", "answered", 2, "share of those steps that were answered before the next"),
    ("jerk_m_s3", "jerk m/s³", 0, "mean norm of the third difference of joint positions"),
    ("pop_cm", "max pop cm", 2, "largest jump of a joint at any transition beyond its velocity"),
    ("ordinary_pop_cm", "no pop cm", 2, "the same where there is no transition, 99th percentile"),
    ("pose_cm", "pose error cm", 2, "joints of poses decoded of true frames, from the data's, root-aligned"),
    ("pose_p99_cm", "p99", 2, "99th percentile of that"),
    ("pose_worst_cm", "worst", 2, "the same of the worst joint, its mean"),
    ("pose_deg", "°", 2, "mean angle between the joints' own rotations, decoded and true"),
    ("pose_cm_s", "cm/s", 1, "mean difference of the joints' velocities, decoded and true"),
    (
        "pose_held_cm",
        "held-out cm",
        2,
        "the same of clips that no model was trained on",
    ),
    (
        "real_cm",
        "real pose cm",
        2,
        "joints from the nearest pose of the data, root-aligned",
    ),
    ("mm_near_cm", "near mm cm", 2, "to what mm-exact shows within half a second, asked the same"),
    ("mm_cm", "from mm cm", 1, "to what it shows at the same frame: being out of step counts"),
    ("transitions_per_s", "trans/s", 2, "transitions a second"),
    ("speed_ratio", "speed ratio", 2, "metres walked over metres commanded"),
    ("stall_s", "no step s", 2, "longest time for which who was asked to go did not step"),
)
BRIEF = (
    "memory_mb",
    "frame_us",
    "frame_mean_us",
    "frame_p99_us",
    "search_us",
    "skate_cm_s",
    "glide_share",
    "airborne_share",
    "sink_cm",
    "sink_p99_cm",
    "hover_cm",
    "path_cm",
    "heading_deg",
    "speed_response_s",
    "heading_response_s",
    "jerk_m_s3",
    "pop_cm",
    "pose_cm",
    "pose_held_cm",
    "real_cm",
    "mm_near_cm",
    "transitions_per_s",
    "speed_ratio",
)
ABOUT = {name: about for name, _, _, about in COLUMNS}
STRIPS = 3  # different ways a course that are drawn as film strips, at least


def save(comparison: Comparison, folder: Path, *, command: str) -> list[Path]:
    """Write summary.csv, courses.csv, summary.json and report.html, all of them or none."""
    texts = {
        "summary.csv": comparison.summary.to_csv(index=False, lineterminator="\n"),
        "courses.csv": comparison.courses.to_csv(index=False, lineterminator="\n"),
        "summary.json": json.dumps(to_json(comparison, command=command), indent=1, allow_nan=False) + "\n",
        "report.html": html(comparison, command=command),
    }
    return files.write_together(folder, texts)


def to_json(comparison: Comparison, *, command: str) -> dict[str, Any]:
    """All numbers and where they come from, as plain data."""
    return {
        "command": command,
        "database": comparison.database,
        "models": comparison.models,
        "machine": comparison.machine,
        "ground": comparison.ground and comparison.ground.facts(),
        "notes": comparison.notes,
        "summary": plain(comparison.summary),
        "courses": plain(comparison.courses),
        "played": [course.to_dict() for course in comparison.played],
    }


def brief(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows for the terminal: the columns that matter most, rounded; None where there is no number."""
    titles = {name: (title, digits) for name, title, digits, _ in COLUMNS}
    rows = []
    for row in table.to_dict("records"):
        cells: dict[str, Any] = {"system": row["system"]}
        if "course" in row:
            cells["course"] = row["course"]
        for name in (name for name in BRIEF if name in table):
            title, digits = titles[name]
            value = row[name]
            cells[title] = None if value is None or not math.isfinite(value) else round(float(value), digits)
        rows.append(cells)
    return rows


def number(value: Any, digits: int) -> str | None:
    """A number with a fixed number of digits; None where there is none."""
    if value is None or not math.isfinite(value):
        return None
    return f"{value:,.{digits}f}"


def html(comparison: Comparison, *, command: str) -> str:
    """The page."""
    import jinja2

    template = resources.files(__package__) / "templates" / "report.html"
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    return environment.from_string(template.read_text("utf-8")).render(
        comparison=comparison,
        facts=facts(comparison),
        command=command,
        data=DATA,
        columns=[c for c in COLUMNS if c[0] in comparison.summary],
        number=number,
        summary=comparison.summary.to_dict("records"),
        pictures=_pictures(comparison),
        sections=[_section(comparison, course) for course in comparison.played],
    )


def facts(comparison: Comparison) -> list[str]:
    """Sentences that follow from the numbers."""
    rows = comparison.summary[comparison.summary["system"] != DATA]
    out = []
    for column, what, unit in (
        ("memory_mb", "The smallest in memory", "MB"),
        ("frame_mean_us", "The cheapest frame, on average,", "µs"),
        ("skate_cm_s", "The least foot skate", "cm/s"),
        ("path_cm", "The closest to the path", "cm"),
        ("real_cm", "The closest to real poses", "cm"),
    ):
        values = rows[["system", column]].dropna() if column in rows else rows[:0]
        if len(values):
            best, worst = values.loc[values[column].idxmin()], values.loc[values[column].idxmax()]
            sentence = f"{what} is {best['system']} with {best[column]:.3g} {unit}"
            if worst[column] > best[column]:
                sentence += f"; {worst['system']} has {worst[column]:.3g}"
            out.append(sentence + ".")
    return out


def _pictures(comparison: Comparison) -> list[tuple[str, str]]:
    """Title and SVG of the figures over all courses."""
    systems = comparison.summary[comparison.summary["system"] != DATA]
    out = []
    for title, draw, rows in (
        ("Cost of a frame by stage", plots.costs, systems),
        ("Memory by part", plots.memory, systems),
        ("Skate and distance from the path", plots.skate_and_path, comparison.summary),
    ):
        with figures.style(title):
            out.append((title, figures.svg(draw(rows))))
    return out


def _section(comparison: Comparison, course: Any) -> dict[str, Any]:
    """What the page shows of one course."""
    traces = [t for t in comparison.traces if t.course == course.name]
    rows = comparison.courses[comparison.courses["course"] == course.name]
    groups = plots.groups(traces)
    with figures.style(course.name):
        pictures = [
            figures.svg(
                draw([group[0] for group in same], [plots.label(group) for group in same], comparison.ground)
            )
            for draw, same in ((plots.paths, plots.groups(traces, poses=False)), (plots.over_time, groups))
        ]
    return {
        "name": course.name,
        "description": course.description,
        "rows": rows.to_dict("records"),
        "pictures": pictures,
        "strips": _strips(comparison, drawn(traces), course.name),
    }


def drawn(traces: Sequence[Any]) -> list[Sequence[Any]]:
    """Groups whose film strips are drawn: the first of each family of systems, and `STRIPS` in any case.

    Those of a family that went the same way are a group; others may stand at one place in other poses.
    """
    families: dict[str, list[Any]] = {}
    for trace in traces:
        families.setdefault(trace.system.split("-", 1)[0], []).append(trace)
    groups = [plots.groups(own, poses=False) for own in families.values()]
    first = [own[0] for own in groups]
    others = [group for own in groups for group in own[1:]][: max(STRIPS - len(first), 0)]
    return [group for own in groups for group in own if group in first or group in others]


def _strips(comparison: Comparison, groups: Sequence[Sequence[Any]], course: str) -> list[tuple[str, str]]:
    out = []
    for i, group in enumerate(groups):
        with figures.style(f"{course} {i}"):
            picture = strips.figure(group[0], feet=comparison.feet, ground=comparison.ground or flat)
            out.append((plots.label(group), figures.svg(picture)))
    return out
