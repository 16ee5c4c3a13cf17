"""The nodes of a file that make a skeleton: a skin's joints or what is animated, all between, all above."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import quat
from ..skeleton import distinct
from .document import Document, Item

MOST_NODES, MOST_DEPTH, MOST_JOINTS = 100_000, 1_000, 1_000
_UNIFORM = 1e-3  # by which a node's three scales may differ from their mean
APPLY = "apply the scale in the program that made the file, and export it again"


@dataclass(frozen=True, eq=False)
class Nodes:
    """The tree of all nodes.

    Attributes
    ----------
    items : the nodes.
    parents : [N], -1 where there is none.
    order : parents before children, siblings as their parent lists them.
    """

    items: list[Item]
    parents: list[int]
    order: list[int]

    def path(self, node: int) -> list[int]:
        """From the top of the tree to the node."""
        path = [node]
        while self.parents[path[-1]] >= 0:
            path.append(self.parents[path[-1]])
        return path[::-1]

    def meet(self, nodes: Iterable[int]) -> int:
        """The lowest node that is, or is above, all of some; -1 where they are of several trees."""
        common: list[int] | None = None
        for node in nodes:
            path = self.path(node)
            if common is None:
                common = path
            else:
                same = [a for a, b in zip(common, path, strict=False) if a == b]
                common = same
        return common[-1] if common else -1


@dataclass(frozen=True, eq=False)
class Rig:
    """A skeleton's nodes.

    Attributes
    ----------
    chain : first the nodes above the top joint, then the joints; parents before children.
    parents : [C] index in chain, -1 for the first.
    above : how many of the chain stand above the top joint.
    names : of the joints, unique.
    ends : joint (its index in chain) to a node that ends it and is no joint.
    """

    chain: tuple[int, ...]
    parents: NDArray[np.int32]
    above: int
    names: tuple[str, ...]
    ends: dict[int, int]


def read_nodes(document: Document) -> Nodes:
    """The tree; a node with two parents, below itself, or more nodes than any file has is a UserError."""
    items = document.items("nodes")
    if len(items) > MOST_NODES:
        raise document.root.fault(f"/nodes: {len(items)} nodes, at most {MOST_NODES} are read")
    parents = [-1] * len(items)
    children = [item.indices("children", "nodes") for item in items]
    for node, below in enumerate(children):
        for child in below:
            if parents[child] >= 0:
                raise items[child].fault(f"it is a child of both node {parents[child]} and node {node}")
            parents[child] = node
    order, stack = [], [node for node, parent in enumerate(parents) if parent < 0][::-1]
    depth = [0] * len(items)
    while stack:
        node = stack.pop()
        order.append(node)
        depth[node] = depth[parents[node]] + 1 if parents[node] >= 0 else 0
        if depth[node] > MOST_DEPTH:
            raise items[node].fault(f"nodes nested more than {MOST_DEPTH} deep")
        stack.extend(children[node][::-1])
    if len(order) < len(items):
        lost = min(set(range(len(items))) - set(order))
        raise items[lost].fault("it is below itself: the nodes form a ring")
    return Nodes(items, parents, order)


def find_rigs(document: Document, nodes: Nodes, animated: set[int]) -> list[Rig]:
    """The skeletons of a file: of its skins or, where no animation moves one, of its animated trees."""
    groups = _skins(document, nodes)
    if not any(animated & _ways(nodes, group) for group in groups):
        trees: dict[int, set[int]] = {}
        for node in animated:
            trees.setdefault(nodes.path(node)[0], set()).add(node)
        groups = [_subtree(nodes, nodes.meet(tree), tree) for tree in trees.values()]
    return [_rig(document, nodes, group) for group in groups]


def _ways(nodes: Nodes, group: set[int]) -> set[int]:
    """A group's nodes and all above them."""
    return {above for joint in group for above in nodes.path(joint)}


def _skins(document: Document, nodes: Nodes) -> list[set[int]]:
    """Joints of the skins; skins whose joints are one another's, or stand above one another, are one body."""
    groups: list[set[int]] = []
    for skin in document.items("skins"):
        joints = set(skin.indices("joints", "nodes"))
        if not joints:
            raise skin.fault("it has no joints")
        if nodes.meet(joints) < 0:
            raise skin.fault("its joints have no common root")
        ways, apart = _ways(nodes, joints), []
        for group in groups:
            others = _ways(nodes, group)
            if joints & others or group & ways:
                joints, ways = joints | group, ways | others
            else:
                apart.append(group)
        groups = [*apart, joints]
    return groups


def _subtree(nodes: Nodes, top: int, animated: set[int]) -> set[int]:
    """Animated nodes, and those below their top that only place others: no still meshes, lights, cameras."""
    below, kept = {top}, set(animated)
    for node in nodes.order:
        if nodes.parents[node] in below:
            below.add(node)
            if not {"mesh", "camera", "skin", "extensions"} & nodes.items[node].data.keys():
                kept.add(node)
    return kept | {top}


def _rig(document: Document, nodes: Nodes, group: set[int]) -> Rig:
    top = nodes.meet(group)
    above = nodes.path(top)[:-1]
    wanted = {top}
    for joint in group:
        while joint not in wanted:
            wanted.add(joint)
            joint = nodes.parents[joint]
    if len(wanted) > MOST_JOINTS:
        raise nodes.items[top].fault(
            f"{len(wanted)} joints below it, at most {MOST_JOINTS} make a body", "no body has such a skeleton"
        )
    joints = [node for node in nodes.order if node in wanted]
    chain = (*above, *joints)
    place = {node: i for i, node in enumerate(chain)}
    parents = np.array([place.get(nodes.parents[node], -1) for node in chain], np.int32)
    names = distinct([nodes.items[n].text("name").strip() or f"node_{n}" for n in joints])
    has_child = set(parents.tolist())
    ends: dict[int, int] = {}
    for node in nodes.order:
        parent = place.get(nodes.parents[node], -1)
        solid = {"mesh", "camera", "skin"} & nodes.items[node].data.keys()
        if node not in place and parent >= len(above) and parent not in has_child and not solid:
            ends.setdefault(parent, node)
    return Rig(chain, parents, len(above), names, ends)


def rest(item: Item) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Translation [3], rotation (w, x, y, z) and scales [3] of a node, by its properties or its matrix."""
    matrix = item.numbers("matrix", 16)
    if matrix is not None:
        columns = matrix.reshape(4, 4)  # as the file lists them, column by column
        scales = np.linalg.norm(columns[:3, :3], axis=-1)
        axes = columns[:3, :3] / np.maximum(scales, 1e-30)[:, None]
        if scales.min() == 0 or np.abs(axes @ axes.T - np.eye(3)).max() > 1e-2:
            raise item.fault("its matrix shears or flattens", APPLY)
        if np.linalg.det(axes) < 0:
            raise item.fault("its matrix mirrors", APPLY)
        return columns[3, :3], quat.from_matrix(axes.T), scales
    translation = item.numbers("translation", 3)
    rotation = item.numbers("rotation", 4)
    scale = item.numbers("scale", 3)
    if rotation is not None and not np.linalg.norm(rotation) > 1e-6:
        raise item.fault("its rotation has no length")
    return (
        np.zeros(3) if translation is None else translation,
        quat.identity() if rotation is None else quat.normalize(np.roll(rotation, 1)),
        np.ones(3) if scale is None else scale,
    )


def uniform(item: Item, scales: NDArray[np.float64]) -> NDArray[np.float64]:
    """The one scale [...] of three [..., 3]; scales that differ or mirror are a UserError."""
    mean = scales.mean(axis=-1)
    uneven = np.abs(scales - mean[..., None]).max(axis=-1) > _UNIFORM * np.abs(mean)
    if np.any(uneven | (mean < 0)):
        first = np.reshape(scales, (-1, 3))[np.argmax(uneven | (mean < 0))]
        what = "shears" if np.any(uneven) else "mirrors"
        raise item.fault(f"scale {', '.join(f'{s:g}' for s in first)} {what} the joints below it", APPLY)
    return np.asarray(mean)
