"""viewer.layers, viewer.panel, viewer.cast: what is drawn about a driven character is what it recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import lmm_models
import numpy as np
import pfnn_models
import pytest

from features.terrain import Heightmap
from mm import courses
from mm.course import Course
from mm.database import Database
from motion import console, kinematics, quat
from motion.clip import Clip
from motion.errors import UserError
from viewer import camera, cast, layers, legend, offscreen, panel, shows, sources, views
from viewer.cast import Member
from viewer.layers import Moment, colours, features, ghost, placed
from viewer.scene import LIGHT, Arrows, Labels, Layer, Lines, Points, Solids
from viewer.stage import Stage
from viewer.views import View

TIME = 2.0


@pytest.fixture(scope="module")
def data() -> Database:
    return lmm_models.database()


@pytest.fixture(scope="module")
def members(data: Database) -> dict[str, Member]:
    found = sources.Sources(databases={"walk": data}, models={"lmm": lmm_models.model(data)})
    return driven(found, courses.load("circle"))


def driven(found: sources.Sources, course: Course, **options: object) -> dict[str, Member]:
    made = cast.driven(found.parts(), course, seconds=3.0, progress=console.silent, **options)  # type: ignore[arg-type]
    return {member.name: member for member in made}


def draw(member: Member, name: str, time: float = TIME) -> dict[str, Layer]:
    return layers.drawn(Moment(member, time), [name])


def test_systems_are_driven_over_one_course(members: dict[str, Member]) -> None:
    assert list(members) == ["mm", "lmm"]
    mm, lmm = members.values()
    np.testing.assert_array_equal(mm.run["command_velocity"][0], lmm.run["command_velocity"][0])  # type: ignore[index]
    assert mm.show.seconds == lmm.show.seconds == pytest.approx(3.0)
    assert mm.run is not None and mm.run.course is not None and mm.run.course.name == "circle"


def test_settings_are_for_all_or_for_one(data: Database, tmp_path: Path) -> None:
    (tmp_path / "often.toml").write_text("search_interval = 0.05\n")
    found, file = sources.Sources(databases={"walk": data}), str(tmp_path / "often.toml")
    for settings in ({"": file}, {"mm": file}):
        member = driven(found, courses.load("circle"), settings=settings)["mm"]
        assert member.run is not None and member.run.settings["search_interval"] == 0.05
    (tmp_path / "often.toml").write_text("serach_interval = 0.05\n")
    with pytest.raises(UserError, match="serach_interval"):
        driven(found, courses.load("circle"), settings={"": file})


def test_what_is_asked_and_predicted_is_what_was_recorded(members: dict[str, Member]) -> None:
    member = members["mm"]
    found, record = draw(member, "trajectory"), member.timeline.record(120)
    asked = found["trajectory asked"]
    assert isinstance(asked, Arrows)
    np.testing.assert_allclose(asked.vectors[0, [0, 2]], record["command_velocity"], atol=1e-6)
    np.testing.assert_allclose(asked.origins[0, [0, 2]], record["positions"][0, [0, 2]], atol=1e-6)
    way, facings = found["trajectory way"], found["trajectory facings"]
    assert isinstance(way, Lines) and isinstance(facings, Arrows)
    np.testing.assert_allclose(way.points[1:, [0, 2]], record["trajectory"][:, :2], atol=1e-6)
    np.testing.assert_allclose(way.points[0, [0, 2]], record["simulation_position"], atol=1e-6)
    turned = np.arctan2(facings.vectors[:, 0], facings.vectors[:, 2])
    np.testing.assert_allclose(np.cos(turned - record["trajectory"][:, 2]), 1, atol=1e-5)


def test_the_match_goes_where_its_clip_goes(members: dict[str, Member], data: Database) -> None:
    member = members["mm"]
    moment, frame = Moment(member, TIME), int(data.starts[1]) + 5
    row = moment.features(frame)
    assert row is not None
    points, facings = moment.way(row, moment.root)
    after = frame + np.append(0, np.round(data.schema.trajectory().times * data.fps)).astype(int)
    roots = data.poses.positions[:, 0].astype(np.float64)
    yaws = quat.yaw(data.poses.rotations[:, 0].astype(np.float64))
    turn = moment.root.yaw - yaws[frame]
    there = quat.rotate(quat.from_yaw(np.array(turn)), roots[after] - roots[frame])[:, [0, 2]]
    np.testing.assert_allclose(points, there + moment.root.position, atol=2e-3)
    turned = np.arctan2(facings[1:, 0], facings[1:, 1])
    np.testing.assert_allclose(np.cos(turned - yaws[after[1:]] - turn), 1, atol=1e-3)
    way, played = draw(member, "match")["match way"], int(moment.record["frame"])
    assert isinstance(way, Lines)
    expected, _ = moment.way(moment.features(played), moment.root)  # type: ignore[arg-type]
    np.testing.assert_allclose(way.points[:, [0, 2]], expected, atol=1e-5)
    assert draw(members["lmm"], "match") == {}  # what it plays is no frame


def test_features_are_joints(members: dict[str, Member]) -> None:
    """Where a jump has just been made, the frame's feet are where the database has them."""
    member = members["mm"]
    moment = Moment(member, TIME)
    assert moment.search is not None
    found = draw(member, "features")
    query, match = found["features query points"], found["features match points"]
    assert isinstance(query, Points) and isinstance(match, Points) and len(query.positions) == 3
    frame, data = int(moment.search[0]["frame"]), member.data
    assert isinstance(data, Database)
    poses = data.poses[slice(frame, frame + 1)]
    world, turned = kinematics.forward(data.skeleton, poses.positions, poses.rotations)
    feet = world[0, [data.skeleton.roles[f"{side}_foot"] for side in ("left", "right")]] - world[0, 0]
    turn = quat.from_yaw(np.array(moment.search[1].yaw) - quat.yaw(turned[:1, 0].astype(np.float64)))
    where = np.insert(moment.search[1].position, 1, 0.0)
    np.testing.assert_allclose(match.positions[:2], quat.rotate(turn, feet) + where, atol=2e-3)
    # Of the hips the schema has a velocity alone: it stands where they were.
    record, roles = moment.search[0], data.skeleton.roles
    then, _ = kinematics.forward(data.skeleton, record["positions"][None], record["rotations"][None])
    np.testing.assert_allclose(query.positions[2], then[0, roles["hips"]], atol=1e-5)
    around = data.poses[slice(frame - 1, frame + 2)]
    near, _ = kinematics.forward(data.skeleton, around.positions, around.rotations)
    joints = [roles["left_foot"], roles["right_foot"], roles["hips"]]
    moved = quat.rotate(turn, (near[2] - near[0])[joints].astype(np.float64)) * data.fps / 2
    arrows = found["features match velocities"]
    assert isinstance(arrows, Arrows)
    np.testing.assert_allclose(arrows.vectors / features.SECONDS, moved, atol=0.05)
    way = found["features match way"]
    assert isinstance(way, Lines)
    expected, _ = moment.way(moment.features(frame), moment.search[1])  # type: ignore[arg-type]
    np.testing.assert_allclose(way.points[:, [0, 2]], expected, atol=1e-5)


def test_contacts_are_at_the_toes(members: dict[str, Member], walker: Clip) -> None:
    member = members["mm"]
    record = member.timeline.record(120)
    found = draw(member, "contacts")
    touching, held = found["contacts touching"], found["contacts held"]
    assert isinstance(touching, Points) and isinstance(held, Points)
    assert (
        len(touching.positions) == record["contacts"].sum() and len(held.positions) == record["locked"].sum()
    )
    clip = cast.of_clip(shows.of_clip(walker))  # a clip's are told by its motion
    stands = [draw(clip, "contacts", time)["contacts touching"] for time in np.arange(0, 4, 0.1)]
    heights = np.concatenate([layer.positions[:, 1] for layer in stands if isinstance(layer, Points)])
    assert len(heights) > 20 and np.abs(heights).max() < 0.1


def test_candidates_are_the_explained_ones(members: dict[str, Member]) -> None:
    for member in members.values():
        explanation = member.explanation(TIME)
        assert explanation is not None
        found = draw(member, "candidates")
        ways = found["candidates ways"]
        assert isinstance(ways, Lines)
        assert len(ways.starts) == len([c for c in explanation.candidates if c.frame >= 0])
        last = ways.colours[ways.starts[-1]]  # the cheapest one is drawn last, and is green
        np.testing.assert_allclose(last, colours.graded(0.0), atol=1e-6)
        boxes = draw(member, "boxes")["boxes small"]
        assert isinstance(boxes, Lines) and np.isfinite(boxes.points).all()


def test_layers_move_as_a_whole() -> None:
    turn, move = quat.from_yaw(np.array(np.pi / 2)), np.array([1.0, 0, 0])
    ahead = np.array([[0, 0, 2.0]])
    for layer, name in ((Lines(points=ahead), "points"), (Points(positions=ahead), "positions"),
                        (Labels(texts=["a"], positions=ahead), "positions")):  # fmt: skip
        np.testing.assert_allclose(getattr(placed(layer, turn, move), name), [[3, 0, 0]], atol=1e-6)
    arrow = placed(Arrows(origins=ahead, vectors=ahead), turn, move)
    np.testing.assert_allclose(arrow.vectors, [[2, 0, 0]], atol=1e-6)
    solid = placed(Solids(parts=[], transforms=np.zeros((1, 0, 3, 4))), turn, move)
    assert solid.transforms.shape == (1, 0, 3, 4)


def test_a_stage_shows_them_where_the_character_stands(members: dict[str, Member]) -> None:
    both = list(members.values())
    marks = [offscreen.marks_of(member, ["trajectory", "contacts"]) for member in both]
    stage = Stage([member.show for member in both], marks=marks)
    stage.move_to(TIME)
    for i in range(2):
        asked = stage.scene.layers[f"{i} trajectory asked"]
        assert isinstance(asked, Arrows)
        np.testing.assert_allclose(asked.origins[0, [0, 2]], stage.roots[i, [0, 2]], atol=1e-4)
    kept = stage.scene.layers["0 trajectory asked"]
    stage.move_to(0.5)
    assert stage.scene.layers["0 trajectory asked"] is kept and kept.revision > 0


def test_a_ghost_stands_at_the_same_root(members: dict[str, Member]) -> None:
    one, other = (Moment(member, TIME) for member in members.values())
    same = ghost.over(one, one)
    lines, mean = same["distances"], same["mean"]
    assert isinstance(lines, Lines) and len(lines.points) == 0
    assert isinstance(mean, Labels) and "0.0 cm apart" in mean.texts[0]
    found = ghost.over(one, other)
    body, joints = found["body"], found["joints"]
    assert isinstance(body, Solids) and body.opacity < 1 and isinstance(joints, Points)
    middle = body.transforms[0, :, :, 3].mean(axis=0)
    assert np.linalg.norm(middle[[0, 2]] - one.root.position) < 0.3
    distances = found["distances"]
    assert isinstance(distances, Lines)
    apart = np.linalg.norm(distances.points[::2] - distances.points[1::2], axis=-1)
    assert (apart > ghost.WORTH).all() and apart.max() < 1


def test_the_ground_is_laid_and_its_samples_lie_on_it() -> None:
    ground = Heightmap(np.linspace(0, 2, 200)[:, None] * np.ones((1, 200)), spacing=0.2)
    found = sources.Sources(models={"pfnn": pfnn_models.model()})
    member = driven(found, courses.load("circle"), ground=ground)["pfnn"]
    spots = draw(member, "samples")["samples ground"]
    assert isinstance(spots, Points) and len(spots.positions) == 36
    x, y, z = spots.positions.T
    np.testing.assert_allclose(y, ground(x, z) + 0.015, atol=1e-3)
    stage = offscreen.stages([member], offscreen.Look())[0]
    surface = stage.scene.layers["0 ground"].mesh  # type: ignore[attr-defined]
    assert stage.scene.ground is None
    np.testing.assert_allclose(surface.vertices[:, 1], ground(*surface.vertices[:, [0, 2]].T), atol=1e-3)
    assert (surface.normals[:, 1] > 0.9).all()
    stage.move_to(TIME)  # the camera goes up and down with who walks
    assert stage.middle[1] == pytest.approx(float(ground(*stage.roots[0, [0, 2]])), abs=0.02)
    told = panel.Gauge(member).at(TIME)
    assert told.phase is not None and "skate" not in [row.name for row in told.rows]
    assert sum(bar.share for bar in told.bars) == pytest.approx(1, abs=0.1)


def test_the_camera_stands_farther_for_what_is_drawn(members: dict[str, Member]) -> None:
    member, far = members["mm"], []
    for shown in ([], ["trajectory"]):
        stage = offscreen.stages([member], offscreen.Look(shown=shown))[0]
        view, size = View(azimuth=np.pi / 2), (105, 120)
        far.append(views.first_camera(stage, [TIME], size, view, marked=True).distance)
        eye = views.first_camera(stage, [TIME], size, view, marked=True)
    assert far[0] < far[1] <= 1.16 * far[0]
    way = stage.scene.layers["0 trajectory way"]
    assert isinstance(way, Lines)
    x, y = camera.project(eye, way.points, *size)[0].T
    assert x.min() > 0 and x.max() < 105 and y.max() < 120


def test_panels_hide_nobody(members: dict[str, Member]) -> None:
    """The highest thing of a side's colour is below all panels."""
    both = list(members.values())
    look = offscreen.Look(shown=["panel", "costs"], apart=True)
    (image,) = offscreen.filmed(both, look, [TIME], (320, 180), View())
    hue = np.ptp(image.astype(int), axis=-1) * (np.abs(image[..., 0].astype(int) - image[..., 2]) > 50)
    high = round(
        180 * panel.share([panel.Gauge(m, look.shown) for m in both], [TIME], (320, 180), apart=True)
    )
    assert 0.3 * 180 < high < 0.5 * 180
    assert (hue[high:] > 60).sum() > 200
    assert panel.covers(2, (1280, 720), apart=True, bodies=2) and panel.covers(
        4, (1280, 720), apart=False, bodies=4
    )
    assert not panel.covers(1, (1280, 720), apart=False, bodies=1) and not panel.covers(
        0, (8, 8), apart=True, bodies=1
    )


def test_a_legend_says_what_colours_mean_and_when_it_is() -> None:
    keys = legend.of(["trajectory", "features", "trajectory", "panel"])
    assert [key.words for key in keys] == ["asked", "predicted", "query", "what answered it"]
    for name in layers.DRAWN:
        assert name in legend.KEYS
    blank = [np.full((360, 640, 3), 250, np.uint8) for _ in range(2)]
    one, other = legend.on(blank, [1.0, 2.5], keys, LIGHT)
    shade = np.round(255 * colours.ASKED).astype(int)
    assert (np.abs(one[-30:, :60].astype(int) - shade).sum(axis=-1) < 9).sum() > 10
    assert np.array_equal(one[:, :400], other[:, :400]) and not np.array_equal(one[:, 560:], other[:, 560:])
    (narrow,) = legend.on([np.full((360, 120, 3), 250, np.uint8)], [1.0], keys, LIGHT)
    assert narrow.shape == (360, 120, 3)
    cells = [np.full((200, 300, 3), 250, np.uint8) for _ in range(3)]
    plain, keyed = (offscreen.joined(cells, offscreen.Look(shown=shown)) for shown in ([], ["contacts"]))
    assert plain.shape == keyed.shape == (200, 900, 3)
    changed = (plain != keyed).any(axis=-1)
    assert changed[:40, :300].any() and not changed[40:].any()


def test_a_panel_of_a_crowd_says_of_whom_it_is(members: dict[str, Member]) -> None:
    run = members["mm"].run
    assert run is not None
    arrays = {name: np.repeat(array, 3, axis=1) for name, array in run.arrays.items()}
    crowd = cast.of_run("crowd", replace(run, arrays=arrays))
    assert panel.Gauge(crowd).at(TIME).name == "crowd, the first of 3"


def test_a_panel_tells_what_was_recorded(members: dict[str, Member]) -> None:
    member = members["mm"]
    told = panel.Gauge(member, ("panel", "costs")).at(TIME)
    record = member.timeline.record(120)
    values = {row.name: row.value for row in told.rows}
    assert values["cost"] == f"{record['feature_costs'].sum():.2f}"
    assert values["speed"].endswith(f" of {np.linalg.norm(record['command_velocity']):.2f} m/s")
    assert told.bars[0].value == f"{record['feature_costs'].max():.2f}"
    assert told.name == "mm"
    stamp = panel.drawn(told, LIGHT)
    assert stamp.dtype == np.uint8 and stamp.shape[1:] == (268, 4)
    assert stamp[..., :3].min() < 60 < 200 < stamp[..., :3].max()  # letters on a light ground
    pictures = [np.full((360, 640, 3), 128, np.uint8)]
    changed = next(panel.on(pictures, [TIME], [panel.Gauge(m) for m in members.values()], LIGHT, apart=True))
    for left in (0, 320):  # each in its own half
        assert (changed[:80, left : left + 150] != 128).any()
    assert (changed[200:] == 128).all()


def test_grades_go_from_green_to_red() -> None:
    low, high, beyond = colours.graded([0.0, 1.0, 7.0])
    assert low[1] > low[0] and high[0] > high[1]
    np.testing.assert_array_equal(high, beyond)
    np.testing.assert_array_equal(colours.graded(np.nan), high)


def test_what_is_of_a_search_is_made_once_for_it(members: dict[str, Member]) -> None:
    member = members["mm"]
    drawing, names = layers.Drawing(["match", *layers.OF_SEARCH]), set[str]()
    searched, before = member.timeline.stack("searched"), dict[str, Layer]()
    for step in range(100, 130):
        moment = Moment(member, step / member.timeline.fps)
        found = drawing.at(moment)
        expected = layers.drawn(moment, ["match", *layers.OF_SEARCH])
        assert found.keys() == expected.keys()
        for name, layer in found.items():
            standing = name.split()[0] in layers.OF_SEARCH
            assert (layer is before.get(name)) == (standing and step > 100 and not searched[step])
            if isinstance(layer, Lines | Points):
                here = "points" if isinstance(layer, Lines) else "positions"
                np.testing.assert_array_equal(getattr(layer, here), getattr(expected[name], here))
        names, before = names | found.keys(), found
    assert {name.split()[0] for name in names} == {"match", *layers.OF_SEARCH}
    assert 1 < searched[101:130].sum() < 28


def test_what_stands_is_moved_with_its_stage_and_hidden_where_it_is_not(members: dict[str, Member]) -> None:
    """Going back to before the first search and on again shows what was shown."""
    both = list(members.values())
    marks = [offscreen.marks_of(member, ["features"]) for member in both]
    stage = Stage([member.show for member in both], marks=marks)
    stage.move_to(TIME)
    name = "0 features query points"
    points = stage.scene.layers[name]
    assert isinstance(points, Points)
    there = points.positions.copy()
    stage.move_to(TIME + 1e-3)
    np.testing.assert_array_equal(points.positions, there)
    stage.move_to(TIME - 1.0)
    assert np.abs(points.positions - there).max() > 0.05
    stage.move_to(TIME)
    assert points.visible
    np.testing.assert_array_equal(points.positions, there)
