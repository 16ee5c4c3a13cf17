"""Numbers and curves of a passage, by role, so that skeletons, units and rates do not matter.

Angles are degrees, as clinical gait analysis names them: flexion is positive, a straight leg that hangs and a
foot flat on the ground under it are 0. The sagittal plane is that of the mean facing over the passage (of a
cycle: of the line from its first facing to its last, so that turning is not taken for rotation). Lengths that
scale with the body are per cent of the leg. ``near`` is the side whose foot strikes at the cycle's beginning,
``far`` the other; cycles of both sides count, those of the right mirrored.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mm import metrics
from motion import kinematics, quat

from . import body as bodies
from .body import Body
from .moves import Passage

Array = NDArray[np.floating]

POINTS = 101  # of a curve over the cycle, 0 to 100 per cent
BANDS = (0, 1, 2, 4, 8, 15, 30)  # Hz
JOINTS = ("hips", "chest", "head", "leg", "foot", "toe", "arm", "forearm", "hand")  # both sides together
JOINT_NAMES = {"leg": "knee", "foot": "ankle", "arm": "shoulder", "forearm": "elbow", "hand": "wrist"}
STIFF = 0.5  # degrees: a toe that bends less in all of a clip was not captured
PLANTED = (0.35, 0.7)  # share of a stance in which the toe is planted: foot flat to heel off


CURVES: dict[str, str] = {
    "hip": "hip flexion, thigh to vertical, °",
    "knee": "knee flexion, °",
    "ankle": "ankle dorsiflexion, °",
    "foot": "foot pitch, toes up, °",
    "toe": "toe extension, °",
    "hip_abduction": "hip abduction, °",
    "pelvis_tilt": "pelvis tilt, forward, °",
    "pelvis_obliquity": "pelvis obliquity, near side up, °",
    "pelvis_rotation": "pelvis rotation, near side ahead, °",
    "thorax_rotation": "thorax rotation, near side ahead, °",
    "trunk_lean": "trunk lean, forward, °",
    "trunk_side": "trunk lean, to the near side, °",
    "shoulder": "shoulder flexion, arm to vertical, °",
    "elbow": "elbow flexion, °",
    "head_pitch": "head pitch, down, °",
    "head_roll": "head roll, to the far side, °",
    "pelvis_height": "pelvis height, % leg",
    "pelvis_side": "pelvis to the near side, % leg",
    "head_height": "head height, % leg",
}


@dataclass(eq=False)
class Gauge:
    """What is told of a whole body once: joint angles against a mean, velocities by band, jerk.

    Zero of pelvis, thorax and head is their mean over the clip, against where the hips face: rigs disagree on
    a neutral pose, so that of these only ranges compare. Zero of foot and toe is the foot flat on the ground.
    """

    body: Body
    offsets: dict[str, Array]
    soles: dict[str, Array]
    bands: dict[str, Array]
    jerks: dict[str, Array]

    @staticmethod
    def of(body: Body) -> Gauge:
        facing = quat.inv(quat.from_yaw(body.heading))
        offsets = {
            role: bodies.turned_mean(quat.mul(facing, body.turned(role)))
            for role in ("hips", "chest", "head")
            if body.has(role)
        }
        soles: dict[str, Array] = {}
        for side in bodies.SIDES:
            soles |= _soles(body, side)
        bands, jerks = {}, {}
        for role in _joints(body):
            velocity = kinematics.velocities(body.at(role), body.fps)
            bands[role] = split(velocity, body.fps, BANDS)
            third = np.linalg.norm(np.diff(body.at(role), n=3, axis=0), axis=-1) * body.fps**3
            jerks[role] = np.concatenate([third[:1], third[:1], third, third[-1:]])
        return Gauge(body, offsets, soles, bands, jerks)


def split(values: Array, fps: float, bands: tuple[float, ...]) -> Array:
    """Values [T, ...] split by frequency, [B, T, ...]; bands are B + 1 edges in Hz.

    By the discrete Fourier transform of the signal continued at both ends by its point reflection, which has
    neither a jump nor a kink there. Edges belong to the band above, the last to the one below; what lies
    outside of them is lost.
    """
    count = len(values)
    left, right = 2 * values[:1] - values[:0:-1], 2 * values[-1:] - values[-2::-1]
    longer = np.concatenate([left, values, right])
    spectrum = np.fft.rfft(longer, axis=0)
    frequency = np.fft.rfftfreq(len(longer), 1 / fps)
    out = np.empty((len(bands) - 1, *values.shape))
    for i, (low, high) in enumerate(pairwise(bands)):
        keep = (frequency >= low) & ((frequency < high) | (high == bands[-1]) & (frequency == high))
        part = spectrum * keep.reshape(-1, *[1] * (values.ndim - 1))
        out[i] = np.fft.irfft(part, len(longer), axis=0)[count - 1 : 2 * count - 1]
    return out


def curves(gauge: Gauge, passage: Passage) -> dict[str, Array]:
    """The `CURVES` of a passage [n + 1] at its own frames, a cycle's last included."""
    body, near = gauge.body, passage.side or "left"
    far = "right" if near == "left" else "left"
    sign = 1.0 if near == "left" else -1.0
    frames = slice(passage.start, min(passage.stop + 1, len(body)))
    heading = _heading(body, passage, frames)
    forward = np.stack([np.sin(heading), 0 * heading, np.cos(heading)], axis=-1)
    aside = sign * np.stack([np.cos(heading), 0 * heading, -np.sin(heading)], axis=-1)
    out: dict[str, Array] = {}

    def between(upper: str, lower: str) -> Array:
        return body.at(lower)[frames] - body.at(upper)[frames]

    thigh = between(f"{near}_up_leg", f"{near}_leg")
    shank = between(f"{near}_leg", f"{near}_foot")
    out["hip"] = _lean(thigh, forward)
    out["hip_abduction"] = _aside(thigh, aside)
    out["knee"] = angle(thigh, shank)
    if f"{near}_foot" in gauge.soles:
        out["foot"] = _pitch(body, gauge, f"{near}_foot", frames)
        out["ankle"] = out["foot"] + _lean(-shank * [1, -1, 1], forward)
        if f"{near}_toe" in gauge.soles:  # not where it was not captured
            out["toe"] = _pitch(body, gauge, f"{near}_toe", frames) - out["foot"]

    across = body.at("left_up_leg")[frames] - body.at("right_up_leg")[frames]
    out["pelvis_obliquity"] = sign * np.degrees(
        np.arctan2(across[:, 1], np.hypot(across[:, 0], across[:, 2]))
    )
    out["pelvis_rotation"] = -sign * np.degrees(metrics.wrap(body.yaw[frames] - heading))
    facing = quat.inv(quat.from_yaw(heading))
    for role, names in (
        ("hips", {"pelvis_tilt": (1, 1.0)}),
        ("chest", {"thorax_rotation": (0, -sign)}),
        ("head", {"head_pitch": (1, 1.0), "head_roll": (2, sign)}),
    ):
        if role in gauge.offsets:
            turned = quat.mul(quat.mul(facing, body.turned(role)[frames]), quat.inv(gauge.offsets[role]))
            euler = np.degrees(quat.to_euler(turned, "yxz"))
            out |= {name: factor * euler[:, axis] for name, (axis, factor) in names.items()}
    top = next((role for role in ("neck", "chest", "head") if body.has(role)), None)
    if top is not None:
        trunk = between("hips", top) * [1, -1, 1]
        out["trunk_lean"], out["trunk_side"] = _lean(trunk, forward), _aside(trunk, aside)
    if body.has(f"{near}_arm", f"{near}_forearm"):
        upper = between(f"{near}_arm", f"{near}_forearm")
        out["shoulder"] = _lean(upper, forward)
        if body.has(f"{near}_hand"):
            out["elbow"] = angle(upper, between(f"{near}_forearm", f"{near}_hand"))
    hips = body.at("hips")[frames]
    out["pelvis_height"] = 100 * (hips[:, 1] - hips[:, 1].mean()) / body.leg
    out["pelvis_side"] = 100 * _sideways(body, passage, frames) * sign / body.leg
    if body.has("head"):
        height = body.at("head")[frames][:, 1]
        out["head_height"] = 100 * (height - height.mean()) / body.leg
    # What the other side's leg does is needed for the phase of the arm.
    out["_far_hip"] = _lean(between(f"{far}_up_leg", f"{far}_leg"), forward)
    return out


def over_cycle(curve: Array) -> Array:
    """A curve at its own frames, at 0 to 100 per cent of the cycle [101]."""
    return np.interp(np.linspace(0, len(curve) - 1, POINTS), np.arange(len(curve)), curve)


def measure(gauge: Gauge, passage: Passage) -> dict[str, tuple[float, str]]:
    """All numbers of a passage: name to value and unit; what cannot be told is left out."""
    body, found = gauge.body, curves(gauge, passage)
    out: dict[str, tuple[float, str]] = {"speed": (passage.speed, "m/s"), "turn": (abs(passage.turn), "°/s")}
    if passage.side:
        out |= _gait(gauge, passage, found)
    for name, curve in found.items():
        if name.startswith("_"):
            continue
        unit = "% leg" if CURVES[name].endswith("% leg") else "°"
        out[f"{name} range"] = (float(np.ptp(curve)), unit)
        if name in ("hip", "knee", "ankle", "foot", "toe"):
            out[f"{name} max"] = (float(curve.max()), unit)
            out[f"{name} min"] = (float(curve.min()), unit)
        elif name in ("trunk_lean", "shoulder", "elbow", "hip_abduction"):
            out[f"{name} mean"] = (float(curve.mean()), unit)
    out |= _feet(body, passage)
    frames = slice(passage.start, passage.stop)
    for joint, roles in _grouped(body).items():
        name = JOINT_NAMES.get(joint, joint)
        rms = np.sqrt(np.mean([np.mean(gauge.jerks[role][frames] ** 2) for role in roles]))
        out[f"{name} jerk"] = (float(rms), "m/s³")
        for i, (low, high) in enumerate(pairwise(BANDS)):
            if high <= body.band + 1e-9:
                power = np.mean([np.var(gauge.bands[role][i, frames], axis=0).sum() for role in roles])
                out[f"{name} {low}-{high} Hz"] = (float(np.sqrt(power)), "m/s")
    return {name: (value, unit) for name, (value, unit) in out.items() if np.isfinite(value)}


def _gait(gauge: Gauge, passage: Passage, found: dict[str, Array]) -> dict[str, tuple[float, str]]:
    """What only a cycle has: cadence, stride, step width, duty, phases."""
    body, near = gauge.body, passage.side
    side = bodies.SIDES.index(near)
    frames = slice(passage.start, passage.stop)
    stands = body.stands[frames]
    stride = passage.speed * passage.seconds
    out = {
        "cadence": (120 / passage.seconds, "steps/min"),
        "stride": (stride, "m"),
        "duty": (100 * float(stands[:, side].mean()), "%"),
        "double support": (100 * float(stands.all(axis=1).mean()), "%"),
        "flight": (100 * float((~stands.any(axis=1)).mean()), "%"),
        "step width": (100 * _step_width(body, passage) / body.leg, "% leg"),
        "foot lift": (100 * _lift(body, passage, f"{near}_foot", np.max) / body.leg, "% leg"),
        "toe clearance": (100 * _clearance(body, passage), "cm"),
        "toe out": (_toe_out(body, passage), "°"),
        "knee in loading": (float(over_cycle(found["knee"])[5:31].max()), "°"),
    }
    if "foot" in found:
        out["foot at strike"] = (float(found["foot"][0]), "°")
    if "thorax_rotation" in found:
        turned = found["thorax_rotation"] - found["pelvis_rotation"]
        out["thorax against pelvis range"] = (float(np.ptp(turned)), "°")
        late = _lag(found["thorax_rotation"], found["pelvis_rotation"])
        out["thorax phase to pelvis"] = (abs(late), "°")
    if "shoulder" in found:
        out["arm phase to far leg"] = (_lag(found["shoulder"], found["_far_hip"]), "°")
    return out


def _lag(curve: Array, reference: Array) -> float:
    """By how many degrees of the cycle a curve's first harmonic lags behind another's, in [-180, 180)."""
    one, two = (np.fft.rfft(over_cycle(c)[:-1])[1] for c in (curve, reference))
    return float(np.degrees(metrics.wrap(np.angle(two) - np.angle(one))))


def angle(u: Array, v: Array) -> Array:
    """Degrees [T] between vectors u and v [T, 3]."""
    cross = np.linalg.norm(np.cross(u, v), axis=-1)
    return np.degrees(np.arctan2(cross, np.sum(u * v, axis=-1)))


def _lean(down: Array, direction: Array) -> Array:
    """Degrees [T] by which what points down [T, 3] swings towards a level direction [T, 3]."""
    return np.degrees(np.arctan2(np.sum(down * direction, axis=-1), -down[:, 1]))


def _aside(limb: Array, direction: Array) -> Array:
    """Degrees [T] by which a limb [T, 3] leaves the plane that a level direction [T, 3] stands upright on."""
    share = np.sum(limb * direction, axis=-1) / np.maximum(np.linalg.norm(limb, axis=-1), 1e-9)
    return np.degrees(np.arcsin(np.clip(share, -1, 1)))


def _heading(body: Body, passage: Passage, frames: slice) -> Array:
    """The facing that angles refer to: of a cycle the straight line through it, else its average."""
    if not passage.side:
        return body.heading[frames]
    yaw = body.yaw[frames]
    line = np.linspace(yaw[0], yaw[-1], len(yaw))
    return line + np.mean(yaw - line)


def _sideways(body: Body, passage: Passage, frames: slice) -> Array:
    """Metres [T] that the hips are left of the way they go.

    Of a cycle that is the line between its ends, where the phase is the same, or an arc that turns as the
    body does: v t w / 2 (T - t) beside the chord. Of other passages the line of the mean facing.
    """
    path = body.path[frames]
    time = np.arange(len(path)) / body.fps
    if passage.side:
        way = path[-1] - path[0]
        arc = np.radians(passage.turn) * passage.speed / 2 * time * (time[-1] - time)
    else:
        mean = body.heading[frames].mean()
        way, arc = np.array([np.sin(mean), np.cos(mean)]), 0.0
    way = way / max(float(np.linalg.norm(way)), 1e-9)
    left = (path - path[0]) @ np.array([way[1], -way[0]]) + arc
    return left - left.mean()


def _soles(body: Body, side: str) -> dict[str, Array]:
    """In the frames of foot and toe joints, the direction [3] that is level and ahead when the foot is flat.

    The foot is flat in the quietest tenth of the frames in which it stands.
    """
    stands = np.flatnonzero(body.stands[:, bodies.SIDES.index(side)])
    if len(stands) == 0:
        return {}
    foot, toe = f"{side}_foot", body.toe(side)
    rates = [np.linalg.norm(kinematics.velocities(body.at(role), body.fps), axis=-1) for role in (foot, toe)]
    quiet = np.maximum(*rates)[stands]
    flat = stands[quiet <= np.quantile(quiet, 0.1)]
    if toe == foot:
        ahead = np.stack([np.sin(body.yaw[flat]), 0 * body.yaw[flat], np.cos(body.yaw[flat])], axis=-1)
    else:
        ahead = (body.at(toe) - body.at(foot))[flat] * [1, 0, 1]
    out = {}
    local = body.clip.rotations[:, body.skeleton.role(toe)]
    bends = np.degrees(quat.angle_between(local, local[:1])).max() > STIFF
    for role in dict.fromkeys((foot, toe) if bends else (foot,)):
        inside = quat.rotate(quat.inv(body.turned(role)[flat]), ahead).mean(axis=0)
        if np.linalg.norm(inside) > 0:
            out[role] = inside / np.linalg.norm(inside)
    return out


def _pitch(body: Body, gauge: Gauge, role: str, frames: slice) -> Array:
    """Degrees [T] that a sole points up."""
    turned = body.turned(role)[frames]
    ahead = quat.rotate(turned, np.broadcast_to(gauge.soles[role], (len(turned), 3)))
    return np.degrees(np.arcsin(np.clip(ahead[:, 1], -1, 1)))


def _feet(body: Body, passage: Passage) -> dict[str, tuple[float, str]]:
    """How feet keep to the ground: skate, what a planted toe moves, how far they go below where they rest."""
    frames = slice(passage.start, min(passage.stop + 1, len(body)))
    toes = np.stack([body.at(body.toe(side))[frames] for side in bodies.SIDES], axis=1)
    ankles = np.stack([body.at(f"{side}_foot")[frames] for side in bodies.SIDES], axis=1)
    out = {"foot skate": (metrics.foot_skate(toes, body.fps, body.rest[2:]), "cm/s")}
    moved = 1000 * np.linalg.norm(np.diff(toes[..., [0, 2]], axis=0), axis=-1)
    planted = _planted(body)[frames]
    planted = planted[1:] & planted[:-1]
    if planted.any():
        out["planted toe moves"] = (float(np.median(moved[planted])), "mm/frame")
        out["planted toe moves p95"] = (float(np.percentile(moved[planted], 95)), "mm/frame")
    depths = np.concatenate([body.rest[:2] - ankles[..., 1], body.rest[2:] - toes[..., 1]])
    out["foot below its rest"] = (float(np.clip(100 * depths.max(), 0, None)), "cm")
    out["foot below y = 0"] = (
        float(np.clip(-100 * min(ankles[..., 1].min(), toes[..., 1].min()), 0, None)),
        "cm",
    )
    return out


def _planted(body: Body) -> NDArray[np.bool_]:
    """Where toes are planted, bool [T, 2]: the middle of every whole stance."""
    from .moves import runs

    out = np.zeros_like(body.stands)
    for side in (0, 1):
        for start, stop in runs(body.stands[:, side]):
            if start > 0 and stop < len(body):
                first, last = (round(start + share * (stop - start)) for share in PLANTED)
                out[first : last + 1, side] = True
    return out


def _step_width(body: Body, passage: Passage) -> float:
    """Metres between where the feet stand, across the way of the hips; NaN unless both stand."""
    frames = slice(passage.start, passage.stop)
    way = body.path[passage.stop] - body.path[passage.start]
    way = way / max(np.linalg.norm(way), 1e-9)
    places = []
    for i, side in enumerate(bodies.SIDES):
        stands = body.stands[frames, i]
        if not stands.any():
            return float("nan")
        ankle = body.at(f"{side}_foot")[frames][:, [0, 2]]
        if abs(passage.turn) > 5:
            ankle = ankle - body.path[frames]  # on an arc the feet are told from the body as it passes
        places.append(np.median(ankle[stands] @ np.array([way[1], -way[0]])))
    return float(places[0] - places[1])


def _lift(body: Body, passage: Passage, role: str, what: Callable) -> float:
    side = bodies.SIDES.index(passage.side)
    return float(what(body.at(role)[passage.start : passage.stop, 1]) - body.rest[side])


def _clearance(body: Body, passage: Passage) -> float:
    """Metres by which the toe clears its rest where it is lowest in the middle of its swing; NaN without."""
    side = bodies.SIDES.index(passage.side)
    swing = np.flatnonzero(~body.stands[passage.start : passage.stop, side])
    if len(swing) < 5:
        return float("nan")
    first, last = swing[0] + len(swing) // 3, swing[0] + 5 * len(swing) // 6
    toe = body.at(body.toe(passage.side))[passage.start + first : passage.start + last, 1]
    return float(toe.min() - body.rest[2 + side]) if len(toe) else float("nan")


def _toe_out(body: Body, passage: Passage) -> float:
    """Degrees by which the standing foot points outwards of the facing; NaN without a toe."""
    if body.toe(passage.side).endswith("foot"):
        return float("nan")
    frames = slice(passage.start, passage.stop)
    planted = _planted(body)[frames, bodies.SIDES.index(passage.side)]
    if not planted.any():
        return float("nan")
    foot = (body.at(body.toe(passage.side)) - body.at(f"{passage.side}_foot"))[frames][planted]
    heading = _heading(body, passage, slice(passage.start, passage.stop))[planted]
    out = metrics.wrap(np.arctan2(foot[:, 0], foot[:, 2]) - heading)
    return float(np.degrees(np.mean(out))) * (1 if passage.side == "left" else -1)


def _joints(body: Body) -> list[str]:
    return [role for roles in _grouped(body).values() for role in roles]


def _grouped(body: Body) -> dict[str, list[str]]:
    """`JOINTS` that the body has, to the roles that stand for them."""
    groups = {
        j: [j] if j in ("hips", "chest", "head") else [f"{s}_{j}" for s in bodies.SIDES] for j in JOINTS
    }
    return {joint: roles for joint, roles in groups.items() if body.has(*roles)}
