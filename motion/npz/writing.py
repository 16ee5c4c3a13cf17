"""Writing: a clip with all that it holds, in keys that others can read."""

from __future__ import annotations

import io
import os
import zipfile

import numpy as np

from .. import files
from ..clip import Clip
from ..errors import UserError

FORMAT, VERSION = "motion clip", 1


def write(
    path: str | os.PathLike[str],
    clip: Clip,
    *,
    unit_to_m: float | None = None,
    axes: tuple[str, str, str] = ("y", "z", "right"),
) -> None:
    """Write a clip as ``.npz``, whole or not at all; the same clip gives the same bytes.

    Lengths are in metres, or divided by unit_to_m; axes (up, forward, handedness) are those that the clip is
    in, which the file says. Keys: fps, names, parents, offsets, local_positions, rotations (quaternions w, x,
    y, z in the parents' frames), and the roles and end sites; see `motion.npz`.
    """
    if len(clip) == 0:
        raise UserError(f"clip {clip.name!r} has no frames", remedy="a file holds at least one")
    if not (np.isfinite(clip.positions).all() and np.isfinite(clip.rotations).all()):
        raise UserError(f"clip {clip.name!r} has values that are not finite", remedy="cut those frames out")
    skeleton, unit = clip.skeleton, unit_to_m or 1.0
    ends = sorted(skeleton.end_sites.items())
    arrays = {
        "format": np.array(FORMAT),
        "version": np.array(VERSION),
        "fps": np.array(float(clip.fps)),
        "unit_to_m": np.array(float(unit)),
        **{key: np.array(word) for key, word in zip(("up", "forward", "handedness"), axes, strict=True)},
        "names": np.array(skeleton.names),
        "parents": skeleton.parents,
        "offsets": skeleton.offsets / unit,
        "roles": np.array(list(skeleton.roles), np.str_),
        "role_joints": np.array(list(skeleton.roles.values()), np.int32),
        "end_site_joints": np.array([joint for joint, _ in ends], np.int32),
        "end_site_offsets": np.array([offset for _, offset in ends], np.float64).reshape(-1, 3) / unit,
        "rotation_format": np.array("quaternion_wxyz"),
        "rotations": clip.rotations,
        "local_positions": clip.positions / unit,
    }
    with files.atomic(path) as stream, zipfile.ZipFile(stream, "w") as archive:
        for key, array in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, np.asanyarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{key}.npy"), buffer.getbuffer())
