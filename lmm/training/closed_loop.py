"""Training of the Projector once more, on what is asked in the states that the networks themselves reach.

A crowd that motion matching drives is never where a network's small errors lead to. So the networks drive
one, the exact search answers what it asks, and the Projector learns these answers beside the others (dataset
aggregation: Ross, Gordon and Bagnell 2011). Without it a character whose queries lie far from the data may be
answered, again and again, by a pose in which it stands and glides.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping

import numpy as np
from torch import Tensor, nn

from lmm.controller import controller
from lmm.model import Model
from mm import queries as recorded
from mm.queries import Queries
from motion.errors import NotFinite

from .checkpoint import Errors
from .data import Data
from .projector import FEWEST, JUDGED, REUSE, ProjectorStage, anywhere
from .randomness import generator, users
from .settings import Settings, StageSettings

OWN = 0.5  # share of a batch that the networks' own crowd asked
MOST = 300_000  # queries of it
MANY_AWAY = 0.5  # share of its queries far off the data, from which on that is told
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
        asked, away = self._listen(model, count, training)
        if away >= MANY_AWAY:
            rest = "nothing of it is" if away == 1 else "the rest of it is"
            told = (
                f"note: {self.name}: {away:.0%} of what the networks' own crowd asked lies far off the data, "
                f"where they ran away to; {rest} trained on: look at the stepper, train it longer"
            )
            print(told, file=sys.stderr, flush=True)
        self._asked = self._projector.answered(asked)
        judged, self._away = self._listen(model, JUDGED, judging)
        self._judged = self._projector.answered(judged)

    def _listen(self, model: Model, count: int, seed: int) -> tuple[Queries, float]:
        """What a crowd asks that the networks drive, without who ran away, and the share of what they ask."""
        characters = min(recorded.MOST_CHARACTERS, -(-count // recorded.EACH))
        crowd = controller(model, count=characters, settings=recorded.SETTINGS)
        seconds = count * recorded.SETTINGS.search_interval
        user = recorded.random_user(self._data.database, seconds, seed=seed)
        try:
            queries = recorded.listen(crowd, user, count)
        except NotFinite:  # where a character is, and with it the next command, is no number
            return self._projector.judged["training"][0].take(slice(0)), 1.0
        usual = self._projector.judged["training"][0].features
        low, high = usual.min(axis=0), usual.max(axis=0)
        beyond = np.maximum(queries.features - high, low - queries.features)
        near = (beyond <= FAR * (high - low)).all(axis=1)
        return anywhere(queries.take(near)), float(1 - near.mean())

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
        """The Projector's errors, and those on what the networks' crowd asked, as ``own_...``, and
        ``ran_away``, the share of that which is left out, for it lies far off the data."""
        found = {part: dict(errors) for part, errors in self._projector.evaluate().items()}
        found["training"]["ran_away"] = self._away
        if len(self._judged[0]):
            own = self._projector.errors(*self._judged)
            found["training"] |= {f"own_{name}": value for name, value in own.items()}
        return found
