"""Which clips are trained on and which are held out, to see what the networks do with what they never saw."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Hashable, Mapping

from mm.database import Database
from motion.errors import UserError

from .randomness import generator
from .settings import Common


def held_out(
    database: Database,
    settings: Common,
    *,
    left_out: Collection[str] = (),
    kinds: Mapping[str, Collection[Hashable]] | None = None,
) -> tuple[str, ...]:
    """Names of whole clips that make about settings.held_out of the frames, by settings.seed; at least one.

    A clip's mirrored copy goes with it. Clips that are left out anyway do not count. Where one part would
    have no clip that is as long as the longest window, a UserError says so. Of every kind of motion, which
    clips have by name, there stays some that is trained on.
    """
    longest = settings.longest
    lengths = database.stops - database.starts
    frames = {name: 0 for name in database.names if name not in left_out}
    fits = dict.fromkeys(frames, False)
    for name, length in zip(database.names, lengths.tolist(), strict=True):
        if name in frames:
            frames[name] += length
            fits[name] |= length >= longest
    if not any(fits.values()):
        what = f"no clip is as long as a window, {longest} frames"
        raise UserError(f"too small a database: {what}", remedy="build one of longer clips")
    if settings.held_out == 0:
        return ()
    able = [name for name in frames if fits[name]]
    if len(able) < 2:
        what = f"{len(able)} of {len(frames)} clips is as long as a window, {longest} frames"
        raise UserError(
            f"too small a database to hold a clip out: {what}"
            if len(frames) > 1
            else "a database of one clip",
            remedy="build one of more clips, or train on all of it with --held-out 0",
        )
    of = {name: set((kinds or {}).get(name, ())) for name in frames}
    having = Counter(kind for name in frames for kind in of[name])
    spare = [name for name in able if all(having[kind] > 1 for kind in of[name])]
    if not spare:
        raise UserError(
            "too small a database to hold a clip out: each has some motion that no other has",
            remedy="build one of more clips, or train on all of it with --held-out 0",
        )
    order = [able[i] for i in generator(settings.seed, "held out").permutation(len(able))]
    wanted = settings.held_out * sum(frames.values())
    taken: set[str] = set()
    total = 0
    for name in order[:-1]:  # the last one stays, whatever the share
        nearer = abs(total + frames[name] - wanted) < abs(total - wanted)
        if nearer and all(having[kind] > 1 for kind in of[name]):
            taken.add(name)
            total += frames[name]
            having.subtract(of[name])
    if not taken:
        # All are longer than twice what is wanted: the shortest.
        taken.add(min(spare, key=lambda name: frames[name]))
    return tuple(name for name in frames if name in taken)
