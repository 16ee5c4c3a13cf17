"""What others hold, as far as they tell, beside what this database takes and what its systems do."""

from __future__ import annotations

from typing import Any

import pandas as pd

from bench.published import O3DE, TABLE_3
from mm.database import Database

HOUR = 3600.0
# Of the paper's scenarios those of systems that ours answer to, and what each is.
SHOWN = {
    ("locomotion", "MM"): "",
    ("locomotion", "DMM"): ": a Decompressor and latents",
    ("locomotion", "LMM"): "",
    ("terrain", "PFNN"): "",
    ("dog", "MANN"): "",
}
OURS = (
    "mm-exact",
    "mm-coded-quantised-11+features-8bit",
    "lmm-D",
    "lmm-PSD",
    "lmm-PSD-fp16",
    "pfnn-cubic",
    "mann-4",
)


def features(database: Database) -> list[dict[str, Any]]:
    """Rows: MB of the features of an hour of motion; mirrored copies are as much again."""
    columns, fps = database.schema.size, database.fps
    rows = [(O3DE[0], *O3DE[1:], 4.0)]
    rows += [
        (f"this database, schema {database.schema.name}{name}", columns, fps, size)
        for name, size in (
            ("", 4.0),
            (", 8 bits", 1.0),
            (", product quantisation", -(-columns // 3) / columns),
        )
    ]
    return [
        {
            "features": name,
            "columns": count,
            "fps": rate,
            "bytes_a_number": size,
            "mb_an_hour": count * rate * HOUR * size / 1e6,
        }
        for name, count, rate, size in rows
    ]


def beside(database: Database, systems: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows: MB in all, and bytes by frame of the data, of the paper's systems and some of ours."""
    rows = [
        (
            f"the paper's {row.system}, {row.scenario}{SHOWN[row.scenario, row.system]}",
            row.joints,
            row.frames,
            row.memory_mb,
        )
        for row in TABLE_3
        if (row.scenario, row.system) in SHOWN
    ]
    held = dict(zip(systems["system"].str.removesuffix("-free"), systems["memory_mb"], strict=True))
    rows += [(name, len(database.skeleton), len(database), held[name]) for name in OURS if name in held]
    return [
        {"system": name, "joints": joints, "frames": frames, "mb": mb, "bytes_a_frame": 1e6 * mb / frames}
        for name, joints, frames, mb in rows
    ]
