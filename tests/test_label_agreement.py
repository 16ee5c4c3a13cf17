"""How well labels agree with hand-made ones, and with those that are known because the motion was planned.

Each bound is a little beyond what was measured, so that labels that get worse fail. Thresholds of the labels
were chosen on the generated motion, the clips labelled by hand and the published ones; so some tests choose
them anew on one subject and look at the others, or are of clips on which none was chosen.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from features import contacts as touching
from features import phase as phases
from features.labels import GAITS, Labels, label_clip
from motion import kinematics, leadin, sources
from motion.clip import Clip
from motion.dancecard import generate

Array = NDArray[np.float64]

NEAR = 0.15  # seconds between a footfall found and one labelled by hand
# Names of the hand-made labels, and the columns of .gait files, as our gaits; a run is a jog.
NAMED = {"stand": "stand", "walk": "walk", "walk1": "walk", "jog": "jog", "run": "jog", "run1": "jog"}
COLUMNS = ("stand", "walk", "jog", "jog", "crouch", "jump", "other", "other")


def degrees(phase: Array, truth: Array) -> Array:
    return np.degrees(np.abs(np.angle(np.exp(1j * (np.asarray(phase, np.float64) - truth)))))


def f1(hits: float, found: float, known: float) -> float:
    return 2 * hits / (found + known)


def between(falls: list[tuple[float, str]], time: Array) -> Array:
    """Phase on straight lines between footfalls labelled by hand: the right foot at 0, the left one at pi."""
    at = {"right": 0.0, "left": np.pi}
    values = [at[falls[0][1]]]
    for (_, before), (_, foot) in itertools.pairwise(falls):
        values.append(values[-1] + (np.pi if foot != before else 2 * np.pi))
    return np.interp(time, [seconds for seconds, _ in falls], values)


def cmu(data: Path) -> Iterator[tuple[Clip, Labels, list[tuple[float, str]], list[str]]]:
    """The hand-labelled clips: labels found, footfalls (seconds, side) and a gait for each frame."""
    for path in sorted((data / "cmu/labelled_60fps").glob("*.bvh")):
        clip = sources.load(path, fps=60)
        text = path.with_name(f"{path.stem}_contacts.txt").read_text()
        falls = [((int(f) - 1) / 60, side) for f, side in re.findall(r"\[(\d+), *'(left|right)'\]", text)]
        gaits = ["stand"] * len(clip)
        for line in path.with_name(f"{path.stem}_gait.txt").read_text().splitlines():
            if line.strip():
                first, name = line.split()
                gaits[int(first) - 1 :] = [NAMED[name]] * (len(clip) - int(first) + 1)
        yield clip, label_clip(clip), falls, gaits


def pfnn(data: Path) -> Iterator[tuple[Clip, Labels, list[tuple[float, str]], Array, list[str]]]:
    """The published clips: labels found, footfalls, phase (NaN where it stands still) and gaits."""
    folder = data / "pfnn/animations"
    for name in ("LocomotionFlat04_000", "LocomotionFlat09_000", "NewCaptures10_000"):
        clip = sources.load(folder / f"{name}.bvh")
        lines = (folder / f"{name}_footsteps.txt").read_text().splitlines()
        falls = [
            ((int(frame) - 1) / 120, side)
            for line in lines
            for frame, side in zip(line.split(), ("right", "left"), strict=False)
        ]
        phase = 2 * np.pi * np.loadtxt(folder / f"{name}.phase")
        step = np.mod(np.diff(phase), 2 * np.pi)
        moving = np.append((step > 0.005) & (step < 1), False)
        gaits = [COLUMNS[k] for k in np.loadtxt(folder / f"{name}.gait").argmax(axis=1)]
        yield clip, label_clip(clip), falls, np.where(moving, phase, np.nan), gaits


def matched(clip: Clip, labels: Labels, falls: list[tuple[float, str]]) -> NDArray[np.int64]:
    """Footfalls found near labelled ones, found, and labelled, within the time that is labelled."""
    feet = touching.feet(labels.names, labels.contacts, clip.fps)
    out = np.zeros(3, np.int64)
    for foot, side in enumerate(("left", "right")):
        known = np.array([seconds for seconds, own in falls if own == side and seconds > 0.1])
        if len(known) == 0:
            continue
        found = np.array([a for a, _ in touching.spans(feet[:, foot]) if a > 0]) / clip.fps
        found = found[(found > known.min() - NEAR) & (found < known.max() + NEAR)]
        hits = sum(len(found) > 0 and np.abs(found - seconds).min() < NEAR for seconds in known)
        out += (hits, len(found), len(known))
    return out


def named(labels: Labels) -> NDArray[np.str_]:
    return np.array(GAITS)[labels.gait.argmax(axis=1)]


def report(name: str, **numbers: float) -> None:
    print(f"{name}: " + ", ".join(f"{key} {value:.3f}" for key, value in numbers.items()))


def test_with_planned_motion():
    """All ten minutes of the built-in data."""
    hits, errors, gaits, lowest, highest = np.zeros((4, 3), np.int64), [], [], np.inf, 0.0
    for passage in generate():
        found, known = label_clip(passage.clip), passage.labels
        on, planned = found.contacts != 0, known.contacts != 0
        hits += np.stack([array.sum(axis=0) for array in (on & planned, on, planned)], axis=-1)
        error = degrees(found.phase, known.phase)
        errors.append(error[known.gait != GAITS.index("stand")])
        gaits.append(found.gait.argmax(axis=1) == known.gait)
        rate = phases.rate(found.phase, 60)
        lowest, highest = min(lowest, rate.min()), max(highest, rate.max())
    heels, toes = hits[[0, 2]].sum(axis=0), hits[[1, 3]].sum(axis=0)
    median, most = np.percentile(np.concatenate(errors), [50, 95])
    gait = np.concatenate(gaits).mean()
    report("planned", heels=f1(*heels), toes=f1(*toes), median=median, p95=most, gait=gait)
    assert f1(*heels) > 0.92 and f1(*toes) > 0.975
    assert median < 5.5 and most < 23
    assert gait > 0.955
    assert lowest > 0 and highest < 20  # rad/s


@pytest.fixture(scope="module")
def by_hand(data) -> list[tuple[Clip, Labels, list[tuple[float, str]], list[str]]]:
    return list(cmu(data))


def test_with_clips_labelled_by_hand(by_hand):
    hits, errors, gaits = np.zeros(3, np.int64), [], []
    for clip, labels, falls, known in by_hand:
        hits += matched(clip, labels, falls)
        first, last = round(falls[0][0] * 60), min(round(falls[-1][0] * 60), len(clip))
        span = np.arange(max(first, 3), last)  # a blend out of the T-pose comes before
        errors.append(degrees(labels.phase[span], between(falls, span / 60)))
        gaits.append((named(labels) == np.array(known))[span])
    median, most = np.percentile(np.concatenate(errors), [50, 95])
    gait = np.concatenate(gaits).mean()
    report("cmu", footfalls=f1(*hits), median=median, p95=most, gait=gait)
    assert hits[2] > 130
    assert f1(*hits) > 0.95
    assert median < 9.5 and most < 38
    assert gait > 0.98


def test_thresholds_that_one_subject_chooses_do_for_the_others(by_hand, monkeypatch):
    """Those that footfalls depend on most, by the eight clips of subject 16; looked at are eleven others."""
    own, others = [], []
    for clip, labels, falls, _ in by_hand:
        start = leadin.lead_in(clip)
        world = kinematics.forward(clip.skeleton, clip.positions[start:], clip.rotations[start:])
        places = touching.points(clip.skeleton, clip.fps, *world, labels.names)
        (own if clip.name.startswith("16_") else others).append((clip, labels, falls, places))
    assert (len(own), len(others)) == (8, 14)

    def score(some) -> float:
        hits = np.zeros(3, np.int64)
        for clip, labels, falls, places in some:
            contacts = touching.resting(places, clip.fps)
            contacts = np.concatenate([np.repeat(contacts[:1], len(clip) - len(contacts), axis=0), contacts])
            hits += matched(clip, replace(labels, contacts=contacts), falls)
        return f1(*hits)

    shipped = score(others)
    for name in ("SHARE", "RISE", "NOISE"):
        usual, scores = getattr(touching, name), {}
        for factor in (0.5, 0.7, 1.4, 2.0):  # ours is not among them
            monkeypatch.setattr(touching, name, factor * usual)
            scores[factor] = score(own)
        monkeypatch.setattr(touching, name, max(scores, key=lambda factor: scores[factor]) * usual)
    report("subject 16", own=score(own), others=score(others), shipped=shipped)
    assert score(others) > 0.95
    assert shipped > score(others) - 0.04  # ours, which saw them all, are no worse


def test_with_the_published_clips(data):
    """What is labelled there as a footfall comes some 0.03 s later than the first touch of the heel."""
    hits, errors, gaits = np.zeros(3, np.int64), [], []
    for clip, labels, falls, phase, known in pfnn(data):
        hits += matched(clip, labels, falls)
        moving = np.isfinite(phase)
        errors.append(degrees(labels.phase[moving], phase[moving]))
        span = slice(round(falls[0][0] * 120), round(falls[-1][0] * 120))
        gaits.append((named(labels) == np.array(known))[span])
    median, most = np.percentile(np.concatenate(errors), [50, 95])
    gait = np.concatenate(gaits).mean()
    report("pfnn", footfalls=f1(*hits), median=median, p95=most, gait=gait)
    assert hits[2] > 95
    assert f1(*hits) > 0.965
    assert median < 17 and most < 58
    assert gait > 0.89


def test_the_published_mirror_twin_is_half_a_turn_on(data):
    folder = data / "pfnn/animations"
    one, twin = (
        label_clip(sources.load(folder / f"LocomotionFlat09_000{end}.bvh")) for end in ("", "_mirror")
    )
    twin = twin.mirrored()
    assert np.mean(one.contacts == twin.contacts) > 0.97
    assert np.percentile(degrees(one.phase, twin.phase.astype(np.float64)), 90) < 25


@pytest.mark.parametrize(
    ("folder", "gait"), [("run", "jog"), ("dash", "jog"), ("walk", "walk"), ("walk-back", "walk")]
)
def test_clips_named_for_their_gait(data, folder, gait):
    """Of 13 styles, most of the time; people stand at some ends."""
    shares = [
        label_clip(sources.load(path), phase=False).gait.mean(axis=0)
        for path in sorted((data / "bandai/dataset-1").glob(f"*_{folder}_*.bvh"))
    ]
    report(folder, share=np.mean(shares, axis=0)[GAITS.index(gait)])
    assert len(shares) >= 10 and np.mean(shares, axis=0)[GAITS.index(gait)] > 0.9


@pytest.mark.parametrize(
    ("clips", "gait", "least"),
    [
        ("run_normal", "jog", 0.95),
        ("run_active", "jog", 0.88),
        ("walk_normal", "walk", 0.95),
        ("walk-turn-left_normal", "walk", 0.95),
        ("walk-turn-right_normal", "walk", 0.95),
        ("walk_active", "walk", 0.35),  # a springy one, hardly ever on both feet: taken for a jog as often
    ],
)
def test_clips_on_which_no_threshold_was_chosen(data, clips, gait, least):
    paths = sorted((data / "bandai/dataset-2").glob(f"*_{clips}_*.bvh"))[::4]
    shares = [label_clip(sources.load(path), phase=False).gait.mean(axis=0) for path in paths]
    report(clips, share=np.mean(shares, axis=0)[GAITS.index(gait)])
    assert len(shares) >= 2 and np.mean(shares, axis=0)[GAITS.index(gait)] > least


def test_jumps_and_ducking(data):
    for name, gait, least in (
        ("16/16_01", "jump", 0.1),
        ("16/16_07", "jump", 0.1),
        ("127/127_29", "crouch", 0.3),
    ):
        labels = label_clip(sources.load(data / f"cmu/asfamc/{name}.amc"), phase=False)
        assert labels.gait.mean(axis=0)[GAITS.index(gait)] > least
