"""The obvious twin of `motion.retarget_kernels`: the same over all characters, for the tests to compare."""

from __future__ import annotations

import numpy as np

from . import foot_lock_numpy, quat, springs
from .foot_lock import SOFT_REACH
from .retarget_kernels import CARRIER, DEEPEST, FREE, ROOT, SINK_HALFLIFE


def step(t, w, feet, sinks, planting, contacts, settings, positions, rotations, velocities, angular,
         to_positions, to_rotations, to_velocities, to_angular):  # fmt: skip
    """See `motion.retarget_kernels.step`; w is not used."""
    given = [np.moveaxis(a.astype(np.float64), 1, 0) for a in (positions, rotations, velocities, angular)]
    source = _source_world(t, *given)
    pos, rot, vel, ang = _target_world(t, source, np.moveaxis(to_positions.astype(np.float64), 1, 0))
    for j in t.needed:
        p = t.parents[j]
        x, q, v, a = pos[j], rot[j], vel[j], ang[j]
        if p >= 0:
            back, arm = quat.inv(rot[p]), x - pos[p]
            v = quat.rotate(back, v - vel[p] - np.cross(ang[p], arm))
            x, q, a = quat.rotate(back, arm), quat.mul(back, q), quat.rotate(back, a - ang[p])
        to_rotations[:, j], to_angular[:, j] = q, a
        if t.kinds[j] != FREE:
            to_positions[:, j], to_velocities[:, j] = x, v
    if planting:
        _plant(t, pos, rot, feet, sinks, contacts, settings, to_positions, to_rotations)


def _source_world(t, positions, rotations, velocities, angular):
    pos, rot, vel, ang = positions.copy(), rotations.copy(), velocities.copy(), angular.copy()
    for j in t.source_needed:
        p = t.source_parents[j]
        if p >= 0:
            arm = quat.rotate(rot[p], positions[j])
            pos[j], rot[j] = pos[p] + arm, quat.mul(rot[p], rotations[j])
            vel[j] = vel[p] + quat.rotate(rot[p], velocities[j]) + np.cross(ang[p], arm)
            ang[j] = ang[p] + quat.rotate(rot[p], angular[j])
    return pos, rot, vel, ang


def _target_world(t, source, bones):
    source_pos, source_rot, source_vel, source_ang = source
    scale, lift = t.moves
    joints, count = bones.shape[:2]
    pos, vel, ang = (np.zeros((joints, count, 3)) for _ in range(3))
    rot = quat.identity(joints, count)
    for j in t.needed:
        p, entries = t.parents[j], slice(t.starts[j], t.starts[j + 1])
        sources = t.joints[entries]
        if len(sources):
            each = quat.mul(source_rot[sources], t.turns[entries, None])
            weights = t.weights[entries, None, None]
            sign = np.where(np.sum(each * each[:1], axis=-1, keepdims=True) < 0, -1, 1)
            rot[j] = quat.normalize(np.sum(weights * sign * each, axis=0))
            ang[j] = np.sum(weights * source_ang[sources], axis=0)
        else:
            rot[j] = t.rest[j] if p < 0 else quat.mul(rot[p], t.rest[j])
            ang[j] = 0 if p < 0 else ang[p]
        if t.kinds[j] == ROOT:
            pos[j], vel[j] = scale * source_pos[t.source_root], scale * source_vel[t.source_root]
        elif t.kinds[j] == CARRIER:
            arm = quat.rotate(source_rot[t.hips], t.pelvis)
            own = quat.rotate(rot[j], t.target_pelvis)
            pos[j] = scale * (source_pos[t.hips] + arm) + np.array([0, lift, 0]) - own
            moved = source_vel[t.hips] + np.cross(source_ang[t.hips], arm)
            vel[j] = scale * moved - np.cross(ang[j], own)
        elif p < 0:
            pos[j] = bones[j]
        else:
            arm = quat.rotate(rot[p], bones[j])
            pos[j], vel[j] = pos[p] + arm, vel[p] + np.cross(ang[p], arm)
    return pos, rot, vel, ang


def _plant(t, pos, rot, feet, sinks, contacts, settings, to_positions, to_rotations):
    s = settings[0]
    wanted, places = np.zeros(len(feet)), []
    for k, (hip, _, ankle, joint) in enumerate(t.legs):
        touch = pos[joint] + quat.rotate(rot[joint], t.points[k])
        place = foot_lock_numpy.update_contact(feet[:, k], contacts[:, k] != 0, touch, t.heights[k], s)
        places.append(place)
        x, y, z = np.moveaxis(place + pos[ankle] - touch - pos[hip], -1, 0)
        now = np.sum((pos[ankle] - pos[hip]) ** 2, axis=-1)
        limit = np.maximum((SOFT_REACH * t.lengths[k]) ** 2, now)
        needed = -y - np.sqrt(np.maximum(limit - x * x - z * z, 0))
        needed = np.clip(needed, 0, DEEPEST * t.lengths[k])
        wanted = np.where(feet["locked"][:, k], np.maximum(wanted, needed), wanted)
    sinks[:, 0], sinks[:, 1] = springs.damp(sinks[:, 0], sinks[:, 1], wanted, SINK_HALFLIFE, s["dt"])
    down = np.zeros((len(feet), 3))
    down[:, 1] = -np.maximum(sinks[:, 0], 0)
    above = t.parents[t.carrier]
    to_positions[:, t.carrier] += down if above < 0 else quat.rotate(quat.inv(rot[above]), down)
    pos = pos + down
    world_pos, world_rot = np.moveaxis(pos, 0, 1), np.moveaxis(rot, 0, 1)
    for k, leg in enumerate(t.legs):
        touch = pos[leg[3]] + quat.rotate(rot[leg[3]], t.points[k])
        moved = np.abs(places[k] - touch).sum(axis=-1) > 1e-5
        bent = to_rotations.copy()
        foot_lock_numpy.reach_for(places[k], touch, leg, t.hinges[k], t.parents, world_pos, world_rot, bent)
        to_rotations[moved] = bent[moved]
