"""The controller's hot loops, compiled; `mm.kernels_numpy` is the obvious twin of every function here.

Arrays: N characters, J joints, K trajectory samples, C feet. A pose is four arrays (positions [.., J, 3],
rotations [.., J, 4], velocities [.., J, 3], angular velocities [.., J, 3]), local. In a pose that comes out
of Decompression, joint 0 holds the root's motion: its displacement and turn since the previous frame in the
previous root's space, its velocity and angular velocity in its own space.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from motion import springs
from motion.quat_scalar import exp, inv, log_shortest, mul, rotate

from .search.rows import row_cost, terms_cost

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")


@_jit
def turn(x, z, yaw):
    """Rotate a ground vector about the vertical: yaw 0 keeps it, pi/2 turns +Z to +X."""
    c, s = math.cos(yaw), math.sin(yaw)
    return c * x + s * z, c * z - s * x


@_jit
def push_out(x, z, obstacles, distance):
    """The nearest point outside every obstacle (rows: x, z, half widths x, z, radius) by distance."""
    for k in range(len(obstacles)):
        ox, oz, hx, hz, radius = obstacles[k]
        reach = radius + distance
        dx, dz = x - ox, z - oz
        ex, ez = abs(dx) - hx, abs(dz) - hz
        sx, sz = 1.0 if dx >= 0 else -1.0, 1.0 if dz >= 0 else -1.0
        if ex <= 0 and ez <= 0:
            # Inside the box: leave through the nearest side.
            if ex > ez:
                x = ox + sx * (hx + reach)
            else:
                z = oz + sz * (hz + reach)
            continue
        ex, ez = max(ex, 0.0), max(ez, 0.0)
        gap = math.sqrt(ex * ex + ez * ez)
        if gap < reach:
            x = x + sx * ex / gap * (reach - gap)
            z = z + sz * ez / gap * (reach - gap)
    return x, z


@_jit
def _chase(x, z, vx, vz, ax, az, yaw, yaw_rate, dvx, dvz, dyaw, velocity_halflife, rotation_halflife, dt):
    """One update of a simulated object towards a desired velocity and facing."""
    x, vx, ax = springs.simulate(x, vx, ax, dvx, velocity_halflife, dt)
    z, vz, az = springs.simulate(z, vz, az, dvz, velocity_halflife, dt)
    offset, yaw_rate = springs.decay(springs.wrap(yaw - dyaw), yaw_rate, rotation_halflife, dt)
    return x, z, vx, vz, ax, az, dyaw + offset, yaw_rate


@_jit
def control(characters, velocity, yaw, turn_rate, required_tags, forbidden_tags, ended, settings, obstacles,
            times, slots, trajectory, who):  # fmt: skip
    """Take commands in, decide who searches, and predict the trajectory at future times.

    velocity [N, 2], yaw, turn_rate, tags [N]: see `mm.control.Command`; ended [N], whose data ends here;
    times [F] ascending seconds and their slots [F] in trajectory [N, K, 3] (x, z, yaw in the world), which
    is written. Returns the first character whose command is not finite, before which nothing was done, or
    -1; and how many search, who stand first in who [N].
    """
    s = settings[0]
    dt = s.dt
    for i in range(len(characters)):
        if not math.isfinite(velocity[i, 0] + velocity[i, 1] + yaw[i] + turn_rate[i]):
            return i, 0
    count = 0
    for i in range(len(characters)):
        c = characters[i]
        dx, dz = velocity[i, 0] - c.desired_velocity[0], velocity[i, 1] - c.desired_velocity[1]
        # Tags are bits; a change of theirs is as abrupt as can be.
        retagged = c.required_tags != required_tags[i] or c.forbidden_tags != forbidden_tags[i]
        c.required_tags, c.forbidden_tags = required_tags[i], forbidden_tags[i]
        velocity_change = math.sqrt(dx * dx + dz * dz)
        yaw_change = abs(springs.wrap(yaw[i] - c.desired_yaw))
        limit = s.forced_search_change
        settled = (c.velocity_change >= limit and velocity_change < limit) or (
            c.yaw_change >= limit and yaw_change < limit
        )
        # Half a frame of tolerance: timers count whole frames, whatever the rounding.
        c.forced = retagged or (settled and c.until_forced < dt / 2)
        c.until_forced = s.search_interval if c.forced else c.until_forced - dt
        c.until_back -= dt
        c.searching = c.forced or ended[i] or c.until_search < dt / 2
        c.until_search = (s.search_interval if c.searching else c.until_search) - dt
        if c.searching:
            who[count] = i
            count += 1
        c.velocity_change, c.yaw_change = velocity_change, yaw_change
        c.desired_velocity[0], c.desired_velocity[1] = velocity[i, 0], velocity[i, 1]
        c.desired_yaw = yaw[i]

        x, z = c.position[0], c.position[1]
        vx, vz = c.velocity[0], c.velocity[1]
        ax, az = c.acceleration[0], c.acceleration[1]
        angle, rate = c.yaw, c.yaw_rate
        before = 0.0
        for k in range(len(times)):
            turned = turn_rate[i] * times[k]
            dvx, dvz = turn(velocity[i, 0], velocity[i, 1], turned)
            x, z, vx, vz, ax, az, angle, rate = _chase(
                x, z, vx, vz, ax, az, angle, rate, dvx, dvz, yaw[i] + turned,
                s.velocity_halflife, s.rotation_halflife, times[k] - before,
            )  # fmt: skip
            x, z = push_out(x, z, obstacles, s.body_radius)
            before = times[k]
            trajectory[i, slots[k], 0] = x
            trajectory[i, slots[k], 1] = z
            trajectory[i, slots[k], 2] = angle
    return -1, count


@_jit
def remember(characters, history, head, frames, slots, present, trajectory):
    """Write roots to history [N, H, 3], at the head of its ring, and past samples to trajectory [N, K, 3].

    frames [P]: how long ago the samples of slots [P] were; present: slots of samples of now.
    """
    for i in range(len(characters)):
        ring, root = history[i], characters[i].root
        for a in range(3):
            ring[head, a] = root[a]
        for k in range(len(frames)):
            whole = int(frames[k])
            part = frames[k] - whole
            later, earlier = ring[(head - whole) % len(ring)], ring[(head - whole - 1) % len(ring)]
            sample = trajectory[i, slots[k]]
            for a in range(2):
                sample[a] = later[a] + part * (earlier[a] - later[a])
            sample[2] = later[2] + part * springs.wrap(earlier[2] - later[2])
        for k in present:
            for a in range(3):
                trajectory[i, k, a] = root[a]


@_jit
def divide(flags, tag, required, forbidden, to_require, to_forbid):
    """Tags [N] to require and to forbid: tag by flags [N], unless it is asked for or forbidden already."""
    for n in range(len(flags)):
        to_require[n], to_forbid[n] = required[n], forbidden[n]
        if flags[n]:
            to_require[n] |= tag & ~forbidden[n]
        else:
            to_forbid[n] |= tag & ~required[n]


@_jit
def build_queries(
    characters, who, features, trajectory, position_columns, direction_columns, offset, scale, queries
):
    """Queries [M, F] of characters who [M]: the current features with the trajectory columns replaced.

    features [M, F] are normalised, of the data frames that play; trajectory [N, K, 3] is in the world and
    goes into the shown root's frame; columns [K] are -1 where a sample has no such feature.
    """
    for m in range(len(who)):
        root = characters[who[m]].root
        for f in range(features.shape[1]):
            queries[m, f] = features[m, f]
        for k in range(trajectory.shape[1]):
            x, z, yaw = trajectory[who[m], k]
            column = position_columns[k]
            if column >= 0:
                lx, lz = turn(x - root[0], z - root[1], -root[2])
                queries[m, column] = (lx - offset[column]) / scale[column]
                queries[m, column + 1] = (lz - offset[column + 1]) / scale[column + 1]
            column = direction_columns[k]
            if column >= 0:
                dx, dz = math.sin(yaw - root[2]), math.cos(yaw - root[2])
                queries[m, column] = (dx - offset[column]) / scale[column]
                queries[m, column + 1] = (dz - offset[column + 1]) / scale[column + 1]


@_jit
def ask(
    characters, who, features, tags, required, forbidden, ended, trajectory,
    position_columns, direction_columns, offset, scale, terms, share,
    queries, needed, avoided, forced, costs, bounds,
):  # fmt: skip
    """What characters who [M] search for, into the last six arrays [M, ..].

    features [M, F] and tags [M] are of what plays. Queries are those of `build_queries`; tags needed and
    avoided those required and forbidden [N] of them. Forced is who cannot play on, since the clip has ended
    [N] or does not bear those tags; costs are what playing on costs (by terms, see `mm.search.terms`),
    infinite for the forced, and bounds a share of them.
    """
    build_queries(
        characters, who, features, trajectory, position_columns, direction_columns, offset, scale, queries
    )
    for m in range(len(who)):
        i, query, row = who[m], queries[m], features[m]
        needed[m], avoided[m] = required[i], forbidden[i]
        forced[m] = ended[i] or (needed[m] & ~tags[m]) != 0 or (avoided[m] & tags[m]) != 0
        cost = row_cost(query, row) if terms is None else terms_cost(query, row, terms)
        costs[m] = np.inf if forced[m] else cost
        bounds[m] = costs[m] * share


@_jit
def turn_back(characters, who, frames, forced, radius, dt, found):
    """Keep characters who [M] from jumping to frames [M] that they left a moment ago.

    What is found [M] is so no more within a radius of such a frame, unless who found it is forced [M] to go
    on elsewhere; frames of -1 are none.
    """
    for m in range(len(who)):
        c, frame = characters[who[m]], frames[m]
        near = frame >= 0 and c.left >= 0 and abs(frame - c.left) < radius
        if near and c.until_back > dt / 2 and not forced[m]:
            found[m] = False


@_jit
def transition(who, characters, positions, rotations, velocities, angular, offsets,
               to_positions, to_rotations, to_velocities, to_angular):  # fmt: skip
    """Record the differences of a jump: characters who [M] go from the pose shown to another one [M, J, ..].

    offsets [N, J, 4, 3]: position, rotation (scaled angle axis), velocity, angular velocity of
    shown minus destination, rotation shown * inverse(destination) on the short side. The root starts where
    it is shown, so only its velocity differs.
    """
    for m in range(len(who)):
        i = who[m]
        c = characters[i]
        for j in range(1, positions.shape[1]):
            q = mul(
                (rotations[i, j, 0], rotations[i, j, 1], rotations[i, j, 2], rotations[i, j, 3]),
                inv(
                    (
                        to_rotations[m, j, 0],
                        to_rotations[m, j, 1],
                        to_rotations[m, j, 2],
                        to_rotations[m, j, 3],
                    )
                ),
            )
            v = log_shortest(q)
            for a in range(3):
                offsets[i, j, 0, a] = positions[i, j, a] - to_positions[m, j, a]
                offsets[i, j, 1, a] = v[a]
                offsets[i, j, 2, a] = velocities[i, j, a] - to_velocities[m, j, a]
                offsets[i, j, 3, a] = angular[i, j, a] - to_angular[m, j, a]
        vx, vz = turn(to_velocities[m, 0, 0], to_velocities[m, 0, 2], c.root[2])
        for a in range(3):
            c.data_root[a] = c.root[a]
            c.root_offset[a] = 0
        c.root_offset_rate[0] = c.root_rate[0] - vx
        c.root_offset_rate[1] = c.root_rate[1] - vz
        c.root_offset_rate[2] = c.root_rate[2] - to_angular[m, 0, 1]


@_jit
def inertialize(characters, settings, offsets, from_positions, from_rotations, from_velocities, from_angular,
                positions, rotations, velocities, angular):  # fmt: skip
    """Decay the offsets by one frame and add them to the data's pose, which gives the pose shown.

    The data's root motion moves the root through the world.
    """
    dt = settings[0].dt
    y = springs.half_damping(settings[0].inertialization_halflife)
    e = math.exp(-y * dt)
    for i in range(len(characters)):
        c = characters[i]
        dx, dz = turn(from_positions[i, 0, 0], from_positions[i, 0, 2], c.data_root[2])
        c.data_root[0] += dx
        c.data_root[1] += dz
        turned = 2 * math.atan2(from_rotations[i, 0, 2], from_rotations[i, 0, 0])
        c.data_root[2] = springs.wrap(c.data_root[2] + turned)
        vx, vz = turn(from_velocities[i, 0, 0], from_velocities[i, 0, 2], c.data_root[2])
        for a in range(3):
            c.root_offset[a], c.root_offset_rate[a] = springs.decay(
                c.root_offset[a], c.root_offset_rate[a], settings[0].inertialization_halflife, dt
            )
            c.root[a] = c.data_root[a] + c.root_offset[a]
        c.root_rate[0] = vx + c.root_offset_rate[0]
        c.root_rate[1] = vz + c.root_offset_rate[1]
        c.root_rate[2] = from_angular[i, 0, 1] + c.root_offset_rate[2]

        for j in range(1, positions.shape[1]):
            for a in range(3):
                x, v = offsets[i, j, 0, a], offsets[i, j, 2, a]
                jerk = v + y * x
                x, v = e * (x + jerk * dt), e * (v - y * jerk * dt)
                offsets[i, j, 0, a], offsets[i, j, 2, a] = x, v
                positions[i, j, a] = from_positions[i, j, a] + x
                velocities[i, j, a] = from_velocities[i, j, a] + v
                x, v = offsets[i, j, 1, a], offsets[i, j, 3, a]
                jerk = v + y * x
                offsets[i, j, 1, a], offsets[i, j, 3, a] = e * (x + jerk * dt), e * (v - y * jerk * dt)
            o = exp((offsets[i, j, 1, 0], offsets[i, j, 1, 1], offsets[i, j, 1, 2]))
            q = mul(
                o,
                (
                    from_rotations[i, j, 0],
                    from_rotations[i, j, 1],
                    from_rotations[i, j, 2],
                    from_rotations[i, j, 3],
                ),
            )
            for a in range(4):
                rotations[i, j, a] = q[a]
            w = rotate(o, (from_angular[i, j, 0], from_angular[i, j, 1], from_angular[i, j, 2]))
            for a in range(3):
                angular[i, j, a] = w[a] + offsets[i, j, 3, a]


@_jit
def synchronize(characters, settings, obstacles, positions, rotations, velocities, angular):
    """Advance the simulated objects, keep the characters with them, and write joint 0 in the world."""
    s = settings[0]
    dt = s.dt
    for i in range(len(characters)):
        c = characters[i]
        x, z, vx, vz, ax, az, yaw, rate = _chase(
            c.position[0], c.position[1], c.velocity[0], c.velocity[1], c.acceleration[0], c.acceleration[1],
            c.yaw, c.yaw_rate, c.desired_velocity[0], c.desired_velocity[1], c.desired_yaw,
            s.velocity_halflife, s.rotation_halflife, dt,
        )  # fmt: skip
        x, z = push_out(x, z, obstacles, s.body_radius)
        c.velocity[0], c.velocity[1], c.acceleration[0], c.acceleration[1] = vx, vz, ax, az
        c.position[0], c.position[1], c.yaw, c.yaw_rate = x, z, springs.wrap(yaw), rate
        if s.data:
            c.position[0], c.position[1], c.yaw = c.root[0], c.root[1], c.root[2]
        mx, mz, my = 0.0, 0.0, 0.0
        if s.adjust:
            share = 1 - math.exp(-springs.LN2 * dt / (s.position_adjustment_halflife + springs.TINY))
            mx, mz = share * (c.position[0] - c.root[0]), share * (c.position[1] - c.root[1])
            length = math.sqrt(mx * mx + mz * mz)
            speed = math.sqrt(c.root_rate[0] * c.root_rate[0] + c.root_rate[1] * c.root_rate[1])
            most = s.adjustment_ratio * speed * dt
            if length > most:
                mx, mz = mx * most / length, mz * most / length
            share = 1 - math.exp(-springs.LN2 * dt / (s.rotation_adjustment_halflife + springs.TINY))
            most = s.adjustment_ratio * abs(c.root_rate[2]) * dt
            my = min(max(share * springs.wrap(c.yaw - c.root[2]), -most), most)
        if s.clamp:
            dx, dz = c.root[0] + mx - c.position[0], c.root[1] + mz - c.position[1]
            length = math.sqrt(dx * dx + dz * dz)
            if length > s.maximal_distance:
                back = s.maximal_distance / length - 1
                mx, mz = mx + back * dx, mz + back * dz
            angle = springs.wrap(c.root[2] + my - c.yaw)
            my += min(max(angle, -s.maximal_angle), s.maximal_angle) - angle
        c.data_root[0] += mx
        c.data_root[1] += mz
        c.data_root[2] = springs.wrap(c.data_root[2] + my)
        c.root[0] += mx
        c.root[1] += mz
        c.root[2] = springs.wrap(c.root[2] + my)

        positions[i, 0, 0], positions[i, 0, 1], positions[i, 0, 2] = c.root[0], 0.0, c.root[1]
        rotations[i, 0, 0], rotations[i, 0, 2] = math.cos(c.root[2] / 2), math.sin(c.root[2] / 2)
        rotations[i, 0, 1], rotations[i, 0, 3] = 0.0, 0.0
        velocities[i, 0, 0], velocities[i, 0, 1], velocities[i, 0, 2] = c.root_rate[0], 0.0, c.root_rate[1]
        angular[i, 0, 0], angular[i, 0, 1], angular[i, 0, 2] = 0.0, c.root_rate[2], 0.0


@_jit
def gather(frames, root_steps, positions, rotations, velocities, angular, contacts,
           to_positions, to_rotations, to_velocities, to_angular, to_contacts):  # fmt: skip
    """Decompression from a database: rows frames [N] of poses and contacts, joint 0 the root's motion.

    root_steps [T, 6]: displacement x, z, turn; velocity x, z, turn rate, in root space.
    """
    for i in range(len(frames)):
        f = frames[i]
        for j in range(1, positions.shape[1]):
            for a in range(3):
                to_positions[i, j, a] = positions[f, j, a]
                to_velocities[i, j, a] = velocities[f, j, a]
                to_angular[i, j, a] = angular[f, j, a]
            for a in range(4):
                to_rotations[i, j, a] = rotations[f, j, a]
        to_positions[i, 0, 0], to_positions[i, 0, 1], to_positions[i, 0, 2] = (
            root_steps[f, 0],
            0.0,
            root_steps[f, 1],
        )
        half = root_steps[f, 2] / 2
        to_rotations[i, 0, 0], to_rotations[i, 0, 1] = math.cos(half), 0.0
        to_rotations[i, 0, 2], to_rotations[i, 0, 3] = math.sin(half), 0.0
        to_velocities[i, 0, 0], to_velocities[i, 0, 1], to_velocities[i, 0, 2] = (
            root_steps[f, 3],
            0.0,
            root_steps[f, 4],
        )
        to_angular[i, 0, 0], to_angular[i, 0, 1], to_angular[i, 0, 2] = 0.0, root_steps[f, 5], 0.0
        for a in range(contacts.shape[1]):
            to_contacts[i, a] = contacts[f, a]


@_jit
def at_ends(frames, last, ended):
    """Write to ended [N] whether frames [N] are the last of their ranges; last [T] is that of each frame."""
    for n in range(len(frames)):
        ended[n] = frames[n] >= last[frames[n]]


@_jit
def play_on(frames, last):
    """Go on to the next frame, unless it is the last of its range."""
    for n in range(len(frames)):
        frames[n] = min(frames[n] + 1, last[frames[n]])
