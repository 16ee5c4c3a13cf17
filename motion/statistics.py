"""What a clip is like in numbers: size, rate, speed, direction of travel."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import kinematics, quat
from .clip import Clip
from .leadin import starts_at_rest
from .root import across

COLUMNS = (
    *("frames", "fps", "seconds", "joints", "unit_to_m", "mean_speed_mps", "p99_speed_mps", "path_m"),
    *("forward_share", "left_share", "net_turn_deg", "hip_height_m"),
)
SHORTEST_PATH = 0.3  # metres; below it the direction of travel is that of swaying on the spot


def statistics(clip: Clip) -> dict[str, Any]:
    """Numbers about a clip, by column name.

    Speeds and path_m are of the hips over the ground, between frames. forward_share and left_share are the
    cosines between the hips' facing, and their left, and the direction of travel, averaged over the path (a
    step counts by its length). net_turn_deg is how far the hips' facing turns, left is positive, full turns
    counted. hip_height_m is the median height of the hips above y = 0.

    The hips face along left x up, left being the line between the thighs. Only in ASF/AMC, whose root carries
    axes by definition, it is the root's +Z, and left_share counts by how level that axis lies (as the data's
    manifest has it; it matters for bent bodies only). A rest pose inserted as first frame counts in frames
    and seconds only. Numbers that a clip is too short for are None. The clip needs the role hips, and up_legs
    or arms.
    """
    start = 1 if starts_at_rest(clip) else 0
    world, turns = kinematics.forward(clip.skeleton, clip.positions[start:], clip.rotations[start:])
    joint = clip.skeleton.role("hips")
    hips = world[:, joint]
    by_axis = clip.source is not None and clip.source.suffix.lower() == ".amc"
    if by_axis:
        forward = quat.rotate(turns[:, joint], np.broadcast_to([0.0, 0.0, 1.0], hips.shape))[:, [0, 2]]
    else:
        left = across(clip.skeleton, world)
        forward = np.stack([-left[:, 2], left[:, 0]], axis=-1)
    level = np.linalg.norm(forward, axis=-1, keepdims=True)
    forward = forward / np.maximum(level, 1e-12)
    left = np.stack([forward[:, 1], -forward[:, 0]], axis=-1) * (level if by_axis else 1)
    steps = np.diff(hips[:, [0, 2]], axis=0)
    lengths = np.linalg.norm(steps, axis=-1)
    path = float(lengths.sum())
    speeds = lengths * clip.fps
    yaw = np.unwrap(np.arctan2(forward[:, 0], forward[:, 1]))
    moves = len(steps) > 0
    return {
        "frames": len(clip),
        "fps": clip.fps,
        "seconds": clip.seconds,
        "joints": len(clip.skeleton),
        "unit_to_m": clip.unit_to_m,
        "mean_speed_mps": float(speeds.mean()) if moves else None,
        "p99_speed_mps": float(np.percentile(speeds, 99)) if moves else None,
        "path_m": path,
        "forward_share": float((steps * forward[:-1]).sum()) / path if path >= SHORTEST_PATH else None,
        "left_share": float((steps * left[:-1]).sum()) / path if path >= SHORTEST_PATH else None,
        "net_turn_deg": float(np.degrees(yaw[-1] - yaw[0])) if len(yaw) else None,
        "hip_height_m": float(np.median(hips[:, 1])) if len(hips) else None,
    }
