from __future__ import annotations

from pathlib import Path
from typing import Any

import gltf_files
import numpy as np
import pytest
from click.testing import CliRunner

from motion import gltf, kinematics, quat
from motion.clip import Clip
from motion.errors import UserError
from viewer import shows, skin
from viewer.cli import main
from viewer.scene import Surface
from viewer.stage import Stage

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.04
FACES = [
    [0, 1, 3],
    [0, 3, 2],
    [4, 6, 7],
    [4, 7, 5],
    [0, 4, 5],
    [0, 5, 1],
    [2, 3, 7],
    [2, 7, 6],
    [0, 2, 6],
    [0, 6, 4],
]
FACES += [[1, 5, 7], [1, 7, 3]]


def character(clip: Clip, *, size: float = 1.0, blend: bool = False, **primitive: Any) -> gltf_files.Builder:
    """A file of a clip whose every joint bears a cube around its place at rest.

    size : a scale of the node above all joints, by which the file's lengths are the smaller.
    blend : each cube hangs on its joint and the one above by halves.
    """
    small = clip.replace(positions=clip.positions / size)
    builder, skeleton = gltf_files.of_clips([small]), clip.skeleton
    for j in range(len(skeleton)):
        builder.json["nodes"][j]["translation"] = (skeleton.offsets[j] / size).tolist()
    if size != 1:
        builder.node("scaled", scale=[size] * 3, children=[0])
    at_rest, _ = kinematics.forward(skeleton, skeleton.offsets, quat.identity(len(skeleton)))
    vertices = (at_rest[:, None] + CUBE).reshape(-1, 3)
    own = np.repeat(np.arange(len(skeleton)), len(CUBE))
    joints, weights = np.zeros((len(own), 4), int), np.zeros((len(own), 4))
    joints[:, 0], weights[:, 0] = own, 1
    if blend:
        joints[:, 1], weights[:, :2] = np.maximum(skeleton.parents, 0)[own], 0.5
    triangles = np.concatenate([np.array(FACES) + j * len(CUBE) for j in range(len(skeleton))])
    binds = np.tile(np.eye(4), (len(skeleton), 1, 1))
    binds[:, :3, :3] /= size
    binds[:, :3, 3] = -at_rest / size
    builder.json["skins"][0]["inverseBindMatrices"] = builder.accessor(binds.swapaxes(1, 2).reshape(-1, 16))
    builder.json["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [0.04, 0.64, 0.36, 1]}}]
    shape = {
        "attributes": {
            "POSITION": builder.accessor(vertices),
            "JOINTS_0": builder.accessor(joints, "B"),
            "WEIGHTS_0": builder.accessor(weights),
        },
        "indices": builder.accessor(triangles.reshape(-1), "H"),
        "material": 0,
    }
    builder.json["meshes"] = [{"primitives": [shape | primitive]}]
    builder.node("mesh", mesh=0, skin=0)
    return builder


def cubes(clip: Clip, frame: int) -> np.ndarray:
    """Where the cubes' corners are: each moves as its joint does [J, 8, 3]."""
    places, turns = kinematics.forward(clip.skeleton, clip.positions[frame], clip.rotations[frame])
    return places[:, None] + quat.rotate(turns[:, None], CUBE)


@pytest.mark.parametrize("size", [1.0, 0.01])
def test_what_hangs_on_one_joint_moves_as_it_does(walker: Clip, tmp_path: Path, size: float) -> None:
    path = character(walker, size=size).write(tmp_path / "hero.glb")
    show = shows.load(path)
    assert show.skin is not None
    np.testing.assert_allclose(show.skin.skin.colours[0], [0.04, 0.64, 0.36], atol=1e-6)
    stage = Stage([show])
    for frame in (0, 77):
        stage.move_to(frame / walker.fps)
        (layer,) = (one for one in stage.scene.layers.values() if isinstance(one, Surface))
        np.testing.assert_allclose(layer.mesh.vertices.reshape(-1, 8, 3), cubes(walker, frame), atol=1e-4)
        np.testing.assert_allclose(layer.mesh.colours[0], [0.2, 0.8, 0.6], atol=1e-3)
        outward = (
            layer.mesh.vertices.reshape(-1, 8, 3)
            - layer.mesh.vertices.reshape(-1, 8, 3).mean(axis=1)[:, None]
        )
        assert (np.sum(layer.mesh.normals.reshape(-1, 8, 3) * outward, axis=-1) > 0).all()


def test_halves_of_two_joints_are_in_their_middle(walker: Clip, tmp_path: Path) -> None:
    show = shows.load(character(walker, blend=True).write(tmp_path / "hero.glb"))
    assert show.skin is not None
    positions, rotations = (array[0, show.skin.joints] for array in show.pose(1.0))
    found = skin.mesh(show.skin.skin, positions, rotations).vertices.reshape(-1, 8, 3)
    frame, skeleton = round(walker.fps), walker.skeleton
    places, turns = kinematics.forward(skeleton, walker.positions[frame], walker.rotations[frame])
    at_rest, _ = kinematics.forward(skeleton, skeleton.offsets, quat.identity(len(skeleton)))
    above = np.maximum(skeleton.parents, 0)
    corners = at_rest[:, None] + CUBE
    by_parent = places[above][:, None] + quat.rotate(turns[above][:, None], corners - at_rest[above][:, None])
    np.testing.assert_allclose(found, (cubes(walker, frame) + by_parent) / 2, atol=1e-4)


def test_the_compiled_blend_is_the_plain_one(walker: Clip, tmp_path: Path) -> None:
    worn = shows.load(character(walker, blend=True).write(tmp_path / "hero.glb")).skin
    assert worn is not None
    rng = np.random.default_rng(2)
    positions, rotations = rng.normal(size=(22, 3)), quat.normalize(rng.normal(size=(22, 4)))
    some = worn.skin.__class__(
        **(vars(worn.skin) | {"normals": rng.normal(size=worn.skin.normals.shape).astype("f")})
    )
    found = [[np.empty_like(some.vertices), np.empty_like(some.normals)] for _ in range(2)]
    skin.placed(some, positions, rotations, *found[0])
    skin.placed_numpy(some, positions, rotations, *found[1])
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_files_without_a_mesh_and_other_files_wear_none(walker: Clip, tmp_path: Path) -> None:
    path = gltf_files.of_clips([walker]).write(tmp_path / "bare.glb")
    assert gltf.skin(path) is None
    assert shows.load(path).skin is None
    hero = character(walker).write(tmp_path / "hero.glb")
    assert shows.load(hero, skinned=False).skin is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"attributes": {}}, "a skinned mesh without POSITION, JOINTS_0 or WEIGHTS_0"),
        ({"indices": -1}, "indices is -1, but the file has"),
    ],
)
def test_what_is_amiss_is_named(change: dict, said: str, walker: Clip, tmp_path: Path) -> None:
    path = character(walker, **change).write(tmp_path / "hero.glb")
    with pytest.raises(UserError, match=said):
        shows.load(path)


def test_joints_beyond_the_skin_are_refused(walker: Clip, tmp_path: Path) -> None:
    builder = character(walker)
    builder.json["skins"][0]["joints"] = builder.json["skins"][0]["joints"][:5]
    with pytest.raises(UserError, match="JOINTS_0 beyond the skin's 5 joints"):
        shows.load(builder.write(tmp_path / "hero.glb"))


def test_the_command_draws_it(walker: Clip, tmp_path: Path) -> None:
    path, out = character(walker).write(tmp_path / "hero.glb"), tmp_path / "hero.png"
    result = CliRunner().invoke(main, [str(path), "--offscreen", str(out), "--size", "80x60"])
    assert result.exit_code == 0, result.output
    assert out.stat().st_size > 1000
