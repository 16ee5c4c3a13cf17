"""Checks: every kind of defect, put into clean motion at known frames, is found there and nothing else is."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest
import synthetic

from motion import axes, quat, resample, sources
from motion.check import KINDS, Finding, check, good_spans
from motion.checking import finding, jumps, rate
from motion.checking.body import Body
from motion.clip import Clip
from motion.units import to_metres

RATES = [30, 60, 120]
AT = 2.0  # seconds into the clip, where the defects are


@pytest.fixture(params=RATES)
def clip(request):
    return synthetic.walk("walker", turn=synthetic.weave, fps=request.param)


def frames(clip, seconds):
    """The frame AT, and the one so many seconds later."""
    return round(AT * clip.fps), round((AT + seconds) * clip.fps)


def changed(clip, *, positions=None, rotations=None):
    """A copy whose arrays the functions given change in place."""
    copies = clip.positions.copy(), clip.rotations.copy()
    for array, change in zip(copies, (positions, rotations), strict=True):
        if change is not None:
            change(array)
    return clip.replace(positions=copies[0], rotations=quat.unroll(copies[1]))


def only(clip, kind, start, stop, *, slack=1, fatal=True):
    """The one finding of a clip: its kind, its frames within slack, and whether it is fatal."""
    (found,) = check(clip)
    assert found.kind == kind in KINDS
    assert abs(found.start - start) <= slack and abs(found.stop - stop) <= slack, found
    assert found.fatal is fatal, found
    return found


@pytest.mark.parametrize("axis", ["x", "z", "-x", "-y", "-z"])
def test_another_axis_than_y_points_up(axis):
    upright = synthetic.walk("walker", turn=synthetic.weave, fps=60)
    forward = "z" if axis[-1] != "z" else "x"
    for hand in ("right", "left"):
        clip = axes.convert(upright, up=axis, forward=forward, handedness=hand)
        found = only(clip, "axes", 0, len(clip))
        assert f"along {axis}, not along y" in found.what


def test_who_lies_still_or_hangs_is_upright_for_all_we_know():
    clip = synthetic.walk("stander", speed=0.0, fps=60)
    lying = axes.convert(clip, up="z", forward="-y")
    assert "axes" not in {f.kind for f in check(lying)}


# Clean motion


@pytest.mark.parametrize("fps", [24, *RATES, 240])
def test_clean_motion_gets_no_finding(fps):
    clips = [
        *synthetic.clips(fps=fps),
        synthetic.walk("slow", speed=0.5, fps=fps),
        synthetic.walk("fast", speed=1.8, fps=fps),
        synthetic.walk("backward", speed=-1.0, fps=fps),
    ]
    assert {clip.name: check(clip) for clip in clips if check(clip)} == {}


def test_clips_of_no_or_one_frame_and_of_one_joint(clip):
    one = clip.replace(positions=clip.positions[:1], rotations=clip.rotations[:1])
    none = clip.replace(positions=clip.positions[:0], rotations=clip.rotations[:0])
    assert check(one) == check(none) == []
    for count in range(2, 8):
        assert check(clip.replace(positions=clip.positions[:count], rotations=clip.rotations[:count])) == []
    from motion.skeleton import Skeleton

    point = Skeleton(("p",), np.array([-1]), np.zeros((1, 3)))
    still = clip.replace(skeleton=point, positions=clip.positions[:, :1], rotations=clip.rotations[:, :1])
    assert check(still) == []


def test_what_has_no_roles_is_not_judged_by_them(clip):
    bare = clip.replace(skeleton=clip.skeleton.with_roles({}))
    assert check(bare) == []
    start, _ = frames(clip, 0)

    def away(positions):
        positions[start:, 0] += [0, 0, 0.6]

    (found,) = check(changed(bare, positions=away))
    assert found.kind == "teleport" and abs(found.start - start) <= 1


def test_any_unit_gives_the_same(clip):
    inches = to_metres(clip.replace(unit_to_m=1.0), 0.0254)
    assert check(to_metres(inches, 1.0)) == []
    child = to_metres(clip, 0.6)
    assert check(child) == []


# Frames


def test_a_body_that_jumps_away_and_stays_there(clip):
    start, _ = frames(clip, 0)

    def away(positions):
        positions[start:, 0] += [0.25, 0, 0]

    step = clip.positions[start, 0] - clip.positions[start - 1, 0] + [0.25, 0, 0]
    speed = np.linalg.norm(step) * clip.fps
    kind = "jump" if speed < 14 else "teleport"
    found = only(changed(clip, positions=away), kind, start, start + 1, slack=0)
    assert f"from frame {start - 1} to {start} ({speed:.0f} m/s)" in found.what


def test_a_body_that_jumps_away_and_comes_back(clip):
    start, stop = frames(clip, 0.07)

    def away(positions):
        positions[start:stop, 0] += [0, 0, 2.0]

    only(changed(clip, positions=away), "teleport", start, stop, slack=0)


def test_a_jump_near_an_end_takes_the_end_with_it(clip):
    def away(positions):
        positions[:2, 0] += [0, 0, 2.0]
        positions[-2:, 0] += [0, 0, 2.0]

    first, last = check(changed(clip, positions=away))
    assert (first.start, first.stop, last.start, last.stop) == (0, 2, len(clip) - 2, len(clip))


def test_a_jump_smeared_over_two_steps(clip):
    start, _ = frames(clip, 0)

    def away(positions):
        positions[start, 0] += [0, 0, 0.5]
        positions[start + 1 :, 0] += [0, 0, 1.0]

    (found,) = check(changed(clip, positions=away))
    assert found.kind in ("jump", "teleport") and found.start <= start + 1 <= found.stop


@pytest.mark.parametrize("joint", ["LeftArm", "RightLeg", "Hips"])
@pytest.mark.parametrize("degrees", [100, 180])
def test_a_joint_that_flips_and_returns(clip, joint, degrees):
    j, (start, stop) = clip.skeleton.index(joint), frames(clip, 0.04)
    axis = quat.from_axis_angle([0.6, 0.8, 0], np.radians(degrees))

    def flip(rotations):
        rotations[start:stop, j] = quat.mul(rotations[start:stop, j], axis)

    found = only(changed(clip, rotations=flip), "flip", start, stop, slack=0)
    assert joint in found.what


def test_quaternions_of_the_other_sign_are_no_flip(clip):
    start, stop = frames(clip, 0.1)
    rotations = clip.rotations.copy()
    rotations[start:stop, 3] *= -1
    assert check(clip.replace(rotations=rotations)) == []


def test_a_finger_that_flips_is_a_remark(clip):
    j, (start, _) = clip.skeleton.index("LeftHand"), frames(clip, 0)
    roles = {role: joint for role, joint in clip.skeleton.roles.items() if not role.endswith("hand")}

    def flip(rotations):
        rotations[start, j] = quat.mul(rotations[start, j], quat.from_axis_angle([1.0, 0, 0], 3.0))

    damaged = changed(clip, rotations=flip)
    bare = damaged.replace(skeleton=clip.skeleton.with_roles(roles))
    only(bare, "flip", start, start + 1, fatal=False)
    only(damaged, "flip", start, start + 1, fatal=True)


def test_values_that_are_no_numbers(clip):
    start, stop = frames(clip, 0.1)
    for value in (np.nan, np.inf, 1e12):

        def spoil(positions, value=value):
            positions[start:stop, 0, 1] = value

        found = only(changed(clip, positions=spoil), "not finite", start, stop, slack=0)
        assert "Hips" in found.what
    rotations = clip.rotations.copy()
    rotations[start:stop, 5] = 0
    only(clip.replace(rotations=rotations), "not finite", start, stop, slack=0)
    rotations[:] = np.nan
    only(clip.replace(rotations=rotations), "not finite", 0, len(clip), slack=0)


def tee(skeleton):
    """Local rotations [J, 4] of the humanoid with its arms out like a T."""
    pose = quat.identity(len(skeleton))
    for joint, sign in (("LeftArm", 1), ("RightArm", -1)):
        pose[skeleton.index(joint)] = quat.from_axis_angle([0, 0, 1.0], sign * np.pi / 2)
    return pose


@pytest.mark.parametrize("where", ["start", "middle", "end"])
@pytest.mark.parametrize("arms", ["out", "down"])
def test_an_inserted_rest_pose(clip, where, arms):
    # Standing upright is too near to walking to be told from a fifteenth of a second.
    count = 2 if arms == "out" or clip.fps > 30 else 6
    start = {"start": 0, "middle": round(AT * clip.fps), "end": len(clip) - count}[where]
    pose = tee(clip.skeleton) if arms == "out" else quat.identity(len(clip.skeleton))

    def insert(rotations):
        rotations[start : start + count, 1:] = pose[1:]

    only(changed(clip, rotations=insert), "rest pose", start, start + count)


def test_a_t_pose_held_in_the_middle_of_the_motion(clip):
    start, stop = frames(clip, 0.5)

    def hold(rotations):
        rotations[start:stop, 1:] = tee(clip.skeleton)[1:]

    found = only(changed(clip, rotations=hold), "rest pose", start, stop)
    assert "T-pose" in found.what


def test_a_limb_that_changes_its_length(clip):
    j, (start, stop) = clip.skeleton.index("LeftLeg"), frames(clip, 0.3)

    def stretch(positions):
        positions[start:stop, j] *= 1.1

    found = only(changed(clip, positions=stretch), "stretch", start, stop, slack=0)
    assert "LeftLeg is 0.47 m long" in found.what and "mostly 0.43 m" in found.what


def test_frames_that_froze(clip):
    start, stop = frames(clip, 0.2)
    source = np.arange(len(clip))
    source[start:stop] = start
    source[stop:] -= stop - start - 1  # what follows goes on where it froze
    frozen = clip.replace(positions=clip.positions[source], rotations=clip.rotations[source])
    only(frozen, "frozen", start + 1, stop, slack=0)


def test_a_frozen_span_that_snaps_back(clip):
    start, stop = frames(clip, 0.5)
    source = np.arange(len(clip))
    source[start:stop] = start
    found = check(clip.replace(positions=clip.positions[source], rotations=clip.rotations[source]))
    assert found[0].kind == "frozen" and (found[0].start, found[0].stop) == (start + 1, stop)
    assert {f.kind for f in found[1:]} <= {"jump", "teleport"}  # the half metre to where the body has gone


@pytest.mark.parametrize(("every", "share"), [(2, 1 / 2), (4, 3 / 4), (5, 4 / 5)])
def test_every_second_frame_repeated(clip, every, share):
    kept = resample.resample(clip, clip.fps * share)
    source = np.minimum(np.floor(np.arange(len(clip)) * share + 1e-9).astype(int), len(kept) - 1)
    repeated = clip.replace(positions=kept.positions[source], rotations=kept.rotations[source])
    found = only(repeated, "repeated", 0, len(clip), slack=0)
    assert f"every {every}" in found.what and f"sampled at {clip.fps * share:.3g} fps" in found.what


def test_a_single_repeated_frame_is_a_remark(clip):
    start, _ = frames(clip, 0)
    source = np.arange(len(clip))
    source[start] = start - 1
    damaged = clip.replace(positions=clip.positions[source], rotations=clip.rotations[source])
    only(damaged, "repeated", start, start + 1, slack=0, fatal=False)


def test_a_body_that_stands_still_repeats_frames_unseen():
    clip = synthetic.walk("stand", gait="stand", speed=0.0)
    source = np.arange(len(clip))
    source[100] = 99
    assert check(clip.replace(positions=clip.positions[source], rotations=clip.rotations[source])) == []


# The ground


def test_a_clip_that_does_not_stand_on_the_ground(clip):
    for height in (-0.9, 0.8):

        def move(positions, height=height):
            positions[:, 0, 1] += height

        found = only(changed(clip, positions=move), "ground", 0, len(clip))
        assert ("below" if height < 0 else "above") in found.what


def test_a_body_that_sinks_and_comes_up(clip):
    start, stop = frames(clip, 1.0)
    depth = 0.4 * np.sin(np.linspace(0, np.pi, stop - start)) ** 2

    def sink(positions):
        positions[start:stop, 0, 1] -= depth

    (found,) = check(changed(clip, positions=sink))
    assert found.kind == "ground" and start < found.start < found.stop < stop
    assert "under the ground" in found.what


def test_a_body_that_is_carried_through_the_air(clip):
    start, stop = frames(clip, 1.2)
    ease = np.clip(
        np.minimum(np.arange(stop - start), np.arange(stop - start)[::-1]) / (0.3 * clip.fps), 0, 1
    )

    def carry(positions):
        positions[start:stop, 0, 1] += 0.6 * ease**2 * (3 - 2 * ease)
        positions[:, 0, 2] += 1.5 * np.arange(len(positions)) / clip.fps  # so that no foot rests

    found = [f for f in check(changed(clip, positions=carry)) if f.kind == "floating"]
    assert len(found) == 1 and start <= found[0].start < found[0].stop <= stop
    assert found[0].stop - found[0].start > 0.5 * clip.fps


def test_a_leap_is_no_floating(clip):
    start, stop = frames(clip, 0.6)
    time = np.arange(stop - start) / clip.fps
    rise = 9.81 / 2 * time * (time[-1] - time)

    def leap(positions):
        positions[start:stop, 0, 1] += rise

    assert [f for f in check(changed(clip, positions=leap)) if f.kind != "jump"] == []


def test_a_body_on_a_box_is_no_floating(clip):
    # Up 0.4 m by a step of the same length, as feet that rest up there show.
    def climb(positions):
        height = 0.4 * np.clip((np.arange(len(positions)) / clip.fps - AT) / 1.5, 0, 1)
        positions[:, 0, 1] += height

    assert check(changed(clip, positions=climb)) == []


# The rate


@pytest.mark.parametrize("factor", [4, 8])
@pytest.mark.parametrize("name", ["walk", "run"])
def test_a_rate_that_is_too_low(clip, factor, name):
    moves = clip if name == "walk" else synthetic.walk("run", gait="run", speed=2.5, fps=clip.fps)
    found = only(moves.replace(fps=clip.fps / factor), "rate", 0, len(clip), slack=0)
    assert "slower" in found.what
    assert clip.fps / 2 <= likely(found) <= clip.fps * 2


def likely(found):
    """The rate that a finding suggests."""
    return float(re.search(r"; ([0-9.]+) fps rather than", found.what)[1])


def test_a_rate_that_is_too_high(clip):
    found = only(clip.replace(fps=clip.fps * 4.0), "rate", 0, len(clip), slack=0)
    assert "faster" in found.what and clip.fps / 2 <= likely(found) <= clip.fps * 2


def test_frames_are_judged_at_the_likely_rate(clip):
    start, _ = frames(clip, 0)

    def away(positions):
        positions[start:, 0] += [0, 0, 3.0]

    whole, jump = check(changed(clip, positions=away).replace(fps=clip.fps / 4.0))
    assert (whole.kind, jump.kind) == ("rate", "teleport") and jump.start == start


def test_step_times_and_falls_of_known_motion():
    clip = synthetic.walk("walk", speed=1.2, fps=120)
    times = rate.step_times(Body(clip))
    # The foot goes by an ease curve during 0.4 s of each second while the body moves on.
    usual = np.median(times)
    assert len(times) >= 6 and (np.abs(times - usual) < 0.02).all() and 0.2 < usual < 0.4
    leap = rate.falls_of_flights(Body(flight(clip, 5.0)))
    assert len(leap) == 1 and leap[0] == pytest.approx(5.0, rel=0.1)


def flight(clip, gravity, seconds=0.5):
    """The clip with its hips on a parabola for a while, legs straight."""
    start, stop = frames(clip, seconds)
    time = np.arange(stop - start) / clip.fps
    positions, rotations = clip.positions.copy(), clip.rotations.copy()
    positions[start:stop, 0, 1] = 1.0 + gravity / 2 * time * (time[-1] - time)
    rotations[start:stop] = quat.identity(1)
    return clip.replace(positions=positions, rotations=rotations)


def test_turning_points():
    values = np.array([0.0, 2, 1.9, 2.1, -1, -0.5, 3, 3.1, 0])
    assert rate.turning_points(values, 1.0) == [(0, 0.0), (3, 2.1), (4, -1.0), (7, 3.1)]
    assert rate.turning_points(values, 10.0) == []
    assert rate.turning_points(np.zeros(0), 1.0) == []


# Sides


def test_left_and_right_swapped(clip):
    skeleton = clip.skeleton
    swapped = {
        role.replace("left", "L").replace("right", "left").replace("L", "right"): joint
        for role, joint in skeleton.roles.items()
    }
    found = only(clip.replace(skeleton=skeleton.with_roles(swapped)), "sides", 0, len(clip), slack=0)
    assert "left and right are swapped" in found.what


def test_knees_that_bend_backwards(clip):
    legs = [
        clip.skeleton.index(f"{side}{part}")
        for side in ("Left", "Right")
        for part in ("UpLeg", "Leg", "Foot")
    ]

    def bend(rotations):
        rotations[:, legs] = quat.inv(rotations[:, legs])

    found = check(changed(clip, rotations=bend))
    assert any(f.kind == "sides" and "backward" in f.what for f in found)


def test_arms_on_the_other_side(clip):
    roles = dict(clip.skeleton.roles)
    for part in ("shoulder", "arm", "forearm", "hand"):
        roles[f"left_{part}"], roles[f"right_{part}"] = roles[f"right_{part}"], roles[f"left_{part}"]
    found = only(clip.replace(skeleton=clip.skeleton.with_roles(roles)), "sides", 0, len(clip), slack=0)
    assert "arm" in found.what


# What is made of findings


def test_good_spans():
    fatal, remark = Finding("jump", 10, 12, "", True), Finding("flip", 30, 31, "", False)
    assert good_spans(50, []) == [(0, 50)]
    assert good_spans(50, [fatal, remark]) == [(0, 10), (12, 50)]
    assert good_spans(50, [fatal], minimum=20) == [(12, 50)]
    assert good_spans(50, [Finding("rate", 0, 50, "", True)]) == []


def test_frames_of_bad_steps():
    def of(*steps, count=20, gap=3):
        bad = np.zeros(count - 1, bool)
        bad[list(steps)] = True
        return finding.between_steps(bad, gap=gap)

    assert of(8) == [(9, 10)]  # to frame 9, and the body stays there
    assert of(8, 10) == [(9, 11)]  # frames 9 and 10 are elsewhere
    assert of(5, 12) == [(6, 7), (13, 14)]
    assert of(0) == [(0, 1)] and of(1) == [(0, 2)]
    assert of(18) == [(19, 20)] and of(16) == [(17, 20)]
    assert of() == []


def test_steps_unlike_their_neighbours():
    steps = np.zeros((9, 3))
    steps[4] = [3, 4, 0]
    expected = np.zeros(9)
    expected[4] = 5
    np.testing.assert_allclose(jumps.unlike_neighbours(steps), expected)
    assert jumps.unlike_neighbours(np.ones((1, 3))).tolist() == [0]
    smeared = np.zeros((9, 3))
    smeared[4:6, 0] = 2
    assert jumps.unlike_neighbours(smeared).tolist() == [0] * 4 + [2, 2] + [0] * 3
    ramp = np.arange(9.0)[:, None] * [1.0, 0, 0]  # a steady acceleration is as far on either side
    assert (jumps.unlike_neighbours(ramp) <= 2).all()


@pytest.mark.parametrize("seed", range(8))
def test_no_motion_however_wild_ends_in_anything_but_findings(seed):
    random = np.random.default_rng(seed)
    rig, length = synthetic.skeleton(), int(random.integers(2, 90))
    rotations = quat.normalize(random.normal(size=(length, len(rig), 4)))
    positions = random.normal(size=(length, len(rig), 3)) * 10.0 ** random.integers(-6, 5)
    if seed % 2:
        rotations[:] = rotations[0]
    if seed % 3 == 0:
        positions[random.random(positions.shape) < 0.1] = np.nan
    if seed == 7:
        positions[:] = 0
    clip = Clip("wild", rig, float(random.choice([1, 15, 60, 1000])), positions, rotations)
    found = check(clip)
    assert all(0 <= f.start < f.stop <= length and f.kind in KINDS and f.what for f in found)


# Real motion


def manifest(data):
    with open(data / "manifest.csv") as rows:
        return [row["file"] for row in csv.DictReader(rows)]


def findings(data, name):
    return check(sources.load(data / name))


def test_the_known_bad_clips_are_found_at_their_frames(data):
    for name, kind, frame in (
        ("07_12.bvh", "teleport", 1),
        ("09_10.bvh", "teleport", 3),
        ("09_10.amc", "teleport", 3),
        ("03_02.bvh", "jump", 24),
    ):
        found = findings(data, f"cmu/known_bad/{name}")
        assert any(f.kind == kind and f.fatal and f.start - 1 <= frame <= f.stop for f in found), name
    sunk = findings(data, "cmu/known_bad/07_12.bvh")
    assert any(f.kind == "ground" and "below y = 0" in f.what for f in sunk)
    assert any("317 m/s" in f.what for f in sunk)


def test_the_wrong_rate_is_found_in_every_clip(data):
    names = [name for name in manifest(data) if name.startswith("cmu/labelled_60fps")]
    assert len(names) == 22
    for name in names:
        (wrong,) = [f for f in findings(data, name) if f.kind == "rate"]
        assert "60 fps rather than 15?" in wrong.what, name
        assert "rate" not in {f.kind for f in check(sources.load(data / name, fps=60))}, name


def test_clean_captures_get_no_finding(data):
    clean = [
        *(
            "bandai/dataset-1/dataset-1_run_normal_001.bvh",
            "bandai/dataset-1/dataset-1_walk-back_proud_001.bvh",
        ),
        *("bandai/dataset-2/dataset-2_walk-turn-left_normal_002.bvh", "cmu/asfamc/02/02_01.amc"),
        *("cmu/asfamc/09/09_01.amc", "cmu/asfamc/16/16_03.amc", "cmu/asfamc/127/127_23.amc"),
        *("cmu/asfamc/03/03_01.amc", "lafan1/original_30fps/obstacles1_subject2.bvh"),
        *("lafan1/locomotion_60fps/walk1_subject1_walk2_filtered.bvh", "dog_mann/D1_010_KAN01_002.bvh"),
    ]
    names = set(manifest(data))
    for name in (name for name in clean if name in names):
        fatal = [f for f in findings(data, name) if f.fatal]
        assert fatal == [], name
    assert len(names & set(clean)) >= 9


@pytest.mark.parametrize("part", ["bandai/dataset-1", "bandai/dataset-2", "lafan1/locomotion_60fps"])
def test_sound_sets_get_no_fatal_finding(data, part):
    stumbles = "obstacles5_subject3_stumble"  # its hips do jump, by 8 m/s
    names = [name for name in manifest(data) if name.startswith(part) and stumbles not in name]
    assert len(names) > 80
    assert {
        name: found for name in names[::4] if (found := [f for f in findings(data, name) if f.fatal])
    } == {}
