"""Skins: the mesh of a character and how it hangs on the joints of its clips."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import quat
from . import accessors, clips
from .document import Document, Item, open_document

Array = NDArray[np.float64]

TRIANGLES = 4
GREY = (0.5, 0.5, 0.5)
INFLUENCES = 4  # joints that move a vertex; those beyond are passed over


@dataclass(frozen=True, eq=False, repr=False)
class Skin:
    """A mesh of V vertices on the J joints of a clip that `motion.gltf.read` gives of the same file.

    Attributes
    ----------
    vertices, normals : float32 [V, 3] as stored; normals are zero where the file has none.
    triangles : int32 [F, 3].
    colours : float32 [V, 3], the materials' base colours, linear; textures are passed over.
    joints : int32 [V, 4], which joints move a vertex.
    weights : float32 [V, 4], how much; their sum is 1.
    bind : float32 [J, 3, 4], from the mesh to each joint's axes: with x and R of a joint in the world,
        a vertex is at the sum of w (x + R B v).
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    triangles: NDArray[np.int32]
    colours: NDArray[np.float32]
    joints: NDArray[np.int32]
    weights: NDArray[np.float32]
    bind: NDArray[np.float32]

    def __repr__(self) -> str:
        return f"Skin({len(self.vertices)} vertices on {len(self.bind)} joints)"


def skin(path: str | os.PathLike[str], animation: str | None = None) -> Skin | None:
    """The meshes that hang on an animation's skeleton, as one; None where there are none.

    With G the joint's transform in the world and M its inverse bind matrix, a vertex is at the sum of w G M v
    (the specification, 3.7.3.3). Errors: UserError for what is amiss in the file.
    """
    document = open_document(path)
    rig = clips.rig_of(document, animation)
    _, turns, sizes = clips.rest_pose(document, rig)
    place = {node: i - rig.above for i, node in enumerate(rig.chain) if i >= rig.above}
    frames = quat.to_matrix(turns[0, rig.above :]) * sizes[0, rig.above :, None, None]
    found: list[tuple[NDArray, ...]] = []
    binds = np.tile(np.eye(3, 4), (len(rig.names), 1, 1))
    for node in document.items("nodes"):
        mesh, hung = node.index("mesh", "meshes"), node.index("skin", "skins")
        if mesh is None or hung is None:
            continue
        item = document.items("skins")[hung]
        joints = item.indices("joints", "nodes")
        if not set(joints) <= place.keys():
            continue
        own = np.array([place[joint] for joint in joints])
        binds[own] = frames[own] @ _inverse_binds(document, item, len(joints))
        for primitive in document.items("meshes")[mesh].items("primitives"):
            if primitive.integer("mode", TRIANGLES) == TRIANGLES:
                found.append(_primitive(document, primitive, own))
    return _joined(found, binds) if found else None


def _inverse_binds(document: Document, item: Item, count: int) -> Array:
    """Inverse bind matrices [K, 3, 4]; the identity where the skin has none."""
    index = item.index("inverseBindMatrices", "accessors")
    if index is None:
        return np.tile(np.eye(3, 4), (count, 1, 1))
    matrices = accessors.numbers(document, index, "MAT4").reshape(-1, 4, 4)
    if len(matrices) < count:
        raise item.fault(f"{len(matrices)} inverse bind matrices for {count} joints")
    return np.swapaxes(matrices[:count], 1, 2)[:, :3]


def _primitive(document: Document, item: Item, own: NDArray[np.int64]) -> tuple[NDArray, ...]:
    """Vertices, normals, triangles, colours, joints and weights."""
    attributes = item.needed("attributes")

    def read(name: str, kind: str) -> Array | None:
        index = attributes.index(name, "accessors")
        return None if index is None else accessors.numbers(document, index, kind)

    vertices, joints, weights = read("POSITION", "VEC3"), read("JOINTS_0", "VEC4"), read("WEIGHTS_0", "VEC4")
    if vertices is None or joints is None or weights is None:
        raise item.fault("a skinned mesh without POSITION, JOINTS_0 or WEIGHTS_0")
    normals = read("NORMAL", "VEC3")
    normals = np.zeros_like(vertices) if normals is None else normals
    count, index = len(vertices), item.index("indices", "accessors")
    corners = np.arange(count) if index is None else accessors.numbers(document, index, "SCALAR")[:, 0]
    if not len(normals) == len(joints) == len(weights) == count:
        raise item.fault(
            f"{len(normals)} normals, {len(joints)} joints, {len(weights)} weights of {count} vertices"
        )
    if len(corners) % 3 or not 0 <= corners.min(initial=0) <= corners.max(initial=0) < max(count, 1):
        raise item.fault(f"its {len(corners)} indices are no triangles of {count} vertices")
    if not (joints.min(initial=0) >= 0 and joints.max(initial=0) < len(own) and weights.min(initial=0) >= 0):
        raise item.fault(f"JOINTS_0 beyond the skin's {len(own)} joints, or WEIGHTS_0 below 0")
    total = weights.sum(axis=-1, keepdims=True)
    weights = np.where(total > 0, weights / np.where(total > 0, total, 1), np.eye(INFLUENCES)[0])
    colours = np.tile(_colour(document, item), (count, 1))
    return vertices, normals, corners.reshape(-1, 3), colours, own[joints.astype(np.int64)], weights


def _colour(document: Document, item: Item) -> Array:
    index = item.index("material", "materials")
    surface = None if index is None else document.items("materials")[index].item("pbrMetallicRoughness")
    factor = None if surface is None else surface.numbers("baseColorFactor", 4)
    return np.array(GREY) if factor is None else np.clip(factor[:3], 0, 1)


def _joined(found: list[tuple[NDArray, ...]], binds: Array) -> Skin:
    firsts = np.cumsum([0, *(len(part[0]) for part in found)])
    triangles = [part[2] + first for part, first in zip(found, firsts, strict=False)]
    vertices, normals, _, colours, joints, weights = (
        np.concatenate([part[i] for part in found]) for i in range(6)
    )
    return Skin(
        vertices.astype(np.float32),
        normals.astype(np.float32),
        np.concatenate(triangles).astype(np.int32),
        colours.astype(np.float32),
        joints.astype(np.int32),
        weights.astype(np.float32),
        binds.astype(np.float32),
    )
