"""Layers moved as a whole, to where a stage has the character that they are about."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from motion import quat

from ..scene import Arrows, Labels, Layer, Lines, Mesh, Points, Solids, Surface

Array = NDArray[np.floating]
Some = TypeVar("Some", bound=Layer)

_POINTS: dict[type[Layer], str] = {
    Lines: "points",
    Points: "positions",
    Labels: "positions",
    Arrows: "origins",
}


def placed(layer: Some, turn: Array, move: Array) -> Some:
    """The layer turned about the origin (turn [4]), then moved (move [3])."""
    if isinstance(layer, Surface):
        mesh = layer.mesh
        vertices, normals = quat.rotate(turn, mesh.vertices) + move, quat.rotate(turn, mesh.normals)
        return replace(layer, mesh=Mesh(vertices, normals, mesh.triangles, mesh.colours))
    if isinstance(layer, Solids):
        matrix, transforms = quat.to_matrix(turn), np.array(layer.transforms)
        transforms = (matrix @ transforms).astype(np.float32)
        transforms[..., 3] += move
        return replace(layer, transforms=transforms)
    name = _POINTS[type(layer)]
    moved: dict[str, Any] = {name: quat.rotate(turn, getattr(layer, name)) + move}
    if isinstance(layer, Arrows):
        moved["vectors"] = quat.rotate(turn, layer.vectors)
    return replace(layer, **moved)


def extent(layer: Layer) -> Array:
    """Points [P, 3] that lines, points, arrows or labels reach; none of other layers, and of hidden ones."""
    name = _POINTS.get(type(layer)) if layer.visible else None
    points = np.zeros((0, 3)) if name is None else np.asarray(getattr(layer, name), np.float64)
    return np.concatenate([points, points + layer.vectors]) if isinstance(layer, Arrows) else points


def put(layers: dict[str, Layer], name: str, layer: Layer) -> None:
    """Let a scene's layer be as this one: changed in place where there is one of its kind, made otherwise."""
    there = layers.get(name)
    if type(there) is type(layer) and there is not None:
        there.update(**{part.name: getattr(layer, part.name) for part in fields(layer) if part.init})
    else:
        layers[name] = layer
