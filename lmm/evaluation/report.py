"""What an evaluation prints, and leaves in a folder."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

from motion import console, files

from .pictures import KINDS, PARTS, all_of

# Of the rows of systems: column, title, digits after the point.
COLUMNS = (
    ("skate_cm_s", "skate cm/s", 2),
    ("path_cm", "path cm", 2),
    ("heading_deg", "heading °", 1),
    ("speed_response_s", "speed s", 2),
    ("heading_response_s", "turn s", 2),
    ("jerk_m_s3", "jerk m/s³", 0),
    ("pop_cm", "max pop cm", 2),
    ("ordinary_pop_cm", "no pop cm", 2),
    ("real_cm", "from real cm", 2),
    ("transitions_per_s", "trans/s", 2),
    ("speed_ratio", "speed ratio", 2),
    ("frame_us", "µs a character", 1),
    ("memory_mb", "memory MB", 2),
    ("broke", "broke", 0),
)
BRIEF = ("broke", "skate_cm_s", "path_cm", "heading_deg", "jerk_m_s3", "real_cm", "speed_ratio", "frame_us")


def save(found: dict[str, Any], folder: Path, *, command: str) -> list[Path]:
    """Write evaluation.json and the pictures, all of them or none."""
    content = {
        "evaluation.json": (
            json.dumps({"command": command, **found}, indent=1, allow_nan=False) + "\n"
        ).encode()
    } | all_of(found)
    with contextlib.ExitStack() as stack:
        for name, data in content.items():
            stream = stack.enter_context(files.atomic(folder / name))
            stream.write(data)
            stream.flush()  # a disk that is full leaves all the old files
    return [folder / name for name in content]


def show(found: dict[str, Any], name: str) -> None:
    """Print the tables that people read."""
    tables = {
        f"{name}: compressor and decompressor, poses of true states": poses(found),
        "stepper: free runs from true states; means, and what 95 % of the runs keep to": drifts(found),
        "projector: its answers beside those of exact search": answers(found),
        "driven over courses, means": systems(found["systems"]),
        "each course": systems(found["courses"], brief=True),
        "mixtures; of projector P, stepper S, decompressor D those named are learned": systems(
            found["mixtures"]
        ),
        "good enough?": [row | {"met": _WORDS[row["met"]]} for row in found["targets"]],
    }
    for title, rows in tables.items():
        console.print_table(rows, title=title)
        print()
    print(lasting(found["endurance"]))


_WORDS = {True: "yes", False: "no", None: "-"}


def poses(found: dict[str, Any]) -> list[dict[str, Any]]:
    """A row a part of the data and kind of error."""
    kinds = {"position_cm": "position, cm", "rotation_deg": "rotation, °", "velocity_cm_s": "velocity, cm/s"}
    return [
        {
            "clips": {"whole": "all", "training": "training", "held_out": "held out"}[part],
            "error": title,
            "mean": round(errors[kind]["mean"], 3),
            "std": round(errors[kind]["std"], 3),
            "p99": round(errors[kind]["p99"], 3),
            "worst joint": errors[kind]["worst_joint"],
            "its mean": round(errors[kind]["worst"], 3),
        }
        for part, errors in found["decompressor"].items()
        for kind, title in kinds.items()
        if kind in errors
    ]


DRIFT = {
    "joints_cm": "joints cm",
    "joints_p95_cm": "95 %",
    "decoded_cm": "decoded cm",
    "still_cm": "still cm",
    "path_cm": "root cm",
    "path_p95_cm": "root 95 %",
    "heading_deg": "heading °",
}


def drifts(found: dict[str, Any]) -> list[dict[str, Any]]:
    """A row a part of the data and number of frames."""
    return [
        {"clips": PARTS[part].removesuffix(" clips"), "frames": row["steps"], "runs": row["runs"]}
        | {title: None if row[key] is None else round(row[key], 2) for key, title in DRIFT.items()}
        for part, run in found["stepper"].items()
        for row in run["drift"]
    ]


def answers(found: dict[str, Any]) -> list[dict[str, Any]]:
    """A row a kind of query."""
    rows = []
    for kind, errors in found["projector"].items():
        decisions = errors.get("decisions") or {}
        rows.append(
            {
                "queries": KINDS[kind],
                "regret, median": round(errors["regret"]["median"], 3),
                "mean": round(errors["regret"]["mean"], 3),
                "95 %": round(errors["regret"]["p95"], 3),
                "latent error / spread": round(errors["latent_error"], 3),
                "off the data": round(errors["off_data"], 3),
                "decides as search": decisions.get("as_search"),
                "jumps": decisions.get("jumps"),
                "search jumps": decisions.get("search_jumps"),
            }
        )
    return rows


def systems(rows: list[dict[str, Any]], *, brief: bool = False) -> list[dict[str, Any]]:
    """Rows of systems, rounded; columns that no row has are left out."""
    shown = [c for c in COLUMNS if (not brief or c[0] in BRIEF) and any(c[0] in row for row in rows)]
    out = []
    for row in rows:
        cells: dict[str, Any] = {key: row[key] for key in ("system", "course") if key in row}
        for column, title, digits in shown:
            value = row.get(column)
            cells[title] = None if value is None else round(value, digits)
        out.append(cells)
    return out


def lasting(run: dict[str, Any]) -> str:
    """The long run in a sentence."""
    who = f"{run['characters']} characters under random commands"
    if not run["finite"]:
        left = f"states left the data's range after {run['outside_s']:.1f} s, " if run["outside_s"] else ""
        return f"{who}: {left}poses are no numbers after {run['broken_s']:.1f} s: not passed"
    beyond, column = 100 * run["state_excess"], run["state_excess_column"]
    return (
        f"{who} for {run['minutes']:.3g} minutes: states at most {beyond:.0f} % of a column's range beyond "
        f"it ({column}), bones off by at most {run['bone_excess_cm']:.2f} cm, roots at most "
        f"{run['speed_mps']:.2f} m/s (data: {run['data_speed_mps']:.2f}): "
        f"{'passed' if run['passed'] else 'not passed'}"
    )
