"""Skinned characters: meshes of glTF files that follow the joints of their clips, by linear blends."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from numpy.typing import NDArray

from motion import kinematics, quat
from motion.gltf import Skin
from motion.gltf.skins import INFLUENCES
from motion.skeleton import Skeleton

from . import shapes
from .body import Body
from .scene import Floats, Mesh

if TYPE_CHECKING:
    from .shows import Worn

Array = NDArray[Any]


def placed(skin: Skin, positions: Array, rotations: Array, out_vertices: Floats, out_normals: Floats) -> None:
    """Vertices and normals [V, 3] in the world, from world transforms of the skin's joints [J, 3], [J, 4]."""
    transforms = _transforms(skin, positions, rotations)
    _blend(transforms, skin.joints, skin.weights, skin.vertices, skin.normals, out_vertices, out_normals)


def placed_numpy(
    skin: Skin, positions: Array, rotations: Array, out_vertices: Floats, out_normals: Floats
) -> None:
    """The obvious twin of `placed`."""
    blended = np.einsum("vk,vkij->vij", skin.weights, _transforms(skin, positions, rotations)[skin.joints])
    out_vertices[:] = np.einsum("vij,vj->vi", blended[..., :3], skin.vertices) + blended[..., 3]
    out_normals[:] = np.einsum("vij,vj->vi", blended[..., :3], skin.normals)


def mesh(skin: Skin, positions: Array, rotations: Array) -> Mesh:
    """A skin as a mesh in the world; normals that the file did not have are made of the faces."""
    vertices, normals = np.empty_like(skin.vertices), np.empty_like(skin.normals)
    placed(skin, positions, rotations, vertices, normals)
    if not skin.normals.any():
        normals = shapes.normals(vertices.astype(np.float64), skin.triangles).astype(np.float32)
    return Mesh(vertices, normals, skin.triangles, np.sqrt(skin.colours))


def of_body(body: Body, skeleton: Skeleton) -> Skin:
    """A body as a skin of its skeleton: each part hangs on its joint alone."""
    rest, _ = kinematics.forward(skeleton, skeleton.offsets[None], quat.identity(1, len(skeleton)))
    count = [len(part.vertices) for part in body.parts]
    joints = np.repeat(body.joints, count)
    whole = shapes.merged(body.parts)
    bind = np.tile(np.eye(3, 4), (len(skeleton), 1, 1))
    bind[..., 3] = -rest[0]
    hung = np.zeros((len(joints), INFLUENCES), np.int32)
    hung[:, 0] = joints
    return Skin(
        vertices=(whole.vertices + rest[0, joints]).astype(np.float32),
        normals=whole.normals,
        triangles=whole.triangles,
        colours=np.clip(whole.colours, 0, 1) ** 2,
        joints=hung,
        weights=np.eye(1, INFLUENCES, dtype=np.float32).repeat(len(joints), axis=0),
        bind=bind.astype(np.float32),
    )


def on(worn: Worn, skeleton: Skeleton) -> Skin:
    """A skin as one of all joints of the skeleton that wears it."""
    bind = np.tile(np.eye(3, 4, dtype=np.float32), (len(skeleton), 1, 1))
    bind[worn.joints] = worn.skin.bind
    return replace(worn.skin, joints=worn.joints[worn.skin.joints].astype(np.int32), bind=bind)


def _transforms(skin: Skin, positions: Array, rotations: Array) -> Floats:
    """From the mesh to the world by each joint alone, float32 [J, 3, 4]: x + R B."""
    found = quat.to_matrix(np.asarray(rotations, np.float32)) @ skin.bind
    found[..., 3] += positions
    return np.ascontiguousarray(found, np.float32)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _blend(transforms, joints, weights, vertices, normals, out_vertices, out_normals):
    for v in range(vertices.shape[0]):
        for i in range(3):
            x = y = z = w = np.float32(0)
            for k in range(joints.shape[1]):
                share = weights[v, k]
                if share > 0:
                    row = transforms[joints[v, k], i]
                    x, y, z, w = (
                        x + share * row[0],
                        y + share * row[1],
                        z + share * row[2],
                        w + share * row[3],
                    )
            out_vertices[v, i] = x * vertices[v, 0] + y * vertices[v, 1] + z * vertices[v, 2] + w
            out_normals[v, i] = x * normals[v, 0] + y * normals[v, 1] + z * normals[v, 2]
