"""What files hold by part: the project's own ones, read by their header alone."""

from __future__ import annotations

import fnmatch
import os
from pathlib import Path

from motion import files

# Part by the arrays' names, the first that fits.
PARTS = (
    ("poses.rates", "velocities"),
    ("poses.half_rates", "velocities"),
    ("poses.*root*", "root motion"),
    ("poses.contacts", "contacts"),
    ("poses.starts", "clips"),
    ("poses.stops", "clips"),
    ("poses.*", "poses"),
    ("positions", "poses"),
    ("rotations", "poses"),
    ("*velocities", "velocities"),
    ("features*", "features"),
    ("stored_latents", "latents"),
    ("starts", "clips"),
    ("stops", "clips"),
    ("mirrored", "clips"),
    ("origins", "clips"),
    ("description.*", "description"),
    ("offset", "description"),
    ("scale", "description"),
    ("state_*", "statistics"),
)


def parts(path: str | os.PathLike[str]) -> dict[str, int]:
    """Bytes of a file by part, those of its header and of what describes the data as "description".

    A network goes by its name. The sum is the file's size.
    """
    out: dict[str, int] = {}
    for name, size in files.array_sizes(path).items():
        part = next((part for pattern, part in PARTS if fnmatch.fnmatchcase(name, pattern)), None)
        part = part or name.split(".", 1)[0]
        out[part] = out.get(part, 0) + size
    rest = Path(path).stat().st_size - sum(out.values())
    return out | {"description": out.get("description", 0) + rest}
