"""The pose that a skin was bound to its joints in: a better rest pose than nodes saved in mid-step.

A skin's inverse bind matrices M_j give the joints in it as M_j^-1, up to a transform that all of them share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .. import quat
from . import accessors
from .document import Document
from .rig import Rig

Array = NDArray[np.float64]

_SAME, _MOST = 0.02, 0.9  # most bones have to be as long, to so much, as the nodes have them
_ALIKE = 0.35  # mean cosine of bones, by their lengths: nodes may be posed, but not lie for standing


def pose(document: Document, rig: Rig, place: Array, turn: Array) -> tuple[Array, Array]:
    """Places [C, 3] and rotations [C, 4] in the world of a rig's chain where its skin was bound.

    place and turn are those of the nodes as they are, which are returned where the top joint has no inverse
    bind matrix or the matrices do not go with the nodes. The shared transform is none or that of the node
    above the top joint, whichever comes nearer to the nodes, or else the one of those from axes to axes that
    does. The top joint stays at its place.
    """
    bound = _bound(document, rig)
    bones = [(int(rig.parents[j]), j) for j in bound if int(rig.parents[j]) in bound]
    if rig.above not in bound or not bones:
        return place, turn
    ours = np.stack([place[j] - place[p] for p, j in bones])
    theirs = np.stack([bound[j][0] - bound[p][0] for p, j in bones])
    lengths, others = np.linalg.norm(ours, axis=-1), np.linalg.norm(theirs, axis=-1)
    solid = (lengths > 1e-3 * lengths.max()) & (others > 0)
    if not solid.any():
        return place, turn
    ratios = lengths[solid] / others[solid]
    scale = float(np.median(ratios))
    if np.mean(np.abs(ratios / scale - 1) < _SAME) < _MOST:
        return place, turn

    def likeness(shared: Array) -> float:
        # Long bones count more: arms hang with all their fingers where they were bound in a T.
        return float(np.sum(ours * quat.rotate(shared, theirs)) / np.sum(lengths * others))

    above = quat.identity() if rig.above == 0 else turn[rig.above - 1]
    shared = max((quat.identity(), above), key=likeness)
    if likeness(shared) < _ALIKE:
        shared = max(_axes(), key=likeness)
    if likeness(shared) < _ALIKE:
        return place, turn
    places, turns, top = place.copy(), turn.copy(), bound[rig.above][0]
    for j in range(rig.above, len(rig.chain)):
        if j in bound:
            places[j] = place[rig.above] + scale * quat.rotate(shared, bound[j][0] - top)
            turns[j] = quat.mul(shared, bound[j][1])
        else:  # what no skin binds keeps its place in its parent
            parent = int(rig.parents[j])
            back = quat.mul(turns[parent], quat.inv(turn[parent]))
            places[j] = places[parent] + quat.rotate(back, place[j] - place[parent])
            turns[j] = quat.mul(back, turn[j])
    return places, turns


def _axes() -> Array:
    """The 24 rotations [24, 4] that take axes to axes."""
    return np.roll(Rotation.create_group("O").as_quat(), 1, axis=-1)


def _bound(document: Document, rig: Rig) -> dict[int, tuple[Array, Array]]:
    """Place and rotation of joints, by their index in the chain, in the space of the rig's largest skin.

    None where it has no matrices, or some that shear, flatten or mirror.
    """
    index = {node: i for i, node in enumerate(rig.chain)}
    skins = [(skin.indices("joints", "nodes"), skin) for skin in document.items("skins")]
    joints, skin = max(
        ((joints, skin) for joints, skin in skins if set(joints) <= index.keys()),
        key=lambda found: len(found[0]),
        default=([], None),
    )
    accessor = None if skin is None else skin.index("inverseBindMatrices", "accessors")
    if skin is None or accessor is None:
        return {}
    matrices = accessors.numbers(document, accessor, "MAT4").reshape(-1, 4, 4)[
        : len(joints)
    ]  # columns as rows
    if len(matrices) < len(joints):
        raise skin.fault(f"{len(matrices)} inverse bind matrices for {len(joints)} joints")
    linear = np.swapaxes(matrices[:, :3, :3], 1, 2)
    sizes = np.linalg.norm(linear, axis=1)
    axes = linear / np.maximum(sizes, 1e-30)[:, None]
    skew = np.abs(np.swapaxes(axes, 1, 2) @ axes - np.eye(3)).max()
    if sizes.min() < 1e-12 or skew > 1e-2 or np.linalg.det(axes).min() < 0:
        return {}
    places = -np.linalg.solve(linear, matrices[:, 3, :3, None])[..., 0]
    turns = quat.inv(quat.from_matrix(axes))
    return {index[joint]: (places[i], turns[i]) for i, joint in enumerate(joints)}
