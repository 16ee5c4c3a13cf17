"""How mode-adaptive networks are trained: settings, and two recipes in three sizes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from .locomotion_settings import LocomotionStageSettings, LocomotionTraining, ours
from .settings import PRESETS, RECIPES, Optimiser, Schedule, check_names, check_range

SWAY = 0.75  # of others, by our recipe


@dataclass(frozen=True, kw_only=True)
class MannStageSettings(LocomotionStageSettings):
    """How the network is trained; the defaults are the published recipe's (REFERENCE 5).

    Attributes
    ----------
    epochs : passes over the frames that are trained on, which say how many iterations there are, whatever
        iterations says; 0 leaves that to it.
    experts : K, how many weight sets there are.
    gate : width of the gate's two hidden layers.
    joint_scale : what an input's joint counts, against the trajectory; for the gate it is 1 at first.
    sway : how much of other frames' sway is added at most to what is told of the way, while its own is taken
        away by up to the whole (`lmm.mann.sway`); 0 tells the way as it is. Who reads from the way where in
        its step a body is glides on a straight one.
    """

    learning_rate: float = 1e-4
    schedule: Schedule = "restarts"
    optimiser: Optimiser = "adamwr"
    epochs: int = 150
    experts: int = 4
    gate: int = 32
    joint_scale: float = 1.0
    sway: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, least, most in (
            ("epochs", 0, 1_000_000),
            ("experts", 1, 64),
            ("gate", 1, 16_384),
            ("joint_scale", 1e-6, 1e6),
            ("sway", 0, 10),
        ):
            check_range(name, getattr(self, name), least, most)


@dataclass(frozen=True, kw_only=True)
class MannTraining(LocomotionTraining):
    """How a mode-adaptive network is trained.

    Attributes
    ----------
    mann : the training of the network.
    """

    mann: MannStageSettings = field(default_factory=MannStageSettings)

    @property
    def stage(self) -> MannStageSettings:
        return self.mann


def preset(recipe: str = "ours", name: str = "full") -> MannTraining:
    """The settings of a recipe in a size; an unknown one is a UserError that lists those known.

    "reference" is the published recipe (REFERENCE 5): 150 passes over the data in batches of 32. "quick"
    takes less than half an hour on one core for four experts, "full" three times as long where the recipe is
    ours; "smoke" seconds, to see that all of it runs.
    """
    names: dict[str, Any] = {"recipe": recipe, "preset": name}
    check_names(names, {"recipe": RECIPES, "preset": PRESETS})
    return replace((_ours if recipe == "ours" else _reference)(name), **names)


def _reference(name: str) -> MannTraining:
    if name == "full":
        return MannTraining(mann=MannStageSettings(evaluate=5_000))
    iterations = {"quick": 60_000, "smoke": 30}[name]
    evaluate = max(iterations // 50, 15)
    return MannTraining(mann=MannStageSettings(epochs=0, iterations=iterations, evaluate=evaluate))


def _ours(name: str) -> MannTraining:
    """As all such networks are trained by us, products of bfloat16; and the way does not tell the step."""
    stage = MannStageSettings(**ours(name), epochs=0, joint_scale=0.3, sway=SWAY)
    return MannTraining(precision="bfloat16", mann=stage)
