"""Which clips are trained on and which are held out, to see what the networks do with what they never saw."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence

from mm.database import Database
from motion.errors import UserError

from .randomness import generator
from .settings import Common


def held_out(
    database: Database,
    settings: Common,
    *,
    left_out: Collection[str] = (),
    kinds: Mapping[str, Collection[str]] | None = None,
) -> tuple[str, ...]:
    """Names of whole clips that make about settings.held_out of the frames, by settings.seed; at least one.

    A clip's mirrored copy goes with it, and so do the other pieces of its file. Clips that are left out
    anyway do not count. Where one part would have no clip that is as long as the longest window, a UserError
    says so. Of every kind of motion, which clips have by name, there stays some that is trained on.
    """
    longest = settings.longest(database.fps)
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
    files, able_files = ({file_of(name) for name in names} for names in (frames, able))
    if len(able_files) < 2:
        what = f"{len(able_files)} of {len(files)} clips is as long as a window, {longest} frames"
        raise UserError(
            f"too small a database to hold a clip out: {what}"
            if len(files) > 1
            else "a database of one clip",
            remedy="build one of more clips, or train on all of it with --held-out 0",
        )
    taken = _drawn(frames, able, kinds or {}, settings)
    return tuple(name for name in frames if file_of(name) in taken)


def file_of(name: str) -> str:
    """The clip that a piece was cut out of (see `mm.build`), where it is one: the name of its file."""
    return re.sub(r"@\d+-\d+$", "", name)


def _drawn(
    frames: Mapping[str, int],
    able: Sequence[str],
    kinds: Mapping[str, Collection[str]],
    settings: Common,
) -> set[str]:
    """Files in random order, each taken that brings the share nearer to what is asked for."""
    sizes: Counter[str] = Counter()
    of: dict[str, set[str]] = {}
    for name, size in frames.items():
        sizes[file_of(name)] += size
        of.setdefault(file_of(name), set()).update(kinds.get(name, ()))
    having = Counter(kind for found in of.values() for kind in found)

    def spare(file: str) -> bool:
        return all(having[kind] > 1 for kind in of[file])

    places = generator(settings.seed, "held out").permutation(len(able))
    order = list(dict.fromkeys(file_of(able[i]) for i in places))
    if not any(map(spare, order)):
        alone = ", ".join(f"only one has {kind}" for kind, count in having.items() if count == 1)
        raise UserError(
            f"too small a database to hold a clip out: of {len(sizes)} clips {alone}",
            remedy="build one of more clips, or train on all of it with --held-out 0",
        )
    wanted = settings.held_out * sum(sizes.values())
    taken: set[str] = set()
    total = 0
    for file in order[:-1]:  # the last one stays, whatever the share
        if spare(file) and abs(total + sizes[file] - wanted) < abs(total - wanted):
            taken.add(file)
            total += sizes[file]
            having.subtract(of[file])
    if not taken:
        # All are longer than twice what is wanted: the shortest.
        taken.add(min((file for file in sizes if file in order and spare(file)), key=lambda f: sizes[f]))
    return taken
