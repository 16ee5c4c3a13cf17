"""Animations as clips: keys sampled at one rate, scales folded into lengths, rest poses at zero rotation."""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import kinematics, quat
from ..clip import Clip
from ..errors import UserError
from ..skeleton import Skeleton, distinct, listed
from . import accessors, bind, keys
from . import rig as rigs
from .document import Document, Item, open_document
from .rig import Nodes, Rig

MOST_TRANSFORMS = 12_000_000  # joints times frames: an hour of 55 joints at 60 frames a second
SPARSE, MOST_BETWEEN = 20_000, 600  # frames of a clip of few keys, and frames a key beyond them

_WIDTHS = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3"}
_KINDS = ("LINEAR", "STEP", "CUBICSPLINE")


@dataclass(frozen=True, eq=False)
class _Channel:
    item: Item
    node: int
    path: str
    sampler: Item


@dataclass(frozen=True, eq=False)
class _Motion:
    """An animation that moves a skeleton: its label, what it moves, and those of its channels that do."""

    label: str
    rig: Rig
    channels: list[_Channel]


def animations(path: str | os.PathLike[str]) -> list[str]:
    """Labels of a file's animations that move a skeleton, unique, in file order.

    A label is the animation's name without slashes; what stands behind ``#`` in ``hero.glb#Walk``.
    """
    return [motion.label for motion in _motions(open_document(path))]


def read(
    path: str | os.PathLike[str],
    animation: str | None = None,
    *,
    fps: float | None = None,
    own_frames: bool = False,
) -> Clip:
    """Read an animation of a glTF file as a clip in metres.

    Parameters
    ----------
    path : a ``.gltf`` or ``.glb`` file.
    animation : its label, see `animations`; it may be left out where the file has only one.
    fps : replaces the rate that the keys were taken at.
    own_frames : keep the nodes' own frames. By default each joint's frame is parallel to the world's in the
        rest pose, so that zero rotations show the rest pose; joints' places in the world are the same. That
        is the pose a skin was bound in, or else the nodes' own.

    The clip begins at the animation's first key and ends at its last, sampled at the rate that most keys are
    apart (`keys.frame_rate`). Joint 0 moves as all that is above it does. Positions of joints are the file's,
    times the scales above them. A file without such an animation, or with several of which none is named, and
    anything amiss in the file is a UserError.
    """
    document = open_document(path)
    motion = _chosen(document, animation)
    name, source = Path(path).stem, Path(path)
    if animation is not None:
        name, source = animation, Path(f"{os.fspath(path)}#{animation}")
    clip = _clip(document, motion, own_frames).replace(name=name, source=source)
    return clip if fps is None else clip.replace(fps=float(fps))


def rig_of(document: Document, animation: str | None = None) -> Rig:
    """The nodes that an animation's skeleton is made of; what animation is, see `read`."""
    return _chosen(document, animation).rig


def _chosen(document: Document, animation: str | None) -> _Motion:
    found, path = _motions(document), document.path
    if animation is None:
        if len(found) > 1:
            raise UserError(
                f"{len(found)} animations: {listed([motion.label for motion in found])}",
                path=path,
                remedy=f"name one, as {path.name}#{found[0].label}",
            )
        return found[0]
    for motion in found:
        if motion.label == animation:
            return motion
    raise UserError(
        f"no animation {animation!r}",
        path=path,
        remedy=f"the file has {listed([motion.label for motion in found])}",
    )


def read_all(path: str | os.PathLike[str], *, fps: float | None = None) -> list[Clip]:
    """All animations of a file that move a skeleton, each as `read` gives it."""
    labels = animations(path)
    if len(labels) == 1:
        return [read(path, fps=fps)]
    return [read(path, label, fps=fps) for label in labels]


@functools.lru_cache(maxsize=4)
def _motions(document: Document) -> list[_Motion]:
    """The animations that move a skeleton, at least one; kept, for each of a file's clips asks for them."""
    nodes = rigs.read_nodes(document)
    found = document.items("animations")
    if not found:
        raise document.root.fault(
            "the file has no animations", "export it with its animations, or give another file"
        )
    channels = [_channels(animation) for animation in found]
    labels = distinct([_label(animation, i) for i, animation in enumerate(found)])
    skeletons = rigs.find_rigs(document, nodes, {c.node for some in channels for c in some})
    chains = [set(rig.chain) for rig in skeletons]
    motions = []
    for label, some in zip(labels, channels, strict=True):
        moved = [[c for c in some if c.node in chain] for chain in chains]
        most = max(moved, key=len, default=[])
        if most:
            motions.append(_Motion(label, skeletons[moved.index(most)], most))
    if not motions:
        raise document.root.fault(
            "no animation moves a joint", "export the character's animation, not only its shapes or cameras"
        )
    return motions


def _label(animation: Item, index: int) -> str:
    name = re.sub(r"[/\\\x00-\x1f]+", "_", animation.text("name")).strip()
    return name[:100].strip() or f"animation_{index}"


def _channels(animation: Item) -> list[_Channel]:
    """The channels that move nodes; shapes' weights and what extensions animate are passed over."""
    samplers, found, seen = animation.items("samplers"), [], set()
    for channel in animation.items("channels"):
        target = channel.needed("target")
        node, path = target.index("node", "nodes"), target.text("path")
        if node is None or path not in _WIDTHS:
            continue
        if (node, path) in seen:
            raise channel.fault(f"the animation moves the {path} of node {node} twice")
        seen.add((node, path))
        sampler = channel.integer("sampler")
        if sampler >= len(samplers):
            raise channel.fault(f"sampler is {sampler}, but the animation has {len(samplers)}")
        found.append(_Channel(channel, node, path, samplers[sampler]))
    return found


def _clip(document: Document, motion: _Motion, own_frames: bool) -> Clip:
    rig, nodes = motion.rig, rigs.read_nodes(document)
    tracks = _tracks(document, motion)
    start = min(track.times[0] for track in tracks.values())
    stop = max(track.times[-1] for track in tracks.values())
    distinct_times = {id(track.times): track.times for track in tracks.values()}
    fps = keys.frame_rate(list(distinct_times.values()))
    frames = int(min((stop - start) * fps + 0.05, 1e12)) + 1
    known = max(len(times) for times in distinct_times.values())
    if frames * len(rig.chain) > MOST_TRANSFORMS or frames > SPARSE + MOST_BETWEEN * known:
        what = f"{frames:,} frames of {len(rig.chain)} joints from {start:g} to {stop:g} s"
        raise UserError(
            f"animation {motion.label!r}: {what}",
            path=document.path,
            remedy=f"at most {MOST_TRANSFORMS:,} joints times frames fit, and keys may not be minutes apart; "
            "cut the animation into pieces",
        )
    instants = start + np.arange(frames) / fps
    positions, rotations, scales = _local(nodes, rig, tracks, instants, fps)
    rest_place, rest_turn, rest_size = rest_pose(document, rig, own_frames=own_frames)
    place, turn, _ = _world(nodes, rig, positions, rotations, scales)

    joints = slice(rig.above, None)
    frame = quat.identity(len(rig.names)) if own_frames else rest_turn[0, joints]
    parents = np.where(rig.parents[joints] >= rig.above, rig.parents[joints] - rig.above, -1)
    ends = {}
    for joint, node in rig.ends.items():
        j, (offset, _, _) = joint - rig.above, rigs.rest(nodes.items[node])
        ends[j] = rest_size[0, joint] * np.asarray(quat.rotate(frame[j], offset), np.float64)
    bare = Skeleton(rig.names, parents, np.zeros((len(parents), 3)))
    aligned = quat.mul(rest_turn[:, joints], quat.inv(frame))
    offsets = kinematics.local(bare, np.ascontiguousarray(rest_place[:, joints]), aligned)[0][0]
    skeleton = Skeleton(rig.names, parents, offsets, end_sites=ends)
    turned = turn[:, joints] if own_frames else quat.mul(turn[:, joints], quat.inv(frame))
    local = kinematics.local(skeleton, np.ascontiguousarray(place[:, joints]), np.ascontiguousarray(turned))
    return Clip(motion.label, skeleton, fps, local[0], kinematics.unroll(local[1]), source=document.path)


def rest_pose(
    document: Document, rig: Rig, *, own_frames: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Places [1, C, 3], rotations [1, C, 4] and sizes [1, C] in the world of a rig's chain at rest: where its
    skin was bound, or with own_frames as the nodes stand in the file."""
    nodes = rigs.read_nodes(document)
    at_rest = [rigs.rest(nodes.items[node]) for node in rig.chain]
    positions, rotations, scales = (np.stack([pose[i] for pose in at_rest])[None] for i in range(3))
    place, turn, size = _world(nodes, rig, positions, rotations, scales)
    if not own_frames:
        bound = bind.pose(document, rig, place[0], turn[0])
        place, turn = bound[0][None], bound[1][None]
    return place, turn, size


def _tracks(document: Document, motion: _Motion) -> dict[tuple[int, str], keys.Sampler]:
    """The channels' keys by node and path; keys that several share are one array."""
    read: dict[tuple[int, str], NDArray[np.float64]] = {}

    def values(sampler: Item, key: str, kind: str) -> NDArray[np.float64]:
        index = sampler.index(key, "accessors")
        if index is None:
            raise sampler.fault(f"{key} is missing")
        if (index, kind) not in read:
            found = accessors.numbers(document, index, kind)
            read[index, kind] = _rising(document, index, found[:, 0]) if kind == "SCALAR" else found
        return read[index, kind]

    tracks = {}
    for channel in motion.channels:
        sampler = channel.sampler
        kind = sampler.text("interpolation", "LINEAR")
        if kind not in _KINDS:
            raise sampler.fault(f"interpolation {kind!r}, expected {', '.join(_KINDS)}")
        times = values(sampler, "input", "SCALAR")
        found = values(sampler, "output", _WIDTHS[channel.path])
        count = len(times) * (3 if kind == "CUBICSPLINE" else 1)
        if len(found) != count:
            raise sampler.fault(f"output has {len(found)} values, expected {count} for {len(times)} keys")
        shape = (len(times), 3, -1) if kind == "CUBICSPLINE" else (len(times), -1)
        found = found.reshape(shape)
        if channel.path == "rotation":
            centre = found[:, 1] if kind == "CUBICSPLINE" else found
            short = np.linalg.norm(centre, axis=-1) < 1e-6
            if short.any():
                raise sampler.fault(f"the rotation at key {np.argmax(short)} has no length")
        tracks[channel.node, channel.path] = keys.Sampler(times, found, kind)
    return tracks


def _rising(document: Document, index: int, times: NDArray[np.float64]) -> NDArray[np.float64]:
    back = np.flatnonzero(np.diff(times) < 0)
    if len(back):
        key = int(back[0])
        raise document.items("accessors")[index].fault(
            f"the times of keys fall, from {times[key]:g} to {times[key + 1]:g} s at key {key + 1}"
        )
    return times


def _local(
    nodes: Nodes,
    rig: Rig,
    tracks: dict[tuple[int, str], keys.Sampler],
    instants: NDArray[np.float64],
    fps: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Translations [T, C, 3], rotations [T, C, 4] and scales [T, C, 3] of a rig's chain at instants [T]."""
    frames, place = len(instants), {node: i for i, node in enumerate(rig.chain)}
    at_rest = [rigs.rest(nodes.items[node]) for node in rig.chain]
    positions, rotations, scales = (
        np.repeat(np.stack([pose[i] for pose in at_rest])[None], frames, axis=0) for i in range(3)
    )
    spots = _once(lambda track: keys.Instants(track.times, instants, fps))
    straight: dict[int, list[tuple[int, keys.Sampler]]] = {}
    for (node, path), track in tracks.items():
        at, joint = spots(track), place[node]
        if path == "rotation":
            if track.interpolation == "LINEAR":
                straight.setdefault(id(track.times), []).append((joint, track))
            else:
                rotations[:, joint] = keys.rotations(keys.sample(track.values, track.interpolation, at))
        else:
            out = positions if path == "translation" else scales
            out[:, joint] = keys.sample(track.values, track.interpolation, at)
    for some in straight.values():
        joints = [joint for joint, _ in some]
        values = np.stack([keys.rotations(track.values) for _, track in some], axis=1)
        rotations[:, joints] = keys.slerp(values, spots(some[0][1]))
    return positions, rotations, scales


def _once(function: Callable[[keys.Sampler], Any]) -> Callable[[keys.Sampler], Any]:
    """A function of a sampler's times that is computed once for those that samplers share."""
    known: dict[int, Any] = {}

    def call(track: keys.Sampler) -> Any:
        if id(track.times) not in known:
            known[id(track.times)] = function(track)
        return known[id(track.times)]

    return call


def _world(
    nodes: Nodes,
    rig: Rig,
    positions: NDArray[np.float64],
    rotations: NDArray[np.float64],
    scales: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Places [T, C, 3], rotations [T, C, 4] and sizes [T, C] in the world of a rig's chain.

    With one scale s a node, x_j = x_p + s_p R_p t_j, R_j = R_p R_j' and s_j = s_p s_j'.
    """
    bearing = {int(parent) for parent in rig.parents} | {j for j in rig.ends}
    sizes = np.ones(scales.shape[:2])
    for j, node in enumerate(rig.chain):
        parent = rig.parents[j]
        own = rigs.uniform(nodes.items[node], scales[:, j]) if j in bearing else 1.0
        sizes[:, j] = own * sizes[:, parent] if parent >= 0 else own
    scaled = positions.copy()
    scaled[:, 1:] *= sizes[:, rig.parents[1:], None]
    tree = Skeleton(tuple(map(str, rig.chain)), rig.parents, np.zeros((len(rig.chain), 3)))
    place, turn = kinematics.forward(tree, scaled, rotations)
    return place, turn, sizes
