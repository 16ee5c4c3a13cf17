"""viewer.export: what is read back from files moves, and looks, as what was shown."""

from __future__ import annotations

from pathlib import Path

import lmm_models
import numpy as np
import pytest
from test_gltf_skins import arm, expected

from mm import courses
from mm.controller import Controller
from mm.recording import Recording, record
from motion import console, gltf, kinematics, sources
from motion.clip import Clip
from motion.errors import UserError
from viewer import cast, export, shows, skin
from viewer.cast import Member

START, STOP = 0.25, 0.5


@pytest.fixture(scope="module")
def crowd() -> Member:
    """Two characters who do not do the same."""
    data = lmm_models.database()
    run = record(
        Controller(data, count=2), courses.load("circle"), seconds=0.8, spread=True, progress=console.silent
    )
    return cast.of_run("crowd", run, data)


def world(clip: Clip, frame: int) -> tuple[np.ndarray, np.ndarray]:
    return kinematics.forward(clip.skeleton, clip.positions[frame], clip.rotations[frame])


def test_each_character_of_a_run_moves_as_it_was_shown(crowd: Member, tmp_path: Path) -> None:
    for form in (".bvh", ".glb"):
        paths = export.write([crowd], str(tmp_path / f"out{form}"), start=START, stop=STOP)
        assert [path.name for path in paths] == [f"out-crowd-1{form}", f"out-crowd-2{form}"]
        clips = [sources.load(path) for path in paths]
        for frame in (0, 7, 15):
            shown, _ = crowd.show.pose(START + frame / 60)
            for clip, places in zip(clips, shown, strict=True):
                assert len(clip) == 16 and clip.fps == pytest.approx(60)
                np.testing.assert_allclose(world(clip, frame)[0], places, atol=1e-4)


def test_a_body_that_is_read_back_looks_as_it_was_shown(crowd: Member, tmp_path: Path) -> None:
    path = export.write([crowd], str(tmp_path / "out.glb"), start=START, stop=STOP)[1]
    clip, worn = sources.load(path), gltf.skin(path)
    assert worn is not None
    positions, rotations = (array[1:] for array in crowd.show.pose(START + 9 / 60))
    transforms = crowd.show.body.transforms(positions, rotations)[0]
    shown = np.concatenate(
        [
            part.vertices @ t[:, :3].T + t[:, 3]
            for part, t in zip(crowd.show.body.parts, transforms, strict=True)
        ]
    )
    found = skin.mesh(worn, *world(clip, 9)).vertices
    assert len(found) == len(shown)
    for axis in range(3):  # they are sorted by their colours
        np.testing.assert_allclose(np.sort(found[:, axis]), np.sort(shown[:, axis]), atol=2e-4)


def test_a_run_that_is_read_back_is_shown_alike(crowd: Member, tmp_path: Path) -> None:
    assert crowd.run is not None
    (path,) = export.write([crowd], str(tmp_path / "out.rec"), start=START, stop=STOP)
    again = Recording.load(path)
    assert again.database == crowd.run.database and again.settings == crowd.run.settings
    for name, array in crowd.run.arrays.items():
        np.testing.assert_array_equal(again[name], array[15:31])
    np.testing.assert_array_equal(again.step_seconds, crowd.run.step_seconds[15:31])
    show = shows.load(path)
    for time in (0.0, 0.11):  # between frames, too
        for one, other in zip(show.pose(time), crowd.show.pose(START + time), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-5)


def test_a_mesh_of_a_file_is_written_as_it_was_worn(tmp_path: Path) -> None:
    path = arm().write(tmp_path / "arm.glb")
    member = cast.of_clip(shows.load(f"{path}#swing"))
    (out,) = export.write([member], str(tmp_path / "out.glb"))
    clip, worn = sources.load(out), gltf.skin(out)
    assert worn is not None
    found = skin.mesh(worn, *world(clip, 7)).vertices
    np.testing.assert_allclose(found, expected("swing", 7 / 30), atol=1e-5)


def test_who_is_called_alike_is_written_apart(walker: Clip, tmp_path: Path) -> None:
    members = [cast.of_clip(shows.of_clip(walker)) for _ in range(2)]
    paths = export.write(members, str(tmp_path / "out.bvh"), stop=0.1)
    assert len(set(paths)) == 2 and all(path.is_file() for path in paths)


def test_nothing_is_written_where_one_has_ended(crowd: Member, walker: Clip, tmp_path: Path) -> None:
    members = [cast.of_clip(shows.of_clip(walker)), crowd]
    with pytest.raises(UserError, match=r"nothing of crowd from 2 s on; it lasts 0\.8"):
        export.write(members, str(tmp_path / "out.bvh"), start=2.0)
    with pytest.raises(UserError, match="of which there is no run; export it as"):
        export.write(members[::-1], str(tmp_path / "out.rec"))
    assert list(tmp_path.iterdir()) == []
