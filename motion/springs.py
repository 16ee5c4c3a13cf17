"""Critically damped springs in closed form, parameterised by half-life (REFERENCE 2.5).

Every function is plain arithmetic: it takes NumPy arrays, and scalars inside compiled kernels, alike.
Half-lives and dt are in seconds. x and v stand for any quantity and its rate.
"""

from __future__ import annotations

import numpy as np
from numba.extending import register_jitable

LN2 = 0.6931471805599453
# Keeps a half-life of zero (an immediate response) finite.
TINY = 1e-5


@register_jitable
def half_damping(halflife):
    """y = 2 ln2 / halflife, half of the damping of a critically damped spring [1/s]."""
    return 2 * LN2 / (halflife + TINY)


@register_jitable
def decay(x, v, halflife, dt):
    """Spring towards zero: an inertialization offset after dt. Returns (x, v)."""
    y = half_damping(halflife)
    j = v + y * x
    e = np.exp(-y * dt)
    return e * (x + j * dt), e * (v - y * j * dt)


@register_jitable
def damp(x, v, goal, halflife, dt):
    """Spring towards goal. Returns (x, v)."""
    offset, v = decay(x - goal, v, halflife, dt)
    return offset + goal, v


@register_jitable
def simulate(x, v, a, desired, halflife, dt):
    """A simulated character whose velocity v and acceleration a chase the desired velocity.

    Returns (x, v, a).
    """
    y = half_damping(halflife)
    j0 = v - desired
    j1 = a + y * j0
    e = np.exp(-y * dt)
    moved = e * (-j1 / (y * y) + (-j0 - j1 * dt) / y) + j1 / (y * y) + j0 / y + desired * dt
    return x + moved, e * (j0 + j1 * dt) + desired, e * (a - y * j1 * dt)


@register_jitable
def damper(x, goal, halflife, dt):
    """Exact exponential approach: half of the way every half-life. Returns x."""
    return x + (goal - x) * (1 - np.exp(-LN2 * dt / (halflife + TINY)))


@register_jitable
def wrap(angle):
    """The same angle in [-pi, pi)."""
    return angle - 2 * np.pi * np.floor((angle + np.pi) / (2 * np.pi))


def transition_cost(x, v, halflife):
    """Area under a decaying offset's absolute value, per component (REFERENCE 2.5), in x times seconds.

    The integral of x(t) over [0, inf) is (2 y x + v) / y^2. Where the offset crosses zero, at
    t = -x / (v + y x), the two parts are added without their signs.
    """
    x, v = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(v, np.float64))
    y = half_damping(halflife)
    whole = (2 * y * x + v) / (y * y)
    j = v + y * x
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = np.where(j != 0, -x / np.where(j != 0, j, 1), -1.0)
    crosses = crossing > 0
    x_c, v_c = decay(x, v, halflife, np.where(crosses, crossing, 0.0))
    after = (2 * y * x_c + v_c) / (y * y)
    return np.where(crosses, np.abs(whole - after) + np.abs(after), np.abs(whole))
