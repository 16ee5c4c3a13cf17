"""Documents as clips and clips as documents, and both steps at once between clips and files."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from .. import euler, files, quat, units
from ..clip import Clip
from ..errors import UserError
from ..skeleton import Skeleton, distinct, sort_topologically
from .document import CHANNELS, BvhDocument
from .reading import parse
from .writing import serialise


def to_clip(document: BvhDocument, *, name: str, unit_to_m: float = 1.0, source: Path | None = None) -> Clip:
    """The clip of a document: lengths times unit_to_m, degrees to unrolled quaternions.

    Joints of the same name are told apart by a number behind the later ones.
    """
    frames, joints = len(document.values), len(document.names)
    positions = np.repeat(document.offsets[None], frames, axis=0)
    columns, axes = np.full((2, joints, 3), -1, np.int64)
    column = 0
    for j, channels in enumerate(document.channels):
        turns = 0
        for channel in channels:
            axis = "XYZ".index(channel[0])
            if channel.endswith("position"):
                positions[:, j, axis] = document.values[:, column]
            elif channel.endswith("rotation"):
                columns[j, turns], axes[j, turns] = column, axis
                turns += 1
            column += 1
    rotations = euler.unrolled(document.values, columns, axes)
    ends = {j: sites[0] for j, sites in enumerate(document.end_sites) if sites}
    skeleton = Skeleton(distinct(document.names), document.parents, document.offsets, end_sites=ends)
    clip = Clip(name, skeleton, document.fps, positions, rotations, source=source)
    return clip if unit_to_m == 1 else units.to_metres(clip, unit_to_m)


def read(path: str | os.PathLike[str], *, fps: float | None = None, unit_to_m: float = 1.0) -> Clip:
    """Read a BVH file as a clip named after it.

    Lengths are multiplied by unit_to_m; fps, if given, replaces the file's rate.
    """
    clip = to_clip(parse(path), name=Path(path).stem, unit_to_m=unit_to_m, source=Path(path))
    return clip if fps is None else clip.replace(fps=float(fps))


def from_clip(
    clip: Clip, *, unit_to_m: float | None = None, order: str = "zxy", decimals: int = 6
) -> BvhDocument:
    """The document of a clip, its lengths divided by unit_to_m (the clip's own unless given).

    The root gets six channels, and so does every joint whose position moves by more than the decimals hide;
    the others get their constant position as OFFSET.
    """
    unit = clip.unit_to_m if unit_to_m is None else unit_to_m
    if sorted(order.lower()) != ["x", "y", "z"]:
        raise UserError(
            f"rotation order {order!r}", remedy="an order names x, y and z once each, as zxy does"
        )
    skeleton = clip.skeleton
    if len(clip) == 0:
        raise UserError(f"clip {clip.name!r} has no frames", remedy="a file holds at least one")
    if not (np.isfinite(clip.positions).all() and np.isfinite(clip.rotations).all()):
        raise UserError(f"clip {clip.name!r} has values that are not finite", remedy="cut those frames out")
    joints = sort_topologically(skeleton.parents.tolist())
    place = np.empty(len(joints), np.int64)
    place[joints] = np.arange(len(joints))
    positions = clip.positions[:, joints] / unit
    angles = np.degrees(quat.to_euler(clip.rotations[:, joints], order.lower()))
    moving = np.ptp(positions, axis=0).max(axis=-1) > 0.5 * 10.0**-decimals
    moving[0] = True
    turns = tuple(f"{axis.upper()}rotation" for axis in order)
    blocks = []
    for j in range(len(joints)):
        blocks += [positions[:, j], angles[:, j]] if moving[j] else [angles[:, j]]
    has_child = np.isin(np.arange(len(joints)), skeleton.parents)
    ends = [
        (skeleton.end_sites[j] / unit,) if j in skeleton.end_sites else () if has_child[j] else (np.zeros(3),)
        for j in joints.tolist()
    ]
    return BvhDocument(
        names=tuple(" ".join(re.sub(r"[{}]", "_", skeleton.names[j]).split()) for j in joints),
        parents=np.array([-1, *place[skeleton.parents[joints[1:]]]], np.int32),
        offsets=np.where(moving[:, None], skeleton.offsets[joints] / unit, positions[0]),
        end_sites=tuple(ends),
        channels=tuple((*CHANNELS[:3], *turns) if moves else turns for moves in moving),
        frame_time=f"{1 / clip.fps:.10f}",
        values=np.concatenate(blocks, axis=1),
    )


def write(
    path: str | os.PathLike[str],
    clip: Clip,
    *,
    unit_to_m: float | None = None,
    order: str = "zxy",
    decimals: int = 6,
) -> None:
    """Write a clip as BVH, whole or not at all; see `from_clip`."""
    content = serialise(
        from_clip(clip, unit_to_m=unit_to_m, order=order, decimals=decimals), decimals=decimals
    )
    with files.atomic(path) as stream:
        stream.write(content)
