"""Statistics against the manifest of the real clips, and against motion of known speed and turn."""

import csv

import numpy as np
import pytest
import synthetic

from motion import leadin, quat, sources, statistics

TOLERANCE = {  # half of the last digit printed, and rounding
    "frames": 0, "fps": 0.01, "seconds": 0.0051, "joints": 0, "unit_to_m": 1e-7, "mean_speed_mps": 0.0051,
    "p99_speed_mps": 0.0051, "path_m": 0.0051, "forward_share": 0.0051, "left_share": 0.0051,
    "net_turn_deg": 0.51,
}  # fmt: skip


@pytest.fixture(scope="module")
def rows(data):
    with open(data / "manifest.csv", newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_number_of_the_manifest(data, rows):
    assert len(rows) == 498
    wrong = []
    for row in rows:
        # Only these headers lie about their rate; the manifest says so.
        fps = 60.0 if "header Frame Time is wrong" in row["notes"] else None
        found = statistics.statistics(sources.load(data / row["file"], fps=fps))
        assert tuple(found) == statistics.COLUMNS
        for column, tolerance in TOLERANCE.items():
            ours, theirs = found[column], row[column]
            agree = (
                ours is None if theirs == "" else ours is not None and abs(ours - float(theirs)) <= tolerance
            )
            if not agree:
                wrong.append((row["file"], column, ours, theirs))
        if row["set"] != "cmu/known_bad" and "dog" not in row["set"]:
            assert 0.6 < found["hip_height_m"] < 1.3
    assert wrong == []


def test_known_motion():
    found = statistics.statistics(synthetic.walk(speed=1.2, seconds=5))
    assert found["mean_speed_mps"] == pytest.approx(1.2, rel=0.01)
    assert found["path_m"] == pytest.approx(1.2 * 299 / 60, rel=0.01)
    assert found["forward_share"] > 0.99 and abs(found["left_share"]) < 0.02
    assert found["hip_height_m"] == pytest.approx(synthetic.HIPS, abs=0.01)
    assert (found["frames"], found["joints"], found["seconds"]) == (300, 22, 5.0)


@pytest.mark.parametrize("turn", [0.8, -0.8])
def test_turns_to_the_left_are_positive(turn):
    found = statistics.statistics(synthetic.walk(turn=turn, seconds=10))
    assert found["net_turn_deg"] == pytest.approx(np.degrees(turn * 10), abs=8)


def test_walking_sideways():
    clip = synthetic.walk(speed=1.0, seconds=3)
    positions, rotations = clip.positions.copy(), clip.rotations.copy()
    rotations[:, 0] = quat.mul(quat.from_yaw(-np.pi / 2), rotations[:, 0])
    found = statistics.statistics(clip.replace(positions=positions, rotations=rotations))
    assert found["left_share"] > 0.99 and abs(found["forward_share"]) < 0.1


def test_short_clips_and_standing(walker):
    for frames in (1, 2):
        clip = walker.replace(positions=walker.positions[:frames], rotations=walker.rotations[:frames])
        found = statistics.statistics(clip)
        assert found["frames"] == frames and found["forward_share"] is None
        assert (found["mean_speed_mps"] is None) == (frames == 1)
    assert statistics.statistics(synthetic.walk(gait="stand", speed=0))["forward_share"] is None


def test_rest_frames_are_found_in_the_sets_that_have_them(data, rows):
    for row in rows:
        path = data / row["file"]
        has = path.suffix == ".bvh" and row["joints"] == "43"
        if not has and path.stem[-1] not in "16":  # a sample of the others
            continue
        resampled = "labelled" in row["set"]
        clip = sources.load(path, fps=60.0 if resampled else None)
        assert leadin.starts_at_rest(clip) == (has and not resampled)
        assert (leadin.lead_in(clip) > 0) == has
        if "daz" in row["set"]:
            rest = leadin.without_lead_in(clip)
            speed = quat.angle_between(rest.rotations[1:9, 1:], rest.rotations[:8, 1:]).max() * clip.fps
            assert speed < 25 and len(clip) - len(rest) <= 18


def test_an_inserted_rest_pose_is_cut_off(walker):
    rest = walker.rotations[:1].copy()
    rest[:, 1:] = quat.identity(1, 21)
    arm = walker.skeleton.index("LeftArm")
    raised = walker.rotations.copy()
    raised[:, arm] = quat.mul(quat.from_axis_angle([0.0, 0.0, 1.0], 1.5), raised[:, arm])
    clip = walker.replace(
        positions=np.concatenate([walker.positions[:1], walker.positions]),
        rotations=np.concatenate([rest, raised]),
    )
    assert leadin.lead_in(clip) == 1
    np.testing.assert_array_equal(leadin.without_lead_in(clip).rotations, raised)
    assert leadin.without_lead_in(walker) is walker
