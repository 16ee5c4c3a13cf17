"""Random numbers without hidden state: what is drawn depends on the seed, the stage and the iteration alone.

So a training that goes on from a checkpoint draws what it would have drawn.
"""

from __future__ import annotations

import contextlib
import zlib
from collections.abc import Iterator

import numpy as np


def sequence(seed: int, stage: str, iteration: int = 0) -> np.random.SeedSequence:
    """Where the numbers of one iteration of a stage come from."""
    return np.random.SeedSequence([seed, zlib.crc32(stage.encode()), iteration])


def generator(seed: int, stage: str, iteration: int = 0) -> np.random.Generator:
    """A generator of its own for one iteration of a stage."""
    return np.random.Generator(np.random.Philox(sequence(seed, stage, iteration)))


def users(seed: int) -> tuple[int, int]:
    """Seeds of the random users that a training learns from and is judged by: unlike those of evaluations."""
    training, judging = sequence(seed, "users").generate_state(2, np.uint32)
    return int(training), int(judging)


@contextlib.contextmanager
def seeded(seed: int, stage: str) -> Iterator[None]:
    """Torch's own generator seeded for a stage, and put back after: what modules take first weights from."""
    import torch

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(sequence(seed, stage).generate_state(1, np.uint64)[0]))
        yield
