"""Contacts of heels and toes: against motion whose contacts are known, and skeletons that lack parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import synthetic

from features import contacts as touching
from motion import kinematics, quat, sources
from motion.clip import Clip
from motion.dancecard import CONTACTS, Move, Style, figure, perform
from motion.errors import UserError


def world(clip: Clip):
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)


def find(clip: Clip, fps: float | None = None):
    return touching.find(clip.skeleton, fps or clip.fps, *world(clip))


def without(clip: Clip, *words: str, ends: bool = True) -> Clip:
    """The clip with roles of these words unknown, and end sites if they are to go."""
    skeleton = clip.skeleton
    roles = {role: joint for role, joint in skeleton.roles.items() if not any(w in role for w in words)}
    return clip.replace(skeleton=replace(skeleton, roles=roles, end_sites=skeleton.end_sites if ends else {}))


@pytest.fixture(scope="module")
def dance():
    moves = [
        Move(2),
        Move(4, 1.3),
        Move(4, 3.2, gait="run"),
        Move(3, 0.7, gait="crouch"),
        Move(3, 0, 0.8),
        Move(3, turn=150),
        Move(2),
    ]
    return perform(moves, name="dance", style=Style(), rng=np.random.default_rng(0))


def f1(found, known):
    return 2 * np.sum(found & known) / max(found.sum() + known.sum(), 1)


def test_contacts_of_a_dance_are_those_planned(dance):
    names, found = find(dance.clip)
    assert names == CONTACTS and found.dtype == np.uint8 and found.shape == dance.labels.contacts.shape
    known = dance.labels.contacts
    for c, name in enumerate(names):
        assert f1(found[:, c], known[:, c]) > (0.9 if name.endswith("heel") else 0.96)


@pytest.mark.parametrize("fps", [30, 60, 100, 120])
@pytest.mark.parametrize("gait", ["walk", "run"])
def test_planted_feet_are_found_at_any_rate(gait, fps):
    clip = synthetic.walk(gait=gait, speed=1.2 if gait == "walk" else 3.0, seconds=6, fps=fps)
    names, found = find(clip)
    feet = touching.feet(names, found, fps)
    assert np.mean(feet == synthetic.planted(clip, gait)) > 0.94


def test_feet_that_slide_a_little_still_touch(dance):
    """Motion fitted to another body: the whole of it goes 6 % further than its feet."""
    clip = dance.clip
    positions = clip.positions.copy()
    positions[:, 0, [0, 2]] *= 1.06
    known = dance.labels.contacts.reshape(-1, 2, 2).any(axis=2)
    names, found = find(clip.replace(positions=positions))
    assert np.mean(touching.feet(names, found, 60) == known) > 0.92


def test_the_heel_is_where_it_is_drawn(dance):
    """Within 2 cm of the edge that the figure's heel turns about, but for the height of the toe joint."""
    places = touching.points(dance.clip.skeleton, 60, *world(dance.clip), CONTACTS)
    at, turned = world(dance.clip)
    foot = dance.clip.skeleton.role("left_foot")
    edge = np.array([0, figure.BALL[1] - figure.ANKLE, figure.HEEL[2]])
    truth = at[:, foot] + quat.rotate(turned[:, foot], np.broadcast_to(edge, (len(at), 3)))
    assert np.linalg.norm(places[:, 0] - truth, axis=-1).max() < 0.02


def test_a_foot_held_still_in_the_air_does_not_touch():
    clip = synthetic.walk(gait="stand", speed=0.0, seconds=12)
    knee, hip = (clip.skeleton.role(f"left_{part}") for part in ("leg", "up_leg"))
    raised = clip.rotations.copy()
    time = np.arange(len(clip)) / 60
    ease = np.clip(time - 1, 0, 1) * np.clip(5 - time, 0, 1)  # up within a second, and down two later
    raised[:, hip] = quat.from_axis_angle(np.array([1.0, 0, 0]), -1.2 * ease)
    raised[:, knee] = quat.from_axis_angle(np.array([1.0, 0, 0]), 1.6 * ease)
    names, found = find(clip.replace(rotations=raised))
    assert names == CONTACTS
    assert not found[70:290, :2].any() and found[:, 2:].all() and found[:55].all() and found[310:].all()


def test_a_foot_that_hovers_before_it_is_put_down_does_not_touch():
    """Who turns on the spot puts the feet down from a still height: the ball of the foot from 3 cm."""
    moves = [Move(2), Move(4, turn=100), Move(3), Move(4, turn=-160), Move(2)]
    turn = perform(moves, name="turn", style=Style(), rng=np.random.default_rng(0))
    names, found = find(turn.clip)
    heights = touching.points(turn.clip.skeleton, 60, *world(turn.clip), names)[:, 1::2, 1]
    assert heights[found[:, 1::2] != 0].max() < figure.BALL[1] + 0.02
    assert np.mean(found[:, 1::2] == turn.labels.contacts[:, 1::2]) > 0.95


def test_who_stands_and_then_runs_touches_the_ground_running(data):
    """The toes rest 3 cm higher in the run than in the stand, as captured."""
    clip = sources.load(data / "cmu/asfamc/127/127_03.amc")
    names, found = find(clip)
    assert touching.feet(names, found, clip.fps)[200:].any(axis=0).all()


def test_what_a_skeleton_has(walker):
    positions, _ = world(walker)
    assert touching.parts(walker.skeleton, positions) == CONTACTS
    bare = without(walker, "toe", ends=False)
    assert touching.parts(bare.skeleton, positions) == ("left_foot", "right_foot")
    names, found = find(bare)
    assert np.mean(touching.feet(names, found, 60) == synthetic.planted(walker, "walk")) > 0.85
    tips = {walker.skeleton.role(f"{side}_foot"): np.array([0, -0.06, 0.13]) for side in ("left", "right")}
    cut = without(walker, "toe")
    joints = [j for j, name in enumerate(cut.skeleton.names) if "Toe" not in name]
    skeleton = replace(
        cut.skeleton,
        names=tuple(cut.skeleton.names[j] for j in joints),
        parents=np.array([joints.index(p) if p >= 0 else -1 for p in cut.skeleton.parents[joints]]),
        offsets=cut.skeleton.offsets[joints],
        roles={role: joints.index(j) for role, j in cut.skeleton.roles.items()},
        end_sites={joints.index(j): tip for j, tip in tips.items()},
    )
    tipped = Clip("tipped", skeleton, 60, walker.positions[:, joints], walker.rotations[:, joints])
    names, found = find(tipped)  # the tip of a foot counts as its toe
    assert names == CONTACTS
    assert np.mean(touching.feet(names, found, 60) == synthetic.planted(walker, "walk")) > 0.9


def test_a_skeleton_without_feet_is_one_line(walker):
    with pytest.raises(UserError, match="no pair of toes or feet"):
        find(without(walker, "toe", "foot"))


def test_short_gaps_and_spells_are_none():
    flags = np.ones(100, bool)
    flags[20:23] = False  # 0.05 s: no swing
    flags[50:80] = False
    flags[60:62] = True  # 0.03 s: no stance
    flags[98:] = False  # may be the begin of a swing
    touching.clean(flags, 60)
    assert touching.spans(~flags) == [(50, 80), (98, 100)]


def test_clips_of_few_frames(walker):
    for frames in (1, 2, 3, 5):
        clip = walker.replace(positions=walker.positions[:frames], rotations=walker.rotations[:frames])
        _, found = find(clip)
        assert found.shape == (frames, 4)
    assert touching.resting(np.zeros((0, 4, 3)), 60).shape == (0, 4)
