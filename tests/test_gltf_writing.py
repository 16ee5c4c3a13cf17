"""motion.gltf.writing: what is written is read back alike, by our reader and by another library."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from motion import gltf, kinematics, quat, resample, root, sources, writers
from motion.clip import Clip
from motion.errors import UserError
from viewer import shows
from viewer.skin import of_body


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
    quarter = np.where(above == own, 0, 0.25)  # the first joint has none above it
    left = np.array([name.startswith("Left") for name in clip.skeleton.names])[own]
    return gltf.Skin(
        vertices=(rest[0, own] + 0.05 * np.tile(np.eye(3), (count, 1))).astype(np.float32),
        normals=np.tile(np.eye(3, dtype=np.float32), (count, 1)),
        triangles=np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        colours=np.where(left[:, None], [1.0, 0, 0], [0, 0, 1.0]).astype(np.float32),
        joints=np.stack([own, above, 0 * own, 0 * own], -1).astype(np.int32),
        weights=np.stack([1 - quarter, quarter, 0 * quarter, 0 * quarter], -1).astype(np.float32),
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


def complaints(path: Path) -> list[str]:
    """What a validator would say of a file: the specification's rules for all that we write."""
    pygltflib = pytest.importorskip("pygltflib")
    document, found = pygltflib.GLTF2().load(str(path)), []
    blob, data = document.binary_blob(), path.read_bytes()
    types = {5126: "<f4", 5123: "<u2", 5125: "<u4"}
    widths = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
    tables = []
    for i, accessor in enumerate(document.accessors):
        view, kind = document.bufferViews[accessor.bufferView], np.dtype(types[accessor.componentType])
        size = accessor.count * widths[accessor.type] * kind.itemsize
        if (view.byteOffset or 0) % 4 or size != view.byteLength or view.byteOffset + size > len(blob):
            found.append(f"accessor {i} is not aligned, or does not fill its view")
        table = np.frombuffer(blob, kind, accessor.count * widths[accessor.type], view.byteOffset)
        tables.append(table.reshape(accessor.count, -1).astype(np.float64))
        for edge, said in ((tables[i].min(axis=0), accessor.min), (tables[i].max(axis=0), accessor.max)):
            if said and not np.array_equal(edge, said):
                found.append(f"accessor {i}: its bounds are {edge}, not {said}")
    if len(data) % 4 or int.from_bytes(data[8:12], "little") != len(data):
        found.append("its length")
    for motion in document.animations:
        for sampler in motion.samplers:
            if (
                document.accessors[sampler.input].min is None
                or (np.diff(tables[sampler.input][:, 0]) <= 0).any()
            ):
                found.append("times without bounds, or that do not rise")
        turned = [
            s for c, s in zip(motion.channels, motion.samplers, strict=True) if c.target.path == "rotation"
        ]
        lengths = np.concatenate([np.linalg.norm(tables[s.output], axis=-1) for s in turned])
        if np.abs(lengths - 1).max() > 1e-6:
            found.append("rotations that are no unit quaternions")
    for skin in document.skins:
        whole = {}  # each node's place, its parents' before it: nodes are not turned
        stack = [(n, np.zeros(3)) for n in document.scenes[0].nodes]
        while stack:
            node, above = stack.pop()
            whole[node] = above + np.array(document.nodes[node].translation or np.zeros(3))
            stack += [(child, whole[node]) for child in document.nodes[node].children]
        binds = tables[skin.inverseBindMatrices].reshape(-1, 4, 4).swapaxes(1, 2)
        expected = np.tile(np.eye(4), (len(skin.joints), 1, 1))
        expected[:, :3, 3] = [-whole[joint] for joint in skin.joints]
        if np.abs(binds - expected).max() > 1e-6:
            found.append("inverse bind matrices that are not those of the nodes at rest")
    for mesh in document.meshes:
        for part in mesh.primitives:
            of = part.attributes
            weights, joints = tables[of.WEIGHTS_0], tables[of.JOINTS_0]
            if np.abs(weights.sum(axis=-1) - 1).max() > 1e-6 or joints[weights == 0].any():
                found.append("weights that are not 1 together, or joints without a weight")
            if of.NORMAL is not None and np.abs(np.linalg.norm(tables[of.NORMAL], axis=-1) - 1).max() > 1e-4:
                found.append("normals that are no unit vectors")
            corners = tables[part.indices].reshape(-1, 3)
            if corners.max() >= len(weights) or (corners[:, 0] == corners[:, 1]).any():
                found.append("triangles of vertices that are not there, or of two corners")
            if not document.accessors[of.POSITION].min:
                found.append("positions without bounds")
    return found


def test_a_validator_finds_nothing_amiss(walker: Clip, tmp_path: Path) -> None:
    clip = resample.crop(root.ground(walker), 0, 40)
    worn = of_body(shows.shape_of(clip), clip.skeleton)
    many = np.random.default_rng(1).random(worn.colours.shape).astype(np.float32)
    for skin in (None, hung(clip), worn, replace(worn, normals=worn.normals * 3, colours=many)):
        gltf.write(tmp_path / "walk.glb", clip, skin=skin)
        assert complaints(tmp_path / "walk.glb") == []


def test_many_colours_are_those_of_vertices(walker: Clip, tmp_path: Path) -> None:
    skin = of_body(shows.shape_of(walker), walker.skeleton)
    shades = np.random.default_rng(1).random(skin.colours.shape).astype(np.float32)
    gltf.write(tmp_path / "walk.glb", walker, skin=replace(skin, colours=shades))
    found = gltf.skin(tmp_path / "walk.glb")
    assert found is not None
    np.testing.assert_allclose(found.colours, shades, atol=1e-6)


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
