from __future__ import annotations

import numpy as np
import pytest

from viewer import shapes
from viewer.scene import Mesh

GREY = np.full(3, 0.5)


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.triangles[:, i]].astype(float) for i in range(3))
    return float(np.sum(np.cross(a, b) * c) / 6)


def is_closed(mesh: Mesh) -> bool:
    """Whether each edge is walked once in each direction."""
    edges = np.concatenate([mesh.triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    walked = {tuple(edge) for edge in edges.tolist()}
    return len(walked) == len(edges) and all((b, a) in walked for a, b in walked)


MESHES = {
    "ellipsoid": shapes.ellipsoid([1, 2, 3], np.diag([0.5, 1.0, 2.0]), GREY),
    "capsule": shapes.capsule([0, 0, 0], [0, 2, 0], (0.3, 0.3), GREY),
    "limb": shapes.limb(np.eye(3), [1, 0, 0], [(0, 0.1, 0.2), (1, 0.2, 0.1, 0.05)], GREY, square=3.0),
    "arrow": shapes.arrows(np.zeros((1, 3)), np.array([[0, 0, 1.0]]), GREY, 0.01),
}


@pytest.mark.parametrize("name", MESHES)
def test_bodies_are_closed_and_turned_to_the_outside(name: str) -> None:
    mesh = MESHES[name]
    assert is_closed(mesh)
    assert volume(mesh) > 0
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=-1), 1, atol=1e-5)
    # A small step along the normals makes it larger.
    assert volume(Mesh(mesh.vertices + 1e-3 * mesh.normals, mesh.normals, mesh.triangles, GREY)) > volume(
        mesh
    )


def test_volumes_come_near_to_those_of_geometry() -> None:
    # A polygon of n corners has n sin(2 pi / n) / 2 pi of its circle's area.
    n = shapes.AROUND
    flat = n * np.sin(2 * np.pi / n) / (2 * np.pi)
    assert volume(MESHES["ellipsoid"]) == pytest.approx(flat * 4 / 3 * np.pi * 0.5 * 1 * 2, rel=0.05)
    ball, tube = 4 / 3 * np.pi * 0.3**3, np.pi * 0.3**2 * 2
    assert volume(MESHES["capsule"]) == pytest.approx(flat * (ball + tube), rel=0.02)


def test_a_capsule_reaches_from_end_to_end() -> None:
    mesh = MESHES["capsule"]
    assert mesh.vertices[:, 1].max() == pytest.approx(2.3, abs=0.02)
    assert mesh.vertices[:, 1].min() == pytest.approx(-0.3, abs=0.02)


def test_arrows_without_a_length_are_none() -> None:
    origins, vectors = np.zeros((2, 3)), np.array([[0, 0, 0], [0, 1.0, 0]])
    two = shapes.arrows(origins, vectors, np.array([[1.0, 0, 0], [0, 1, 0]]), 0.01)
    np.testing.assert_allclose(np.unique(two.colours, axis=0), [[0, 1, 0]])
    assert two.vertices[:, 1].max() == pytest.approx(1.0)
    assert len(shapes.arrows(origins, 0 * vectors, GREY, 0.01).triangles) == 0


def test_merged_meshes_keep_their_triangles() -> None:
    one, other = MESHES["capsule"], MESHES["ellipsoid"]
    both = shapes.merged([one, other])
    assert volume(both) == pytest.approx(volume(one) + volume(other), rel=1e-5)
