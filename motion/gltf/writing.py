"""Clips as ``.glb`` files: the skeleton as nodes, its motion as an animation, a mesh where there is one.

What Blender and engines open, and what `read` and `skin` give back (the specification, 3.6, 3.7.3.3, 4.4).
"""

from __future__ import annotations

import json
import os
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import files, kinematics, quat
from ..clip import Clip
from ..errors import UserError
from .skins import Skin

MOVES = 1e-6  # metres by which a joint leaves its rest offset whose translation is written
SHADES = 64  # steps of colours that are told apart in a mesh
MOST_MATERIALS = 32  # a mesh of more colours bears them at its vertices
_FLOAT, _SHORT, _INT, _VERTICES, _INDICES = 5126, 5123, 5125, 34962, 34963
_KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def write(
    path: str | os.PathLike[str], clip: Clip, *, skin: Skin | None = None, unit_to_m: float | None = None
) -> None:
    """Write a clip as ``.glb``, whole or not at all; the same clip gives the same bytes.

    Lengths are metres, as the format has it: another unit_to_m is a UserError. The clip has to have Y up, as
    ours do. skin : a mesh on the clip's joints. Keys stand at every frame. End sites become nodes without
    motion; roles are not kept, since names tell them.
    """
    if len(clip) == 0:
        raise UserError(f"clip {clip.name!r} has no frames", remedy="a file holds at least one")
    if not (np.isfinite(clip.positions).all() and np.isfinite(clip.rotations).all()):
        raise UserError(f"clip {clip.name!r} has values that are not finite", remedy="cut those frames out")
    if unit_to_m not in (None, 1.0):
        raise UserError("glTF files are in metres", path=path, remedy="leave out the unit")
    builder = _Builder()
    _skeleton(builder, clip)
    _animation(builder, clip)
    _mesh(builder, clip, skin)
    with files.atomic(path) as stream:
        stream.write(builder.bytes())


class _Builder:
    """JSON and buffer of a file in the making."""

    def __init__(self) -> None:
        self.buffer = bytearray()
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "accessors": [],
            "bufferViews": [],
        }

    def accessor(self, values: NDArray, code: int = _FLOAT, *, bounds: bool = False, **view: int) -> int:
        """An accessor of numbers [K] or [K, C]; returns its index."""
        values = np.ascontiguousarray(values, {_FLOAT: "<f4", _SHORT: "<u2", _INT: "<u4"}[code])
        self.buffer += b"\0" * (-len(self.buffer) % 4)
        place = {"buffer": 0, "byteOffset": len(self.buffer), "byteLength": values.nbytes}
        self.json["bufferViews"].append(place | view)
        self.buffer += values.tobytes()
        table = values.reshape(len(values), -1)
        found = {"bufferView": len(self.json["bufferViews"]) - 1, "componentType": code, "count": len(values)}
        if bounds:
            found |= {"min": table.min(axis=0).tolist(), "max": table.max(axis=0).tolist()}
        self.json["accessors"].append(found | {"type": _KINDS[table.shape[1]]})
        return len(self.json["accessors"]) - 1

    def bytes(self) -> bytes:
        """The file: a header, a chunk of JSON, a chunk of the buffer."""
        self.json["buffers"] = [{"byteLength": len(self.buffer)}]
        text = json.dumps(self.json, ensure_ascii=False, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.buffer) + b"\0" * (-len(self.buffer) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _skeleton(builder: _Builder, clip: Clip) -> None:
    """A node for each joint, at its rest offset, and for each end site one more; joint j is node j."""
    skeleton = clip.skeleton
    nodes: list[dict[str, Any]] = [
        {"name": name, "translation": offset.tolist()}
        for name, offset in zip(skeleton.names, skeleton.offsets, strict=True)
    ]
    parents = [*skeleton.parents.tolist()]
    for joint, offset in sorted(skeleton.end_sites.items()):
        nodes.append({"name": f"{skeleton.names[joint]}_end", "translation": np.asarray(offset).tolist()})
        parents.append(joint)
    for node, parent in enumerate(parents):
        if parent >= 0:
            nodes[parent].setdefault("children", []).append(node)
    builder.json["nodes"], builder.json["scenes"] = nodes, [{"nodes": [0]}]


def _animation(builder: _Builder, clip: Clip) -> None:
    """Rotations of all joints, and translations of those that move in their parents."""
    times = builder.accessor(np.arange(len(clip)) / clip.fps, bounds=True)
    rotations = np.roll(quat.normalize(kinematics.unroll(clip.rotations)), -1, axis=-1)
    moved = np.abs(clip.positions - clip.skeleton.offsets).max(axis=(0, 2)) > MOVES
    channels: list[dict[str, Any]] = []
    samplers: list[dict[str, int]] = []
    for j in range(len(clip.skeleton)):
        paths = {"rotation": rotations[:, j]} | ({"translation": clip.positions[:, j]} if moved[j] else {})
        for path, values in paths.items():
            channels.append({"sampler": len(samplers), "target": {"node": j, "path": path}})
            samplers.append({"input": times, "output": builder.accessor(values)})
    builder.json["animations"] = [{"name": clip.name, "channels": channels, "samplers": samplers}]


def _mesh(builder: _Builder, clip: Clip, skin: Skin | None) -> None:
    """The skin that tells which nodes are joints, and the mesh that hangs on them."""
    joints = len(clip.skeleton)
    bind = np.tile(np.eye(4), (joints, 1, 1))
    if skin is None:
        rest, _ = kinematics.forward(clip.skeleton, clip.skeleton.offsets[None], quat.identity(1, joints))
        bind[:, :3, 3] = -rest[0]
    else:
        bind[:, :3] = skin.bind
    inverse = builder.accessor(np.swapaxes(bind, 1, 2).reshape(joints, 16))  # column by column
    builder.json["skins"] = [{"joints": list(range(joints)), "skeleton": 0, "inverseBindMatrices": inverse}]
    if skin is None:
        return
    shades = np.round(skin.colours[skin.triangles[:, 0]] * SHADES) / SHADES
    groups = _by_colour(shades, skin.triangles)
    painted = len(groups) > MOST_MATERIALS
    if painted:
        groups = [(np.ones(3), skin.triangles)]
    materials, primitives = [], []
    for k, (shade, triangles) in enumerate(groups):
        surface = {"baseColorFactor": [*shade.tolist(), 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}
        materials.append({"name": f"colour_{k}", "pbrMetallicRoughness": surface})
        own, corners = np.unique(triangles, return_inverse=True)
        weights = skin.weights[own]
        attributes = {
            "POSITION": builder.accessor(skin.vertices[own], bounds=True, target=_VERTICES),
            "JOINTS_0": builder.accessor(
                np.where(weights > 0, skin.joints[own], 0), _SHORT, target=_VERTICES
            ),
            "WEIGHTS_0": builder.accessor(weights, target=_VERTICES),
        }
        if painted:
            attributes["COLOR_0"] = builder.accessor(skin.colours[own], target=_VERTICES)
        if skin.normals.any():
            attributes["NORMAL"] = builder.accessor(_units(skin.normals[own]), target=_VERTICES)
        indices = builder.accessor(corners.reshape(-1), _INT, target=_INDICES)
        primitives.append({"attributes": attributes, "indices": indices, "material": k})
    builder.json["materials"], builder.json["meshes"] = materials, [{"primitives": primitives}]
    builder.json["nodes"].append({"name": "body", "mesh": 0, "skin": 0})
    builder.json["scenes"][0]["nodes"].append(len(builder.json["nodes"]) - 1)


def _units(normals: NDArray) -> NDArray:
    """Normals [V, 3] of length 1, as the format demands; those without a length point upwards."""
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.where(lengths > 0, normals / np.where(lengths > 0, lengths, 1), [0.0, 1.0, 0.0])


def _by_colour(shades: NDArray, triangles: NDArray) -> list[tuple[NDArray, NDArray]]:
    """The triangles of each colour."""
    found, of = np.unique(shades, axis=0, return_inverse=True)
    return [(shade, triangles[of.reshape(-1) == k]) for k, shade in enumerate(found)]
