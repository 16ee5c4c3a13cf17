"""Limbs that change their length: only possible where joints carry position channels."""

from __future__ import annotations

import numpy as np

from .body import Body
from .finding import Finding, some, spans

STRETCH, LEAST = 0.05, 0.01  # share of the bone, and metres; solvers that let bones breathe stay below


def findings(body: Body) -> list[Finding]:
    """Where bones between joints with roles are longer or shorter than they mostly are."""
    skeleton = body.skeleton
    above = set(skeleton.chain(body.hips))
    joints = sorted({j for joint in body.roles.values() for j in skeleton.chain(joint)} - above)
    if not joints:
        return []
    lengths = np.linalg.norm(body.clip.positions[:, joints], axis=-1)
    usual = np.median(lengths, axis=0)
    change = np.abs(lengths - usual)
    bad = change > np.maximum(STRETCH * usual, LEAST * body.scale)
    found = []
    for start, stop in spans(bad.any(axis=1), gap=body.gap):
        worst = np.argsort(-change[start:stop].max(axis=0), kind="stable")
        worst = worst[bad[start:stop].any(axis=0)[worst]]
        frame = start + int(change[start:stop, worst[0]].argmax())
        names = some([skeleton.names[joints[w]] for w in worst])
        now, then = lengths[frame, worst[0]], usual[worst[0]]
        what = f"the bone to {names} is {now:.2f} m long at frame {frame}, mostly {then:.2f} m"
        found.append(Finding("stretch", start, stop, what, fatal=True))
    return found
