"""Work on many items: in threads, in order, with progress and remarks for the user."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

from motion import console
from motion.errors import UserError

T = TypeVar("T")
R = TypeVar("R")


def _silent(line: str) -> None:
    pass


@dataclass(frozen=True)
class Work:
    """How long work is done and reported.

    Attributes
    ----------
    jobs : threads; what takes long in them releases the interpreter's lock.
    note : called with each remark for the user, a line.
    progress : wraps a loop, as `motion.console.progress` does.
    """

    jobs: int
    note: Callable[[str], None]
    progress: Callable[..., Iterator[Any]]

    @staticmethod
    def of(
        jobs: int | None = None,
        note: Callable[[str], None] | None = None,
        progress: Callable[..., Iterator[Any]] | None = None,
    ) -> Work:
        """By default one thread a core, and silence."""
        return Work(jobs or os.cpu_count() or 1, note or _silent, progress or console.silent)

    def map(
        self,
        function: Callable[[T], R],
        items: Sequence[T],
        *,
        label: str,
        unit: str = "clips",
        keep: Callable[[UserError], None] | None = None,
    ) -> Iterator[R]:
        """Results in the items' order; UserErrors go to keep if it is given.

        Else the first error in that order is raised and what has not begun never does.
        """
        return self.progress(self._results(function, items, keep), label=label, total=len(items), unit=unit)

    def _results(
        self, function: Callable[[T], R], items: Sequence[T], keep: Callable[[UserError], None] | None
    ) -> Iterator[R]:
        with ThreadPoolExecutor(self.jobs) as pool:
            futures = deque(pool.submit(function, item) for item in items)
            try:
                while futures:
                    try:
                        yield futures.popleft().result()
                    except UserError as error:
                        if keep is None:
                            raise
                        keep(error)
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
