"""Skins: the mesh of a character and how it hangs on the joints of its clips."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import quat
from . import accessors, clips, paint
from .document import Document, Item, open_document
from .rig import read_nodes, rest

Array = NDArray[np.float64]

TRIANGLES = 4
INFLUENCES = 4  # joints that move a vertex; those beyond are passed over
_DRACO = "KHR_draco_mesh_compression"


@dataclass(frozen=True, eq=False, repr=False)
class Skin:
    """A mesh of V vertices on the J joints of a clip that `motion.gltf.read` gives of the same file.

    Attributes
    ----------
    vertices, normals : float32 [V, 3] as stored; normals are zero where the file has none.
    triangles : int32 [F, 3].
    colours : float32 [V, 3], linear: the material's, its texture's there, the vertex's (`motion.gltf.paint`).
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


class _Part(NamedTuple):
    """A primitive: as of a `Skin`, its joints counted among those of what it hangs on."""

    vertices: Array
    normals: Array
    triangles: NDArray[np.int64]
    colours: Array
    joints: NDArray[np.int64]
    weights: Array


def skin(path: str | os.PathLike[str], animation: str | None = None) -> Skin | None:
    """The meshes that hang on an animation's skeleton, as one; None where there are none.

    With G the joint's transform in the world and M its inverse bind matrix, a vertex is at the sum of w G M v
    (the specification, 3.7.3.3). A mesh without a skin at a joint, or below one, moves with that joint alone.
    Errors: UserError for what is amiss in the file.
    """
    document = open_document(path)
    rig = clips.rig_of(document, animation)
    hung = _Hung(len(rig.names))
    place = {node: i - rig.above for i, node in enumerate(rig.chain) if i >= rig.above}
    for node, item in enumerate(document.items("nodes")):
        mesh, own = item.index("mesh", "meshes"), item.index("skin", "skins")
        if mesh is None:
            continue
        if own is None:
            held = _held(document, node, place)
            joints, inverse = ([], np.zeros((0, 4, 4))) if held is None else ([held[0]], held[1][None])
        else:
            skin = document.items("skins")[own]
            joints = [place.get(joint, -1) for joint in skin.indices("joints", "nodes")]
            inverse = _inverse_binds(document, skin, len(joints))
        if not joints or min(joints) < 0:
            continue  # another character's, or the scenery
        for primitive in document.items("meshes")[mesh].items("primitives"):
            if primitive.integer("mode", TRIANGLES) == TRIANGLES:
                part = _primitive(document, primitive, len(joints), skinned=own is not None)
                hung.add(part, np.array(joints), inverse)
    if not hung.parts:
        return None
    _, turns, sizes = clips.rest_pose(document, rig)
    frames = quat.to_matrix(turns[0, rig.above :]) * sizes[0, rig.above :, None, None]
    return _joined(hung.parts, frames @ hung.inverse[:, :3])


class _Hung:
    """Meshes on J joints: their parts, and the matrices inverse [J, 4, 4] from the mesh to each joint's node.

    The first mesh on a joint says what its matrix is; vertices of others are put where that one takes them to
    the same place (those of one skin differ from another's by a transform that its joints share).
    """

    def __init__(self, count: int) -> None:
        self.parts: list[_Part] = []
        self.inverse, self._known = np.tile(np.eye(4), (count, 1, 1)), np.zeros(count, bool)

    def add(self, part: _Part, joints: NDArray[np.int64], inverse: Array) -> None:
        """Take a part in, whose joints [V, 4] count among these [K]; inverse are their matrices [K, 4, 4]."""
        fresh = ~self._known[joints]
        self.inverse[joints[fresh]], self._known[joints] = inverse[fresh], True
        there = self.inverse[joints]
        if not np.allclose(there, inverse, rtol=1e-5, atol=1e-6):
            moved = np.linalg.pinv(there) @ inverse
            heaviest = np.take_along_axis(part.joints, part.weights.argmax(axis=-1)[:, None], axis=-1)[:, 0]
            turn, move = moved[heaviest, :3, :3], moved[heaviest, :3, 3]
            vertices = np.einsum("vij,vj->vi", turn, part.vertices) + move
            normals = np.einsum("vij,vj->vi", turn, part.normals)
            size = np.linalg.norm(normals, axis=-1, keepdims=True)
            part = part._replace(vertices=vertices, normals=normals / np.where(size > 0, size, 1))
        self.parts.append(part._replace(joints=joints[part.joints]))


def _held(document: Document, node: int, place: dict[int, int]) -> tuple[int, Array] | None:
    """The joint that a node without a skin is, or stands below, and the transform [4, 4] from it to there;
    None without one."""
    nodes, whole = read_nodes(document), np.eye(4)
    while node not in place:
        whole = _local(nodes.items[node]) @ whole
        node = nodes.parents[node]
        if node < 0:
            return None
    return place[node], whole


def _local(item: Item) -> Array:
    """A node's transform [4, 4] in its parent."""
    matrix = item.numbers("matrix", 16)
    if matrix is not None:
        return matrix.reshape(4, 4).T
    translation, rotation, scales = rest(item)
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = quat.to_matrix(rotation) * scales, translation
    return found


def _inverse_binds(document: Document, item: Item, count: int) -> Array:
    """Inverse bind matrices [K, 4, 4]; the identity where the skin has none."""
    index = item.index("inverseBindMatrices", "accessors")
    if index is None:
        return np.tile(np.eye(4), (count, 1, 1))
    matrices = accessors.numbers(document, index, "MAT4").reshape(-1, 4, 4)
    if len(matrices) < count:
        raise item.fault(f"{len(matrices)} inverse bind matrices for {count} joints")
    return np.swapaxes(matrices[:count], 1, 2)


def _primitive(document: Document, item: Item, count: int, *, skinned: bool) -> _Part:
    """A part of a mesh on so many joints; without a skin it hangs on the first one."""
    attributes, extensions = item.needed("attributes"), item.item("extensions")
    if extensions is not None and _DRACO in extensions.data:
        raise item.fault(f"it is compressed by {_DRACO}, which is not supported", "export it uncompressed")

    def read(name: str, kind: str) -> Array | None:
        index = attributes.index(name, "accessors")
        return None if index is None else accessors.numbers(document, index, kind)

    vertices, joints, weights = read("POSITION", "VEC3"), read("JOINTS_0", "VEC4"), read("WEIGHTS_0", "VEC4")
    if vertices is not None and not skinned:
        joints = np.zeros((len(vertices), INFLUENCES))
        weights = np.eye(1, INFLUENCES).repeat(len(vertices), axis=0)
    if vertices is None or joints is None or weights is None:
        raise item.fault(
            f"a {'skinned ' * skinned}mesh without POSITION{', JOINTS_0 or WEIGHTS_0' * skinned}"
        )
    normals = read("NORMAL", "VEC3")
    normals = np.zeros_like(vertices) if normals is None else normals
    size, index = len(vertices), item.index("indices", "accessors")
    corners = np.arange(size) if index is None else accessors.numbers(document, index, "SCALAR")[:, 0]
    if not len(normals) == len(joints) == len(weights) == size:
        raise item.fault(
            f"{len(normals)} normals, {len(joints)} joints, {len(weights)} weights of {size} vertices"
        )
    if len(corners) % 3 or not 0 <= corners.min(initial=0) <= corners.max(initial=0) < max(size, 1):
        raise item.fault(f"its {len(corners)} indices are no triangles of {size} vertices")
    if not (joints.min(initial=0) >= 0 and joints.max(initial=0) < count and weights.min(initial=0) >= 0):
        raise item.fault(f"JOINTS_0 beyond the skin's {count} joints, or WEIGHTS_0 below 0")
    total = weights.sum(axis=-1, keepdims=True)
    weights = np.where(total > 0, weights / np.where(total > 0, total, 1), np.eye(INFLUENCES)[0])
    colours = paint.colours(document, item, size)
    triangles = corners.reshape(-1, 3).astype(np.int64)
    return _Part(vertices, normals, triangles, colours, joints.astype(np.int64), weights)


def _joined(parts: list[_Part], bind: Array) -> Skin:
    firsts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    triangles = [part.triangles + first for part, first in zip(parts, firsts, strict=False)]
    vertices, normals, _, colours, joints, weights = (
        np.concatenate([part[i] for part in parts]) for i in range(len(_Part._fields))
    )
    return Skin(
        vertices.astype(np.float32),
        normals.astype(np.float32),
        np.concatenate(triangles).astype(np.int32),
        colours.astype(np.float32),
        joints.astype(np.int32),
        weights.astype(np.float32),
        bind.astype(np.float32),
    )
