"""What a user did, from files, as courses: logs of the public reference, recordings, tables of keys."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motion import config, files, quat
from motion.errors import UserError

from . import interchange, recording
from .course import Course, Gait, VelocityKey
from .speeds import FROUDE, GRAVITY, HIPS

PathLike = str | os.PathLike[str]

LOG_RATE = 60.0  # frames a second of the public reference's logs, which do not say
FAST = 95  # percentile of the speed that tells whether a user ran
TURNED = 1e-6  # what two facings differ by that are the same


def read(path: PathLike) -> Course:
    """The course that a file's user took; its suffix says what it is (`FORMATS`).

    A damaged file, and one that is none of these, is a UserError.
    """
    return FORMATS[Path(path).suffix.lower()](path)


def of_log(path: PathLike) -> Course:
    """A log of the public reference: how its simulated character went under a user's hands.

    Arrays of n elements one after another: positions, velocities, accelerations (3 each), rotations (4),
    angular velocities (3), at 60 frames a second. What is asked is to go as it went, at every moment as fast
    and facing as it did, so that springs follow once more: about a quarter of a second late.
    """
    cursor = interchange.Cursor(path)
    try:
        arrays = [
            cursor.take(what, 1, elements)
            for what, elements in (
                ("positions", 3),
                ("velocities", 3),
                ("accelerations", 3),
                ("rotations", 4),
                ("angular velocities", 3),
            )
        ]
        cursor.end()
        if len({len(array) for array in arrays}) > 1 or not len(arrays[0]):
            raise interchange.Misfit(f"its arrays have {', '.join(str(len(array)) for array in arrays)} rows")
    except interchange.Misfit as misfit:
        raise interchange.refuse(path, "log of a simulated character", misfit) from misfit
    interchange.check_finite(path, *arrays)
    _, velocities, _, rotations, _ = arrays
    norms = np.linalg.norm(rotations, axis=-1)
    if np.any(np.abs(norms - 1) > 0.01):
        raise interchange.refuse(
            path, "log of a simulated character", "its rotations are no unit quaternions"
        )
    yaws = quat.yaw(rotations / norms[:, None])
    return of_velocities(velocities[:, [0, 2]], yaws, LOG_RATE, "a log of a simulated character")


def of_recording(path: PathLike) -> Course:
    """What the first character of a recorded run was asked (see `mm.recording`), at every frame of it."""
    run = recording.Recording.load(path)
    velocity, yaw = run["command_velocity"][:, 0], run["command_yaw"][:, 0]
    crouch = run.arrays.get("command_crouch")
    return of_velocities(
        velocity,
        yaw,
        run.fps,
        f"what a run of {run.system} was asked",
        crouch=crouch if crouch is None else crouch[:, 0],
    )


def of_velocities(
    velocity: ArrayLike, yaw: ArrayLike, fps: float, description: str = "", *, crouch: NDArray | None = None
) -> Course:
    """Velocities x, z [T, 2], m/s, and facings [T], radians, so many times a second, as a script.

    All of one gait, a run if the user was mostly able to: the 95th percentile of the speed is beyond where
    people begin to run (see `mm.speeds`); so scaling to the data's speeds bends no rise of the speed. Frames
    that ask for what the one before asked need no key.
    """
    velocity, yaw = np.asarray(velocity, np.float64), np.asarray(yaw, np.float64)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    runs = np.percentile(speed, FAST) >= np.sqrt(FROUDE * GRAVITY * HIPS)
    gaits: list[Gait] = ["run" if runs else "walk"] * len(yaw)
    if crouch is not None:
        gaits = ["crouch" if low else gait for low, gait in zip(crouch, gaits, strict=True)]
    facing = np.column_stack([np.sin(yaw), np.cos(yaw)])
    asked = np.column_stack([velocity, facing, [gait == "crouch" for gait in gaits]])
    new = np.append(True, np.abs(np.diff(asked, axis=0)).max(axis=1) > TURNED)
    keys = tuple(
        VelocityKey(
            time=t / fps,
            velocity=(float(velocity[t, 0]), float(velocity[t, 1])),
            gait=gaits[t],
            facing=(float(facing[t, 0]), float(facing[t, 1])),
        )
        for t in np.flatnonzero(new).tolist()
    )
    return Course(description=description, velocity=keys, seconds=len(yaw) / fps)


def of_table(path: PathLike) -> Course:
    """A CSV file with a key a row, under the names that keys have in a course's TOML file.

    Those of a stick (time, move_x, move_z, and if need be camera_deg, camera_rate_deg, strafe, gait) or those
    of a velocity (time, velocity_x, velocity_z, facing_x, facing_z, gait); an empty cell is left out. The
    last key holds as long as keys are apart on average, a single one for a second.
    """
    text = files.read_text(path, remedy="save it as UTF-8")
    table = [(line, row) for line, row in enumerate(csv.reader(io.StringIO(text)), 1) if any(row)]
    header = [name.strip() for name in table[0][1]] if table else []
    kind = "stick" if "move_x" in header else "velocity"
    for line, row in table:
        if len(row) != len(header):
            what = f"{len(row)} cells under {len(header)} headers"
            raise UserError(what, path=path, line=line, remedy="give every row as many as the first")
    keys = [_key(dict(zip(header, row, strict=True))) for _, row in table[1:]]
    if not keys:
        raise UserError("no keys", path=path, remedy="give a row of headers, and below it a row a key")
    last, gaps = keys[-1].get("time"), len(keys) - 1
    seconds = last + last / gaps if gaps and isinstance(last, float) and last > 0 else 1.0
    try:
        return config.from_dict(
            Course, {"description": "recorded keys", "seconds": seconds, kind: keys, "interpolate": "hold"}
        )
    except config.ConfigError as error:
        place = error.key[1] if len(error.key) > 1 and error.key[0] == kind else None
        found = table[1 + place][0] if isinstance(place, int) else None
        name = config.dotted(error.key[2:] if found else error.key)
        raise UserError(f"{name}: {error.what}", path=path, line=found, remedy=error.remedy) from error


def _key(cells: dict[str, str]) -> dict[str, Any]:
    """A row as TOML has it: cells of two axes are one value, and numbers are numbers."""
    key: dict[str, Any] = {}
    for name, cell in cells.items():
        if cell := cell.strip():
            vector = name.removesuffix("_x").removesuffix("_z")
            if vector == name:
                key[name] = _value(cell)
            else:
                key.setdefault(vector, []).append(_value(cell))
    return key


def _value(cell: str) -> float | bool | str:
    if cell.lower() in ("true", "false"):
        return cell.lower() == "true"
    try:
        return float(cell)
    except ValueError:
        return cell


FORMATS: dict[str, Callable[[PathLike], Course]] = {".bin": of_log, ".rec": of_recording, ".csv": of_table}
