"""Models of every kind: which a file holds, what loads and describes it, what drives characters by it."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar, cast

from mm.database import KIND as DATABASE
from motion import files
from motion.errors import UserError

from . import model as of_stages
from . import pretrained
from .locomotion.model import LocomotionModel
from .mann import model as of_mann
from .mann.model import MannModel
from .model import Model
from .network import WEIGHTS
from .pfnn import model as of_phase
from .pfnn.model import PhaseModel

if TYPE_CHECKING:
    from .evaluator import Products
    from .locomotion.controller import LocomotionController

AnyModel = Model | LocomotionModel
SameKind = TypeVar("SameKind", bound=AnyModel)

# Kinds by the name that commands and systems have for them.
TYPES: dict[str, type[AnyModel]] = {"lmm": Model, "pfnn": PhaseModel, "mann": MannModel}
TITLES = {
    "lmm": "learned motion matching",
    "pfnn": "phase-functioned networks",
    "mann": "mode-adaptive networks",
}
FORMATS = {of_stages.KIND: "lmm", of_phase.KIND: "pfnn", of_mann.KIND: "mann"}


def kind_of(model: AnyModel | str | os.PathLike[str]) -> str:
    """ "lmm", "pfnn" or "mann": what a model is, or a file by its header; lmm where that says nothing."""
    if isinstance(model, str | os.PathLike):
        return FORMATS.get(files.format_of(pretrained.find(model)) or "", "lmm")
    return next(name for name, of_kind in TYPES.items() if isinstance(model, of_kind))


def load(path: str | os.PathLike[str]) -> AnyModel:
    """Read a model of any kind: a file, or one that ships, by its name.

    What is no model is a UserError. Other errors: see `motion.files.load`.
    """
    found = files.format_of(pretrained.find(path))
    if found not in FORMATS:
        what = "no model" if found is None else f"a {found}, no model"
        ships = ", ".join(pretrained.names())
        remedy = f"train one, or name one that ships ({ships})"
        if found == DATABASE:
            remedy = "train one of it (python -m lmm train), or drive it as it is (python -m mm run)"
        raise UserError(f"{what} of any kind that `lmm train` makes", path=path, remedy=remedy)
    return TYPES[FORMATS[found]].load(path)


def describe(model: AnyModel, path: str) -> dict[str, Any]:
    """What a model is, as plain data."""
    from . import summary
    from .locomotion import summary as of_locomotion

    return summary.describe(model, path) if isinstance(model, Model) else of_locomotion.describe(model, path)


def show(facts: dict[str, Any], model: AnyModel) -> None:
    """Print what `describe` tells of a model for people."""
    from . import summary
    from .locomotion import summary as of_locomotion

    if isinstance(model, Model):
        summary.show(facts)
    else:
        of_locomotion.show(facts, model)


def with_weights(model: SameKind, weights: str | None) -> tuple[SameKind, Products]:
    """A model whose weights are held as one of `WEIGHTS` (None: as they are stored), and its products.

    bfloat16 weights are multiplied as such, others as float32. Mixed weights have no int8: a UserError.
    """
    if weights not in (*WEIGHTS, None):
        raise UserError(f"no weights of type {weights!r}", remedy=f"choose from {', '.join(WEIGHTS)}")
    if weights == "int8" and not isinstance(model, Model):
        raise UserError(f"a {model.kind} has no int8 weights", remedy="take float16")
    if weights in (None, "bfloat16"):
        return model, cast("Products", weights or "float32")
    return cast("SameKind", model.as_type(cast(Any, weights))), "float32"


def controllers(model: LocomotionModel) -> dict[str, Callable[..., LocomotionController]]:
    """What makes controllers of a network, by what the names of these systems end in.

    A phase-functioned network has one for each way to evaluate its spline; a mode-adaptive network one, which
    is named by its experts.
    """
    if isinstance(model, PhaseModel):
        from .pfnn.controller import PhaseController
        from .pfnn.spline import SETS

        return {mode: partial(PhaseController, model, mode=mode) for mode in SETS}
    from .mann.controller import MannController

    return {str(model.network.experts): partial(MannController, cast(MannModel, model))}
