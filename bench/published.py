"""What others have published of such systems, in one place, and ours beside it.

The paper is D. Holden, O. Kanoun, M. Perepichka, T. Popa, Learned Motion Matching, 2020 (its Table 3, see
REFERENCE 3.3): one thread at 3.5 GHz, C++; searches every 10 frames; its MM has no velocities and no constant
translations. The thesis's own figures stand in `bench.thesis.published`, O3DE's feature matrix is that of its
default schema (REFERENCE 2.3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import pandas as pd

from mm.database import Database

from .thesis import published as thesis

if TYPE_CHECKING:
    from lmm.models import AnyModel

PAPER, THESIS, OURS = "LMM paper, 2020", "PFNN thesis, 2021", "ours"
NONE = math.nan


class Figures(NamedTuple):
    """A row of the paper's table: MB in all, microseconds of a frame and of a search, hours of training."""

    scenario: str
    system: str
    joints: int
    frames: int
    features: float
    memory_mb: float
    frame_us: float
    search_us: float = NONE
    training_hours: float = 0.0


# features is how many numbers a search compares. A projector stands where a search does.
TABLE_3 = (
    Figures("locomotion", "MM", 28, 89_480, 27, 52.1, 9, 90),
    Figures("locomotion", "DMM", 28, 89_480, 27, 21.4, 94, 90, 8.7),
    Figures("locomotion", "LMM", 28, 89_480, 27, 5.3, 197, 127, 14.7),
    Figures("terrain", "MM", 28, 170_534, 35, 104.7, 21),
    Figures("terrain", "DMM", 28, 170_534, 35, 31.7, 102, NONE, 8.8),
    Figures("terrain", "LMM", 28, 170_534, 35, 5.5, 200, NONE, 15.3),
    Figures("terrain", "PFNN", 28, 170_534, NONE, 9.3, 1370, NONE, 21.5),
    Figures("dog", "MM", 58, 124_418, 39, 136.5, 11),
    Figures("dog", "DMM", 58, 124_418, 39, 36.3, 142, NONE, 16.9),
    Figures("dog", "LMM", 58, 124_418, 39, 6.5, 262, NONE, 23.0),
    Figures("dog", "MANN", 58, 124_418, NONE, 16.9, 2440, NONE, 5.9),
    Figures("bear", "MM", 75, 694_272, 55, 995.6, 94),
    Figures("bear", "DMM", 75, 694_272, 55, 238.3, 187, NONE, 20.4),
    Figures("bear", "LMM", 75, 694_272, 55, 7.1, 340, NONE, 29.3),
    Figures("user study, 30 Hz", "MM", 54, 23_382, 27, 23.4, 11),
    Figures("user study, 30 Hz", "DMM", 54, 23_382, 27, 7.0, 94, NONE, 16.6),
    Figures("user study, 30 Hz", "LMM", 54, 23_382, 27, 6.1, 155, NONE, 23.0),
)
# Features of an hour, float32 numbers: who, columns, frames a second.
O3DE = ("O3DE's default schema", 59, 30.0)
# Systems of ours that answer to theirs: MM, DMM, LMM, PFNN, MANN.
COUNTERPARTS = ("mm-exact", "lmm-D", "lmm-PSD", "pfnn-cubic", "pfnn-constant", "mann-4", "mann-8")


def beside(
    database: Database,
    summary: pd.DataFrame,
    models: Mapping[str, AnyModel],
    training_hours: Mapping[str, float] | None = None,
) -> list[dict[str, Any]]:
    """Rows of ours by a comparison's summary first, then the paper's and the thesis's; NaN is not told.

    Columns: source, scenario, system, joints, frames, features, memory_mb (of the thesis weights alone),
    bytes_a_frame (of the data), frame_us, search_us, training_hours (ours by model, where that is known; the
    paper's PFNN and MANN were trained on a GPU).
    """
    hours = training_hours or {}
    rows: list[dict[str, Any]] = []
    for row in summary.to_dict("records"):
        name = str(row["system"]).removesuffix("-free")
        model = next((model for model in models if name.startswith(f"{model}-")), None)
        if name not in COUNTERPARTS and not (model and name.endswith("-PSD")):
            continue
        if name != row["system"] and name in set(summary["system"]):
            continue
        figures = Figures(
            "this database",
            str(row["system"]),
            len(database.skeleton),
            len(database),
            database.features.shape[1],
            row["memory_mb"],
            row.get("frame_mean_us", NONE),
            row.get("search_us", NONE),
            hours.get(model, NONE) if model else 0.0,
        )
        rows.append({"source": OURS, **figures._asdict()})
    rows += [{"source": PAPER, **figures._asdict()} for figures in TABLE_3]
    rows += [
        {
            "source": THESIS,
            "scenario": "Apex engine",
            "system": name,
            "memory_mb": thesis.SIZES_MB["weights"][name],
            "frame_us": 1000 * thesis.FRAME_MS[name][0],
            "training_hours": thesis.PIPELINE_S["training"][name] / 3600,
        }
        for name in thesis.CONFIGURATIONS
    ]
    for row in rows:
        row["bytes_a_frame"] = 1e6 * row["memory_mb"] / row["frames"] if "frames" in row else NONE
    return rows
