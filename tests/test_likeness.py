"""Motion beside motion: a walker whose gait is known, angles set by hand, and real walks."""

from __future__ import annotations

import json

import numpy as np
import page_html
import pandas as pd
import pytest
import synthetic
from click.testing import CliRunner

from bench.cli import main
from bench.likeness import compare, measures, moves, page, pictures
from bench.likeness.body import Body
from bench.likeness.measures import Gauge
from bench.likeness.moves import Passage
from motion import bvh, quat
from motion.clip import Clip
from motion.errors import UserError


def walk(**options) -> Clip:
    return synthetic.walk(**({"seconds": 6.0} | options))


def numbers(clip: Clip, move: str) -> pd.DataFrame:
    """Measures of all passages of a move in a clip."""
    side = compare.Side("one")
    side.add(Body.of(clip))
    side.measure()
    assert move in side.passages, f"{move} is not among {sorted(side.passages)}"
    return side.numbers[move]


def still(seconds: float = 3.0, **turns: np.ndarray) -> Clip:
    """The synthetic humanoid that stands, joints turned as asked."""
    rig = synthetic.skeleton()
    count = round(60 * seconds)
    rotations = quat.identity(count, len(rig))
    for name, turn in turns.items():
        rotations[:, rig.index(name)] = turn
    return Clip("still", rig, 60.0, np.tile(rig.offsets, (count, 1, 1)), rotations)


def about(axis: str, degrees: float) -> np.ndarray:
    return quat.from_axis_angle(np.eye(3)["xyz".index(axis)], np.radians(degrees))


# --- what a clip is cut into


@pytest.mark.parametrize(
    ("options", "move"),
    [
        ({"speed": 1.2}, "walk 1.25"),
        ({"speed": 0.75}, "walk 0.75"),
        ({"speed": 3.0, "gait": "run"}, "run 3"),
        ({"speed": 3.6, "gait": "run"}, "run 3.5"),
        ({"speed": 1.2, "turn": 1.0}, "walk-turn 60"),
        ({"speed": 1.2, "turn": -0.5}, "walk-turn 30"),
        ({"speed": 3.0, "gait": "run", "turn": 0.6}, "run-turn 30"),
        ({"speed": -0.9}, "backward"),
        ({"speed": -2.0, "gait": "run"}, "backward-run"),
        ({"speed": 0.0, "gait": "stand"}, "stand"),
    ],
)
def test_a_known_walk_has_its_name_and_no_other(options, move):
    found = moves.passages(Body.of(walk(**options)))
    assert {p.move for p in found} == {move}
    assert len(found) >= 2


def test_who_hops_slowly_neither_walks_nor_runs(monkeypatch):
    monkeypatch.setitem(synthetic.GAITS, "run", (0.7, 0.15))  # seven tenths of the time in the air
    assert moves.passages(Body.of(walk(speed=1.0, gait="run"))) == []


def test_strikes_come_when_the_clock_plants_a_foot():
    clip = walk(speed=1.2)
    body = Body.of(clip)
    # The left foot lands whenever the clock of one second strikes, the right one half a second later.
    for side, shift in (("left", 0.0), ("right", 0.5)):
        found = moves.strikes(body, side) / 60
        assert len(found) >= 4
        assert np.abs((found - shift + 0.5) % 1 - 0.5).max() < 0.05


def test_a_start_leads_from_rest_to_a_walk_and_a_stop_back():
    standing, walking = walk(gait="stand", speed=0.0, seconds=2.0), walk(speed=1.2, seconds=4.0)
    back = walking.positions.copy()
    back[:, 0] -= walking.positions[-1, 0] * [1, 0, 1]
    for name, first, second in (
        ("start", standing, walking),
        ("stop", walking.replace(positions=back), standing),
    ):
        both = [
            np.concatenate([getattr(c, what) for c in (first, second)]) for what in ("positions", "rotations")
        ]
        found = moves.passages(Body.of(walking.replace(positions=both[0], rotations=both[1])))
        changes = [p for p in found if p.move in ("start", "stop")]
        assert [p.move for p in changes] == [name]
        assert changes[0].start < 60 * first.seconds < changes[0].stop
        assert changes[0].speed == pytest.approx(1.2, abs=0.1)


def test_a_turn_on_the_spot_is_found_with_its_side_and_rate():
    clip = still(4.0)
    time = np.arange(len(clip)) / 60
    rotations = clip.rotations.copy()
    rotations[:, 0] = quat.from_yaw(np.radians(-90) * np.clip(time - 1, 0, 2))
    found = [p for p in moves.passages(Body.of(clip.replace(rotations=rotations))) if p.move == "turn"]
    assert len(found) == 1
    assert found[0].turn == pytest.approx(-90, abs=12)
    assert found[0].seconds == pytest.approx(2, abs=0.5)


def test_a_walk_on_bent_legs_is_a_crouch():
    clip = walk(speed=0.8)
    low = clip.positions.copy()
    low[:, 0, 1] -= 0.2
    rig, rotations = clip.skeleton, clip.rotations.copy()
    for side in ("Left", "Right"):  # legs fold about as much as the hips sink
        for part, degrees in (("UpLeg", -35), ("Leg", 70), ("Foot", -35)):
            joint = rig.index(side + part)
            rotations[:, joint] = quat.mul(rotations[:, joint], about("x", degrees))
    found = moves.passages(Body.of(clip.replace(positions=low, rotations=rotations)))
    assert {p.move for p in found} == {"crouch"}


def test_runs_are_stretches_of_true():
    assert moves.runs(np.array([1, 1, 0, 1, 0, 0, 1], bool)) == [(0, 2), (3, 4), (6, 7)]
    assert moves.runs(np.zeros(3, bool)) == []


def test_moves_are_ordered_as_a_reader_expects():
    names = ["backward", "run 2", "walk 1.25", "stand", "walk 0.75", "walk-turn 60", "walk-turn 120"]
    assert sorted(names, key=moves.order) == [
        *("stand", "walk 0.75", "walk 1.25", "run 2", "walk-turn 60", "walk-turn 120", "backward")
    ]


# --- numbers


def test_angles_are_those_that_were_set():
    clip = still(
        LeftUpLeg=about("x", -30),
        LeftLeg=about("x", 40),
        LeftArm=about("x", -20),
        LeftForeArm=about("x", -50),
        Spine=about("x", 12),
        RightUpLeg=about("z", -15),
    )
    body = Body.of(clip)
    passage = Passage("stand", body, 10, 100, 0.0, 0.0, 0.0)
    found = measures.curves(Gauge.of(body), passage)
    # The spine bends over a joint 8 cm above the hips: less of the line from hips to neck leans.
    neck = np.array([0.24 + 0.22, 0.01])
    line = [0.08 + neck[0] * np.cos(np.radians(12)) - neck[1] * np.sin(np.radians(12))]
    line.append(-0.01 + neck[0] * np.sin(np.radians(12)) + neck[1] * np.cos(np.radians(12)))
    expected = {
        "hip": 30,
        "knee": 40,
        "shoulder": 20 - 12,
        "elbow": 50,
        "trunk_lean": np.degrees(np.arctan2(line[1], line[0])),
        "hip_abduction": 0,
        "pelvis_obliquity": 0,
    }
    for name, degrees in expected.items():
        assert found[name] == pytest.approx(degrees, abs=0.01), name
    right = measures.curves(Gauge.of(body), Passage("stand", body, 10, 100, 0.0, 0.0, 0.0, "right"))
    assert right["hip_abduction"] == pytest.approx(15, abs=0.01)
    assert right["knee"] == pytest.approx(0, abs=0.01)


def test_the_walker_has_the_gait_that_it_was_given():
    found = numbers(walk(speed=1.2), "walk 1.25").median()
    leg = synthetic.THIGH + synthetic.SHIN + synthetic.ANKLE
    expected = {
        "speed": (1.2, 0.01),
        "turn": (0, 0.5),
        "cadence": (120, 2),
        "stride": (1.2, 0.02),
        "duty": (60, 5),
        "double support": (20, 8),
        "flight": (0, 0.1),
        "step width": (100 * 2 * synthetic.SIDE / leg, 0.5),
        "pelvis_rotation range": (np.degrees(2 * 0.06), 0.2),
        "pelvis_height range": (100 * 0.03 / leg, 0.1),
        "pelvis_side range": (0, 0.1),
        "shoulder range": (np.degrees(0.8), 3),
        "planted toe moves": (0, 0.01),
        "foot below its rest": (0, 0.1),
        "toe out": (0, 1),
    }
    for name, (value, error) in expected.items():
        assert found[name] == pytest.approx(value, abs=error), name


def test_a_runner_flies():
    found = numbers(walk(speed=3.0, gait="run"), "run 3").median()
    assert found["cadence"] == pytest.approx(120 / 0.7, rel=0.03)
    # The clock says 40 and 30 per cent; but feet that ease into a landing are low and slow before it.
    assert 20 < found["flight"] <= 40
    assert 30 <= found["duty"] < 40
    assert found["double support"] == 0


def test_turning_is_not_taken_for_rotation_or_sway():
    found = numbers(walk(speed=1.2, turn=1.0), "walk-turn 60").median()
    assert found["turn"] == pytest.approx(np.degrees(1.0), rel=0.03)
    assert found["pelvis_rotation range"] == pytest.approx(np.degrees(0.12), abs=0.5)
    assert found["pelvis_side range"] < 1


def test_rates_units_and_sizes_do_not_matter():
    plain = numbers(walk(speed=1.2), "walk 1.25").median()
    fast = numbers(walk(speed=1.2, fps=120.0), "walk 1.25").median()
    names = ("cadence", "knee range", "hip range", "pelvis_height range", "step width", "ankle 4-8 Hz")
    for name in names:
        assert fast[name] == pytest.approx(plain[name], rel=0.03, abs=0.1), name
    # A giant of 1.3 times the size at 1.3 times the speed has the same angles and shares of the leg.
    clip = walk(speed=1.2)
    rig = clip.skeleton
    rig = type(rig)(rig.names, rig.parents, 1.3 * rig.offsets, rig.roles)
    giant = numbers(clip.replace(skeleton=rig, positions=1.3 * clip.positions), "walk 1.5").median()
    for name in ("knee range", "step width", "pelvis_height range", "cadence"):
        assert giant[name] == pytest.approx(plain[name], rel=0.03), name
    assert giant["stride"] == pytest.approx(1.3 * plain["stride"], rel=0.01)


def test_a_file_of_30_frames_a_second_says_nothing_about_15_hertz():
    found = numbers(walk(speed=1.2, fps=30.0), "walk 1.25")
    assert "knee 8-15 Hz" in found and "knee 15-30 Hz" not in found


def test_feet_that_slide_are_told_by_how_much():
    clip = walk(speed=1.2)
    slid = clip.positions.copy()
    slid[:, 0, 0] += 0.06 * np.arange(len(clip)) / 60
    found = numbers(clip.replace(positions=slid), "walk 1.25").median()
    assert found["planted toe moves"] == pytest.approx(1.0, abs=0.02)  # 6 cm a second is 1 mm a frame
    sunk = clip.positions.copy()
    sunk[:, 0, 1] -= 0.05
    assert numbers(clip.replace(positions=sunk), "walk 1.25")["foot below y = 0"].median() > 2


def test_a_toe_that_never_bends_was_not_captured():
    clip = walk(speed=1.2)
    assert "toe range" in numbers(clip, "walk 1.25")
    stiff = clip.rotations.copy()
    for side in ("Left", "Right"):
        stiff[:, clip.skeleton.index(f"{side}Toe")] = [1, 0, 0, 0]
    found = numbers(clip.replace(rotations=stiff), "walk 1.25")
    assert "toe range" not in found and "ankle range" in found


def test_bands_hold_the_sinusoid_that_was_put_in_and_sum_to_the_signal():
    time = np.arange(400) / 60
    slow, quick = 2 * np.sin(2 * np.pi * 3 * time), 0.5 * np.cos(2 * np.pi * 10 * time)
    bands = measures.split((slow + quick)[:, None], 60.0, measures.BANDS)[..., 0]
    rms = np.sqrt((bands[:, 60:-60] ** 2).mean(axis=1))
    by_band = dict(zip(measures.BANDS, rms, strict=False))
    assert by_band[2] == pytest.approx(2 / np.sqrt(2), rel=0.02)
    assert by_band[8] == pytest.approx(0.5 / np.sqrt(2), rel=0.02)
    for low in (0, 1, 4, 15):
        assert by_band[low] < 0.1
    np.testing.assert_allclose(bands.sum(axis=0), slow + quick, atol=1e-9)


def test_jerk_is_that_of_a_known_wave():
    clip = still(4.0)
    positions = clip.positions.copy()
    time = np.arange(len(clip)) / 60
    positions[:, 0, 1] += 0.01 * np.sin(2 * np.pi * 3 * time)
    body = Body.of(clip.replace(positions=positions))
    found = measures.measure(Gauge.of(body), Passage("stand", body, 60, 180, 0.0, 0.0, 0.0))
    assert found["head jerk"][0] == pytest.approx(0.01 * (6 * np.pi) ** 3 / np.sqrt(2), rel=0.03)
    assert found["head 2-4 Hz"][0] == pytest.approx(0.01 * 6 * np.pi / np.sqrt(2), rel=0.03)


def test_lag_is_positive_for_who_comes_later():
    cycle = np.linspace(0, 2 * np.pi, 71)
    late = measures._lag(3 + np.cos(cycle - np.radians(30)), np.cos(cycle))
    assert late == pytest.approx(30, abs=1e-6)


# --- beside each other


def test_judging_knows_inside_from_outside():
    spread = np.linspace(10, 20, 11)
    inside = compare.judge([14, 15, 16, np.nan], spread)
    assert inside["inside"] is True and inside["off"] == pytest.approx(0)
    assert (inside["b_low"], inside["b"], inside["b_high"]) == pytest.approx((11, 15, 19))
    outside = compare.judge([23.0], spread)
    assert outside["inside"] is False and outside["off"] == pytest.approx(2)
    assert compare.judge([7.0], spread)["off"] == pytest.approx(-2)
    assert compare.judge([7.0], spread, less=True)["inside"] is True
    assert compare.judge([23.0], spread, less=True)["inside"] is False
    assert compare.judge([19.5], spread, 5.0)["inside"] is True
    few = compare.judge([15.0], spread[:3])
    assert few["inside"] is None and np.isnan(few["off"])


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two folders of walks; in the second the arms swing wider and the knees do the same."""
    base = tmp_path_factory.mktemp("likeness")
    for name, share in (("plain", 1.0), ("wide", 1.8)):
        (base / name).mkdir()
        for i, speed in enumerate((1.2, 1.22, 1.28)):
            clip = walk(name=f"walk{i}", speed=speed)
            rig, rotations = clip.skeleton, clip.rotations.copy()
            for joint in (rig.index("LeftArm"), rig.index("RightArm")):
                rotations[:, joint] = quat.exp(share * quat.log(rotations[:, joint]))
            bvh.write(base / name / f"walk{i}.bvh", clip.replace(rotations=rotations))
    (base / "standing").mkdir()
    bvh.write(base / "standing" / "stand.bvh", walk(gait="stand", speed=0.0))
    return base


def test_a_source_lies_inside_of_itself(folders):
    found = compare.compare([folders / "plain"], [folders / "plain"])
    assert found.moves == ["walk 1.25"]
    assert found.table["inside"].all()
    assert found.table["off"].abs().max() < 1e-6
    assert found.worst(10).empty and found.by_measure() == []


def test_what_differs_is_found_and_nothing_else(folders):
    found = compare.compare([folders / "wide"], [folders / "plain"])
    table = found.table.set_index("measure")
    assert not table.loc["shoulder range", "inside"] and table.loc["shoulder range", "off"] > 5
    assert table.loc["shoulder range", "a"] == pytest.approx(1.8 * table.loc["shoulder range", "b"], rel=0.02)
    often = {row["measure"]: row for row in found.by_measure()}
    assert often["shoulder range"]["inside"] == 0 and often["shoulder range"]["moves"] == 1
    assert "knee range" not in often
    assert found.worst(3)["measure"].str.contains("shoulder|elbow|wrist").all()
    for name in ("knee range", "cadence", "hips 1-2 Hz", "duty", "head jerk"):
        assert table.loc[name, "inside"], name


def test_strips_show_both_at_the_same_shares_of_the_cycle(folders):
    found = compare.compare([folders / "wide"], [folders / "plain"])
    films = []
    for side in (found.a, found.b):
        passage = side.typical("walk 1.25")
        assert passage.side == "left" and passage.speed == pytest.approx(1.22, abs=0.03)
        like = found.a.typical("walk 1.25", side.passages["walk 1.25"][-1])
        assert like.speed == pytest.approx(side.passages["walk 1.25"][-1].speed, abs=0.01)
        (frames,), labels = pictures._instants([passage])
        assert labels[0] == "0 %" and labels[-1] == "100 %"
        films.append(pictures.Film.of(passage, frames))
    for film in films:
        left, right = film.feet
        assert film.poses[0, left, 2] - film.poses[0, right, 2] > 0.4  # the left foot strikes ahead
        assert film.low[0, 0] and film.low[-1, 0]
    # The same walk but for the arms: legs coincide.
    legs = [film.feet for film in films]
    seen = [film.poses[:, feet] - film.poses[:, :1] for film, feet in zip(films, legs, strict=True)]
    np.testing.assert_allclose(seen[0], seen[1], atol=0.02)
    figure = pictures.strip(found, "walk 1.25")
    assert len(figure.axes) == 6
    curves = pictures.cycle_curves(found.a, "walk 1.25")
    assert curves["knee"].shape == (len(found.a.passages["walk 1.25"]), measures.POINTS)


def test_tips_show_toes_and_leave_the_rest(folders):
    clip = walk()
    body = Body.of(clip)
    longer, points = pictures.with_tips(body.skeleton, body.positions[:3], body.rotations[:3])
    assert len(longer) == len(body.skeleton) + 2
    np.testing.assert_array_equal(points[:, : len(body.skeleton)], body.positions[:3])
    toe = body.skeleton.role("left_toe")
    tip = longer.names.index("LeftToe tip")
    np.testing.assert_allclose(np.linalg.norm(points[:, tip] - points[:, toe], axis=-1), 0.06)


# --- the command


def likeness(*arguments, code=0):
    result = CliRunner().invoke(main, ["likeness", *map(str, arguments)])
    assert result.exit_code == code, result.output + result.stderr
    return result


def test_the_command_writes_pictures_tables_and_a_page(folders, tmp_path):
    out = tmp_path / "out"
    shown = likeness(folders / "wide", folders / "plain", "-o", out).stdout
    assert "walk 1.25" in shown and "shoulder range" in shown
    assert page_html.files(out) == {
        *("strip-walk-1.25.png", "curves-walk-1.25.png", "spectra-walk-1.25.png"),
        *("table.csv", "summary.csv", "index.html"),
    }
    for picture in out.glob("*.png"):
        assert picture.read_bytes().startswith(b"\x89PNG")
    text = (out / "index.html").read_text()
    assert all(f'src="{p.name}"' in text for p in out.glob("*.png"))
    table = pd.read_csv(out / "table.csv")
    assert set(table.columns) >= {"move", "measure", "unit", "a", "b", "b_low", "b_high", "inside", "off"}


def test_the_command_gives_json(folders):
    facts = json.loads(likeness(folders / "wide", folders / "plain", "--only", "walk", "--json").stdout)
    assert facts["a"]["clips"] == 3 and facts["summary"][0]["move"] == "walk 1.25"
    rows = {row["measure"]: row for row in facts["table"]}
    assert rows["shoulder range"]["inside"] is False


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("{base}/nothing", "{base}/plain"), "no such file or folder"),
        (("{base}/plain", "{base}/standing"), "the two have no move in common"),
        (("{base}/plain", "{base}/wide", "--only", "swim"), "no move 'swim'; the two have"),
        (("{base}/plain", "{base}/wide", "-o", "{base}/plain/walk0.bvh"), "cannot write: it is a file"),
        (("{base}/plain", "{base}/wide", "--exclude", "nobody"), "no clip to exclude is named like 'nobody'"),
        (("{base}/plain",), "Missing argument"),
    ],
)
def test_bad_input_is_one_clear_line(folders, arguments, expected):
    result = likeness(*(a.format(base=folders) for a in arguments), code=2)
    assert expected in result.stderr
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1


def test_clips_that_cannot_be_judged_are_left_out_with_a_note(folders, tmp_path):
    for name in ("plain", "short"):
        (tmp_path / name).mkdir()
    bvh.write(tmp_path / "plain" / "walk.bvh", walk())
    bvh.write(tmp_path / "plain" / "blink.bvh", walk(seconds=0.2))
    found = compare.compare([tmp_path / "plain"], [folders / "plain"])
    assert found.a.clips == 1 and "too short to judge" in found.notes[0]
    bvh.write(tmp_path / "short" / "blink.bvh", walk(seconds=0.2))
    with pytest.raises(UserError, match="no clip of 1 can be judged"):
        compare.compare([tmp_path / "short"], [folders / "plain"])


def test_cells_of_the_page_are_short():
    assert [page.number(v) for v in (None, float("nan"), True, False, 123.4, 12.34, 1.234, "walk")] == [
        *("–", "–", "yes", "no", "123", "12.3", "1.23", "walk")
    ]


# --- real walks


def test_real_walks_have_the_gait_of_people(data):
    found = compare._read([data / "cmu" / "asfamc" / "35"], (), [], None)
    found.measure()
    walks = pd.concat([table for move, table in found.numbers.items() if move.startswith("walk ")])
    assert len(walks) >= 8
    middle = walks.median()
    # Adults at a free pace (Perry and Burnfield 2010): 100 to 125 steps a minute, stance about 60 per cent,
    # knees to about 60 degrees in swing, hips through 40, pelvis up and down by 3 to 6 cm.
    assert 100 < middle["cadence"] < 125
    assert 56 < middle["duty"] < 65
    assert 50 < middle["knee range"] < 70
    assert 35 < middle["hip range"] < 52
    assert 2.5 < middle["pelvis_height range"] < 6
    assert middle["flight"] == 0
