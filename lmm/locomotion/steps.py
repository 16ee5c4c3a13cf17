"""What happens around any such network in a frame, compiled; `steps_numpy` is the obvious twin.

Arrays: N characters (`lmm.locomotion.trajectory.character`), J joints without the ground root, a past
[N, H, 10 or more] whose newest frame is at head. into is where blocks of inputs begin: path, facing, gaits,
positions, velocities; what may follow is the network's own.
"""

from __future__ import annotations

import math

import numba

from mm.kernels import push_out, turn
from motion import springs
from motion.quat_scalar import between, dot, inv, log_shortest, mul, rotate

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")

SAMPLES, FUTURE, ASIDE = 12, 6, 0.25  # as `lmm.locomotion.window` has them
POINT = 1e-4  # m^2: a bone no longer than a centimetre points nowhere
BEND = 0.02  # metres that two bones bend further than the network has it, to end where they shall
NOWHERE = 1e-6  # m^2/s^2: who is asked to go slower is asked to go no way


@_jit
def plan(characters, past, head, velocity, yaw, turn_rate, crouch, settings, sums, turns, joints, velocities,
         into, x):  # fmt: skip
    """Take commands in, blend the future with them, and write the inputs [N, I] but for the heights.

    velocity [N, 2], yaw, turn_rate, crouch [N]: see `mm.control.Command`. sums, turns [5]: see
    `lmm.locomotion.trajectory.blend`. Returns the first character whose command is not finite, before which
    nothing was done; or -1.
    """
    s = settings[0]
    for i in range(len(characters)):
        if not math.isfinite(velocity[i, 0] + velocity[i, 1] + yaw[i] + turn_rate[i]):
            return i
    for i in range(len(characters)):
        c = characters[i]
        for a in range(2):
            c.target_velocity[a] += s.velocity_share * (velocity[i, a] - c.target_velocity[a])
        c.target_yaw = springs.wrap(c.target_yaw + s.facing_share * springs.wrap(yaw[i] - c.target_yaw))
        c.crouch += s.crouch_share * ((s.crouches if crouch[i] else 0) - c.crouch)
        _choose_gait(c, s)
        _write_past(c, past[i], head, into, x[i])
        _write_future(c, turn_rate[i], s.dt, len(past[i]) // FUTURE, sums, turns, into, x[i])
        for j in range(joints.shape[1]):
            for a in range(3):
                x[i, into[3] + 3 * j + a] = joints[i, j, a]
                x[i, into[4] + 3 * j + a] = velocities[i, j, a]
    return -1


@_jit
def _choose_gait(c, s):
    """Draw the gait towards the one that belongs to the speed asked for."""
    vx, vz = c.target_velocity[0], c.target_velocity[1]
    speed = math.sqrt(vx * vx + vz * vz)
    stand = 1 - min(speed / s.stand_speed, 1.0) if s.stand_speed > 0 else 0.0
    jog = s.jogs * min(max((speed - s.jog_from) / (s.jog_to - s.jog_from), 0.0), 1.0)
    going, upright = 1 - stand, 1 - c.crouch
    gait = (stand, going * upright * (1 - jog), going * upright * jog, going * c.crouch, 0.0, 0.0)
    for g in range(6):
        c.gait[g] += s.gait_share * (gait[g] - c.gait[g])


@_jit
def _write_past(c, past, head, into, x):
    """Samples before the present."""
    size = len(past)
    spacing = size // FUTURE
    for k in range(FUTURE):
        frame = past[(head - ((FUTURE - k) * spacing - 1)) % size]
        px, pz = turn(frame[0] - c.root[0], frame[1] - c.root[1], -c.root[2])
        dx, dz = turn(frame[2], frame[3], -c.root[2])
        _write_sample(into, x, k, px, pz, dx, dz)
        for g in range(6):
            x[into[2] + SAMPLES * g + k] = frame[4 + g]


@_jit
def _write_future(c, rate, dt, spacing, sums, turns, into, x):
    """The present and the samples after it: those predicted, mixed with what is asked."""
    vx, vz = turn(c.target_velocity[0], c.target_velocity[1], -c.root[2])
    facing = springs.wrap(c.target_yaw - c.root[2])
    _write_sample(into, x, FUTURE, 0.0, 0.0, 0.0, 1.0)
    px, pz, before_x, before_z = 0.0, 0.0, 0.0, 0.0
    for k in range(1, FUTURE):
        part = sums[k - 1]
        # Over the frames between two samples what is asked is taken as it is in their middle.
        wx, wz = turn(vx, vz, rate * dt * spacing * (k - 0.5))
        ahead_x, ahead_z = c.future[k, 0], c.future[k, 1]
        px += (1 - part / spacing) * (ahead_x - before_x) + part * dt * wx
        pz += (1 - part / spacing) * (ahead_z - before_z) + part * dt * wz
        before_x, before_z = ahead_x, ahead_z
        angle = math.atan2(c.future[k, 2], c.future[k, 3])
        angle += turns[k - 1] * springs.wrap(facing + rate * dt * spacing * k - angle)
        _write_sample(into, x, FUTURE + k, px, pz, math.sin(angle), math.cos(angle))
    for k in range(FUTURE, SAMPLES):
        for g in range(6):
            x[into[2] + SAMPLES * g + k] = c.gait[g]


@_jit
def _write_sample(into, x, k, px, pz, dx, dz):
    x[into[0] + k], x[into[0] + SAMPLES + k] = px, pz
    x[into[1] + k], x[into[1] + SAMPLES + k] = dx, dz


@_jit
def sample_points(characters, into, x, points):
    """Write where the inputs' heights are asked for to points [N, 12, 3, 2], the world's x, z."""
    for i in range(len(characters)):
        c = characters[i]
        for k in range(SAMPLES):
            px, pz = turn(x[i, into[0] + k], x[i, into[0] + SAMPLES + k], c.root[2])
            dx, dz = turn(x[i, into[1] + k], x[i, into[1] + SAMPLES + k], c.root[2])
            for side in range(3):  # right, middle, left
                points[i, k, side, 0] = c.root[0] + px + ASIDE * (side - 1) * dz
                points[i, k, side, 1] = c.root[1] + pz - ASIDE * (side - 1) * dx


@_jit
def mean_height(heights):
    """The mean along the middle of heights [12, 3], where the root stands."""
    mean = 0.0
    for k in range(SAMPLES):
        mean += heights[k, 1] / SAMPLES
    return mean


@_jit
def bound(y, bounds):
    """Outputs y [N, O] where bounds [2, O] keep them."""
    for i in range(len(y)):
        for o in range(y.shape[1]):
            y[i, o] = min(max(y[i, o], bounds[0, o]), bounds[1, o])


@_jit
def move_joints(c, s, positions, velocities, joints, kept):
    """Mix joints [J, 3] put out, positions and velocities [3 J], with the last frame's moved on.

    joints and kept, their velocities, [J, 3] are written back.
    """
    # Where the last frame's root space is in this one's.
    sx, sz = turn(c.shown[0] - c.root[0], c.shown[1] - c.root[1], -c.root[2])
    sy, angle = c.shown_height - c.height, c.shown[2] - c.root[2]
    for j in range(len(joints)):
        bx, bz = turn(joints[j, 0], joints[j, 2], angle)
        before = (bx + sx, joints[j, 1] + sy, bz + sz)
        for a in range(3):
            v = velocities[3 * j + a]
            kept[j, a] = v
            moved, now = before[a] + v * s.dt, positions[3 * j + a]
            joints[j, a] = now + s.joint_smoothing * (moved - now)


@_jit
def put_pose(i, c, fps, parents, offsets, aims, joints, turned, places, positions, rotations, velocities,
             angular):  # fmt: skip
    """Write character i's joints [J, 3] and rotations turned [J, 4] in root space as pose i of arrays.

    parents [J + 1] and offsets [J + 1, 3] are the skeleton's. Bones keep their length, and joints are turned
    for aims [J + 1, 2] (`lmm.locomotion.bones`); without any, aims [0, 2], bones stretch from joint to joint.
    places [J, 3] is scratch. Joint 0 of the pose is the root, in the world.
    """
    if len(aims) > 0:
        _keep_lengths(parents, offsets, aims, joints, turned, places)
    for j in range(1, len(parents)):
        p, x = parents[j] - 1, (joints[j - 1, 0], joints[j - 1, 1], joints[j - 1, 2])
        q = _quaternion(turned[j - 1])
        if p >= 0:
            back = inv(_quaternion(turned[p]))
            q = mul(back, q)
            x = rotate(back, (x[0] - joints[p, 0], x[1] - joints[p, 1], x[2] - joints[p, 2]))
            if len(aims) > 0:
                x = (offsets[j, 0], offsets[j, 1], offsets[j, 2])
        _put(i, j, x, q, fps, positions, rotations, velocities, angular)
    half = c.root[2] / 2
    x, q = (c.root[0], c.height, c.root[1]), (math.cos(half), 0.0, math.sin(half), 0.0)
    _put(i, 0, x, q, fps, positions, rotations, velocities, angular)
    c.shown[0], c.shown[1], c.shown[2], c.shown_height = c.root[0], c.root[1], c.root[2], c.height


@_jit
def _keep_lengths(parents, offsets, aims, joints, turned, places):
    """Turn joints, rotations turned [J, 4], for their aims; places [J, 3] become where they are then."""
    for j in range(1, len(parents)):
        p, here = parents[j] - 1, _vector(joints[j - 1])
        if p >= 0:
            away = rotate(_quaternion(turned[p]), _vector(offsets[j]))
            here = (places[p, 0] + away[0], places[p, 1] + away[1], places[p, 2] + away[2])
        for a in range(3):
            places[j - 1, a] = here[a]
        end, far = aims[j]
        if end < 0:
            continue
        bone = _vector(offsets[end])
        way = _minus(_vector(joints[end - 1]), here)
        if far >= 0:
            reach = _minus(_vector(joints[far - 1]), here)
            way = _bent(way, reach, dot(bone, bone), dot(_vector(offsets[far]), _vector(offsets[far])))
        if dot(way, way) > POINT:
            q = _quaternion(turned[j - 1])
            q = mul(between(rotate(q, bone), way), q)
            for a in range(4):
                turned[j - 1, a] = q[a]


@_jit
def _bent(way, reach, first, second):
    """The way of the first of two bones of squared lengths first and second that end at reach: on the side
    of its way so far, and not much further aside, where straight bones would bend this way and that."""
    d = math.sqrt(max(dot(reach, reach), POINT))
    along = dot(way, reach) / (d * d)
    aside = (way[0] - along * reach[0], way[1] - along * reach[1], way[2] - along * reach[2])
    width = math.sqrt(dot(aside, aside))
    if width < POINT:
        return way
    # The law of cosines: what of the first bone lies along reach.
    part = (first + d * d - second) / (2 * d)
    height = min(math.sqrt(max(first - part * part, 0.0)), width + BEND)
    part = math.copysign(math.sqrt(first - height * height), part)
    u, w = part / d, height / width
    return u * reach[0] + w * aside[0], u * reach[1] + w * aside[1], u * reach[2] + w * aside[2]


@_jit
def _vector(row):
    return row[0], row[1], row[2]


@_jit
def _minus(u, v):
    return u[0] - v[0], u[1] - v[1], u[2] - v[2]


@_jit
def _quaternion(row):
    return row[0], row[1], row[2], row[3]


@_jit
def _put(i, j, x, q, fps, positions, rotations, velocities, angular):
    """A joint's transform, and its rates since the one before."""
    step = log_shortest(mul(q, inv(_quaternion(rotations[i, j]))))
    for a in range(3):
        velocities[i, j, a] = (x[a] - positions[i, j, a]) * fps
        angular[i, j, a] = step[a] * fps
        positions[i, j, a] = x[a]
    for a in range(4):
        rotations[i, j, a] = q[a]


@_jit
def remember(c, frame):
    """The present as a past frame [10 or more]."""
    frame[0], frame[1] = c.root[0], c.root[1]
    frame[2], frame[3] = math.sin(c.root[2]), math.cos(c.root[2])
    for g in range(6):
        frame[4 + g] = c.gait[g]


@_jit
def _drawn(vx, vz, asked, ratio):
    """A velocity without what of it is aside of the way asked, but for what exceeds ratio times its speed."""
    along, square = vx * asked[0] + vz * asked[1], asked[0] * asked[0] + asked[1] * asked[1]
    if along <= 0 or square < NOWHERE:
        return vx, vz
    ax, az = vx - along / square * asked[0], vz - along / square * asked[1]
    aside, most = math.sqrt(ax * ax + az * az), ratio * math.sqrt(vx * vx + vz * vz)
    share = min(aside, most) / max(aside, 1e-9)
    return vx - share * ax, vz - share * az


@_jit
def move_root(c, s, vx, vz, turn_rate, obstacles):
    """Move the root on by a local velocity and a turn rate; who stands hardly moves. Returns that share."""
    going = max(1 - c.gait[0], 0.0) ** 0.25
    vx, vz = turn(vx, vz, c.root[2])
    vx, vz = _drawn(vx, vz, c.target_velocity, s.adjustment_ratio)
    x, z = c.root[0] + going * vx * s.dt, c.root[1] + going * vz * s.dt
    x, z = push_out(x, z, obstacles, s.body_radius)
    c.velocity[0], c.velocity[1] = (x - c.root[0]) / s.dt, (z - c.root[1]) / s.dt
    c.root[0], c.root[1] = x, z
    c.root[2] = springs.wrap(c.root[2] + going * turn_rate * s.dt)
    return going
