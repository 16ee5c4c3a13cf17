"""From files to a database: what goes in is found again, and what cannot go in is refused by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import synthetic

from features import extract, normalise
from features.schema import Feature, Schema
from mm import build, interchange, skeletons, tags
from mm.database import Database
from motion import bvh, kinematics, quat, resample, root
from motion.clip import Clip
from motion.errors import Note, UserError
from motion.pose import Poses
from motion.skeleton import Skeleton

NAMES = ["left_turn", "right_turn", "run", "stand", "straight"]


@pytest.fixture(scope="module")
def built(walker_files: Path) -> Database:
    return build.build(walker_files)


def _truth(clips: list[Clip]) -> dict[str, Clip]:
    return {clip.name: clip for clip in clips}


def _range(db: Database, name: str, mirrored: bool) -> slice:
    (r,) = [r for r in range(len(db.starts)) if db.names[r] == name and db.mirrored[r] == mirrored]
    return slice(db.starts[r], db.stops[r])


def _world(db: Database, piece: slice) -> tuple[np.ndarray, np.ndarray]:
    poses = db.poses[piece]
    return kinematics.forward(db.skeleton, poses.positions.astype(float), poses.rotations.astype(float))


def _file(folder: Path, clip: Clip, name: str | None = None) -> Path:
    path = folder / f"{name or clip.name}.bvh"
    path.parent.mkdir(parents=True, exist_ok=True)
    bvh.write(path, clip)
    return path


def _short(clip: Clip, frames: int) -> Clip:
    return resample.crop(clip, 0, frames)


def test_ranges_names_and_sizes(built: Database) -> None:
    assert built.fps == 60 and len(built) == 5 * 2 * 300
    assert built.names == tuple(name for name in NAMES for _ in range(2))
    assert built.mirrored.tolist() == [False, True] * 5
    np.testing.assert_array_equal(built.starts, np.arange(10) * 300)
    np.testing.assert_array_equal(built.stops, built.starts + 300)
    assert (
        built.skeleton.names[0] == "root" and built.skeleton.role("root") == 0 and len(built.skeleton) == 23
    )
    assert built.contact_roles == ("left_toe", "right_toe") and built.schema.name == "mm27"
    assert built.tag_names == () and not built.tags.any()
    for array in (*built.poses.arrays().values(), built.features, built.offset, built.scale):
        assert array.dtype == np.float32 and np.isfinite(array).all()


@pytest.mark.parametrize("name", NAMES)
def test_joints_are_where_the_clip_has_them(built: Database, walker_clips: list[Clip], name: str) -> None:
    clip = _truth(walker_clips)[name]
    expected, turned = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
    positions, rotations = _world(built, _range(built, name, False))
    np.testing.assert_allclose(positions[:, 1:], expected, atol=2e-5)
    assert quat.angle_between(rotations[:, 1:], turned).max() < 1e-4
    np.testing.assert_allclose(positions[:, 0, 1], 0, atol=1e-7)


@pytest.mark.parametrize("name", NAMES)
def test_the_mirrored_copy_is_the_reflection(built: Database, name: str) -> None:
    plain, _ = _world(built, _range(built, name, False))
    mirrored, _ = _world(built, _range(built, name, True))
    names = built.skeleton.names
    swap = [names.index(n.replace("Left", "?").replace("Right", "Left").replace("?", "Right")) for n in names]
    np.testing.assert_allclose(mirrored, plain[:, swap] * np.array([-1, 1, 1]), atol=1e-5)
    contacts = built.contacts[_range(built, name, False)]
    np.testing.assert_array_equal(built.contacts[_range(built, name, True)], contacts[:, ::-1])


def test_the_root_travels_and_faces_as_the_walker_does(built: Database) -> None:
    straight = built.poses[_range(built, "straight", False)]
    np.testing.assert_allclose(straight.velocities[10:-10, 0].mean(axis=0), [0, 0, 1.2], atol=0.02)
    heading = quat.yaw(straight.rotations[:, 0])  # the hips themselves swing by 0.06
    np.testing.assert_allclose(heading, 0, atol=0.07)
    assert abs(heading.mean()) < 0.01
    turning = built.poses[_range(built, "left_turn", False)]
    np.testing.assert_allclose(turning.angular_velocities[30:-30, 0, 1].mean(), 0.8, atol=0.03)
    mirrored = built.poses[_range(built, "left_turn", True)]
    np.testing.assert_allclose(mirrored.angular_velocities[30:-30, 0, 1].mean(), -0.8, atol=0.03)


def test_contacts_are_the_planted_feet(built: Database, walker_clips: list[Clip]) -> None:
    for name, gait in (("straight", "walk"), ("left_turn", "walk"), ("stand", "stand"), ("run", "run")):
        planted = synthetic.planted(_truth(walker_clips)[name], gait)
        found = built.contacts[_range(built, name, False)].astype(bool)
        # A toe slows down before it stands: the edges of a contact are a matter of the speed's threshold.
        assert (found == planted).mean() > 0.8, name
        assert found[planted].mean() > 0.9, name


def test_velocities_are_the_rates_of_the_positions_within_each_range(built: Database) -> None:
    for start, stop in zip(built.starts, built.stops, strict=True):
        positions = built.poses.positions[start:stop].astype(float)
        rates = (positions[2:] - positions[:-2]) * 30
        np.testing.assert_allclose(built.poses.velocities[start + 1 : stop - 1], rates, atol=2e-3)


def test_features_are_the_schema_s(built: Database) -> None:
    raw = extract.extract(built.schema, built.skeleton, built.fps, built.poses, built.starts, built.stops)
    offset, scale = normalise.fit(built.schema, raw)
    np.testing.assert_array_equal(built.offset, offset)
    np.testing.assert_array_equal(built.scale, scale)
    np.testing.assert_array_equal(built.features, normalise.normalise(raw, offset, scale))


def test_threads_do_not_change_a_bit(built: Database, walker_files: Path, tmp_path: Path) -> None:
    marks = set()
    for i, db in enumerate((built, build.build([walker_files], jobs=1), build.build(walker_files, jobs=7))):
        db.save(tmp_path / str(i))
        marks.add(db.fingerprint)
    assert len(marks) == 1


def test_without_mirror_and_at_another_rate(walker_files: Path, walker_clips: list[Clip]) -> None:
    db = build.build(walker_files, mirror=False, fps=30)
    assert not db.mirrored.any() and db.names == tuple(NAMES) and db.fps == 30
    assert (db.stops - db.starts).tolist() == [150] * 5
    clip = _truth(walker_clips)["run"]
    expected, _ = kinematics.forward(clip.skeleton, clip.positions[::2], clip.rotations[::2])
    np.testing.assert_allclose(_world(db, _range(db, "run", False))[0][:, 1:], expected, atol=2e-5)


def test_a_wrong_rate_in_the_file_can_be_put_right(walker_files: Path) -> None:
    db = build.build(walker_files / "straight.bvh", source_fps=30, mirror=False)
    assert len(db) == 599
    np.testing.assert_allclose(db.poses.velocities[50:-50, 0].mean(axis=0), [0, 0, 0.6], atol=0.02)


@pytest.mark.parametrize("fps", [0, -60, np.nan, np.inf, 1e6])
def test_no_rate_is_refused(walker_files: Path, fps: float) -> None:
    with pytest.raises(UserError, match=r"frames per second.*between 1 and 1000"):
        build.build(walker_files, fps=fps)


# Skeletons


def _other_rig() -> Clip:
    """The walker without hands: other joints, the same roles for the features."""
    clip = synthetic.walk("handless", seconds=1)
    keep = [j for j, name in enumerate(clip.skeleton.names) if not name.endswith("Hand")]
    old = clip.skeleton
    place = {j: i for i, j in enumerate(keep)} | {-1: -1}
    skeleton = Skeleton(
        tuple(old.names[j] for j in keep),
        np.array([place[int(old.parents[j])] for j in keep]),
        old.offsets[keep],
    )
    return Clip("handless", skeleton, 60, clip.positions[:, keep], clip.rotations[:, keep])


def test_mixed_skeletons_are_refused_with_the_remedies(walker_files: Path, tmp_path: Path) -> None:
    other = _file(tmp_path, _other_rig())
    with pytest.raises(UserError) as caught:
        build.build([walker_files, other])
    message = str(caught.value)
    for part in (
        "2 different skeletons",
        "5 clips with 22 joints, such as",
        "1 clip with 20 joints",
        str(other),
    ):
        assert part in message
    # Told so, the command works: nothing is left to be found out.
    told = message.partition("--skeleton ")[2].split()[0]
    assert Path(told).parent == walker_files and "--roles-only" in message
    assert len(build.build([walker_files, other], skeleton=told, mirror=False).names) == 6


def test_without_retargeting_a_chosen_skeleton_leaves_others_out(walker_files: Path, tmp_path: Path) -> None:
    other, notes = _file(tmp_path, _other_rig()), []
    options = {"retarget": False, "note": notes.append}
    db = build.build([walker_files, other], skeleton=walker_files / "run.bvh", **options)
    assert db.names[::2] == tuple(NAMES)
    assert notes == [f"left out 1 clip with 20 joints, such as {other}: lacks LeftHand, RightHand"]
    db = build.build([walker_files, other], skeleton=other, mirror=False, **options)
    assert db.names == ("handless",) and len(db.skeleton) == 21
    with pytest.raises(UserError, match="no clip has the skeleton's 20 joints"):
        build.build(walker_files, skeleton=other, **options)


def test_roles_only_takes_any_mixture_and_keeps_the_features(
    built: Database, walker_files: Path, tmp_path: Path
) -> None:
    alone = build.build(walker_files, roles_only=True)
    assert alone.skeleton.names == ("root", "left_foot", "right_foot", "hips")
    assert alone.skeleton.parents.tolist() == [-1, 0, 0, 0] and alone.contact_roles == (
        "left_foot",
        "right_foot",
    )
    np.testing.assert_allclose(alone.offset, built.offset, atol=1e-5)
    np.testing.assert_allclose(alone.features, built.features, atol=1e-3)

    mixed = build.build([walker_files, _file(tmp_path, _other_rig())], roles_only=True)
    assert len(mixed) == len(built) + 120 and set(mixed.names) == {*NAMES, "handless"}


def test_other_bone_lengths_are_fitted_to_the_first_clip_s(walker_files: Path, tmp_path: Path) -> None:
    clip = synthetic.walk("tall", seconds=2)
    old = clip.skeleton
    tall = clip.replace(
        skeleton=Skeleton(old.names, old.parents, old.offsets * 1.1, old.roles),
        positions=clip.positions * 1.1,
    )
    notes: list[str] = []
    clips = [walker_files / "straight.bvh", _file(tmp_path, tall)]
    db = build.build(clips, mirror=False, note=notes.append)
    assert notes == ["1 of 2 clips have other bone lengths and are fitted to one skeleton"]
    legs = [old.index(name) + 1 for name in ("LeftLeg", "LeftFoot", "RightLeg", "RightFoot", "Head")]
    lengths = np.linalg.norm(db.poses.positions[:, legs], axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(lengths[0], lengths.shape), atol=1e-5)
    assert db.names == ("tall", "straight")  # files are taken in the order of their paths
    for name in db.names:
        height = _world(db, _range(db, name, False))[0][:, 1, 1].mean()
        np.testing.assert_allclose(height, 1.1 * synthetic.HIPS, atol=0.01)


@pytest.mark.parametrize("flat", [False, True])
def test_four_paws_touch_the_ground(data: Path, flat: bool) -> None:
    db = build.build(data / "dog_mann/D1_010_KAN01_004.bvh", schema="quadruped39", roles_only=flat)
    assert db.contact_roles == ("left_foot", "right_foot", "left_hand", "right_hand")
    assert db.features.shape == (720, 39)
    assert db.contacts.any(axis=0).all() and not db.contacts.all(axis=0).any()
    plain, mirrored = (db.contacts[_range(db, db.names[0], side)] for side in (False, True))
    np.testing.assert_array_equal(mirrored, plain[:, [1, 0, 3, 2]])


def test_a_skeleton_and_roles_only_exclude_each_other(walker_files: Path) -> None:
    with pytest.raises(UserError, match="leave --skeleton or --roles-only out"):
        build.build(walker_files, skeleton=walker_files / "run.bvh", roles_only=True)


def test_flatten_keeps_where_joints_are_and_how_they_move(walker: Clip) -> None:
    grounded = root.ground(walker)
    skeleton, poses = grounded.skeleton, Poses.of_clip(grounded)
    flat = skeletons.flat(("left_foot", "head", "left_foot"))
    assert flat.names == ("root", "left_foot", "head")
    star = kinematics.forward_velocities(flat, *skeletons.flatten(skeleton, poses, flat).arrays().values())
    whole = kinematics.forward_velocities(skeleton, *poses.arrays().values())
    joints = [0, skeleton.role("left_foot"), skeleton.role("head")]
    for i, tolerance in ((0, 1e-5), (2, 1e-4), (3, 1e-4)):
        np.testing.assert_allclose(star[i], whole[i][:, joints], atol=tolerance)
    assert quat.angle_between(star[1], whole[1][:, joints]).max() < 1e-3


def test_the_skeleton_rests_where_the_clips_have_it(built: Database) -> None:
    offsets = built.skeleton.offsets
    np.testing.assert_allclose(offsets[0], 0)
    assert 0.8 < offsets[1, 1] < 0.95 and np.abs(offsets[1, ::2]).max() < 0.1
    np.testing.assert_allclose(offsets[2:], synthetic.skeleton().offsets[1:], atol=1e-5)


# Names, tags, remarks


def test_equal_names_are_told_apart_by_folder(walker_clips: list[Clip], tmp_path: Path) -> None:
    clip = _short(walker_clips[0], 60)
    for folder in ("one/a", "two/a", "two/b"):
        _file(tmp_path / folder, clip, "walk")
    db = build.build(tmp_path, mirror=False)
    assert db.names == ("one/a/walk", "two/a/walk", "b/walk")


def test_tags_by_pattern_and_by_frames(walker_files: Path, tmp_path: Path) -> None:
    csv = tmp_path / "tags.csv"
    csv.write_text("tag,clips,start,stop\nturn,*_turn,,\nfast, run ,60,120\nturn,run,,30\n")
    db = build.build(walker_files, tags=csv, fps=30)
    assert db.tag_names == ("turn", "fast")
    turn, fast = (db.tags & db.tag_mask([name]) != 0 for name in db.tag_names)
    for mirrored in (False, True):
        assert (
            turn[_range(db, "left_turn", mirrored)].all() and turn[_range(db, "right_turn", mirrored)].all()
        )
        run = _range(db, "run", mirrored)
        np.testing.assert_array_equal(np.flatnonzero(fast[run]), np.arange(30, 60))
        np.testing.assert_array_equal(np.flatnonzero(turn[run]), np.arange(15))
    assert turn.sum() == 2 * (150 + 150 + 15) and fast.sum() == 2 * 30

    toml = tmp_path / "tags.toml"
    toml.write_text(
        '[[tags]]\ntag = "turn"\nclips = "*_turn"\n'
        '[[tags]]\ntag = "fast"\nclips = "run"\nstart = 60\nstop = 120\n'
        '[[tags]]\ntag = "turn"\nclips = "run"\nstop = 30\n'
    )
    np.testing.assert_array_equal(build.build(walker_files, tags=toml, fps=30).tags, db.tags)


def test_folder_tags(walker_clips: list[Clip], tmp_path: Path) -> None:
    _file(tmp_path / "slow", _short(walker_clips[0], 60))
    _file(tmp_path / "quick", _short(walker_clips[4], 60))
    db = build.build(tmp_path, folder_tags=True, mirror=False)
    assert db.tag_names == ("quick", "slow") and db.names == ("run", "straight")
    assert db.tags.tolist() == [1] * 60 + [2] * 60


TAG_FAULTS = {
    "no such clip": ("tag,clips\nrun,rnu*\n", "no clip is named like 'rnu\\*'.*the clips are left_turn"),
    "frames beyond": (
        "tag,clips,start,stop\nrun,run,10,9999\n",
        "frames 10 to 9999 of clip 'run', which has 300",
    ),
    "no frames": ("tag,clips,start,stop\nrun,run,20,20\n", ":2: not a tag"),
    "no number": ("tag,clips,start,stop\n\nrun,run,now,\n", ":3: not a tag"),
    "no name": ("tag,clips\n,run\n", ":2: not a tag.*needs a name"),
    "header": ("name,clips\nrun,run\n", ":1: header"),
    "empty": ("", ":1: header"),
    "many": ("tag,clips\n" + "".join(f"t{i},run\n" for i in range(33)), "33 different tags, at most 32"),
}


@pytest.mark.parametrize(("text", "message"), TAG_FAULTS.values(), ids=TAG_FAULTS.keys())
def test_wrong_tags_are_refused(walker_files: Path, tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "tags.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=message):
        build.build(walker_files, tags=path)


def test_a_tags_file_without_rules_tags_nothing_and_is_noted(walker_files: Path, tmp_path: Path) -> None:
    path = tmp_path / "tags.csv"
    path.write_text("tag,clips,start,stop\n")
    with pytest.warns(Note, match=r"tags\.csv: no tags in this file"):
        db = build.build(walker_files, tags=path, mirror=False)
    assert db.tag_names == () and not db.tags.any()


def test_an_unknown_key_in_a_tags_file_is_named(walker_files: Path, tmp_path: Path) -> None:
    path = tmp_path / "tags.toml"
    path.write_text('[[tags]]\ntag = "run"\nclip = "run"\n')
    with pytest.raises(UserError, match="clip"):
        build.build(walker_files, tags=path)


def test_clips_that_can_never_be_matched_are_noted(walker_clips: list[Clip], tmp_path: Path) -> None:
    _file(tmp_path, _short(walker_clips[0], 20), "tiny")
    _file(tmp_path, _short(walker_clips[0], 21), "small")
    notes: list[str] = []
    build.build(tmp_path, note=notes.append)
    assert len(notes) == 1 and notes[0].startswith("1 of 2 clips have 20 frames or fewer (such as tiny)")


def test_an_inserted_rest_pose_is_dropped(walker_clips: list[Clip], tmp_path: Path) -> None:
    run = _truth(walker_clips)["run"]
    rotations = np.concatenate([quat.identity(1, len(run.skeleton)), run.rotations])
    positions = np.concatenate([run.positions[:1], run.positions])
    _file(tmp_path, run.replace(positions=positions, rotations=rotations), "posed")
    (tmp_path / "tags.csv").write_text("tag,clips,start,stop\nstart,posed,1,11\n")
    notes: list[str] = []
    db = build.build(tmp_path / "posed.bvh", mirror=False, note=notes.append, tags=tmp_path / "tags.csv")
    assert len(db) == 300 and "1 of 1 clips begin with a rest pose" in notes[0]
    np.testing.assert_array_equal(np.flatnonzero(db.tags), np.arange(10))


# Bad input


def _truncated(good: bytes) -> bytes:
    return good[: len(good) * 2 // 3]


def _with_nan(good: bytes) -> bytes:
    head, _, rows = good.rpartition(b"Frame Time")
    lines = rows.split(b"\n")
    lines[5] = b"nan " + lines[5].split(None, 1)[1]
    return head + b"Frame Time" + b"\n".join(lines)


BAD: dict[str, Callable[[bytes], bytes]] = {
    "truncated": _truncated,
    "binary": lambda good: np.random.default_rng(0).bytes(4000),
    "empty": lambda good: b"",
    "NaN": _with_nan,
}


@pytest.mark.parametrize("damage", BAD.values(), ids=BAD.keys())
def test_one_bad_file_fails_the_build_by_name_or_is_left_out(
    walker_files: Path, tmp_path: Path, damage: Callable[[bytes], bytes]
) -> None:
    good = (walker_files / "run.bvh").read_bytes()
    (tmp_path / "bad.bvh").write_bytes(damage(good))
    (tmp_path / "good.bvh").write_bytes(good)
    with pytest.raises(UserError) as caught:
        build.build(tmp_path)
    assert caught.value.path == str(tmp_path / "bad.bvh") and caught.value.remedy
    notes: list[str] = []
    db = build.build(tmp_path, skip_bad=True, note=notes.append)
    assert set(db.names) == {"good"}
    assert len(notes) == 1 and notes[0].startswith(f"left out: {tmp_path / 'bad.bvh'}")


@pytest.mark.parametrize("frames", [1, 2])
def test_a_clip_of_two_frames_is_refused(walker_clips: list[Clip], tmp_path: Path, frames: int) -> None:
    path = _file(tmp_path, _short(walker_clips[0], frames))
    with pytest.raises(
        UserError, match=rf"a clip of {frames} frames? at 60 fps, at least 3.*--skip-bad"
    ) as caught:
        build.build(tmp_path)
    assert caught.value.path == str(path)
    with pytest.raises(UserError, match="no clip of 1 can be used"):
        build.build(tmp_path, skip_bad=True)
    _file(tmp_path, _short(walker_clips[0], 3), "enough")
    assert set(build.build(tmp_path, skip_bad=True).names) == {"enough"}


def test_three_frames_that_become_two_are_refused(walker_clips: list[Clip], tmp_path: Path) -> None:
    _file(tmp_path, _short(walker_clips[0], 3))
    with pytest.raises(UserError, match="a clip of 3 frames at 60 fps, at least 3 at 30 fps are needed"):
        build.build(tmp_path, fps=30)


def test_joints_missing_for_the_schema_name_clip_feature_role_and_joints(tmp_path: Path) -> None:
    path = _file(tmp_path, _other_rig())
    schema = Schema("hands", (Feature("reach", "position", "left_hand"),))
    with pytest.raises(UserError) as caught:
        build.build(tmp_path, schema=schema)
    for part in ("'reach'", "'left_hand'", "'hands'", "LeftForeArm", "--roles"):
        assert part in str(caught.value)
    assert caught.value.path == str(path)
    roles = tmp_path / "roles.toml"
    roles.write_text('[roles]\nleft_hand = "LeftForeArm"\n')
    db = build.build(tmp_path, schema=schema, roles=roles)
    assert db.skeleton.names[db.skeleton.role("left_hand")] == "LeftForeArm"
    roles.write_text('[roles]\nleft_hand = "Paw"\n')
    with pytest.raises(UserError, match=r"no joint 'Paw'.*LeftForeArm") as caught:
        build.build(tmp_path, schema=schema, roles=roles)
    assert caught.value.path == str(path)


def test_no_clips(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no clips in this folder"):
        build.build(tmp_path)
    with pytest.raises(UserError, match="no such file or folder"):
        build.build(tmp_path / "absent")
    with pytest.raises(UserError, match="no sources"):
        build.build([])


# Real data


STRETCHES = ((60, 460), (1500, 1800))


def test_the_reference_program_s_database_comes_out(data: Path, tmp_path: Path) -> None:
    """From the BVH that it was made from, played 10 % faster: its script makes 2T - 1 frames 0.9 of that.

    The root agrees to 0.3 mm and 0.1 degrees. Rotations differ by up to 4 degrees between the file's frames,
    where it puts cubic splines through the quaternions' components and we slerp, and are equal on them.
    """
    source = bvh.read(data / "lafan1" / "original_30fps" / "obstacles1_subject2.bvh")
    theirs = interchange.import_directory(data / "reference" / "oracle")
    for i, (start, stop) in enumerate(STRETCHES):
        path = _file(tmp_path, resample.crop(source, start, stop), f"stretch{i}")
        frames = int(0.9 * (2 * (stop - start) - 1))
        step = (stop - start - 1) / (frames - 1)
        ours = build.build(path, source_fps=60 * step)
        assert ours.skeleton.same_joints(theirs.skeleton)
        for copy in range(2):
            mine = slice(ours.starts[copy], ours.stops[copy])
            other = slice(theirs.starts[2 * i + copy], theirs.stops[2 * i + copy])
            found, expected = ours.poses[mine], theirs.poses[other]
            assert len(found) == len(expected) == frames
            np.testing.assert_allclose(found.positions, expected.positions, atol=3e-4)
            np.testing.assert_allclose(found.velocities, expected.velocities, atol=1e-2)
            angle = np.degrees(
                quat.angle_between(found.rotations.astype(float), expected.rotations.astype(float))
            )
            assert angle[:, 0].max() < 0.1 and angle.max() < 4 and angle.mean() < 0.2
            shared = np.isclose(np.arange(frames) * step, np.round(np.arange(frames) * step), atol=1e-9)
            assert shared.sum() >= 2 and angle[shared].max() < 0.1
            assert (ours.contacts[mine] == theirs.contacts[other]).mean() > 0.98


def test_real_cmu_clips_move_as_people_do(data: Path) -> None:
    notes: list[str] = []
    db = build.build(data / "cmu" / "daz_bvh" / "02", note=notes.append)
    assert any("rest pose" in note for note in notes)
    speed = np.linalg.norm(db.poses.velocities[:, 0], axis=-1)
    assert speed.max() < 6 and 0.5 < np.median(speed) < 3
    hips = db.poses.positions[:, 1, 1]
    assert 0.7 < np.median(hips) < 1.1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tag,clips,tag\nrun,run*,x\n", "tags.csv:1: header"),
        ("tag,clips\nrun,run*,3,4\n", "tags.csv:2: .*more than 2 columns"),
        ("tag,clips\n" + 200_000 * "x" + ",run*\n", "tags.csv:.*not CSV"),
        ('tag,clips\n"run"x,run*\n', "tags.csv:2: not CSV"),
    ],
)
def test_tables_of_tags_that_are_amiss(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "tags.csv").write_text(text)
    with pytest.raises(UserError, match=message):
        tags.load(tmp_path / "tags.csv")


def test_a_source_rate_that_would_fill_the_memory_is_refused(walker_files: Path) -> None:
    with pytest.raises(UserError, match=r"run.bvh: .* at most 10,000,000 fit.*--source-fps"):
        build.build(walker_files / "run.bvh", source_fps=1e-3)
