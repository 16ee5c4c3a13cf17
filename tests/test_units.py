"""The unit of a skeleton is found from its size, whatever the body."""

from __future__ import annotations

import numpy as np
import pytest

from motion import quat, roles, units
from motion.clip import Clip
from motion.skeleton import Skeleton


def body(scale: float, *, suffix: str = "", names: dict[str, str] | None = None) -> Skeleton:
    """A person of 1.7 m with arms hanging, times scale."""
    parts = [("Hips", -1, (0, 0.9, 0)), ("Spine", 0, (0, 0.3, 0)), ("Head", 1, (0, 0.4, 0))]
    for side, x in (("Left", 1), ("Right", -1)):
        j = len(parts)
        parts += [
            (f"{side}UpLeg", 0, (0.1 * x, 0, 0)),
            (f"{side}Leg", j, (0, -0.42, 0)),
            (f"{side}Foot", j + 1, (0, -0.4, 0)),
            (f"{side}Arm", 1, (0.2 * x, 0.15, 0)),
            (f"{side}ForeArm", j + 3, (0, -0.28, 0)),
            (f"{side}Hand", j + 4, (0, -0.26, 0)),
        ]
    return Skeleton(
        tuple((names or {}).get(name, name) + suffix for name, _, _ in parts),
        np.array([parent for _, parent, _ in parts]),
        np.array([offset for _, _, offset in parts]) * scale,
    )


def dog(scale: float) -> Skeleton:
    """A dog with legs of 0.35 m, times scale."""
    parts = [
        ("Hips", -1, (0, 0, 0)),
        ("Spine", 0, (0, 0, 0.4)),
        ("Head", 1, (0, 0.1, 0.2)),
        ("Tail", 0, (0, 0, -0.1)),
    ]
    for side, x in (("Left", 1), ("Right", -1)):
        for (upper, lower, end), parent in ((("UpLeg", "Leg", "Foot"), 0), (("Arm", "ForeArm", "Hand"), 1)):
            j = len(parts)
            parts += [
                (side + upper, parent, (0.08 * x, 0, 0)),
                (side + lower, j, (0, -0.18, 0)),
                (side + end, j + 1, (0, -0.17, 0)),
            ]
    return Skeleton(
        tuple(name for name, _, _ in parts),
        np.array([parent for _, parent, _ in parts]),
        np.array([offset for _, _, offset in parts]) * scale,
    )


@pytest.mark.parametrize("height", [1.3, 1.7, 2.0])
@pytest.mark.parametrize("unit", units.UNITS.values(), ids=units.UNITS)
def test_people_of_every_size(unit, height):
    assert units.guess(body(height / 1.7 / unit)) == unit


@pytest.mark.parametrize(
    ("height", "unit"),
    [
        (0.25, 1),
        (0.5, 1),
        (1, 1),
        (3, 1),
        (0.25, 0.01),
        (0.5, 0.01),
        (1, 0.01),
        (3, 0.01),
        (0.5, 0.001),
        (3, 0.001),
    ],
)
def test_animals_of_every_size(height, unit):
    assert units.guess(dog(height / unit)) == unit


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.001])
def test_bodies_without_known_legs(unit):
    skeleton = Skeleton(
        ("a", "b", "c"), np.array([-1, 0, 1]), np.array([[0, 9, 0], [0, 0.8, 0], [0, 0.8, 0.1]]) / unit
    )
    assert "left_leg" not in roles.guess(skeleton)
    assert units.guess(skeleton) == unit


def test_a_pose_overrules_stale_offsets():
    skeleton = body(100)
    stale = Skeleton(skeleton.names, skeleton.parents, np.zeros((len(skeleton), 3)))
    assert units.guess(stale, skeleton.offsets) == 0.01


def test_no_size_no_unit():
    assert units.guess(Skeleton(("a",), np.array([-1]), np.zeros((1, 3)))) == 1.0


def test_to_metres():
    skeleton = Skeleton(
        ("a", "b"),
        np.array([-1, 0]),
        np.array([[0.0, 0, 0], [0, 50, 0]]),
        {"hips": 0},
        {1: np.array([0, 0, 10.0])},
    )
    clip = Clip("c", skeleton, 30, np.full((2, 2, 3), 200.0), quat.identity(2, 2))
    metres = units.to_metres(clip, 0.01)
    assert metres.unit_to_m == 0.01
    assert metres.positions[0, 0].tolist() == [2, 2, 2]
    assert metres.skeleton.offsets[1].tolist() == [0, 0.5, 0]
    assert metres.skeleton.end_sites[1].tolist() == [0, 0, 0.1]
    assert metres.skeleton.roles == {"hips": 0}
    # A unit already applied is undone first.
    np.testing.assert_allclose(units.to_metres(metres, 0.0254).positions, clip.positions * 0.0254)
