"""motion.gltf.skins: skinned vertices are where closed forms say, in each animation of a file."""

from __future__ import annotations

import base64
import io
from pathlib import Path

import numpy as np
import pytest
from gltf_files import Builder
from PIL import Image

from motion import gltf, kinematics, sources
from motion.errors import Note, UserError
from viewer import shows, skin

LENGTH, TALL, FPS = 2.0, 1.5, 30.0  # metres of the arm, and how high its shoulder is
TIMES = np.arange(31) / FPS
SHARES = np.linspace(0, 1, 9)  # along the arm, and how much of the elbow moves it there
RED = (1.0, 0.0, 0.0)


def turns(angles: np.ndarray) -> np.ndarray:
    """Turns about z by angles [T] as x, y, z, w."""
    return np.stack([0 * angles, 0 * angles, np.sin(angles / 2), np.cos(angles / 2)], axis=-1)


def swing(times: np.ndarray) -> np.ndarray:
    return 0.8 * np.sin(2 * np.pi * times)


def wave(times: np.ndarray) -> np.ndarray:
    return -0.5 * times


ANIMATIONS = {"swing": swing, "wave": wave}


def arm(size: float = 1.0) -> Builder:
    """A body whose arm lies along x, in two bones, with a strip of vertices on its axis.

    size : a scale above all joints. The skin lists its joints from the elbow backwards, and was bound at the
    shoulder's height. Animations turn the elbow; both raise the body by a metre a second.
    """
    builder = Builder()
    builder.node("body", scale=[size] * 3)
    builder.node("hips", 0, translation=[0, TALL / size, 0])
    builder.node("elbow", 1, translation=[LENGTH / 2 / size, 0, 0])
    builder.node("tip", 2, translation=[LENGTH / 2 / size, 0, 0])
    vertices = np.stack([SHARES * LENGTH, np.full(9, TALL), 0 * SHARES], axis=-1)
    binds = np.tile(np.eye(4), (2, 1, 1))  # of the elbow, of the hips
    binds[:, :3, :3] /= size
    binds[:, :3, 3] = np.array([[-LENGTH / 2, -TALL, 0], [0, -TALL, 0]]) / size
    builder.json["skins"] = [{"joints": [2, 1], "inverseBindMatrices": matrices(builder, binds)}]
    strip(builder, vertices)
    builder.node("strip", mesh=0, skin=0)
    for name, angle in ANIMATIONS.items():
        rise = np.stack([0 * TIMES, (TALL + TIMES) / size, 0 * TIMES], axis=-1)
        builder.animation(
            {(1, "translation"): (TIMES, rise), (2, "rotation"): (TIMES, turns(angle(TIMES)))}, name
        )
    return builder


def matrices(builder: Builder, binds: np.ndarray) -> int:
    return builder.accessor(binds.swapaxes(1, 2).reshape(-1, 16))


def strip(builder: Builder, vertices: np.ndarray, **more: object) -> int:
    """A mesh of vertices along the arm; returns its index."""
    joints = np.tile([0, 1, 0, 0], (len(vertices), 1))
    weights = np.stack([SHARES, 1 - SHARES, 0 * SHARES, 0 * SHARES], axis=-1)
    attributes = {
        "POSITION": builder.accessor(vertices),
        "JOINTS_0": builder.accessor(joints, "B"),
        "WEIGHTS_0": builder.accessor(weights),
    }
    corners = np.arange(7)[:, None] + np.arange(3)
    shape = {"attributes": attributes, "indices": builder.accessor(corners.reshape(-1), "H")} | more
    builder.json.setdefault("meshes", []).append({"primitives": [shape]})
    return len(builder.json["meshes"]) - 1


def expected(name: str, time: float, shares: np.ndarray = SHARES) -> np.ndarray:
    """Where a point of the arm is: at the sum of what the hips alone and what the elbow alone would make."""
    angle, along = ANIMATIONS[name](time), shares * LENGTH
    still = np.stack([along, 0 * along], axis=-1)
    ahead = along - LENGTH / 2
    bent = np.stack([LENGTH / 2 + ahead * np.cos(angle), ahead * np.sin(angle)], axis=-1)
    x, y = ((1 - shares)[:, None] * still + shares[:, None] * bent).T
    return np.stack([x, y + TALL + time, 0 * x], axis=-1)


def shown(path: Path, name: str, frame: int) -> np.ndarray:
    """The vertices of a file's mesh in a frame of an animation."""
    clip, worn = sources.load(f"{path}#{name}"), gltf.skin(path, name)
    assert worn is not None
    world = kinematics.forward(clip.skeleton, clip.positions[frame], clip.rotations[frame])
    return skin.mesh(worn, *world).vertices


@pytest.mark.parametrize("size", [1.0, 0.01])
@pytest.mark.parametrize("name", ANIMATIONS)
def test_vertices_are_where_closed_forms_say(tmp_path: Path, name: str, size: float) -> None:
    path = arm(size).write(tmp_path / "arm.glb")
    for frame in (0, 7, 23):
        np.testing.assert_allclose(shown(path, name, frame), expected(name, frame / FPS), atol=1e-5)


def test_each_animation_is_a_clip_that_wears_the_mesh(tmp_path: Path) -> None:
    path = arm().write(tmp_path / "arm.glb")
    for one in sources.find([path]):
        show = shows.load(one)
        assert show.name in ANIMATIONS and show.skin is not None and show.seconds == pytest.approx(1.0)
        positions, rotations = (array[0, show.skin.joints] for array in show.pose(0.35))
        found = skin.mesh(show.skin.skin, positions, rotations).vertices
        np.testing.assert_allclose(found, expected(show.name, 0.35), atol=5e-3)  # between frames


def test_a_second_skin_may_be_bound_elsewhere(tmp_path: Path) -> None:
    """As clothes are that were modelled in other axes, and in centimetres."""
    builder = arm()
    turned = np.array([[0, 0, 0.01, 0], [0.01, 0, 0, TALL], [0, 0.01, 0, 0], [0, 0, 0, 1]])
    vertices = np.stack([np.full(9, 0.0), np.zeros(9), 100 * SHARES * LENGTH], axis=-1)
    binds = np.tile(np.eye(4), (2, 1, 1))
    binds[:, :3, 3] = [[-LENGTH / 2, -TALL, 0], [0, -TALL, 0]]
    bind = matrices(builder, binds @ turned)
    builder.json["skins"].append({"joints": [2, 1], "inverseBindMatrices": bind})
    builder.node("sleeve", mesh=strip(builder, vertices), skin=1)
    path = builder.write(tmp_path / "arm.glb")
    found = shown(path, "swing", 7)
    np.testing.assert_allclose(found[9:], found[:9], atol=1e-5)
    np.testing.assert_allclose(found[:9], expected("swing", 7 / FPS), atol=1e-5)


def test_what_is_held_without_a_skin_moves_with_its_joint(tmp_path: Path) -> None:
    builder = arm()
    points = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]])
    builder.json["meshes"].append({"primitives": [{"attributes": {"POSITION": builder.accessor(points)}}]})
    grip = builder.node("grip", 2, translation=[LENGTH / 2, 0, 0], scale=[1, 2, 1])
    builder.node("sword", grip, mesh=1)
    builder.node("table", mesh=1)  # which nobody holds
    found = shown(builder.write(tmp_path / "arm.glb"), "wave", 30)
    assert len(found) == 12
    hand, angle = expected("wave", 1.0)[-1], wave(1.0)
    aside = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0]])
    np.testing.assert_allclose(found[9:], hand + np.array([[0, 0], [0.3, 0], [0, 0.6]]) @ aside, atol=1e-5)


def test_bodies_of_rigid_parts_are_worn(tmp_path: Path) -> None:
    """As robots are: no skin at all, a mesh at each node that moves."""
    builder = Builder()
    points = builder.accessor(np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]]))
    builder.json["meshes"] = [{"primitives": [{"attributes": {"POSITION": points}}]}]
    builder.node("base", translation=[0, 1, 0], mesh=0)
    builder.node("lid", 0, translation=[1, 0, 0], mesh=0)
    builder.animation(
        {(0, "rotation"): (TIMES, turns(0 * TIMES)), (1, "rotation"): (TIMES, turns(TIMES))}, "open"
    )
    found = shown(builder.write(tmp_path / "robot.glb"), "open", 30)
    np.testing.assert_allclose(found[:3], [[0, 1, 0], [0.3, 1, 0], [0, 1.3, 0]], atol=1e-6)
    np.testing.assert_allclose(found[4], [1 + 0.3 * np.cos(1), 1 + 0.3 * np.sin(1), 0], atol=1e-6)


def painted(tmp_path: Path, **material: object) -> Builder:
    """The arm with places in a texture, two by two texels: red, white; black, blue."""
    builder = arm()
    image = Image.fromarray(np.array([[[255, 0, 0], [255] * 3], [[0] * 3, [0, 0, 255]]], np.uint8))
    stream = io.BytesIO()
    image.save(stream, "png")
    builder.json["images"] = [{"bufferView": builder.view(stream.getvalue()), "mimeType": "image/png"}]
    builder.json["textures"] = [{"source": 0}]
    builder.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}} | material}]
    primitive = builder.json["meshes"][0]["primitives"][0]
    places = np.tile([[0.2, 0.2], [0.8, 0.2], [1.2, 2.8], [-0.1, -0.1]], (3, 1))[:9]
    primitive["material"], primitive["attributes"]["TEXCOORD_0"] = 0, builder.accessor(places)
    return builder


def colours(builder: Builder, path: Path) -> np.ndarray:
    found = gltf.skin(builder.write(path), "swing")
    assert found is not None
    return found.colours


def test_colours_are_those_of_the_texture_at_the_vertices(tmp_path: Path) -> None:
    found = colours(painted(tmp_path), tmp_path / "arm.glb")
    np.testing.assert_allclose(found[:4], [[1, 0, 0], [1, 1, 1], [0, 0, 0], [0, 0, 1]], atol=1e-6)
    tinted = colours(painted(tmp_path, baseColorFactor=[0.5, 0.25, 1, 1]), tmp_path / "arm.glb")
    np.testing.assert_allclose(tinted[1], [0.5, 0.25, 1], atol=1e-6)


@pytest.mark.parametrize("held", ["file", "data"])
def test_textures_stand_beside_the_file_or_in_it(tmp_path: Path, held: str) -> None:
    builder, stream = painted(tmp_path), io.BytesIO()
    Image.new("RGB", (4, 4), (0, 255, 0)).save(stream, "png")
    (tmp_path / "green skin.png").write_bytes(stream.getvalue())
    data = "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()
    builder.json["images"] = [{"uri": "green%20skin.png" if held == "file" else data}]
    np.testing.assert_allclose(colours(builder, tmp_path / "arm.gltf"), np.tile([0, 1, 0], (9, 1)), atol=1e-6)


def test_vertices_may_have_colours_of_their_own(tmp_path: Path) -> None:
    builder = arm()
    own = np.tile([[128, 0, 64, 255], [255, 255, 0, 255], [0, 0, 0, 255]], (3, 1))
    attributes = builder.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["COLOR_0"] = builder.accessor(own, "B", normalized=True)
    found = colours(builder, tmp_path / "arm.glb")
    np.testing.assert_allclose(found[:2], [[128 / 255, 0, 64 / 255], [1, 1, 0]], atol=1e-6)


def test_without_a_colour_it_is_grey(tmp_path: Path) -> None:
    np.testing.assert_array_equal(colours(arm(), tmp_path / "arm.glb"), 0.5)


@pytest.mark.parametrize(
    "image", [{"uri": "none.png"}, {"uri": "../a.png"}, {"uri": "data:x;base64,!"}, "noise"]
)
def test_a_texture_that_cannot_be_read_is_a_note(tmp_path: Path, image: object) -> None:
    builder = painted(tmp_path, baseColorFactor=[1, 0, 0, 1])
    builder.json["images"] = [{"bufferView": builder.view(b"noise")} if image == "noise" else image]
    with pytest.warns(Note, match=r"arm\.glb: shown without a texture: /images/0: "):
        found = colours(builder, tmp_path / "arm.glb")
    np.testing.assert_array_equal(found, np.tile(RED, (9, 1)))


def test_compressed_meshes_are_refused(tmp_path: Path) -> None:
    builder = arm()
    primitive = builder.json["meshes"][0]["primitives"][0]
    primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {}}}
    with pytest.raises(UserError, match="KHR_draco_mesh_compression, which is not supported; export it unc"):
        gltf.skin(builder.write(tmp_path / "arm.glb"), "swing")
