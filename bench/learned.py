"""Systems that are made of models: learned motion matching and its mixtures, networks of locomotion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm.control import System
from mm.database import Database
from motion.pose import Poses

from .entry import Entry, as_stored, called

if TYPE_CHECKING:
    from features.terrain import Ground
    from lmm.locomotion.model import LocomotionModel
    from lmm.model import Model
    from lmm.models import AnyModel

# Endings of names by what weights are held as (`lmm.models.with_weights`); None: as they are stored.
ENDINGS = {None: "", "bfloat16": "-bf16", "float32": "-fp32", "float16": "-fp16", "int8": "-int8"}
STAGES = {"P": "projection", "S": "stepping", "D": "decompression"}
CHUNK = 4096  # frames


def learned(models: Mapping[str, AnyModel]) -> list[Entry]:
    """All systems that models make, whose names begin with those of the models.

    Learned motion matching runs in all ways in which networks take the place of stages: NAME-PSD is learned
    motion matching itself. P is projection, S stepping, D decompression: NAME-D is the decompressor alone, on
    an exact search. None of them learned is mm-exact. A phase-functioned network is NAME-cubic, NAME-linear
    and NAME-constant, a mode-adaptive one of four experts NAME-4.

    NAME-D-free does not hold the feet; it comes by its name or a pattern, or where legs are not whole.
    NAME-PSD-fp16, NAME-cubic-fp16 and so on hold weights otherwise (see `ENDINGS`): bf16 multiplies bfloat16
    numbers, where the processor can, which pays in crowds (see `bench.crowd`). They come by their names or a
    pattern, to show what that costs in quality.
    """
    from lmm.models import Model

    out = []
    for name, model in models.items():
        shared: dict[str, Any] = {}
        for weights, ending in ENDINGS.items():
            decoder, staged = None, isinstance(model, Model)
            if isinstance(model, Model):
                decoder = _Decompressed(model, weights, shared) if model.knows_latents else None
                ways = _mixtures(model, shared)[: 1 if ending else None]
            else:
                ways = _networks(model) if weights != "int8" else []
            for (way, about, make, alone), locked in product(ways, (True, False)):
                title = called(f"{name}-{way}{ending}", locked)
                about += f", {weights} weights" * bool(ending) + ", feet as they come" * (not locked)
                out.append(
                    Entry(
                        title,
                        partial(make, title, weights, locked),
                        about,
                        locked,
                        spare=not locked,
                        asked=bool(ending),
                        decoder=as_stored if staged and "D" not in way else decoder,
                        source=name,
                        way=way,
                        weights=weights,
                        alone=alone,
                        sees_ground=not isinstance(model, Model) and model.sees_ground,
                        made_of=model.fingerprint or None,
                    )
                )
    return out


def _mixtures(model: Model, shared: dict[str, Any]) -> list[tuple[str, str, Callable[..., System], bool]]:
    """Of each way to mix learned stages with others, all learned first, its letters, what it is, what makes
    it, and whether that takes no database."""
    from lmm.mixtures import COMBINATIONS, LETTERS

    out: list[tuple[str, str, Callable[..., System], bool]] = []
    for letters in filter(None, reversed(COMBINATIONS)):
        networks = " and ".join(word for letter, word in STAGES.items() if letter in letters)
        make = partial(_learned, model, letters, shared)
        out.append((letters, f"{networks} by networks", make, letters == LETTERS))
    return out


def _networks(model: LocomotionModel) -> list[tuple[str, str, Callable[..., System], bool]]:
    """Of each way to run a network of locomotion how its name ends, what it is, what makes it, and that this
    takes no database."""
    from lmm.models import controllers

    return [(way, f"{model.kind}, {way}", partial(_network, model, way), True) for way in controllers(model)]


def _network(
    model: LocomotionModel,
    way: str,
    name: str,
    weights: str | None,
    locked: bool,
    database: Database | None,
    count: int,
    *,
    obstacles: ArrayLike = (),
    **seen: Ground,
) -> System:
    from lmm.locomotion.settings import LocomotionSettings
    from lmm.models import controllers, with_weights

    if database is not None:
        model.check(database)
    held, products = with_weights(model, weights)
    make = controllers(held)[way]
    settings = LocomotionSettings(foot_lock=locked)
    return make(count=count, settings=settings, obstacles=obstacles, products=products, name=name, **seen)


def _learned(
    model: Model,
    letters: str,
    shared: dict[str, Any],
    name: str,
    weights: str | None,
    locked: bool,
    database: Database | None,
    count: int,
    *,
    obstacles: ArrayLike = (),
) -> System:
    from lmm.controller import controller
    from lmm.models import with_weights
    from mm.controller import build_index
    from mm.settings import Settings

    settings = Settings(foot_lock=locked)
    needed: dict[str, Any] = {}
    if database is not None:
        model.check(database)
        if letters != "PSD":  # one index and the latents serve all that need them
            if shared.get("indexed") is not database:
                shared |= {"indexed": database, "index": build_index(database, "exact", settings)}
            latents = _latents(model, database, shared)
            needed = {"database": database, "latents": latents, "index": shared["index"]}
    held, products = with_weights(model, weights)
    return controller(
        held,
        learned=letters,
        settings=settings,
        count=count,
        obstacles=obstacles,
        products=products,
        name=name,
        **needed,
    )


def _latents(model: Model, database: Database, shared: dict[str, Any]) -> NDArray[np.float32]:
    """A model's latents [T, L] of a database, made once."""
    if shared.get("of") is not database:
        shared |= {"of": database, "latents": model.latents(database)}
    return shared["latents"]


class _Decompressed:
    """The poses that a Decompressor makes of the true features and latents of frames."""

    def __init__(self, model: Model, weights: str | None, shared: dict[str, Any]) -> None:
        self._model, self._weights, self._shared = model, weights, shared

    def __call__(self, database: Database, frames: NDArray[np.int32]) -> Poses:
        from lmm.models import with_weights
        from lmm.stages import DecompressorDecompression, LatentState

        self._model.check(database)
        held, products = with_weights(self._model, self._weights)
        stage = DecompressorDecompression(held, products=products)
        latents = _latents(self._model, database, self._shared)
        poses = Poses.empty(len(frames), len(database.skeleton))
        contacts = np.empty((len(frames), len(database.contact_roles)), np.uint8)
        for start in range(0, len(frames), CHUNK):
            part = slice(start, start + CHUNK)
            values = np.concatenate([database.features[frames[part]], latents[frames[part]]], axis=1)
            stage.decompress(LatentState.of(values, held.F), poses[part], contacts[part])
        return poses
