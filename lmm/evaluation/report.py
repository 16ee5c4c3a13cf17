"""What an evaluation prints, and leaves in a folder."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

from features import terrain
from motion import console, files

from .pictures import KINDS, PARTS, all_of

# Of the rows of systems: column, title, digits after the point.
COLUMNS = (
    ("skate_cm_s", "skate cm/s", 2),
    ("sink_cm", "sink cm", 2),
    ("sink_p99_cm", "sink p99", 1),
    ("hover_cm", "hover cm", 2),
    ("path_cm", "path cm", 2),
    ("path_max_cm", "path max", 1),
    ("heading_deg", "heading °", 1),
    ("speed_response_s", "speed s", 2),
    ("heading_response_s", "turn s", 2),
    ("jerk_m_s3", "jerk m/s³", 0),
    ("pop_cm", "max pop cm", 2),
    ("ordinary_pop_cm", "no pop cm", 2),
    ("real_cm", "from real cm", 2),
    ("transitions_per_s", "trans/s", 2),
    ("speed_ratio", "speed ratio", 2),
    ("stall_s", "no step s", 2),
    ("frame_us", "µs a character", 1),
    ("memory_mb", "memory MB", 2),
    ("broke", "broke", 0),
)
BRIEF = (
    *("broke", "skate_cm_s", "sink_cm", "sink_p99_cm", "hover_cm", "path_cm", "path_max_cm", "heading_deg"),
    *("jerk_m_s3", "real_cm", "speed_ratio", "stall_s", "frame_us"),
)


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
    """Print the tables that people read, of learned motion matching or of a network of locomotion."""
    tables = of_network(found, name) if "free_run" in found else of_stages(found, name)
    tables |= {
        "driven over courses, means": systems(found["systems"]),
        "each course": systems(found["courses"], brief=True),
    }
    if "mixtures" in found:
        title = (
            f"mixtures over {', '.join(found['mixed'])}; "
            "of projector P, stepper S, decompressor D those named are learned"
        )
        tables[title] = systems(found["mixtures"])
    tables["good enough?"] = [row | {"met": _WORDS[row["met"]]} for row in found["targets"]]
    for title, rows in tables.items():
        console.print_table(rows, title=title)
        print()
    for sentence in found.get("blame", []):
        print(f"Over {', '.join(found['mixed'])}: {sentence[0].lower()}{sentence[1:]}")
    if found["ground"]:
        print(f"courses lie on {terrain.told(found['ground'])}; all else is on level ground")
    print(lasting(found["endurance"]))


_WORDS = {True: "yes", False: "no", None: "-"}
_KEPT = ", {fps:g} frames a second; means, and what 95 % of the runs keep to"


def of_stages(found: dict[str, Any], name: str) -> dict[str, list[dict[str, Any]]]:
    """Tables by title of the networks of learned motion matching, each alone."""
    return {
        f"{name}: compressor and decompressor, poses of true states": poses(found["decompressor"]),
        f"stepper: free runs from true states{_KEPT.format(**found['database'])}": drifts(found),
        "projector: its answers beside those of exact search": answers(found),
    }


def of_network(found: dict[str, Any], name: str) -> dict[str, list[dict[str, Any]]]:
    """Tables by title of a network of locomotion alone."""
    return {
        f"{name}: one step from true frames, under the true trajectory": poses(found["poses"]),
        f"free runs under the true trajectory{_KEPT.format(**found['database'])}": [
            {"clips": PARTS[part].removesuffix(" clips")}
            | {title: _rounded(row.get(key), 2) for key, title in RUN.items() if key in row}
            for part, run in found["free_run"].items()
            for row in run["drift"]
        ],
        "relative error of a step |t - p| / |t|, over files (the thesis, formula 3.1)": accuracy(found),
        "what a frame of one character costs; operations by the thesis's formula 6.1": [
            {title: _rounded(row.get(key), digits) for key, title, digits in COST} for row in found["costs"]
        ],
    }


RUN = {
    "steps": "frames",
    "runs": "runs",
    "joints_cm": "joints cm",
    "joints_p95_cm": "95 %",
    "rotation_deg": "rotations °",
    "phase_deg": "phase °",
    "phase_p95_deg": "phase 95 %",
    "still_cm": "still cm",
    "path_cm": "root cm",
    "path_p95_cm": "root 95 %",
    "heading_deg": "heading °",
}
COST = (
    ("system", "system", 0),
    ("operations", "operations", 0),
    ("frame_us", "frame µs", 1),
    ("mean_us", "mean µs", 1),
    ("of_lmm", "/ LMM's", 2),
    ("network_us", "network µs", 1),
    ("ns_per_operation", "ns an operation", 3),
    ("memory_mb", "memory MB", 2),
)


def accuracy(found: dict[str, Any]) -> list[dict[str, Any]]:
    """A row a network: mean and deviation of its files, the worst of them; how much two differ."""
    rows = []
    for name, one in ((found["kind"], found), ("against", found.get("against"))):
        if one is not None:
            worst = max(one["files"], key=lambda row: row["relative"] or 0)
            rows.append(
                {
                    "network": name,
                    "files": one["accuracy"]["files"],
                    "mean": _rounded(one["accuracy"]["mean"], 4),
                    "sd": _rounded(one["accuracy"]["sd"], 4),
                    "worst file": worst["file"] + " (mirrored)" * worst["mirrored"],
                    "its mean": _rounded(worst["relative"], 4),
                    "differ by, sd": _rounded(one.get("significance"), 2),
                }
            )
    return rows


def _rounded(value: Any, digits: int) -> Any:
    return round(value, digits) if isinstance(value, float) else value


def poses(errors_of: dict[str, Any]) -> list[dict[str, Any]]:
    """A row a part of the data and kind of error."""
    kinds = {"position_cm": "position, cm", "rotation_deg": "rotation, °", "velocity_cm_s": "velocity, cm/s"}
    return [
        {
            "clips": {"whole": "all", "training": "training", "held_out": "held out"}[part],
            "error": title,
            "mean": _rounded(errors[kind]["mean"], 3),
            "std": _rounded(errors[kind]["std"], 3),
            "p99": _rounded(errors[kind]["p99"], 3),
            "worst joint": errors[kind]["worst_joint"],
            "its mean": _rounded(errors[kind]["worst"], 3),
        }
        for part, errors in errors_of.items()
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
        | {title: _rounded(row[key], 2) for key, title in DRIFT.items()}
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
                "regret, median": _rounded(errors["regret"]["median"], 3),
                "mean": _rounded(errors["regret"]["mean"], 3),
                "95 %": _rounded(errors["regret"]["p95"], 3),
                "latent error / spread": _rounded(errors["latent_error"], 3),
                "off the data": _rounded(errors["off_data"], 3),
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
        f"it ({column}), bones off by at most {run['bone_excess_cm']:.2f} cm, hips by "
        f"{run['hips_excess_cm']:.2f}, roots at most {run['speed_mps']:.2f} m/s "
        f"(data: {run['data_speed_mps']:.2f}), {_stalled(run)}: "
        f"{'passed' if run['passed'] else 'not passed'}"
    )


def _stalled(run: dict[str, Any]) -> str:
    stall = run["stall_s"]
    return (
        "no feet to step with" if stall is None else f"at most {stall:.1f} s without a step when asked to go"
    )
