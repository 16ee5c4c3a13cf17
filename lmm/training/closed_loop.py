"""Training of the Projector once more, on what is asked in the states that the networks themselves reach.

A crowd that motion matching drives is never where a network's small errors lead to. So the networks drive
one, the exact search answers what it asks, and the Projector learns these answers beside the others (dataset
aggregation: Ross, Gordon and Bagnell 2011). Without it a character whose queries lie far from the data may be
answered, again and again, by a pose in which it stands and glides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

from lmm.controller import controller
from lmm.model import Model
from mm import queries as recorded
from mm.queries import Queries

from .checkpoint import Errors
from .data import Data
from .projector import FEWEST, JUDGED, REUSE, ProjectorStage, anywhere
from .randomness import generator, users
from .settings import Settings, StageSettings

OWN = 0.5  # share of a batch that the networks' own crowd asked
MOST = 300_000  # queries of it
FAR = 1.0  # ranges that a query may lie beyond those of motion matching's: a poor Stepper may run away


class ClosedLoopStage:
    """Trains another stage's Projector on.

    model gives the networks as they stand when this stage begins.
    """

    name = "closed_loop"

    def __init__(
        self,
        data: Data,
        settings: Settings,
        stage: StageSettings,
        projector: ProjectorStage,
        model: Callable[[], Model],
    ) -> None:
        self.settings, self._all, self._data = stage, settings, data
        self._projector, self._model = projector, model

    def modules(self) -> Mapping[str, nn.Module]:
        return self._projector.modules()

    def begin(self) -> None:
        self._projector.begin()
        model = self._model()
        training, judging = users(self._all.seed)
        count = min(max(self.settings.iterations * self.settings.batch // REUSE, FEWEST), MOST)
        self._asked = self._answered(model, count, training)
        self._judged = self._answered(model, JUDGED, judging)

    def _answered(self, model: Model, count: int, seed: int) -> tuple[Queries, NDArray[np.int64]]:
        """What a crowd asks that the networks drive, and the answers; nothing of who ran away."""
        characters = min(recorded.MOST_CHARACTERS, -(-count // recorded.EACH))
        crowd = controller(model, count=characters, settings=recorded.SETTINGS)
        seconds = count * recorded.SETTINGS.search_interval
        user = recorded.random_user(self._data.database, seconds, seed=seed)
        queries = recorded.listen(crowd, user, count)
        usual = self._projector.judged["training"][0].features
        low, high = usual.min(axis=0), usual.max(axis=0)
        beyond = np.maximum(queries.features - high, low - queries.features)
        return self._projector.answered(anywhere(queries.take((beyond <= FAR * (high - low)).all(axis=1))))

    def loss(self, iteration: int) -> Mapping[str, Tensor]:
        draw = generator(self._all.seed, self.name, iteration)
        queries, answers = self._asked
        own = round(OWN * self.settings.batch) if len(queries) else 0
        inputs, frames = self._projector.batch(draw, self.settings.batch - own)
        if own:
            which = draw.integers(0, len(queries), own)
            inputs = np.concatenate([inputs, self._projector.inputs(queries.take(which))])
            frames = np.concatenate([frames, answers[which]])
        return self._projector.loss_of(inputs, frames)

    def evaluate(self) -> Errors:
        """The Projector's errors, and those on what the networks' crowd asked, as ``own_...``."""
        found = {part: dict(errors) for part, errors in self._projector.evaluate().items()}
        if len(self._judged[0]):
            own = self._projector.errors(*self._judged)
            found["training"] |= {f"own_{name}": value for name, value in own.items()}
        return found
