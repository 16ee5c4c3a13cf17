from __future__ import annotations

import numpy as np
import pytest
import viewer_scenes as scenes

from viewer.scene import Labels, Lines, Mesh, Points, Surface, colour


def test_colours_are_read_from_their_usual_form() -> None:
    np.testing.assert_allclose(colour("#ff8000"), [1, 128 / 255, 0])


def test_updates_are_counted_and_checked() -> None:
    layer = Points(positions=np.zeros((2, 3)))
    assert layer.positions.dtype == np.float32
    before = layer.revision
    layer.update(positions=np.ones((5, 3)))
    assert layer.revision == before + 1
    assert len(layer.positions) == 5
    layer.update(positions=np.ones((5, 3)), size=layer.size)
    assert layer.revision == before + 1  # nothing changed
    with pytest.raises(AttributeError, match="no sizes"):
        layer.update(sizes=3)
    with pytest.raises(ValueError, match=r"positions are \(5, 2\)"):
        layer.update(positions=np.ones((5, 2)))


def test_shapes_that_do_not_fit_are_refused() -> None:
    mesh = scenes.rectangle((0, 0, 0), 1, 1)
    with pytest.raises(ValueError, match="normals"):
        Mesh(mesh.vertices, mesh.normals[:2], mesh.triangles, mesh.colours)
    with pytest.raises(ValueError, match="triangles of vertices"):
        Mesh(mesh.vertices, mesh.normals, mesh.triangles + 1, mesh.colours)
    with pytest.raises(ValueError, match="transforms"):
        scenes.solids(mesh).update(transforms=np.zeros((1, 2, 3, 4)))
    with pytest.raises(ValueError, match="positions"):
        Labels(texts=["a", "b"], positions=np.zeros((1, 3)))
    assert Surface(mesh=mesh).visible


def test_lines_do_not_join_what_begins_anew() -> None:
    begin, end = Lines(points=np.zeros((5, 3)), starts=np.array([0, 3])).pieces()
    assert list(zip(begin.tolist(), end.tolist(), strict=True)) == [(0, 1), (1, 2), (3, 4)]
    assert [len(part) for part in Lines(points=np.zeros((0, 3))).pieces()] == [0, 0]
