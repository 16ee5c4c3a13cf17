"""How phase-functioned networks are trained: settings, configurations, and two recipes in three sizes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

from lmm.locomotion.statistics import JOINT_SCALE

from .locomotion_settings import LocomotionStageSettings, LocomotionTraining, ours
from .settings import PRESETS, RECIPES, Optimiser, Schedule, check_names, check_range

Configuration = Literal["holden", "holden-xl", "holden-xt", "ava"]
CONFIGURATIONS: tuple[Configuration, ...] = ("holden", "holden-xl", "holden-xt", "ava")


@dataclass(frozen=True, kw_only=True)
class PhaseStageSettings(LocomotionStageSettings):
    """How the network is trained; the defaults are the published recipe's (REFERENCE 4.2).

    Attributes
    ----------
    shrink : weight of the control points' mean square in the loss.
    phase_noise : how far off phases are, radians, as a deviation.
    joint_scale : what an input's joint counts, against the trajectory.
    """

    iterations: int = 2_500_000
    learning_rate: float = 1e-4
    schedule: Schedule = "constant"
    optimiser: Optimiser = "adam"
    shrink: float = 0.01
    phase_noise: float = 0.0
    joint_scale: float = JOINT_SCALE

    def __post_init__(self) -> None:
        super().__post_init__()
        ranges = (("shrink", 0, 1e6), ("phase_noise", 0, 10), ("joint_scale", 1e-6, 1e6))
        for name, least, most in ranges:
            check_range(name, getattr(self, name), least, most)


@dataclass(frozen=True, kw_only=True)
class PhaseTraining(LocomotionTraining):
    """How a phase-functioned network is trained.

    Attributes
    ----------
    configuration : what the settings began as: "holden", the published network; "holden-xl", with one more
        hidden layer; "holden-xt", trained twice as long; "ava", as "holden", and so named where the
        database is of a large rig (`mm.enlarged`).
    pfnn : the training of the network.
    """

    configuration: Configuration = "holden"
    pfnn: PhaseStageSettings = field(default_factory=PhaseStageSettings)

    @property
    def stage(self) -> PhaseStageSettings:
        return self.pfnn


def preset(recipe: str = "ours", name: str = "full", configuration: str = "holden") -> PhaseTraining:
    """The settings of a recipe in a size; an unknown one is a UserError that lists those known.

    "reference" is the published recipe (REFERENCE 4.2): 20 passes over about 4 million samples in batches of
    32. "quick" takes less than half an hour on two cores, "full" three times as long where the recipe is
    ours; "smoke" seconds, to see that all of it runs.
    """
    names: dict[str, Any] = {"recipe": recipe, "preset": name, "configuration": configuration}
    known = {"recipe": RECIPES, "preset": PRESETS, "configuration": CONFIGURATIONS}
    check_names(names, known)
    settings = (_ours if recipe == "ours" else _reference)(name)
    stage = settings.pfnn
    if configuration == "holden-xl":
        stage = replace(stage, hidden=(*stage.hidden, stage.hidden[-1]))
    if configuration == "holden-xt":
        stage = replace(stage, iterations=2 * stage.iterations)
    return replace(settings, pfnn=stage, **names)


def _reference(name: str) -> PhaseTraining:
    iterations = {"full": 2_500_000, "quick": 60_000, "smoke": 30}[name]
    return PhaseTraining(pfnn=PhaseStageSettings(iterations=iterations, evaluate=max(iterations // 50, 15)))


def _ours(name: str) -> PhaseTraining:
    """As all such networks are trained by us, products of bfloat16."""
    return PhaseTraining(
        precision="bfloat16", pfnn=PhaseStageSettings(**ours(name), shrink=0.0, phase_noise=0.05)
    )
