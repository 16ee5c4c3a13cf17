"""motion.gltf.writing: what is written is read back alike, by our reader and by another library."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motion import gltf, kinematics, quat, root, sources, writers
from motion.clip import Clip
from motion.errors import UserError


def world(clip: Clip) -> np.ndarray:
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)[0]


def hung(clip: Clip) -> gltf.Skin:
    """A triangle of its own on every joint, the left ones red; each hangs a quarter on the joint above."""
    count = len(clip.skeleton)
    rest, _ = kinematics.forward(clip.skeleton, clip.skeleton.offsets[None], quat.identity(1, count))
    own = np.repeat(np.arange(count), 3)
    bind = np.tile(np.eye(3, 4, dtype=np.float32), (count, 1, 1))
    bind[..., 3] = -rest[0]
    above = np.maximum(clip.skeleton.parents[own], 0)
    left = np.array([name.startswith("Left") for name in clip.skeleton.names])[own]
    return gltf.Skin(
        vertices=(rest[0, own] + 0.05 * np.tile(np.eye(3), (count, 1))).astype(np.float32),
        normals=np.tile(np.eye(3, dtype=np.float32), (count, 1)),
        triangles=np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        colours=np.where(left[:, None], [1.0, 0, 0], [0, 0, 1.0]).astype(np.float32),
        joints=np.stack([own, above, 0 * own, 0 * own], -1).astype(np.int32),
        weights=np.tile(np.array([0.75, 0.25, 0, 0], np.float32), (len(own), 1)),
        bind=bind,
    )


def test_a_clip_comes_back(walker: Clip, tmp_path: Path) -> None:
    for clip in (walker, root.ground(walker)):
        gltf.write(tmp_path / "walk.glb", clip)
        found = gltf.read(tmp_path / "walk.glb")
        assert found.skeleton.names == clip.skeleton.names and len(found) == len(clip)
        assert found.fps == pytest.approx(clip.fps)
        np.testing.assert_array_equal(found.skeleton.parents, clip.skeleton.parents)
        np.testing.assert_allclose(found.skeleton.offsets, clip.skeleton.offsets, atol=1e-6)
        np.testing.assert_allclose(world(found), world(clip), atol=1e-5)
        assert found.skeleton.end_sites.keys() == clip.skeleton.end_sites.keys()
        assert gltf.skin(tmp_path / "walk.glb") is None


def test_a_skin_comes_back_with_its_colours(walker: Clip, tmp_path: Path) -> None:
    skin = hung(walker)
    gltf.write(tmp_path / "walk.glb", walker, skin=skin)
    found = gltf.skin(tmp_path / "walk.glb")
    assert found is not None and len(found.vertices) == len(skin.vertices)
    np.testing.assert_allclose(found.bind, skin.bind, atol=1e-6)
    one, other = (
        {
            tuple(np.round(np.r_[s.vertices[v], s.normals[v], s.colours[v], s.joints[v], s.weights[v]], 4))
            for v in s.triangles.reshape(-1)
        }
        for s in (skin, found)
    )
    assert one == other


def test_another_library_reads_it(walker: Clip, tmp_path: Path) -> None:
    pygltflib = pytest.importorskip("pygltflib")
    gltf.write(tmp_path / "walk.glb", walker, skin=hung(walker))
    document = pygltflib.GLTF2().load(str(tmp_path / "walk.glb"))
    blob = document.binary_blob()

    def values(index: int) -> np.ndarray:
        accessor = document.accessors[index]
        view = document.bufferViews[accessor.bufferView]
        data = blob[view.byteOffset : view.byteOffset + view.byteLength]
        return np.frombuffer(data, "<f4").reshape(accessor.count, -1)

    motion = document.animations[0]
    paths = {(c.target.node, c.target.path): motion.samplers[c.sampler] for c in motion.channels}
    times = values(paths[0, "rotation"].input)[:, 0]
    np.testing.assert_allclose(times, np.arange(len(walker)) / walker.fps, atol=1e-5)
    np.testing.assert_allclose(values(paths[0, "translation"].output), walker.positions[:, 0], atol=1e-5)
    for j in range(len(walker.skeleton)):
        turned = np.roll(values(paths[j, "rotation"].output).astype(np.float64), 1, axis=-1)
        assert quat.angle_between(turned, walker.rotations[:, j]).max() < 1e-3
    names = [document.nodes[n].name for n in document.skins[0].joints]
    assert tuple(names) == walker.skeleton.names
    assert len(document.materials) == 2  # red and blue
    position = document.accessors[document.meshes[0].primitives[0].attributes.POSITION]
    assert len(position.min) == len(position.max) == 3  # which the format demands


def test_faults_are_named_before_anything_is_written(walker: Clip, tmp_path: Path) -> None:
    broken = walker.replace(positions=walker.positions * np.nan)
    empty = walker.replace(positions=walker.positions[:0], rotations=walker.rotations[:0])
    for clip, said in ((broken, "not finite"), (empty, "no frames")):
        with pytest.raises(UserError, match=said):
            gltf.write(tmp_path / "walk.glb", clip)
    with pytest.raises(UserError, match="in metres"):
        writers.write(tmp_path / "walk.glb", walker, unit_to_m=0.01)
    with pytest.raises(UserError, match="Y up"):
        writers.write(tmp_path / "walk.glb", walker, axes=("z", "x", "right"))
    assert list(tmp_path.iterdir()) == []


def test_converting_writes_it_too(walker: Clip, tmp_path: Path) -> None:
    writers.write(tmp_path / "walk.glb", walker)
    np.testing.assert_allclose(world(sources.load(tmp_path / "walk.glb")), world(walker), atol=1e-5)
