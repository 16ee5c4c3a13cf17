"""The built-in data against published gait analysis, against itself, and beside captured walks."""

from __future__ import annotations

import csv
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from motion import contacts, kinematics, quat, resample, roles, sources
from motion.cli import main
from motion.dancecard import (
    CONTACTS,
    FIGURE,
    GAITS,
    Move,
    Passage,
    Style,
    dances,
    figure,
    generate,
    names,
    perform,
)
from motion.dancecard.curves import hermite, travel

Array = NDArray[np.float64]

STRAIGHT = {"walk": (0.5, 0.75, 1.0, 1.3, 1.6, 2.0), "run": (2.5, 3.0, 3.5, 4.0, 4.5)}


def world(passage: Passage) -> tuple[Array, Array]:
    clip = passage.clip
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)


def straight(speed: float, gait: str, seed: int = 0) -> tuple[Passage, slice]:
    """A straight way, and its frames at an even speed."""
    moves = [Move(1.0), Move(12.0, speed, gait=gait, change=1.5), Move(2.0, change=1.8)]
    passage = perform(moves, name="straight", style=Style(), rng=np.random.default_rng(seed))
    return passage, slice(int(3.5 * 60), int(12.5 * 60))


def strikes(passage: Passage, side: str, frames: slice) -> Array:
    """Seconds at which a foot comes down."""
    first = CONTACTS.index(f"{side}_heel")
    on = passage.labels.contacts[frames, first : first + 2].any(axis=1)
    return (np.flatnonzero(~on[:-1] & on[1:]) + 1) / 60


def flexions(passage: Passage, side: str = "left") -> dict[str, Array]:
    """Angles of a leg in the sagittal plane of a body that faces +Z, degrees, by world positions alone."""
    at, _ = world(passage)
    joint = {part: at[:, FIGURE.role(f"{side}_{part}")] for part in ("up_leg", "leg", "foot", "toe")}
    bones = [joint[b] - joint[a] for a, b in itertools.pairwise(joint)]
    thigh, shank = (np.degrees(np.arctan2(bone[:, 2], -bone[:, 1])) for bone in bones[:2])
    rest = FIGURE.offsets[FIGURE.role("left_toe")]
    sole = np.degrees(np.arctan2(bones[2][:, 1], bones[2][:, 2]) - np.arctan2(rest[1], rest[2]))
    return {"hip": thigh, "knee": thigh - shank, "ankle": sole - shank}


@pytest.fixture(scope="module")
def round_() -> list[Passage]:
    return generate()


class TestFigure:
    def test_has_31_joints_with_the_roles_that_its_names_say(self) -> None:
        assert len(FIGURE) == 31
        pose, _ = kinematics.forward(FIGURE, FIGURE.offsets, quat.identity(31))
        assert dict(FIGURE.roles) == dict(roles.guess(FIGURE, pose))

    def test_is_symmetric(self) -> None:
        for j, name in enumerate(FIGURE.names):
            if name.startswith("Left"):
                other = FIGURE.offsets[FIGURE.index("Right" + name.removeprefix("Left"))]
                np.testing.assert_array_equal(FIGURE.offsets[j] * [-1, 1, 1], other)


class TestGenerate:
    def test_is_as_long_as_asked_and_the_same_again(self) -> None:
        once, again = generate(65.0, seed=3), generate(65.0, seed=3)
        assert sum(len(p.clip) for p in once) == 65 * 60
        for a, b in zip(once, again, strict=True):
            np.testing.assert_array_equal(a.clip.rotations, b.clip.rotations)
            assert a.name == b.name and len(a.labels) == len(a.clip)

    def test_another_seed_dances_otherwise(self) -> None:
        a, b = generate(10.0, seed=0)[0], generate(10.0, seed=1)[0]
        assert np.abs(a.clip.positions[:, 0] - b.clip.positions[:, 0]).max() > 0.05

    def test_a_longer_dance_begins_with_the_shorter_one(self) -> None:
        short, long = generate(40.0), generate(70.0)
        whole = short[0].clip
        np.testing.assert_array_equal(whole.positions, long[0].clip.positions)
        cut = len(short[1].clip)
        np.testing.assert_array_equal(short[1].clip.rotations, long[1].clip.rotations[:cut])

    def test_the_second_round_is_named_and_danced_otherwise(self) -> None:
        names = [p.name for p in generate(700.0)]
        assert len(set(names)) == len(names) and "walk-straight-2" in names

    @pytest.mark.parametrize("seconds", [0.0, -1.0, np.nan, np.inf])
    def test_refuses_lengths_that_are_none(self, seconds: float) -> None:
        with pytest.raises(ValueError, match="positive"):
            next(dances(seconds))

    @pytest.mark.parametrize("seconds", [10.0, 31.0, 65.0, 600.0])
    def test_names_are_those_danced(self, seconds: float) -> None:
        assert names(seconds, seed=2) == [p.name for p in generate(seconds, seed=2)]

    def test_a_single_frame(self) -> None:
        (passage,) = generate(1 / 60)
        assert len(passage.clip) == 1


class TestFeet:
    def test_a_planted_toe_stays_where_it_is(self, round_: list[Passage]) -> None:
        for passage in round_:
            at, _ = world(passage)
            for side in ("left", "right"):
                toe = at[:, FIGURE.role(f"{side}_toe")]
                down = passage.labels.contacts[:, CONTACTS.index(f"{side}_toe")].astype(bool)
                moved = np.linalg.norm(np.diff(toe, axis=0), axis=-1)[down[1:] & down[:-1]]
                assert down.mean() > 0.2 and moved.max() < 1e-6  # metres; the promise is 1e-3
                np.testing.assert_allclose(toe[down, 1], figure.BALL[1], atol=1e-9)

    def test_a_planted_heel_stays_where_it_is(self, round_: list[Passage]) -> None:
        for passage in round_:
            for side in ("left", "right"):
                heel = self.point(passage, side, figure.HEEL - [0, figure.ANKLE, 0])
                down = passage.labels.contacts[:, CONTACTS.index(f"{side}_heel")].astype(bool)
                moved = np.linalg.norm(np.diff(heel, axis=0), axis=-1)[down[1:] & down[:-1]]
                assert moved.max() < 1e-6
                np.testing.assert_allclose(heel[down, 1], 0, atol=1e-9)

    def test_no_foot_goes_under_the_floor(self, round_: list[Passage]) -> None:
        for passage in round_:
            at, turned = world(passage)
            for side in ("left", "right"):
                joint = FIGURE.role(f"{side}_toe")
                tip = at[:, joint] + quat.rotate(
                    turned[:, joint], np.broadcast_to(FIGURE.end_sites[joint], (len(at), 3))
                )
                heel = self.point(passage, side, figure.HEEL - [0, figure.ANKLE, 0])
                assert at[:, joint, 1].min() > figure.BALL[1] - 1e-6
                assert tip[:, 1].min() > 0 and heel[:, 1].min() > -1e-6

    @staticmethod
    def point(passage: Passage, side: str, offset: Array) -> Array:
        at, turned = world(passage)
        joint = FIGURE.role(f"{side}_foot")
        return at[:, joint] + quat.rotate(turned[:, joint], np.broadcast_to(offset, (len(at), 3)))

    @pytest.mark.parametrize(("gait", "speed"), [("walk", 0.75), ("walk", 1.4), ("walk", 2.0), ("run", 3.0)])
    def test_the_heel_strikes_first_and_the_toe_leaves_last(self, gait: str, speed: float) -> None:
        passage, even = straight(speed, gait)
        for side in ("left", "right"):
            heel, toe = (
                passage.labels.contacts[even, CONTACTS.index(f"{side}_{part}")].astype(int)
                for part in ("heel", "toe")
            )
            starts = [np.flatnonzero(np.diff(part) == 1) for part in (heel, toe)]
            stops = [np.flatnonzero(np.diff(part) == -1) for part in (heel, toe)]
            assert len(starts[0]) >= 5
            for struck in starts[0][:-1]:
                landed = starts[1][starts[1] > struck][0]
                rose = stops[0][stops[0] > struck][0]
                left = stops[1][stops[1] > struck][0]
                assert struck < landed <= rose < left

    def test_contacts_agree_with_those_that_are_found_in_the_motion(self, round_: list[Passage]) -> None:
        hit = missed = wrong = 0
        for passage in round_:
            found = contacts.contacts(passage.clip, roles=("left_toe", "right_toe")).astype(bool)
            known = passage.labels.contacts[:, [1, 3]].astype(bool)
            hit += int((found & known).sum())
            missed += int((~found & known).sum())
            wrong += int((found & ~known).sum())
        assert 2 * hit / (2 * hit + missed + wrong) > 0.93


class TestSteps:
    """Times and lengths of steps, measured in the motion, against published ones, within 15 %."""

    @pytest.mark.parametrize("speed", STRAIGHT["walk"])
    def test_walking_cadence_and_stride(self, speed: float) -> None:
        passage, even = straight(speed, "walk")
        times = strikes(passage, "left", even)
        period = float(np.diff(times).mean())
        # Grieve and Gear 1966 for men, through the natural walk of Winter 1991: 105 steps/min at 1.33 m/s.
        published = 105 / 120 * (speed / 1.33) ** 0.58
        assert 1 / period == pytest.approx(published, rel=0.15)
        assert speed * period == pytest.approx(speed / published, rel=0.15)

    @pytest.mark.parametrize("speed", STRAIGHT["run"])
    def test_running_cadence_and_stride(self, speed: float) -> None:
        passage, even = straight(speed, "run")
        period = float(np.diff(strikes(passage, "left", even)).mean())
        # van Oeveren et al. 2017: 77 and 80 strides a minute at 2.4 and 2.9 m/s; Nilsson and Thorstensson
        # 1987: about 1.5 Hz at 4.5 m/s.
        published = np.interp(speed, [2.4, 2.9, 4.5], [77 / 60, 80 / 60, 1.5])
        assert 1 / period == pytest.approx(published, rel=0.15)

    def test_the_body_goes_as_fast_as_it_is_told(self) -> None:
        for gait, speeds in STRAIGHT.items():
            for speed in speeds:
                passage, even = straight(speed, gait)
                hips = world(passage)[0][even, 0, 2]
                assert (hips[-1] - hips[0]) / ((len(hips) - 1) / 60) == pytest.approx(speed, rel=0.02)

    def test_walkers_keep_a_foot_on_the_ground_and_runners_fly(self) -> None:
        for gait, speeds in STRAIGHT.items():
            for speed in speeds:
                passage, even = straight(speed, gait)
                feet = passage.labels.contacts[even].reshape(-1, 2, 2).any(axis=2)
                flight, double = (~feet.any(axis=1)).mean(), feet.all(axis=1).mean()
                if gait == "walk":
                    assert flight == 0 and 0.04 < double < 0.40
                else:
                    assert 0.10 < flight < 0.50 and double == 0

    def test_phase_is_0_where_the_right_foot_strikes_and_half_where_the_left_does(self) -> None:
        passage, even = straight(1.3, "walk")
        for side, at in (("left", np.pi), ("right", 0.0)):
            first = CONTACTS.index(f"{side}_heel")
            on = passage.labels.contacts[:, first]
            struck = np.flatnonzero((on[1:] == 1) & (on[:-1] == 0)) + 1
            struck = struck[(struck > even.start) & (struck < even.stop)]
            off = np.angle(np.exp(1j * (passage.labels.phase[struck] - at)))
            assert np.abs(off).max() < 2 * np.pi * 0.9 / 60 * 1.5  # the next frame, at 0.9 strides a second
        steps = np.diff(np.unwrap(passage.labels.phase[even]))
        assert steps.min() > 0

    def test_phase_at_every_strike(self, round_: list[Passage]) -> None:
        off = []
        for passage in round_:
            for first, at in ((0, np.pi), (2, 0.0)):
                on = passage.labels.contacts[:, first : first + 2].any(axis=1)
                struck = np.flatnonzero(on[1:] & ~on[:-1]) + 1
                off += np.abs(np.angle(np.exp(1j * (passage.labels.phase[struck] - at)))).tolist()
        assert len(off) > 900 and np.mean(np.array(off) < 0.4) > 0.99  # a frame and a half in a run

    def test_phase_never_stops_and_is_slow_in_a_stand(self, round_: list[Passage]) -> None:
        rates = [np.mod(np.diff(passage.labels.phase), 2 * np.pi) * 60 for passage in round_]
        gaits = [passage.labels.gait[1:] for passage in round_]
        assert min(rate.min() for rate in rates) > 0 and max(rate.max() for rate in rates) < 10 * np.pi
        means = [
            np.concatenate([r[g == k] for r, g in zip(rates, gaits, strict=True)]).mean() for k in range(3)
        ]
        assert means[0] < 2.5 < 4 < means[1] < means[2]

    def test_gait_labels(self) -> None:
        moves = [Move(3), Move(4, 1.2), Move(4, 3.0, gait="run"), Move(4, 0.8, gait="crouch"), Move(4)]
        passage = perform(moves, name="all", style=Style(), rng=np.random.default_rng(0))
        at = [int(seconds * 60) for seconds in (1.5, 5.5, 9.5, 13.5, 18.0)]
        assert [GAITS[g] for g in passage.labels.gait[at]] == ["stand", "walk", "jog", "crouch", "stand"]


class TestAngles:
    """Ranges of the leg's joints as gait analysis publishes them (Winter 1991, Perry and Burnfield 2010;
    Novacheck 1998 for running), with a margin for the way they are measured."""

    def cycle(self, speed: float, gait: str) -> dict[str, Array]:
        passage, even = straight(speed, gait)
        angles = flexions(passage)
        times = strikes(passage, "left", even) * 60 + even.start
        grid = np.linspace(0, 1, 101)
        frames = np.arange(len(passage.clip))
        return {
            name: np.mean(
                [np.interp(a + grid * (b - a), frames, angle) for a, b in itertools.pairwise(times)], 0
            )
            for name, angle in angles.items()
        }

    def test_natural_walk(self) -> None:
        leg = self.cycle(1.33, "walk")
        assert 0 < leg["knee"][0] < 25 and 15 < leg["knee"][8:25].max() < 30
        assert 55 < leg["knee"].max() < 75 and 66 <= leg["knee"].argmax() <= 80
        assert leg["knee"][25:45].min() < leg["knee"][8:25].max() - 3  # it extends after the loading
        assert 22 < leg["hip"].max() < 42 and -25 < leg["hip"].min() < -8
        assert 45 <= leg["hip"].argmin() <= 66
        assert 8 < leg["ankle"][30:55].max() < 25 and -28 < leg["ankle"][55:72].min() < -8
        assert 56 <= leg["ankle"].argmin() <= 70

    def test_knees_swing_higher_when_walking_faster_and_higher_still_running(self) -> None:
        knees = [
            self.cycle(*how)["knee"].max()
            for how in ((0.6, "walk"), (1.8, "walk"), (2.5, "run"), (4.2, "run"))
        ]
        assert 45 < knees[0] < knees[1] < knees[2] < knees[3] < 125

    def test_run(self) -> None:
        leg = self.cycle(3.3, "run")
        assert 10 < leg["knee"][0] < 42 and 38 < leg["knee"][5:25].max() < 62
        assert 80 < leg["knee"].max() < 115
        assert 35 < leg["hip"].max() < 65 and leg["hip"].min() < -5
        assert leg["ankle"][10:30].max() > 15 and leg["ankle"].min() < -10

    def test_knees_bend_forward_and_never_snap(self, round_: list[Passage]) -> None:
        for passage in round_:
            at, turned = world(passage)
            for side in ("left", "right"):
                a, b, c = (at[:, FIGURE.role(f"{side}_{part}")] for part in ("up_leg", "leg", "foot"))
                hinge = quat.rotate(
                    turned[:, FIGURE.role(f"{side}_up_leg")], np.broadcast_to([1.0, 0, 0], b.shape)
                )
                bent = np.sum(np.cross(b - a, c - b) * hinge, axis=-1)
                assert bent.min() > 0
                rate = np.diff(np.arcsin(np.clip(bent / (figure.THIGH * figure.SHANK), 0, 1))) * 60
                assert np.abs(rate).max() < 30  # rad/s; sprinters' knees reach 20


class TestUpperBody:
    def test_pelvis_and_chest_turn_against_each_other_and_arms_against_legs(self) -> None:
        for gait, speed in (("walk", 1.3), ("run", 3.2)):
            passage, even = straight(speed, gait)
            at, turned = world(passage)
            pelvis, chest = (quat.yaw(turned[even, FIGURE.role(r)]) for r in ("hips", "chest"))
            assert np.corrcoef(pelvis, chest)[0, 1] < -0.7
            assert 3 < np.degrees(np.ptp(pelvis)) < 20 and 3 < np.degrees(np.ptp(chest)) < 25
            for side in ("left", "right"):
                hand, foot = (
                    at[even, FIGURE.role(f"{side}_{part}"), 2] - at[even, 0, 2] for part in ("hand", "foot")
                )
                assert np.corrcoef(hand, foot)[0, 1] < -0.6

    def test_the_head_is_level(self) -> None:
        for gait, speed in (("walk", 1.3), ("run", 3.5)):
            passage, even = straight(speed, gait)
            up = quat.rotate(
                world(passage)[1][even, FIGURE.role("head")], np.broadcast_to([0.0, 1, 0], (9 * 60, 3))
            )
            tilt = np.degrees(np.arccos(up[:, 1]))
            assert tilt.max() < 10 and np.ptp(tilt) < 6

    def test_the_body_rises_and_sways_as_published(self) -> None:
        for speed, rise, sway in ((0.7, 0.0274, 0.0699), (1.6, 0.0483, 0.0385)):  # Orendurff 2004
            passage, even = straight(speed, "walk")
            hips = world(passage)[0][even, 0]
            for measured, published in ((hips[:, 1], rise), (hips[:, 0], sway)):
                lows = np.sort(measured)
                assert 0.5 < (lows[-30:].mean() - lows[:30].mean()) / published < 1.7

    def test_nothing_is_stiff_in_a_stand(self) -> None:
        passage = perform([Move(20)], name="stand", style=Style(), rng=np.random.default_rng(1))
        at, _ = world(passage)
        for role, least, most in (("hips", 0.01, 0.25), ("head", 0.01, 0.3), ("left_hand", 0.01, 0.4)):
            assert least < np.linalg.norm(np.ptp(at[:, FIGURE.role(role)], axis=0)) < most
        assert passage.labels.contacts.all()


class TestCard:
    def test_has_no_holes_where_a_controller_asks(self, round_: list[Passage]) -> None:
        ahead, left, turning = (
            np.concatenate([getattr(p.path, what) for p in round_]) for what in ("ahead", "left", "turning")
        )
        speed, direction = np.hypot(ahead, left), np.degrees(np.arctan2(left, ahead))
        rate = np.abs(np.degrees(turning))
        calm = rate < 10
        for walked in np.arange(0.5, 4.6, 0.25):
            assert (calm & (np.abs(speed - walked) < 0.13) & (np.abs(direction) < 10)).sum() > 30, walked
        for heading in range(-180, 180, 45):
            near = np.abs((direction - heading + 180) % 360 - 180) < 12
            assert (near & (np.abs(speed - 0.8) < 0.25)).sum() > 60, heading
        for slow, turn in itertools.product((0.0, 0.8, 1.4), (30, 60, 90, 120)):
            assert ((np.abs(speed - slow) < 0.25) & (np.abs(rate - turn) < 15)).sum() > 20, (slow, turn)
        for fast, turn in itertools.product((2.5, 3.0, 3.5), (30, 60)):
            assert ((np.abs(speed - fast) < 0.3) & (np.abs(rate - turn) < 15)).sum() > 20, (fast, turn)
        assert ((speed < 0.3) & (rate > 170)).sum() > 30
        gaits = np.concatenate([p.labels.gait for p in round_])
        assert np.bincount(gaits, minlength=4).min() > 0.05 * len(gaits)

    def test_dances_both_hands_over_two_rounds(self) -> None:
        curves = [p for p in generate(1300.0) if p.name.startswith("walk-curves")]
        assert len(curves) >= 2
        first, second = (p.path.heading[(5 * 60)] for p in curves[:2])
        assert first * second < 0


class TestCurves:
    def test_hermite_meets_values_and_rates(self) -> None:
        times, values, rates = (
            np.array([0.0, 1.0, 3.0]),
            np.array([1.0, -2.0, 0.5]),
            np.array([0.3, 0.0, -1.0]),
        )
        e = 1e-6
        for t, v, r in zip(times, values, rates, strict=True):
            assert hermite(times, values, rates, np.array([t]))[0] == pytest.approx(v)
            inside = np.clip([t - e, t + e], 0, 3)
            a, b = hermite(times, values, rates, inside)
            assert (b - a) / (inside[1] - inside[0]) == pytest.approx(r, abs=1e-4)

    def test_travel_is_the_integral_of_its_speeds(self) -> None:
        speeds = ((0.0, 0.0), (0.3, 2.0), (0.6, 1.0), (1.0, 0.0))
        x = np.linspace(0, 1, 20001)
        way = travel(x, speeds)
        assert way[0] == 0 and way[-1] == pytest.approx(1)
        rate = np.gradient(way, x)
        whole = 0.3 + 0.45 + 0.2
        np.testing.assert_allclose(
            np.interp([0.15, 0.3, 0.45, 0.8], x, rate), np.array([1, 2, 1.5, 0.5]) / whole, atol=1e-3
        )


class TestCommand:
    def test_writes_clips_and_labels(self, tmp_path: Path) -> None:
        result = CliRunner().invoke(
            main, ["dancecard", "-o", str(tmp_path / "d"), "--minutes", "0.6", "--json"]
        )
        assert result.exit_code == 0, result.output
        rows = json.loads(result.stdout)
        assert sum(row["frames"] for row in rows) == 36 * 60
        passages = generate(36)
        for row, passage in zip(rows, passages, strict=True):
            clip = sources.load(row["file"])
            assert clip.fps == 60 and dict(clip.skeleton.roles) == dict(FIGURE.roles)
            at = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)[0]
            np.testing.assert_allclose(at, world(passage)[0], atol=2e-5)
            with Path(row["file"]).with_suffix(".labels.csv").open() as stream:
                lines = list(csv.DictReader(stream))
            found = [[int(line[name]) for name in CONTACTS] for line in lines]
            np.testing.assert_array_equal(found, passage.labels.contacts)
            assert [line["gait"] for line in lines] == [GAITS[g] for g in passage.labels.gait]
            np.testing.assert_allclose(
                [float(line["phase"]) for line in lines], passage.labels.phase, atol=1e-5
            )

    def test_tags_the_crouched_frames(self, tmp_path: Path) -> None:
        CliRunner().invoke(main, ["dancecard", "-o", str(tmp_path), "--minutes", "10"])
        with (tmp_path / "tags.csv").open() as stream:
            rows = list(csv.DictReader(stream))
        assert {row["tag"] for row in rows} == {"crouch"} and {"crouched"} <= {row["clips"] for row in rows}
        clip = sources.load(tmp_path / "crouched.bvh")
        tagged = np.zeros(len(clip), bool)
        for row in rows:
            if row["clips"] == "crouched":
                tagged[int(row["start"]) : int(row["stop"])] = True
        hips = clip.positions[:, 0, 1]
        assert hips[tagged].mean() < 0.8 < hips[~tagged].mean()

    def test_where_nobody_crouches_the_tags_are_a_header(self, tmp_path: Path) -> None:
        """Also over the tags of another dance; what builds a database takes them."""
        (tmp_path / "tags.csv").write_text("tag,clips,start,stop\ncrouch,gone,0,5\n")
        CliRunner().invoke(main, ["dancecard", "-o", str(tmp_path), "--minutes", "0.1"])
        assert (tmp_path / "tags.csv").read_text() == "tag,clips,start,stop\n"
        bare = tmp_path / "bare"
        CliRunner().invoke(main, ["dancecard", "-o", str(bare), "--minutes", "0.1", "--no-labels"])
        assert [path.name for path in bare.iterdir()] == ["walk-straight.bvh"]

    def test_the_folder_is_a_source_of_clips_only(self, tmp_path: Path) -> None:
        CliRunner().invoke(main, ["dancecard", "-o", str(tmp_path), "--minutes", "0.1"])
        assert [path.name for path in sources.find([tmp_path])] == ["walk-straight.bvh"]

    def test_other_clips_in_the_folder_are_not_mixed_with_new_ones(self, tmp_path: Path) -> None:
        for minutes, code in (("0.6", 0), ("0.6", 0), ("0.1", 2), ("0.7", 0)):
            result = CliRunner().invoke(main, ["dancecard", "-o", str(tmp_path), "--minutes", minutes])
            assert result.exit_code == code, result.output
            assert ("other clips, such as walk-curves.bvh" in result.stderr) == (code == 2)

    @pytest.mark.parametrize("arguments", [["--minutes", "0"], ["--minutes", "x"], ["--seed", "-1"], []])
    def test_bad_options(self, arguments: list[str], tmp_path: Path) -> None:
        out = ["-o", str(tmp_path / "d")] if arguments else []
        result = CliRunner().invoke(main, ["dancecard", *out, *arguments])
        assert result.exit_code == 2 and result.stderr.count("error:") == 1

    def test_a_file_in_the_folder_s_place(self, tmp_path: Path) -> None:
        (tmp_path / "d").write_text("")
        result = CliRunner().invoke(main, ["dancecard", "-o", str(tmp_path / "d")])
        assert result.exit_code == 2 and "not a folder" in result.stderr
        result = CliRunner().invoke(main, ["dancecard", "-o", str(tmp_path / ("d" * 300))])
        assert result.exit_code == 2 and result.stderr.endswith("check the path and its permissions\n")


def rms_jerk(at: Array, fps: float) -> float:
    return float(np.sqrt(np.mean(np.sum((np.diff(at, 3, axis=0) * fps**3) ** 2, axis=-1))))


def test_is_no_jerkier_than_captured_walks(data: Path) -> None:
    walks = [
        resample.resample(sources.load(data / f"cmu/asfamc/16/16_{n}.amc"), 60)
        for n in ("21", "22", "31", "32")
    ]
    passage, even = straight(1.3, "walk")
    made, _ = world(passage)
    for role in ("hips", "chest", "head", "left_hand", "right_hand", "left_foot", "right_foot", "left_toe"):
        captured = [
            rms_jerk(
                kinematics.forward(c.skeleton, c.positions, c.rotations)[0][10:, c.skeleton.role(role)], 60
            )
            for c in walks
        ]
        assert rms_jerk(made[even, FIGURE.role(role)], 60) < max(captured), role
