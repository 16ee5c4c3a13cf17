"""glTF: motion as the specification says, by others' files and formulas; faults named where they stand."""

import base64
import copy
import json

import gltf_files
import numpy as np
import pytest
from gltf_files import Builder
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from motion import gltf, kinematics, quat, sources
from motion.errors import UserError
from motion.gltf import keys


def world(clip):
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)


def xyzw(rotations):
    return np.roll(rotations, -1, axis=-1)


def same_turns(a, b, atol=1e-6):
    assert quat.angle_between(a, b).max() < atol


@pytest.fixture
def pendulum():
    """Two joints, the second 0.5 m below the first, with room for channels."""
    builder = Builder()
    builder.node("hips", translation=[0, 1, 0])
    builder.node("tip", 0, translation=[0, -0.5, 0])
    return builder


# Whole characters


@pytest.mark.parametrize("skin", [True, False])
@pytest.mark.parametrize("form", ["glb", "gltf", "data"])
def test_a_character(walker, tmp_path, form, skin):
    path = tmp_path / ("walk.glb" if form == "glb" else "walk.gltf")
    gltf_files.of_clips([walker], skin=skin).write(path, data_uri=form == "data")
    clip = gltf.read(path)
    assert clip.name == "walk" and clip.source == path and clip.fps == 60 and clip.unit_to_m == 1
    assert clip.skeleton.names[:22] == walker.skeleton.names or not skin
    joints = [clip.skeleton.index(name) for name in walker.skeleton.names]
    places, turns = world(clip)
    np.testing.assert_allclose(places[:, joints], world(walker)[0], atol=1e-6)
    same_turns(turns[:, joints], world(walker)[1])
    np.testing.assert_allclose(clip.skeleton.offsets[joints], walker.skeleton.offsets, atol=1e-12)
    if skin:
        assert len(clip.skeleton) == 22
        toe = clip.skeleton.index("LeftToe")
        np.testing.assert_allclose(clip.skeleton.end_sites[toe], [0, 0, 0.06])
        assert dict(sources.load(path).skeleton.roles) == dict(walker.skeleton.roles)


def turned_rig(clip, rng):
    """The clip as programs export it: centimetres under a lying node of 0.01, joints in own frames."""
    skeleton, count = clip.skeleton, len(clip.skeleton)
    frames = quat.normalize(rng.normal(size=(count, 4)))
    above = np.where(skeleton.parents >= 0, skeleton.parents, 0)
    back = quat.inv(frames[above])
    lying = quat.from_axis_angle([1.0, 0, 0], -np.pi / 2)
    back[0] = quat.inv(lying)
    builder = Builder()
    builder.node("Armature", rotation=xyzw(lying), scale=[0.01, 0.01, 0.01])
    rest = quat.mul(back, frames)
    for j, name in enumerate(skeleton.names):
        place = 100 * quat.rotate(back[j], skeleton.offsets[j])
        builder.node(name, 1 + int(skeleton.parents[j]), translation=place, rotation=xyzw(rest[j]))
    builder.json["skins"] = [{"joints": list(range(1, count + 1))}]
    times = builder.accessor(np.arange(len(clip)) / clip.fps)
    local = quat.mul(back, quat.mul(clip.rotations, frames))
    channels = {(1, "translation"): (times, 100 * quat.rotate(back[0], clip.positions[:, 0]))}
    channels |= {(j + 1, "rotation"): (times, xyzw(local[:, j])) for j in range(count)}
    builder.animation(channels)
    return builder, frames


def test_scales_turns_and_frames_of_a_rig_are_taken_out(walker, tmp_path):
    builder, frames = turned_rig(walker, np.random.default_rng(1))
    path = builder.write(tmp_path / "rig.glb")
    clip = gltf.read(path)
    assert clip.skeleton.names == walker.skeleton.names  # the armature is above the skeleton, not in it
    np.testing.assert_allclose(clip.skeleton.offsets, walker.skeleton.offsets, atol=1e-6)
    np.testing.assert_allclose(world(clip)[0], world(walker)[0], atol=1e-5)
    same_turns(clip.rotations, walker.rotations, 1e-5)  # zero rotations are the rest pose of the nodes

    own = gltf.read(path, own_frames=True)
    np.testing.assert_allclose(world(own)[0], world(walker)[0], atol=1e-5)
    same_turns(world(own)[1], quat.mul(world(walker)[1], frames), 1e-5)


@pytest.mark.parametrize("space", ["world", "above", "other axes"])
def test_the_pose_that_a_skin_was_bound_in_is_the_rest_pose(walker, tmp_path, space):
    """Nodes saved in mid-step, with inverse bind matrices of the standing walker in several spaces."""
    builder, frames = turned_rig(walker, np.random.default_rng(1))
    lying = quat.from_axis_angle([1.0, 0, 0], -np.pi / 2)
    skeleton = walker.skeleton
    above = np.maximum(skeleton.parents, 0)
    back = quat.inv(frames[above])
    back[0] = quat.inv(lying)
    posed = quat.mul(back, quat.mul(walker.rotations[20], frames))
    for j, node in enumerate(builder.json["nodes"][1:]):
        node["rotation"] = xyzw(posed[j]).tolist()
    places, turns = bind_pose(skeleton), frames
    if space == "above":  # under the lying node of 0.01
        places, turns = 100 * quat.rotate(quat.inv(lying), places), quat.mul(quat.inv(lying), turns)
    elif space == "other axes":
        side = quat.from_axis_angle([0, 0, 1.0], np.pi / 2)
        places, turns = 7 * quat.rotate(side, places), quat.mul(side, turns)
    matrices = np.tile(np.eye(4), (len(skeleton), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = quat.to_matrix(turns), places
    inverse = np.swapaxes(np.linalg.inv(matrices), 1, 2).reshape(-1, 16)
    builder.json["skins"][0]["inverseBindMatrices"] = builder.accessor(inverse)
    path = builder.write(tmp_path / "a.glb")
    clip = gltf.read(path)
    np.testing.assert_allclose(world(clip)[0], world(walker)[0], atol=1e-5)
    np.testing.assert_allclose(clip.skeleton.offsets[1:], skeleton.offsets[1:], atol=1e-5)
    same_turns(clip.rotations, walker.rotations, 1e-4)

    builder.json["skins"][0]["inverseBindMatrices"] = builder.accessor(inverse[:, ::-1])
    nonsense = gltf.read(builder.write(tmp_path / "b.glb"))  # the nodes' own pose it is
    np.testing.assert_allclose(world(nonsense)[0], world(walker)[0], atol=1e-5)
    assert quat.angle_between(nonsense.rotations[20], quat.identity(1)).max() < 1e-4


def bind_pose(skeleton):
    return kinematics.forward(skeleton, skeleton.offsets.copy(), quat.identity(len(skeleton)))[0]


def test_a_file_of_another_library(walker, tmp_path):
    pygltflib = pytest.importorskip("pygltflib")
    times = (np.arange(len(walker)) / walker.fps).astype("<f4")
    columns = {"translation": walker.positions[:, 0], "rotation": xyzw(walker.rotations[:, 1])}
    blocks = [times.tobytes(), *(values.astype("<f4").tobytes() for values in columns.values())]
    ends = np.cumsum([0, *map(len, blocks)]).tolist()
    document = pygltflib.GLTF2(
        nodes=[
            pygltflib.Node(name="hips", children=[1]),
            pygltflib.Node(name="leg", translation=walker.skeleton.offsets[1].tolist()),
        ],
        skins=[pygltflib.Skin(joints=[0, 1])],
        buffers=[pygltflib.Buffer(byteLength=ends[-1])],
        bufferViews=[
            pygltflib.BufferView(buffer=0, byteOffset=at, byteLength=len(block))
            for at, block in zip(ends, blocks, strict=False)
        ],
        accessors=[
            pygltflib.Accessor(
                bufferView=i, componentType=pygltflib.FLOAT, count=len(times), type=kind,
                min=[float(times[0])] if i == 0 else None, max=[float(times[-1])] if i == 0 else None,
            )
            for i, kind in enumerate((pygltflib.SCALAR, pygltflib.VEC3, pygltflib.VEC4))
        ],
        animations=[
            pygltflib.Animation(
                name="Walk",
                samplers=[pygltflib.AnimationSampler(input=0, output=i) for i in (1, 2)],
                channels=[
                    pygltflib.AnimationChannel(
                        sampler=node, target=pygltflib.AnimationChannelTarget(node=node, path=path)
                    )
                    for node, path in enumerate(columns)
                ],
            )
        ],
    )  # fmt: skip
    document.set_binary_blob(b"".join(blocks))
    document.save(str(tmp_path / "other.glb"))
    clip = gltf.read(tmp_path / "other.glb")
    np.testing.assert_allclose(clip.positions[:, 0], walker.positions[:, 0], atol=1e-6)
    same_turns(clip.rotations[:, 1], walker.rotations[:, 1])


def test_a_real_clip_through_a_file(data, tmp_path):
    clip = sources.load(data / "lafan1/mirror_oracle/walk1_subject1_walk2_mirror_filtered.bvh")
    clip = clip.replace(positions=clip.positions[:300], rotations=clip.rotations[:300])
    builder = gltf_files.of_clips([clip])
    times = 0  # the first accessor; this skeleton's hips move beside its root
    channels = builder.json["animations"][0]
    hips = clip.skeleton.role("hips")
    channels["samplers"].append({"input": times, "output": builder.accessor(clip.positions[:, hips])})
    target = {"node": hips, "path": "translation"}
    channels["channels"].append({"sampler": len(channels["samplers"]) - 1, "target": target})
    back = sources.load(builder.write(tmp_path / "a.glb"))
    np.testing.assert_allclose(world(back)[0], world(clip)[0], atol=2e-5)
    assert back.skeleton.roles == clip.skeleton.roles


# Key frames


def test_straight_lines_steps_and_slerps(pendulum, tmp_path):
    times = np.array([0.0, 0.5, 0.6, 1.0])
    turns = Rotation.random(4, rng=np.random.default_rng(2))
    signs = np.array([1, -1, 1, -1])[:, None]  # the other representative is the same rotation
    places = np.random.default_rng(3).normal(size=(4, 3))
    pendulum.animation(
        {
            (0, "translation"): (times, places),
            (0, "rotation"): (times, signs * turns.as_quat()),
            (1, "translation"): (times, places, "STEP"),
        }
    )
    clip = gltf.read(pendulum.write(tmp_path / "a.glb"))
    at = np.arange(len(clip)) / clip.fps
    assert at[-1] == pytest.approx(1.0)
    truth = np.stack([np.interp(at, times, column) for column in places.T], axis=-1)
    np.testing.assert_allclose(clip.positions[:, 0], truth, atol=1e-6)
    same_turns(clip.rotations[:, 0], np.roll(Slerp(times, turns)(at).as_quat(), 1, axis=-1), 1e-5)
    steps = places[np.searchsorted(times, at + 1e-6, side="right") - 1]
    np.testing.assert_allclose(clip.positions[:, 1], steps, atol=1e-6)


def test_cubic_splines(pendulum, tmp_path):
    rng, times = np.random.default_rng(4), np.array([0.0, 0.25, 1.0, 1.5])
    places, turns = rng.normal(size=(4, 3, 3)), rng.normal(size=(4, 3, 4))
    pendulum.animation(
        {
            (0, "translation"): (times, places.reshape(-1, 3), "CUBICSPLINE"),
            (1, "rotation"): (times, turns.reshape(-1, 4), "CUBICSPLINE"),
        }
    )
    clip = gltf.read(pendulum.write(tmp_path / "a.glb"))
    at = np.arange(len(clip)) / clip.fps

    def truth(values):
        out = np.empty((len(at), values.shape[-1]))
        for k in range(3):  # a tangent belongs to its side of a key
            part = (at >= times[k]) & (at <= times[k + 1])
            piece = CubicHermiteSpline(
                times[k : k + 2], values[k : k + 2, 1], [values[k, 2], values[k + 1, 0]]
            )
            out[part] = piece(at[part])
        return out

    np.testing.assert_allclose(clip.positions[:, 0], truth(places), atol=1e-5)
    same_turns(clip.rotations[:, 1], np.roll(Rotation.from_quat(truth(turns)).as_quat(), 1, axis=-1), 1e-4)


@pytest.mark.parametrize(
    ("code", "top"),
    [("b", 127), ("B", 255), ("h", 32767), ("H", 65535)],
    ids=["byte", "ubyte", "short", "ushort"],
)
@pytest.mark.parametrize("stride", [0, 12])
def test_normalised_integers_and_strides(pendulum, tmp_path, code, top, stride):
    turns = np.abs(Rotation.random(5, rng=np.random.default_rng(5)).as_quat())
    stored = np.round(turns * top)
    values = pendulum.accessor(stored, code, stride=stride, normalized=True)
    pendulum.animation({(0, "rotation"): (np.arange(5) / 30, values)})
    clip = gltf.read(pendulum.write(tmp_path / "a.glb"))
    assert clip.fps == 30 and len(clip) == 5
    same_turns(clip.rotations[:, 0], quat.normalize(np.roll(stored, 1, axis=-1)), 1e-9)


def test_the_least_signed_integer_is_minus_one(pendulum, tmp_path):
    scales = pendulum.accessor([[127, 127, 127], [127, 127, 127]], "b", normalized=True)
    turns = pendulum.accessor([[0, 0, -128, 0], [0, 0, 0, 127]], "b", normalized=True)
    pendulum.animation({(0, "scale"): ([0, 0.1], scales), (0, "rotation"): ([0, 0.1], turns, "STEP")})
    clip = gltf.read(pendulum.write(tmp_path / "a.glb"))
    np.testing.assert_allclose(np.abs(clip.rotations[0, 0]), [0, 0, 0, 1])


@pytest.mark.parametrize("based", [True, False])
def test_sparse_accessors(pendulum, tmp_path, based):
    places = np.arange(12.0).reshape(4, 3) if based else np.zeros((4, 3))
    values = pendulum.accessor(places)
    if not based:
        del pendulum.json["accessors"][values]["bufferView"]
    pendulum.json["accessors"][values]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": pendulum.view(np.array([1, 3], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": pendulum.view(np.full((2, 3), 9, "<f4").tobytes())},
    }
    pendulum.animation({(0, "translation"): (np.arange(4) / 30, values)})
    clip = gltf.read(pendulum.write(tmp_path / "a.glb"))
    places[[1, 3]] = 9
    np.testing.assert_allclose(clip.positions[:, 0], places)


GRID = np.arange(61)
RATES = {
    "60": (GRID / 60, 60),
    "29.97": (GRID * 1001 / 30000, 30),
    "25": (GRID / 25, 25),
    "odd": (GRID / 37, 37),
    "thinned": (np.unique([0, 1, 2, 4, 5, 8, 12, 20, 21, 22, 24, 30, 60]) / 30, 30),
    "by three": (np.array([0, 3, 6, 9, 12, 15, 17, 18]) / 60, 60),
    "two keys": (np.array([0.0, 1.0]), 60),
    "one key": (np.array([0.0]), 60),
    "far apart": (np.array([0.0, 7.31]), 60),
    "late": (1000 + GRID / 30, 30),
}


@pytest.mark.parametrize("name", RATES)
def test_the_rate_of_keys(name):
    times, fps = RATES[name]
    assert keys.frame_rate([times.astype(np.float32).astype(float)]) == pytest.approx(fps, rel=0.01)


def test_a_clip_begins_at_the_first_key_and_ends_at_the_last(pendulum, tmp_path):
    times = 2 + np.arange(31) / 30
    pendulum.animation(
        {
            (0, "translation"): (times, np.arange(31)[:, None] * [0.01, 0, 0]),
            (1, "translation"): ([2.5, 2.6], [[1, 0, 0], [2, 0, 0]]),
        }
    )
    clip = gltf.read(pendulum.write(tmp_path / "a.glb"))
    assert len(clip) == 31 and clip.fps == 30
    np.testing.assert_allclose(clip.positions[:, 0, 0], np.arange(31) * 0.01, atol=1e-6)
    np.testing.assert_allclose(clip.positions[[0, 15, 18, 30], 1, 0], [1, 1, 2, 2], atol=1e-5)  # held outside


# Nodes


def test_what_is_above_the_skeleton_moves_it(tmp_path):
    builder = Builder()
    builder.node(
        "scene", matrix=[0, 0, -2, 0, 0, 2, 0, 0, 2, 0, 0, 0, 5, 0, 0, 1]
    )  # yaw by 90 degrees, twice
    builder.node("mover", 0)
    builder.node("hips", 1, translation=[0, 1, 0])
    builder.node("head", 2, translation=[0, 0.5, 0])
    builder.json["skins"] = [{"joints": [2, 3]}]
    builder.animation(
        {(1, "translation"): ([0, 1], [[0, 0, 0], [0, 0, 1]]), (3, "rotation"): ([0], [[0, 0, 0, 1]])}
    )
    clip = gltf.read(builder.write(tmp_path / "a.glb"))
    assert clip.skeleton.names == ("hips", "head")
    places, turns = world(clip)
    np.testing.assert_allclose(places[[0, -1]], [[[5, 2, 0], [5, 3, 0]], [[7, 2, 0], [7, 3, 0]]], atol=1e-6)
    same_turns(turns, quat.identity(1))  # the scene's own turn is part of the rest pose
    np.testing.assert_allclose(clip.skeleton.offsets, [[5, 2, 0], [0, 1, 0]], atol=1e-9)


def test_scales_that_move(pendulum, tmp_path):
    pendulum.animation({(0, "scale"): ([0, 1], [[1, 1, 1], [3, 3, 3]])})
    clip = gltf.read(pendulum.write(tmp_path / "a.glb"))
    np.testing.assert_allclose(world(clip)[0][[0, -1], 1, 1], [0.5, -0.5], atol=1e-6)


def test_a_scale_of_a_leaf_may_differ_by_axis(pendulum, tmp_path):
    pendulum.json["nodes"][1]["scale"] = [1, 2, 1]
    pendulum.animation({(0, "rotation"): ([0], [[0, 0, 0, 1]])})
    assert len(gltf.read(pendulum.write(tmp_path / "a.glb"))) == 1


def test_joints_of_several_skins_and_nodes_between(tmp_path):
    builder = Builder()
    for name, parent in (("Armature", None), ("hips", 0), ("twist", 1), ("leg", 2), ("head", 1), ("hat", 4)):
        builder.node(name, parent, translation=[0, 1, 0])
    builder.node("crate")
    builder.json["skins"] = [{"joints": [1, 3]}, {"joints": [4]}]
    turn = ([0, 0.5], [[0, 0, 0, 1], [0, 0, 1, 0]])
    builder.animation({(3, "rotation"): turn, (6, "rotation"): turn})
    clip = gltf.read(builder.write(tmp_path / "a.glb"))
    assert clip.skeleton.names == ("hips", "twist", "leg", "head")
    assert clip.skeleton.parents.tolist() == [-1, 0, 1, 0]
    assert list(clip.skeleton.end_sites) == [3]


def test_two_characters_and_the_one_that_moves(tmp_path):
    builder, turn = Builder(), ([0, 0.5], [[0, 0, 0, 1], [0, 0, 1, 0]])
    for who in ("a", "b"):
        top = builder.node(f"{who} hips")
        builder.node(f"{who} head", top, translation=[0, 1, 0])
    builder.json["skins"] = [{"joints": [0, 1]}, {"joints": [2, 3]}]
    builder.animation({(0, "rotation"): turn, (2, "rotation"): turn, (3, "rotation"): turn}, "second")
    builder.animation({(1, "rotation"): turn}, "first")
    path = builder.write(tmp_path / "a.glb")
    assert gltf.read(path, "second").skeleton.names == ("b hips", "b head")
    assert gltf.read(path, "first").skeleton.names == ("a hips", "a head")


def test_without_names_and_with_the_same(tmp_path):
    builder = Builder()
    for parent in (None, 0, 1):
        builder.node(None if parent is None else "bone", parent, translation=[0, 1, 0])
    builder.animation({(n, "rotation"): ([0], [[0, 0, 0, 1]]) for n in range(3)})
    assert gltf.read(builder.write(tmp_path / "a.glb")).skeleton.names == ("node_0", "bone", "bone 2")


# Several animations


@pytest.fixture
def hero(walker_clips, tmp_path):
    builder = gltf_files.of_clips(walker_clips[:3])
    shapes = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    builder.json["animations"].insert(
        1, {"name": "smile", "samplers": [{"input": 0, "output": 0}], "channels": [shapes]}
    )
    builder.json["animations"][2]["name"] = "Armature|left/turn"
    return builder.write(tmp_path / "hero.glb")


def test_several_animations(hero, walker_clips):
    labels = ["straight", "Armature|left_turn", "right_turn"]
    assert gltf.animations(hero) == labels  # not the one that moves shapes only
    clips = gltf.read_all(hero)
    assert [clip.name for clip in clips] == labels
    for clip, truth in zip(clips, walker_clips, strict=False):
        np.testing.assert_allclose(world(clip)[0], world(truth)[0], atol=1e-6)
    with pytest.raises(UserError, match=r"3 animations: straight, .*; name one, as hero\.glb#straight"):
        gltf.read(hero)
    with pytest.raises(UserError, match="no animation 'jump'; the file has straight, "):
        gltf.read(hero, "jump")


def test_sources_name_animations(hero, tmp_path):
    paths = [f"{hero}#{label}" for label in ("Armature|left_turn", "right_turn", "straight")]
    assert list(map(str, sources.find(tmp_path))) == list(map(str, sources.find(hero))) == paths
    assert list(map(str, sources.find([paths[1], hero], exclude=["str*"]))) == paths[:2]
    assert sources.find(tmp_path, exclude=["hero.glb#*turn"])[0].name == "hero.glb#straight"
    assert sources.inputs(tmp_path) == [hero]
    clip = sources.load(paths[1])
    assert clip.name == "right_turn" and str(clip.source) == paths[1]
    assert [str(clip.source) for clip in sources.load_all(hero)] == [paths[2], *paths[:2]]
    assert [c.name for c in sources.load_all(paths[0], fps=30)] == ["Armature|left_turn"]
    with pytest.raises(UserError, match=r"name one, as hero\.glb#straight"):
        sources.load(hero)
    with pytest.raises(UserError, match="no such file"):
        sources.load(tmp_path / "none.glb#Walk")
    with pytest.raises(UserError, match="no such file"):
        sources.find(tmp_path / "none.glb#Walk")


def test_a_broken_file_is_found_and_refused_when_it_is_read(tmp_path):
    (tmp_path / "bad.glb").write_bytes(b"glTF")
    assert sources.find(tmp_path) == [tmp_path / "bad.glb"]
    for function in (sources.load, sources.load_all):
        with pytest.raises(UserError, match="cut short"):
            function(tmp_path / "bad.glb")


# Bad input


def broken(change):
    """The JSON of a small good file, changed."""
    builder = Builder()
    builder.node("hips", translation=[0, 1, 0])
    builder.node("tip", 0, translation=[0, -0.5, 0])
    builder.json["skins"] = [{"joints": [0, 1]}]
    builder.animation(
        {(0, "rotation"): ([0, 0.5, 1], [[0, 0, 0, 1]] * 3), (0, "translation"): ([0, 1], [[0, 1, 0]] * 2)}
    )
    builder.json["buffers"] = [
        {
            "byteLength": len(builder.binary),
            "uri": "data:;base64," + base64.b64encode(builder.binary).decode(),
        }
    ]
    found = copy.deepcopy(builder.json)
    change(found)
    return found


def put(*path):
    """A change: the last of path at the place that the others name; None removes it."""
    *where, last, value = path

    def change(found):
        for key in where:
            found = found[key]
        if value is None:
            del found[last]
        else:
            found[last] = value

    return change


def times(*values):
    def change(found):
        data = np.array(values, "<f4").tobytes()
        found["buffers"].append(
            {"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()}
        )
        found["bufferViews"].append({"buffer": 1, "byteLength": len(data)})
        found["accessors"][0] |= {"bufferView": len(found["bufferViews"]) - 1, "count": len(values)}

    return change


SAMPLER, CHANNEL = ("animations", 0, "samplers", 0), ("animations", 0, "channels", 0)
FAULTS = {
    "no asset": (put("asset", None), "it has no asset"),
    "version": (put("asset", "version", "1.0"), "/asset: glTF version '1.0', expected 2.0"),
    "ring": (put("nodes", 1, "children", [0]), "/nodes/0: it is below itself"),
    "two parents": (put("nodes", 0, "children", [1, 1]), "/nodes/1: it is a child of both node 0 and node 0"),
    "child": (put("nodes", 0, "children", [-1]), "/nodes/0: children/0 is -1, but the file has 2 nodes"),
    "children": (put("nodes", 0, "children", 1), "/nodes/0: children is 1, expected a list"),
    "nodes": (put("nodes", {}), "nodes is {}, expected a list"),
    "a node": (put("nodes", 1, 7), "nodes/1 is 7, expected an object"),
    "joint": (put("skins", 0, "joints", [2]), "/skins/0: joints/0 is 2, but the file has 2 nodes"),
    "no joints": (put("skins", 0, "joints", []), "/skins/0: it has no joints"),
    "place": (put("nodes", 1, "translation", [0, 1]), "/nodes/1: translation is [0, 1], expected 3"),
    "nan": (put("nodes", 1, "translation", [0, 1, float("nan")]), "NaN is no number of JSON"),
    "huge": (put("nodes", 1, "translation", [0, 1, 1e300]), "expected 3 finite numbers"),
    "zero turn": (put("nodes", 1, "rotation", [0, 0, 0, 0]), "/nodes/1: its rotation has no length"),
    "sheared": (put("nodes", 0, "scale", [1, 2, 1]), "/nodes/0: scale 1, 2, 1 shears the joints below it"),
    "mirrored": (put("nodes", 0, "scale", [-1, -1, -1]), "/nodes/0: scale -1, -1, -1 mirrors"),
    "flat": (put("nodes", 0, "matrix", [0] * 16), "/nodes/0: its matrix shears or flattens"),
    "reflection": (put("nodes", 1, "matrix", [-1, *[0, 0, 0, 0, 1] * 3]), "/nodes/1: its matrix mirrors"),
    "no animations": (put("animations", []), "the file has no animations"),
    "only shapes": (put("animations", 0, "channels", []), "no animation moves a joint"),
    "target": (put(*CHANNEL, "target", None), "/animations/0/channels/0: target is missing"),
    "target's node": (put(*CHANNEL, "target", "node", 5), "/animations/0/channels/0/target: node is 5"),
    "twice": (put("animations", 0, "channels", 1, {"sampler": 0, "target": {"node": 0, "path": "rotation"}}),
              "/animations/0/channels/1: the animation moves the rotation of node 0 twice"),
    "sampler": (put(*CHANNEL, "sampler", 2), "/animations/0/channels/0: sampler is 2, but"),
    "negative": (put(*CHANNEL, "sampler", -1), "/animations/0/channels/0: sampler is -1"),
    "no input": (put(*SAMPLER, "input", None), "/animations/0/samplers/0: input is missing"),
    "interpolation": (put(*SAMPLER, "interpolation", "BEZIER"), "samplers/0: interpolation 'BEZIER'"),
    "cubic": (put(*SAMPLER, "interpolation", "CUBICSPLINE"), "output has 3 values, expected 9 for 3 keys"),
    "kind": (put("accessors", 1, "type", "VEC3"), "/accessors/1: type is 'VEC3', expected 'VEC4' here"),
    "component": (put("accessors", 1, "componentType", 5124), "/accessors/1: componentType is 5124"),
    "count": (put("accessors", 1, "count", 4), "/accessors/1: 4 values of 16 bytes"),
    "no count": (put("accessors", 0, "count", 0), "/accessors/0: count is 0, expected a whole number from 1"),
    "bomb": (put("accessors", 0, "count", 10**12), "/accessors/0: count is 1000000000000"),
    "offset": (put("accessors", 1, "byteOffset", 4), "do not fit into the 48 bytes of /bufferViews/1"),
    "stride": (put("bufferViews", 1, "byteStride", 8), "/accessors/1: 3 values of 16 bytes, 8 apart"),
    "view": (put("bufferViews", 3, "byteLength", 4000), "/bufferViews/3: it ends at byte"),
    "compressed": (put("bufferViews", 1, "extensions", {"EXT_meshopt_compression": {}}),
                   "/bufferViews/1: it is compressed by EXT_meshopt_compression"),
    "no buffer": (put("bufferViews", 1, "buffer", 1), "/bufferViews/1: buffer is 1, but the file has 1"),
    "short": (put("buffers", 0, "byteLength", 4000), "/buffers/0: byteLength is 4000, but there are"),
    "no uri": (put("buffers", 0, "uri", None), "/buffers/0: it has no uri, and the file no binary chunk"),
    "base64": (put("buffers", 0, "uri", "data:;base64,@@@@"), "/buffers/0: the data of its uri is no base64"),
    "falling times": (times(0, 2, 1), "/accessors/0: the times of keys fall, from 2 to 1 s at key 2"),
    "infinite": (times(0, 1, np.inf), "/accessors/0: value 2 is not finite"),
    "endless": (times(0, 1, 1e7), "frames of 2 joints from 0 to 1e+07 s; at most 12,000,000"),
    "sparse": (put("accessors", 0, "sparse", {"count": 1}), "/accessors/0/sparse: indices is missing"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_faults(tmp_path, fault):
    change, message = FAULTS[fault]
    path = tmp_path / "bad.gltf"
    path.write_text(json.dumps(broken(change)))
    with pytest.raises(UserError) as error:
        gltf.read(path)
    assert message in error.value.what + "; " + (error.value.remedy or "")
    assert error.value.path == str(path) and error.value.remedy


def test_what_the_faults_are_made_from_is_good(tmp_path):
    path = tmp_path / "good.gltf"
    path.write_text(json.dumps(broken(lambda found: None)))
    assert len(gltf.read(path)) > 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"{", "no valid JSON"),
        (b"[" * 100_000, "no valid JSON"),
        (b"[]", "not a glTF file"),
        (b"\xff\xfe\x00", "no valid JSON"),
        (b"glTF\2\0\0\0", "cut short"),
        (b"glTF\1\0\0\0" + b"\0" * 12, "GLB version 1"),
        (b"glTF\2\0\0\0\xff\0\0\0" + b"\0" * 12, "says 255 bytes, but the file has 24"),
        (b"glTF\2\0\0\0\x18\0\0\0\xff\0\0\0JSON{}  ", "chunk at byte 12 is longer"),
        (b"glTF\2\0\0\0\x18\0\0\0\4\0\0\0BIN\0{}  ", "the first chunk is not JSON"),
    ],
)
def test_files_that_are_none(tmp_path, content, message):
    (tmp_path / "a.gltf").write_bytes(content)
    with pytest.raises(UserError, match=message):
        gltf.read(tmp_path / "a.gltf")


@pytest.mark.parametrize(
    ("uri", "message"),
    [
        ("../secret.bin", "leads out of the file's folder"),
        ("sub/../../secret.bin", "leads out of the file's folder"),
        ("..%2Fsecret.bin", "leads out of the file's folder"),
        ("link.bin", "leads out of the file's folder"),
        ("/etc/passwd", "is no relative path"),
        ("file:///etc/passwd", "is no relative path"),
        ("https://example.org/a.bin", "is no relative path"),
        ("C:\\secret.bin", "is no relative path"),
        ("none.bin", "there is no file"),
        (".", "there is no file"),
    ],
)
def test_buffers_stay_in_the_folder(tmp_path, uri, message):
    folder = tmp_path / "clips"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(b"\0" * 1000)
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    (folder / "a.gltf").write_text(json.dumps(broken(put("buffers", 0, "uri", uri))))
    with pytest.raises(UserError, match=message):
        gltf.read(folder / "a.gltf")


def test_a_buffer_that_is_cut_after_it_was_read(pendulum, tmp_path):
    pendulum.animation({(0, "translation"): ([0, 1], [[0, 1, 0]] * 2)})
    path = pendulum.write(tmp_path / "a.gltf")
    gltf.read(path)
    with open(tmp_path / "a.bin", "r+b") as stream:
        stream.truncate(8)
    with pytest.raises(UserError, match="/buffers/0: byteLength is 32, but there are 8 bytes"):
        gltf.read(path)


def test_a_buffer_in_a_folder_below_with_an_escaped_name(pendulum, tmp_path):
    pendulum.animation({(0, "translation"): ([0, 1], [[0, 1, 0]] * 2)})
    path = pendulum.write(tmp_path / "a.gltf")
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.bin").rename(tmp_path / "sub" / "b c.bin")
    path.write_text(path.read_text().replace("a.bin", "sub/b%20c.bin"))
    assert gltf.read(path).positions[0, 0, 1] == 1


@pytest.mark.parametrize("part", ["json", "any"])
def test_any_damage_is_a_user_error_or_reads(walker, tmp_path, part):
    builder = gltf_files.of_clips(
        [walker.replace(positions=walker.positions[:8], rotations=walker.rotations[:8])]
    )
    plain = np.frombuffer(builder.write(tmp_path / "a.glb").read_bytes(), np.uint8)
    stop = int.from_bytes(plain[12:16].tobytes(), "little") if part == "json" else len(plain)
    rng, outcomes = np.random.default_rng(8), set()
    for i in range(150):
        damaged = plain.copy()
        damaged[rng.integers(20 if part == "json" else 0, stop, rng.integers(1, 4))] = rng.integers(32, 127)
        path = tmp_path / f"{i}.glb"
        path.write_bytes(damaged[: rng.integers(1, len(plain)) if i % 10 == 0 else None].tobytes())
        try:
            clip = gltf.read(path)
            assert np.isfinite(clip.positions).all() and np.isfinite(clip.rotations).all()
            outcomes.add("read")
        except UserError as error:
            assert error.path == str(path)
            outcomes.add("refused")
    assert outcomes == {"read", "refused"}
