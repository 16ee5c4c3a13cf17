"""Retargeting at run time: a rig of any size is driven by the joints of another skeleton, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from . import retarget, retarget_kernels, retarget_numpy
from .anatomy import Anatomy, anatomy
from .errors import UserError
from .foot_lock import FOOT
from .pose import Poses
from .retarget_kernels import CARRIER, ROOT, Tables
from .skeleton import Skeleton

_SETTINGS = np.dtype(
    [("dt", np.float32), ("foot_halflife", np.float32), ("unlock_radius", np.float32)], align=True
)


class Retargeter:
    """Drives N characters of one skeleton by the poses of N characters of another.

    Parameters
    ----------
    source, target : skeletons, or their anatomies (`motion.anatomy`), which those need whose zero rotations
        do not stand.
    count : N.
    contact_roles : what the contacts given to `step` are of; none: feet are not planted.
    foot_halflife : how fast a foot blends into and out of its place on the ground, seconds.
    unlock_radius : a foot further than this from where its motion has it is let go, metres.
    compiled : use the compiled kernel; False takes its NumPy twin, for tests.

    `plan` says what drives what. World positions are the source's times `plan.scale`: a character that the
    target's own size of steps is to bring to some place needs its commands divided by that.
    """

    def __init__(
        self,
        source: Skeleton | Anatomy,
        target: Skeleton | Anatomy,
        count: int,
        *,
        contact_roles: Sequence[str] = (),
        foot_halflife: float = 0.1,
        unlock_radius: float = 0.2,
        compiled: bool = True,
    ) -> None:
        if count < 1:
            raise UserError(f"{count} characters", remedy="ask for one or more")
        source = anatomy(source) if isinstance(source, Skeleton) else source
        if isinstance(target, Skeleton):
            target = retarget.anatomy_like(target, source)
        self.plan = retarget.plan(source, target)
        self.skeleton, self.count = target.skeleton, count
        self.contact_roles = tuple(contact_roles)
        self._source = source.skeleton
        self._step = (retarget_kernels if compiled else retarget_numpy).step
        self._tables = tables(self.plan, self.contact_roles)
        joints, feet = len(self.skeleton), len(self.contact_roles)
        self._work = retarget_kernels.work(len(self._source), joints, feet)
        self._feet = np.zeros((count, feet), FOOT)
        self._sinks = np.zeros((count, 2), np.float64)
        self._settings = np.zeros(1, _SETTINGS)
        self._settings["foot_halflife"], self._settings["unlock_radius"] = foot_halflife, unlock_radius
        self._none = np.zeros((count, feet), np.uint8)
        self._poses = Poses.empty(count, joints)
        self._poses.positions[:] = target.bones
        self._poses.rotations[:] = target.rest
        self.reset()

    def reset(self) -> None:
        """Forget where feet stood: the next poses begin anew."""
        self._feet[:] = np.zeros((), FOOT)
        self._feet["target"] = np.nan
        self._sinks[:] = 0

    def step(self, poses: Poses, contacts: NDArray[np.uint8] | None, dt: float) -> Poses:
        """The target's poses [N] for the source's, valid until the next step.

        Parameters
        ----------
        poses : [N, Js], local, velocities included.
        contacts : [N, C], which limbs are to stay where they are; None plants no feet in this frame.
        dt : seconds since the step before.

        Velocities are those of the motion without planting. Errors: UserError for other shapes.
        """
        if poses.positions.shape != (self.count, len(self._source), 3):
            raise UserError(
                f"poses of shape {poses.positions.shape}",
                remedy=f"give {self.count} characters of {len(self._source)} joints",
            )
        planting = contacts is not None and len(self.contact_roles) > 0
        if contacts is None:
            contacts = self._none
        elif contacts.shape != self._none.shape:
            raise UserError(
                f"contacts of shape {contacts.shape}",
                remedy=f"give {self._none.shape}: {', '.join(self.contact_roles) or 'none'}",
            )
        self._settings["dt"] = dt
        out = self._poses
        self._step(
            self._tables, self._work, self._feet, self._sinks, planting, contacts, self._settings,
            poses.positions, poses.rotations, poses.velocities, poses.angular_velocities,
            out.positions, out.rotations, out.velocities, out.angular_velocities,
        )  # fmt: skip
        return out


def tables(plan: retarget.Plan, contact_roles: Sequence[str]) -> Tables:
    """A plan as the kernel reads it; a UserError where limbs are missing, or the source's root is."""
    source, target = plan.source.skeleton, plan.target.skeleton
    if plan.root >= 0 and plan.source_root < 0:
        raise UserError(
            "the source has no root on the ground", remedy="ground its clips (motion.root.ground)"
        )
    starts, joints, weights, turns = plan.starts, plan.joints, plan.weights, plan.turns
    kinds = np.zeros(len(target), np.int64)
    if plan.root >= 0:
        at = int(starts[plan.root])
        own = retarget.turn(plan.source, plan.source_root, plan.target, plan.root)
        joints, weights = np.insert(joints, at, plan.source_root), np.insert(weights, at, 1.0)
        turns = np.insert(turns, at, own, axis=0)
        starts = starts + (np.arange(len(starts)) > plan.root).astype(np.int32)
        kinds[plan.root] = ROOT
    kinds[plan.carrier] = CARRIER
    limbs = retarget.limbs(plan.target, contact_roles)
    _, heights = retarget.soles(plan, contact_roles)
    driven = np.flatnonzero(np.diff(starts)).tolist()
    ends = [*driven, plan.carrier, *limbs.joints[:, 3].tolist()]
    needed = sorted({j for end in ends for j in target.chain(end)})
    hips = source.roles["hips"]
    source_needed = sorted({j for end in [*joints.tolist(), hips] for j in source.chain(end)})
    placed = np.zeros(len(target), np.int64)
    placed[[j for end in limbs.joints[:, 3].tolist() for j in target.chain(end)]] = 1
    placed[target.chain(plan.carrier)] = 2
    source_placed = np.zeros(len(source), np.int64)
    source_placed[source.chain(hips)] = 1
    lengths = [np.linalg.norm(plan.target.bones[target.chain(end, upper)[1:]], axis=-1).sum()
               for upper, _, end, _ in limbs.joints.tolist()]  # fmt: skip
    return Tables(
        source_parents=np.array(source.parents, np.int32),
        source_needed=np.array(source_needed, np.int64),
        source_placed=source_placed,
        hips=hips,
        source_root=plan.source_root,
        parents=np.array(target.parents, np.int32),
        needed=np.array(needed, np.int64),
        placed=placed,
        starts=starts.astype(np.int32),
        joints=joints.astype(np.int32),
        weights=weights.astype(np.float64),
        turns=np.ascontiguousarray(turns, np.float64),
        rest=np.ascontiguousarray(plan.target.rest, np.float64),
        kinds=kinds,
        carrier=plan.carrier,
        pelvis=plan.pelvis.astype(np.float64),
        target_pelvis=plan.target_pelvis.astype(np.float64),
        moves=np.array([plan.scale, plan.lift]),
        legs=limbs.joints,
        points=limbs.points.astype(np.float64),
        hinges=limbs.hinges.astype(np.float64),
        heights=np.stack([heights, heights], axis=-1),
        lengths=np.array(lengths, np.float64),
    )
