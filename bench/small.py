"""Systems that are made of compressed databases: what ordinary compression takes, costs and loses."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm.codecs.codec import parse
from mm.control import System
from mm.database import Database
from motion import files
from motion.errors import UserError
from motion.pose import Poses

from .entry import Entry, called

if TYPE_CHECKING:
    from mm.codecs.compressed import Compressed

# Ways to make a database small: honest baselines, of which each is smaller than the one before, or coarser.
CODECS = (
    "recomputed",
    "float16",
    "float16+recomputed+features-float16",
    "quantised-16",
    "quantised-11",
    "quantised-11+features-8bit",
    "quantised-11+features-pq",
    "keyframes-0.2+quantised-16+features-8bit",
    "keyframes-0.5+quantised-11+features-8bit",
    "keyframes-1+quantised-11+features-8bit",
    "keyframes-2+quantised-11+features-8bit",
)


def compressed(codecs: Sequence[str] | None = None) -> list[Entry]:
    """Motion matching on databases that codecs have made small (`mm.codecs`), with foot locking and without.

    codecs are names as `mm compress` takes them, each one or several with "+" between, or files that it
    wrote, which go by their stem; None is `CODECS`, whose systems come by their names or a pattern.
    mm-exact-CODEC searches the features decoded, mm-coded-CODEC those of 8 bits as they are stored.
    """
    last: dict[tuple[int, str], Compressed] = {}
    out: list[Entry] = []
    for given in dict.fromkeys(CODECS if codecs is None else codecs):
        source = _Source(given, last)
        for index, locked in product(source.indexes(), (True, False)):
            name, feet = called(f"mm-{index}-{source.title}", locked), "locked" if locked else "as they come"
            out.append(
                Entry(
                    name,
                    partial(source.system, name, index, locked),
                    f"motion matching, index {index}, compressed by {source.codec.whole_name}, feet {feet}",
                    locked,
                    spare=not locked,
                    asked=codecs is None,
                    decoder=source.poses,
                    source=given,
                    alone=source.is_file,
                    made_of=source.made_of,
                )
            )
    return out


class _Source:
    """A codec by its name, or a compressed file; what was made last of any of them is kept in last."""

    def __init__(self, given: str, last: dict[tuple[int, str], Compressed]) -> None:
        from mm.codecs.compressed import Compressed

        self._given, self._last = given, last
        self.is_file = files.kind(given) == "file"
        stored = Compressed.load(given) if self.is_file else None
        self.codec = stored.codec if stored else parse(given)
        self.made_of = stored.fingerprint if stored else self.codec.whole_name
        self.title = Path(given).stem if self.is_file else self.codec.whole_name

    def indexes(self) -> tuple[str, ...]:
        """Search indexes that the features are stored for."""
        return ("exact", "coded") if self.codec.features == "8bit" else ("exact",)

    def of(self, database: Database | None) -> Compressed:
        """The database compressed; of a file, that is of another database, a UserError."""
        from mm.codecs.compressed import Compressed, compress

        key = id(database), self._given
        if key not in self._last:
            if self.is_file:
                found = Compressed.load(self._given)
            elif database is not None:
                found = compress(database, self.codec, rigs=False)
            else:
                raise TypeError("a codec without a database")
            if database is not None and found.description.fingerprint != database.fingerprint:
                remedy = "compress the database that is compared"
                raise UserError("compressed from another database", path=self._given, remedy=remedy)
            self._last.clear()
            self._last[key] = found
        return self._last[key]

    def poses(self, database: Database, frames: NDArray[np.int32]) -> Poses:
        """Poses decoded of frames [N]."""
        return self.of(database).decode(frames)[0]

    def system(
        self,
        name: str,
        index: str,
        locked: bool,
        database: Database | None,
        count: int,
        *,
        obstacles: ArrayLike = (),
    ) -> System:
        """A controller on it."""
        from mm.codecs.stages import controller
        from mm.settings import Settings

        settings = Settings(foot_lock=locked)
        return controller(
            self.of(database), count=count, settings=settings, index=index, obstacles=obstacles, name=name
        )
