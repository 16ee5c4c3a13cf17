from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import synthetic

from motion import anatomy, kinematics, quat, root, sources
from motion.clip import Clip
from motion.skeleton import Skeleton
from viewer import body
from viewer.body import Body

FILES = {
    "cmu": "cmu/asfamc/16/16_15.amc",
    "daz": "cmu/daz_bvh/02/02_01.bvh",
    "lafan": "lafan1/locomotion_60fps/aiming1_subject1_walk2_filtered.bvh",
    "bandai": "bandai/dataset-1/dataset-1_dash_active_001.bvh",
    "pfnn": "pfnn/animations/LocomotionFlat04_000.bvh",
    "dog": "dog_mann/D1_007_KAN01_001.bvh",
}


def cut(clip: Clip, frames: int = 400) -> Clip:
    step = max(1, len(clip) // frames)
    return clip.replace(
        positions=clip.positions[2::step], rotations=clip.rotations[2::step], fps=clip.fps / step
    )


def figure(clip: Clip) -> tuple[Body, Clip]:
    clip = root.ground(clip)
    return body.body(anatomy.anatomy(clip.skeleton, [clip])), clip


def placed(shape: Body, clip: Clip, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """World vertices of all parts, and their colours."""
    world = kinematics.forward(clip.skeleton, clip.positions[frame], clip.rotations[frame])
    transforms = shape.transforms(*world)
    vertices = [part.vertices @ t[:, :3].T + t[:, 3] for part, t in zip(shape.parts, transforms, strict=True)]
    return np.concatenate(vertices), np.concatenate([part.colours for part in shape.parts])


def of_colour(colours: np.ndarray, shade: np.ndarray) -> np.ndarray:
    return np.abs(colours - shade).max(axis=-1) < 1e-4


def check(shape: Body, clip: Clip, *, exact: float = 0.03) -> None:
    """Left is left, the eyes look ahead, feet stand on the ground."""
    lowest, before = [], []
    for frame in np.linspace(0, len(clip) - 1, 12).astype(int):
        vertices, colours = placed(shape, clip, frame)
        world = kinematics.forward(clip.skeleton, clip.positions[frame], clip.rotations[frame])
        ahead = root.facing(clip.skeleton, world[0][None], world[1][None])[0]
        left = np.cross([0, 1, 0], ahead)
        sides = [vertices[of_colour(colours, body.SIDES[side])].mean(axis=0) for side in ("left", "right")]
        assert (sides[0] - sides[1]) @ left > 0.03
        eyes = vertices[of_colour(colours, body.EYES)].mean(axis=0)
        head = world[0][clip.skeleton.roles["head"]]
        before.append((eyes - head) @ ahead)
        lowest.append(vertices[:, 1].min())
        assert np.isfinite(vertices).all()
    assert np.median(before) > 0.02
    assert abs(np.median(lowest)) < exact


def test_a_walker_is_upright_looks_ahead_and_has_its_left_on_the_left(walker: Clip) -> None:
    shape, clip = figure(walker)
    check(shape, clip)
    vertices, _ = placed(shape, clip, 0)
    assert 1.5 < np.ptp(vertices[:, 1]) < 2.0
    assert set(np.array(clip.skeleton.names)[shape.joints]) >= {"Hips", "Head", "LeftFoot", "RightHand"}


@pytest.mark.parametrize("name", FILES)
def test_so_are_real_bodies_of_any_skeleton(name: str, data: Path) -> None:
    shape, clip = figure(cut(sources.load(data / FILES[name])))
    # The converter that made these left ankles that stand at 7 to 12 cm.
    check(shape, clip, exact=0.045 if name == "daz" else 0.03)
    height = np.median([np.ptp(placed(shape, clip, f)[0][:, 1]) for f in range(0, len(clip), 40)])
    assert 0.4 < height < 0.9 if name == "dog" else 1.4 < height < 2.1
    tail = [j for j in shape.joints if "Tail" in clip.skeleton.names[j]]
    assert bool(tail) == (name == "dog")


def test_parts_are_where_their_joints_are(walker: Clip) -> None:
    shape, clip = figure(walker)
    positions, rotations = kinematics.forward(clip.skeleton, clip.positions[:3], clip.rotations[:3])
    transforms = shape.transforms(positions, rotations)
    assert transforms.shape == (3, len(shape.parts), 3, 4)
    point = np.array([0.1, -0.2, 0.3])
    expected = quat.rotate(rotations[:, shape.joints], point) + positions[:, shape.joints]
    np.testing.assert_allclose(transforms[..., :3] @ point + transforms[..., 3], expected, atol=1e-5)


def test_limbs_reach_from_joint_to_joint(walker: Clip) -> None:
    shape, clip = figure(walker)
    shin = shape.parts[shape.joints.tolist().index(clip.skeleton.names.index("LeftLeg"))]
    low, high = shin.vertices[:, 1].min(), shin.vertices[:, 1].max()
    assert low == pytest.approx(-synthetic.SHIN, abs=0.06) and low < -synthetic.SHIN
    assert 0 < high < 0.07


def test_joints_without_a_role_have_no_part(walker: Clip) -> None:
    """As the helper joints of rigs for games."""
    old = walker.skeleton
    count, added = len(old), 12
    skeleton = Skeleton(
        (*old.names, *(f"helper{i}" for i in range(added))),
        np.concatenate([old.parents, np.arange(added, dtype=np.int32)]),
        np.concatenate([old.offsets, np.full((added, 3), 0.01)]),
        old.roles,
        old.end_sites,
    )
    positions = np.concatenate([walker.positions, np.full((len(walker), added, 3), 0.01)], axis=1)
    rotations = np.concatenate([walker.rotations, quat.identity(len(walker), added)], axis=1)
    clip = walker.replace(skeleton=skeleton, positions=positions, rotations=rotations)
    shape = body.body(anatomy.anatomy(clip.skeleton, [clip]))
    assert shape.joints.max() < count
    assert len(shape.parts) == len(body.body(anatomy.anatomy(old, [walker])).parts)


def test_thicknesses_go_with_the_body(walker: Clip) -> None:
    small = walker.replace(
        skeleton=Skeleton(
            walker.skeleton.names,
            walker.skeleton.parents,
            walker.skeleton.offsets / 2,
            walker.skeleton.roles,
            {j: end / 2 for j, end in walker.skeleton.end_sites.items()},
        ),
        positions=walker.positions / 2,
    )
    (whole, _), (half, _) = figure(walker), figure(small)
    for one, other in zip(whole.parts, half.parts, strict=True):
        np.testing.assert_allclose(
            np.ptp(one.vertices, axis=0), 2 * np.ptp(other.vertices, axis=0), rtol=0.15
        )


def test_bare_bones_do_for_any_tree() -> None:
    offsets = np.array([[0, 0, 0], [0, 1, 0], [0.5, 0, 0], [0, 0, 0]], float)
    parents = np.array([-1, 0, 1, 1], np.int32)
    shape = body.bones(Skeleton(("a", "b", "c", "d"), parents, offsets, {}, {2: np.array([0.3, 0, 0])}))
    assert shape.joints.tolist() == [0, 1, 2]
    assert np.ptp(shape.parts[0].vertices, axis=0).argmax() == 1
    alone = body.bones(Skeleton(("a",), np.array([-1], np.int32), np.zeros((1, 3))))
    assert len(alone.parts) == 1


def test_legs_alone_have_a_body(walker: Clip) -> None:
    """And so have arms without hands."""
    some = {
        role: j
        for role, j in walker.skeleton.roles.items()
        if role == "hips" or "leg" in role or "foot" in role
    }
    for roles in (some, {r: j for r, j in walker.skeleton.roles.items() if not r.endswith(("hand", "toe"))}):
        skeleton = walker.skeleton.with_roles(roles)
        shape = body.body(anatomy.anatomy(skeleton, [walker.replace(skeleton=skeleton)]))
        assert np.isfinite(np.concatenate([part.vertices for part in shape.parts])).all()
        assert {skeleton.roles["hips"], skeleton.roles["left_leg"]} <= set(shape.joints.tolist())
