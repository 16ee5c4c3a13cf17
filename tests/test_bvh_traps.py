"""What surprises readers of BVH files, on the real ones; the truth shares no code with the reader."""

from __future__ import annotations

import ast
import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion import bvh, contacts, kinematics, quat, sources, units
from motion.clip import Clip


@pytest.fixture(scope="module")
def manifest(data: Path) -> dict[str, dict[str, str]]:
    with open(data / "manifest.csv", newline="") as stream:
        return {row["file"]: row for row in csv.DictReader(stream)}


def naive(path: Path, frames: int) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Joint names, some frame numbers, and world positions [frames, joints, 3] there, in the file's units.

    By recursion over the words of the file. A position channel replaces that coordinate of the offset, and
    rotations are applied in the order of the channels.
    """
    head, _, tail = path.read_text("latin-1").partition("MOTION")
    rows = [line for line in tail.splitlines() if line.strip()][2:]
    picked = np.unique(np.linspace(0, len(rows) - 1, frames).astype(int))
    table = np.array([rows[i].split() for i in picked], float)
    words, names, places, column = iter(head.split()), [], [], 0

    def joint(origin: np.ndarray, turn: Rotation) -> None:
        nonlocal column
        here, rotation = origin, turn
        for word in words:
            if word == "OFFSET":
                local = np.tile([float(next(words)) for _ in range(3)], (len(picked), 1))
                here = origin + turn.apply(local)
            elif word == "CHANNELS":
                for _ in range(int(next(words))):
                    channel = next(words)
                    if channel[1:] == "position":
                        local[:, "XYZ".index(channel[0])] = table[:, column]
                    else:
                        rotation = rotation * Rotation.from_euler(
                            channel[0], table[:, [column]], degrees=True
                        )
                    column += 1
                here = origin + turn.apply(local)
                places.append(here)
            elif word == "JOINT":
                names.append(next(words))
                joint(here, rotation)
            elif word == "End":
                for _ in range(7):  # Site { OFFSET x y z }
                    next(words)
            elif word == "}":
                return

    assert next(words) == "HIERARCHY" and next(words) == "ROOT"
    names.append(next(words))
    joint(np.zeros((len(picked), 3)), Rotation.identity(len(picked)))
    return names, picked, np.stack(places, 1)


def world(clip: Clip) -> np.ndarray:
    return kinematics.forward(clip.skeleton, clip.positions, clip.rotations)[0]


def test_every_file_stands_where_a_naive_reader_puts_it(data, manifest):
    files = [data / name for name in manifest if name.endswith(".bvh")]
    assert len(files) > 400
    for path in files:
        names, picked, expected = naive(path, 3)
        clip = bvh.read(path)
        assert list(clip.skeleton.names) == names, path
        assert len(clip) == picked[-1] + 1, path
        np.testing.assert_allclose(world(clip)[picked], expected, atol=1e-5, err_msg=str(path))


def test_position_channels_replace_stale_offsets(data, manifest):
    """Whoever adds the offset of Bandai's hips to their channels lifts or sinks the feet by metres."""
    moving = {"dash_normal_001", "run_normal_001", "walk-back_normal_001", "walk_normal_002"}
    names = [n for n in manifest if n.startswith("bandai/")]
    assert len(names) == 217
    for name in names:
        clip = sources.load(data / name)
        root, hips = (clip.skeleton.index(n) for n in ("joint_Root", "Hips"))
        assert hips == clip.skeleton.role("hips")
        feet = [clip.skeleton.role(f"{side}_foot") for side in ("left", "right")]
        sole = np.percentile(world(clip)[:, feet, 1].min(axis=1), 5)
        assert 0.0 < sole < 0.2, name  # an ankle's height above the ground
        travels = np.ptp(clip.positions[:, root], axis=0).max() > 0.1
        special = "dataset-1" in name and any(name.endswith(f"{stem}.bvh") for stem in moving)
        assert travels == special, name


def test_rotation_orders_differ_by_joint(data, manifest):
    for name in (n for n in manifest if "daz_bvh" in n):
        root, *others = bvh.parse(data / name).channels
        assert [c[0] for c in root[3:]] == list("ZYX")
        assert {tuple(c[0] for c in channels) for channels in others} == {tuple("ZXY")}


def test_a_header_that_says_a_quarter_of_the_rate(data, manifest):
    """As 60 frames a second these move as fast as the same captures in other files, at 15 a quarter of it."""
    pairs = 0
    for name in (n for n in manifest if "labelled_60fps" in n):
        stem = Path(name).stem.removesuffix("_60fps")
        original = data / f"cmu/asfamc/{stem.split('_')[0]}/{stem}.amc"
        if not original.is_file():
            continue
        pairs += 1
        as_written, clip, truth = (
            sources.load(data / name),
            sources.load(data / name, fps=60),
            sources.load(original),
        )
        assert (as_written.fps, clip.fps, truth.fps) == (15, 60, 120)
        assert clip.seconds == pytest.approx(truth.seconds, rel=0.05)
        speed, expected = (
            np.median(np.linalg.norm(np.diff(c.positions[:, c.skeleton.role("hips")], axis=0), axis=-1))
            * c.fps
            for c in (clip, truth)
        )
        assert speed == pytest.approx(expected, rel=0.12), name  # the retargeting shortened the paths
    assert pairs >= 8


def test_headers_that_count_one_frame_too_many(data, manifest):
    found = set()
    for name in (n for n in manifest if n.endswith(".bvh")):
        with open(data / name, encoding="latin-1") as stream:
            announced = next(int(line.split()[1]) for line in stream if line.startswith("Frames:"))
        read = len(bvh.parse(data / name).values)
        assert read == int(manifest[name]["frames"])
        if announced != read:
            assert announced == read + 1
            found.add(Path(name).stem)
    assert found == {f"{stem}_60fps" for stem in ("16_13", "16_19", "16_37", "35_01", "46_01")}


def test_labels_have_a_line_for_every_frame_read(data, manifest):
    for name in (n for n in manifest if n.startswith("pfnn/animations")):
        phase = (data / name).with_suffix(".phase")
        assert len(phase.read_text().split()) == len(bvh.parse(data / name).values)
    for name in (n for n in manifest if "labelled_60fps" in n):
        text = (data / name).with_name(f"{Path(name).stem}_contacts.txt").read_text()
        last = max(int(ast.literal_eval(line)[0]) for line in text.splitlines() if line.startswith("["))
        assert last <= len(bvh.parse(data / name).values) + 1  # some labels stand behind the last frame


def test_feet_without_toes_still_touch_the_ground(data, manifest):
    for name in [n for n in manifest if "daz_bvh" in n][::6]:
        clip = sources.load(data / name)
        roles = clip.skeleton.roles
        assert {"left_foot", "right_foot"} <= set(roles) and not {"left_toe", "right_toe"} & set(roles)
        touching = contacts.contact_roles(clip.skeleton, contacts.some_positions([clip]))
        assert touching == ("left_foot", "right_foot")
        joints, points = contacts.touching_points(clip.skeleton, touching)
        assert joints == [roles["left_foot"], roles["right_foot"]]
        places, turns = kinematics.forward(clip.skeleton, clip.positions, clip.rotations)
        tips = places[:, joints] + quat.rotate(turns[:, joints], points)
        lowest, ankles = np.percentile(tips[..., 1], 2), np.percentile(places[:, joints, 1], 2)
        assert 0 < lowest < ankles - 0.015 and 0.05 < ankles < 0.15, name


def test_units_by_the_height_of_the_hips(data, manifest):
    """Metres, centimetres and 2.54/45 metres a unit; dogs' hips are lower than people's."""
    seen = set()
    for name in (n for n in manifest if n.endswith(".bvh") and "known_bad" not in n):
        if Path(name).stem[-1] not in "14" and "pfnn" not in name:  # a sample
            continue
        clip = sources.load(data / name)
        assert clip.unit_to_m == pytest.approx(float(manifest[name]["unit_to_m"]), rel=1e-5)
        height = np.median(world(clip)[:, clip.skeleton.role("hips"), 1])
        low, high = (0.05, 0.6) if "dog" in name else (0.55, 1.9) if "original" in name else (0.6, 1.1)
        assert low < height < high, name
        seen.add(clip.unit_to_m)
    assert seen == {1.0, 0.01, units.UNITS["inch / 0.45"]}


def test_zero_rotations_need_not_be_a_t_pose(data, manifest):
    """LAFAN1's and the dog's bones all lie along +X in the file; roles and sides must not come from that."""
    for name in [n for n in manifest if "dog_mann" in n or "lafan1/loco" in n][::7]:
        document = bvh.parse(data / name)
        clip = sources.load(data / name)
        legs = [clip.skeleton.role(f"{s}_{p}") for s in ("left", "right") for p in ("leg", "foot")]
        across = np.abs(document.offsets[legs]) / np.linalg.norm(document.offsets[legs], axis=-1)[:, None]
        assert across[:, 0].min() > 0.99
        places = world(clip)
        hips, head = (places[:, clip.skeleton.role(role)] for role in ("hips", "head"))
        up_legs = [places[:, clip.skeleton.role(f"{s}_up_leg")] for s in ("left", "right")]
        left = up_legs[0] - up_legs[1]
        if "dog" in name:
            forward = head - hips
            forward[:, 1] = 0
            sides = np.sum(np.cross([0, 1, 0], forward) * left, axis=-1)  # up x forward is left
        else:
            toes = sum(places[:, clip.skeleton.role(f"{s}_toe")] for s in ("left", "right")) / 2
            feet = sum(places[:, clip.skeleton.role(f"{s}_foot")] for s in ("left", "right")) / 2
            sides = np.sum(np.cross([0, 1, 0], toes - feet) * left, axis=-1)
        assert np.mean(sides > 0) > 0.9, name
