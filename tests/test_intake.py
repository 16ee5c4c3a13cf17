"""What of files goes into a database: what is bad is cut where it is, and nothing is left out in silence."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import synthetic
from click.testing import CliRunner, Result

from mm.build import build
from mm.cli import main
from mm.database import Database
from mm.intake import Report
from motion import bvh, kinematics, sources
from motion.clip import Clip
from motion.errors import UserError


def _moved(clip: Clip, start: int, stop: int, offset: tuple[float, float, float]) -> Clip:
    positions = clip.positions.copy()
    positions[start:stop, 0] += offset
    return clip.replace(positions=positions)


@pytest.fixture(scope="module")
def walk() -> Clip:
    return synthetic.walk("walk", turn=synthetic.weave)


@pytest.fixture
def torn(walk: Clip, tmp_path: Path) -> Path:
    """A walk of 300 frames that goes on half a metre aside from frame 150 on, and a sound one."""
    bvh.write(tmp_path / "clips" / "torn.bvh", _moved(walk, 150, 300, (0.5, 0, 0)))
    bvh.write(tmp_path / "clips" / "sound.bvh", walk)
    return tmp_path / "clips"


def _mm(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def _world(db: Database, name: str) -> np.ndarray:
    r = db.names.index(name)
    poses = db.poses[db.starts[r] : db.stops[r]]
    return kinematics.forward(db.skeleton, poses.positions.astype(float), poses.rotations.astype(float))[0]


def test_a_jump_parts_a_clip_in_two(torn: Path, walk: Clip) -> None:
    notes: list[str] = []
    report = Report()
    db = build(torn, mirror=False, note=notes.append, report=report)
    assert db.names == ("sound", "torn@0-150", "torn@151-300")
    assert (db.stops - db.starts).tolist() == [300, 150, 149]
    assert len(notes) == 1
    assert notes[0].startswith(
        f"left out: {torn / 'torn.bvh'}: frame 150 of 300 (0.02 s): teleport: hips move"
    )
    expected = kinematics.forward(walk.skeleton, walk.positions, walk.rotations)[0]
    np.testing.assert_allclose(_world(db, "torn@0-150")[:, 1:], expected[:150], atol=2e-5)
    aside = expected[151:] + np.array([0.5, 0, 0])
    np.testing.assert_allclose(_world(db, "torn@151-300")[:, 1:], aside, atol=2e-5)
    (loss,) = report.losses
    assert (loss.kind, loss.start, loss.stop, loss.frames) == ("teleport", 150, 151, 300)
    assert report.summary() == {
        "files": 2,
        "files_left_out": 0,
        "files_cut": 1,
        "seconds": 10.0,
        "seconds_left_out": pytest.approx(1 / 60, abs=1e-3),
    }


def test_tags_count_the_frames_of_the_file(torn: Path, tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("tag,clips,start,stop\nacross,torn,140,160\nlast,torn,290,\nsecond,torn@151-300,,\n")
    db = build(torn, mirror=False, tags=tags)
    first, second = (slice(db.starts[r], db.stops[r]) for r in (1, 2))

    def at(tag: str, piece: slice) -> list[int]:
        return np.flatnonzero(db.tags[piece] & db.tag_mask([tag])).tolist()

    assert (at("across", first), at("across", second)) == (list(range(140, 150)), list(range(9)))
    assert (at("last", first), at("last", second)) == ([], list(range(139, 149)))
    assert (at("second", first), len(at("second", second))) == ([], 149)
    tags.write_text("tag,clips,start,stop\nacross,torn,140,301\n")
    with pytest.raises(UserError, match="frames 140 to 301 of clip 'torn', which has 300"):
        build(torn, tags=tags)
    assert build(torn, folder_tags=True).tags.all()


def test_unchecked_clips_stay_whole(torn: Path, tmp_path: Path) -> None:
    assert build(torn, mirror=False, check=False).names == ("sound", "torn")
    (tmp_path / "rules.toml").write_text('[[clips]]\nfiles = "torn"\ncheck = false\n')
    assert build(torn, mirror=False, clips=tmp_path / "rules.toml").names == ("sound", "torn")


def test_spans_too_short_for_a_search_are_left_out_and_told(walk: Clip, tmp_path: Path) -> None:
    """Half a second is 30 frames: of two jumps at 100 and 125 the part between them goes, too."""
    twice = _moved(_moved(walk, 100, 300, (0.5, 0, 0)), 125, 300, (0.5, 0, 0))
    bvh.write(tmp_path / "twice.bvh", twice)
    notes: list[str] = []
    db = build(tmp_path, mirror=False, note=notes.append)
    assert db.names == ("twice@0-100", "twice@126-300")
    assert [line.split(": ")[2:4] for line in notes] == [
        ["frame 100 of 300 (0.02 s)", "teleport"],
        ["frames 101-124 of 300 (0.40 s)", "short"],
        ["frame 125 of 300 (0.02 s)", "teleport"],
    ]


def test_a_wrong_rate_is_left_out_until_it_is_put_right(walk: Clip, tmp_path: Path) -> None:
    bvh.write(tmp_path / "clips" / "slow.bvh", walk.replace(fps=15))
    bvh.write(tmp_path / "clips" / "right.bvh", walk)
    notes: list[str] = []
    db = build(tmp_path / "clips", mirror=False, note=notes.append)
    assert db.names == ("right",)
    (line,) = notes
    assert "slow.bvh: all 300 frames (20.00 s): rate: slower than bodies move" in line
    assert "fps rather than 15?" in line and "--source-fps" in line and "clips.toml" in line
    (tmp_path / "clips" / "clips.toml").write_text('[[clips]]\nfiles = "slow"\nfps = 60\n')
    notes.clear()
    db = build(tmp_path / "clips", mirror=False, note=notes.append)
    assert db.names == ("right", "slow") and len(notes) == 1 and "has rules for 1 of 2" in notes[0]
    np.testing.assert_array_equal(db.poses.positions[:300], db.poses.positions[300:])
    with pytest.raises(UserError, match=r"no clip of 1 can be used; the first: .*slow.*fps rather than 15"):
        bvh.write(tmp_path / "slow.bvh", walk.replace(fps=15))
        build(tmp_path / "slow.bvh")


def test_values_that_are_no_numbers_are_cut_out(
    walk: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Readers refuse them in files; what comes from elsewhere may have them."""
    positions = walk.positions.copy()
    positions[100:110, 0, 1] = np.nan
    bvh.write(tmp_path / "holes.bvh", walk)
    holes = walk.replace(name="holes", positions=positions, source=tmp_path / "holes.bvh")
    monkeypatch.setattr(sources, "load", lambda *_, **__: holes)
    notes: list[str] = []
    db = build(tmp_path, mirror=False, note=notes.append)
    assert db.names == ("holes@0-100", "holes@110-300") and "frames 100-109 of 300" in notes[0]
    with pytest.raises(UserError, match=r"positions are not finite at frame 100, joint Hips.*--skip-bad"):
        build(tmp_path, check=False)


RULES: dict[str, tuple[str, Callable[[int], slice]]] = {
    "start": ("start = 60", lambda n: slice(60, n)),
    "stop": ("stop = 200", lambda n: slice(0, 200)),
    "both": ("start = 60\nstop = 200", lambda n: slice(60, 200)),
}


@pytest.mark.parametrize("case", RULES)
def test_trims_are_frames_as_read(walk: Clip, tmp_path: Path, case: str) -> None:
    text, kept = RULES[case]
    bvh.write(tmp_path / "walk.bvh", walk)
    (tmp_path / "clips.toml").write_text(f'[[clips]]\nfiles = "walk"\n{text}\n')
    (tmp_path / "tags.csv").write_text("tag,clips,start,stop\nmiddle,walk,100,110\n")
    db = build(tmp_path / "walk.bvh", clips=tmp_path / "clips.toml", mirror=False, tags=tmp_path / "tags.csv")
    expected = kinematics.forward(walk.skeleton, walk.positions, walk.rotations)[0][kept(300)]
    np.testing.assert_allclose(_world(db, "walk")[:, 1:], expected, atol=2e-5)
    assert np.flatnonzero(db.tags).tolist() == list(range(100 - (kept(300).start), 110 - kept(300).start))


def test_a_jump_outside_of_the_trim_does_not_matter(torn: Path) -> None:
    (torn / "clips.toml").write_text('[[clips]]\nfiles = "torn"\nstop = 150\n')
    report = Report()
    assert build(torn, mirror=False, report=report).names == ("sound", "torn") and not report.losses


def test_a_rest_pose_before_the_motion_is_kept_if_told(walk: Clip, tmp_path: Path) -> None:
    zero = np.zeros_like(walk.rotations[:1])
    zero[..., 0] = 1
    posed = walk.replace(
        positions=np.concatenate([walk.positions[:1], walk.positions]),
        rotations=np.concatenate([zero, walk.rotations]),
    )
    bvh.write(tmp_path / "posed.bvh", posed)
    rule = '[[clips]]\nfiles = "*"\nkeep_lead_in = {}\n'
    for keep, frames in (("true", 301), ("false", 300)):
        (tmp_path / "clips.toml").write_text(rule.format(keep))
        for check in (True, False):
            assert len(build(tmp_path, mirror=False, check=check)) == frames


def test_the_command_says_what_it_left_out(torn: Path, tmp_path: Path) -> None:
    (torn / "broken.bvh").write_text("nothing")
    out = tmp_path / "db"
    result = _mm("build", torn, "-o", out)
    assert result.exit_code == 2 and result.stderr.splitlines()[-1].startswith(f"error: {torn}/broken.bvh:1:")
    result = _mm("build", torn, "-o", out, "--skip-bad")
    assert result.exit_code == 0, result.output
    assert "3 clips, " in result.stdout
    assert result.stdout.endswith("; left out: 1 of 3 files and parts of 1, 0.0 of 10.0 s\n")
    facts = json.loads(_mm("build", torn, "-o", out, "--skip-bad", "--json").stdout)
    assert facts["clips"] == 3 and facts["read"]["files_left_out"] == 1
    by_kind = {loss["kind"]: loss for loss in facts["left_out"]}
    assert set(by_kind) == {"teleport", "unreadable"}
    assert (by_kind["teleport"]["start"], by_kind["teleport"]["stop"]) == (150, 151)
    assert [(f["kind"], f["path"]) for f in facts["findings"]] == [("teleport", str(torn / "torn.bvh"))]


def test_known_defects_are_cut_and_told(data: Path) -> None:
    notes: list[str] = []
    report = Report()
    db = build(data / "cmu" / "known_bad", roles_only=True, mirror=False, note=notes.append, report=report)
    assert {path.stem for path in report.gone} == {"07_12", "09_10"}
    assert {name.partition("@")[0] for name in db.names} == {"03_02"}
    assert np.linalg.norm(db.poses.velocities[:, 0], axis=-1).max() < 3
    told = "\n".join(notes)
    for clip in ("07_12.bvh: all", "09_10.bvh: all", "09_10.amc: all", "03_02.bvh: frame"):
        assert clip in told


def test_the_labelled_clips_need_their_rate(data: Path) -> None:
    folder = data / "cmu" / "labelled_60fps"
    with pytest.raises(UserError, match=r"no clip of 22 can be used.*60 fps rather than 15"):
        build(folder)
    report = Report()
    db = build(folder, source_fps=60, mirror=False, report=report)
    assert len(set(db.names)) == 22 and not report.gone
    assert 0.7 < np.median(np.linalg.norm(db.poses.velocities[:, 0], axis=-1)) < 1.8
