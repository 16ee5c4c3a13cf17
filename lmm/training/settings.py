"""How networks are trained: the settings of a stage and of them all, and two recipes in three sizes."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, TypeVar

from motion import config
from motion.config import ConfigError, choices, shown
from motion.errors import UserError

Schedule = Literal["step", "cosine", "restarts", "constant"]
Optimiser = Literal["radam", "adamw", "adamwr", "adam"]
Precision = Literal["float32", "bfloat16"]
Device = Literal["cpu", "cuda"]
Recipe = Literal["ours", "reference"]
Preset = Literal["smoke", "quick", "full"]
RECIPES: tuple[Recipe, ...] = ("ours", "reference")
PRESETS: tuple[Preset, ...] = ("smoke", "quick", "full")
BEGUN_AS = ("recipe", "preset", "configuration")  # settings that others follow from


@dataclass(frozen=True, kw_only=True)
class StageSettings:
    """How one stage is trained; the defaults are the published recipe's (REFERENCE 3.2).

    Attributes
    ----------
    iterations : steps of the optimiser.
    batch : windows, or queries, a step.
    window : frames of a window.
    learning_rate : at its highest.
    schedule : "step" takes 1 % off the rate every 1,000 iterations, "cosine" lets it fall to 0 at the end,
        "restarts" four times, over 1, 2, 4 and 8 fifteenths of the iterations; "constant" keeps it.
    warm_up : share of the iterations in which the rate rises from 0.
    optimiser : "adamw" keeps the largest second moment (amsgrad) and decays weights by 1e-3; "adamwr", for
        restarts, by 2.5e-3 over the root of the iterations from one to the next (REFERENCE 5).
    hidden : widths of the hidden layers.
    average : decay of the exponential average of the weights, which takes their place; 0 for none.
    clip : longest gradient, longer ones are shortened; 0 for no limit.
    evaluate : iterations between evaluations.
    """

    iterations: int = 500_000
    batch: int = 32
    window: int = 1
    learning_rate: float = 1e-3
    schedule: Schedule = "step"
    warm_up: float = 0.0
    optimiser: Optimiser = "adamw"
    hidden: tuple[int, ...] = (512,)
    average: float = 0.0
    clip: float = 0.0
    evaluate: int = 5_000

    def __post_init__(self) -> None:
        config.validate(self)
        for name, least, most in (
            ("iterations", 1, 100_000_000),
            ("batch", 1, 1_000_000),
            ("window", 1, 10_000),
            ("learning_rate", 1e-12, 10),
            ("warm_up", 0, 1),
            ("average", 0, 0.999999),
            ("clip", 0, 1e9),
            ("evaluate", 1, 100_000_000),
        ):
            check_range(name, getattr(self, name), least, most)
        _check_widths("hidden", self.hidden)


@dataclass(frozen=True, kw_only=True)
class Common:
    """What every training is told, whatever it trains.

    Attributes
    ----------
    recipe, preset : what the settings began as.
    seed : of held-out clips, first weights and batches.
    held_out : share of the frames, in whole clips, that is not trained on; 0 for none.
    precision : "bfloat16" multiplies matrices so, where the processor can; the rest stays float32.
    device : where networks are trained.
    threads : of the processor; 0 takes as many as torch does.
    checkpoint_seconds : time between checkpoints, seconds.
    """

    recipe: Recipe = "ours"
    preset: Preset = "full"
    seed: int = 0
    held_out: float = 0.1
    precision: Precision = "float32"
    device: Device = "cpu"
    threads: int = 0
    checkpoint_seconds: float = 60.0

    def __post_init__(self) -> None:
        config.validate(self)
        for name, least, most in (
            ("seed", 0, 2**63 - 1),
            ("held_out", 0, 0.9),
            ("threads", 0, 1024),
            ("checkpoint_seconds", 0, 1e6),
        ):
            check_range(name, getattr(self, name), least, most)

    def longest(self, fps: float) -> int:
        """Frames of the longest window that is trained on, at a rate."""
        raise NotImplementedError


Told = TypeVar("Told", bound=Common)


@dataclass(frozen=True, kw_only=True)
class Settings(Common):
    """How a model of Learned Motion Matching is trained.

    Attributes
    ----------
    latent : size of the latent.
    compressor : widths of the compressor's hidden layers; it is trained with the decompressor.
    stepper : its window is in frames at 60 Hz, and lasts as long at any other rate.
    stepper_noise : how far off half of the stepper's windows begin, at most, in deviations; 0 for none.
    closed_loop : the projector once more, also with what a crowd asks that the networks themselves drive;
        None for no such stage. Its hidden layers are the projector's, whatever it says.
    """

    latent: int = 32
    compressor: tuple[int, ...] = (512, 512, 512)
    stepper_noise: float = 0.0
    decompressor: StageSettings = field(default_factory=lambda: StageSettings(window=2))
    stepper: StageSettings = field(default_factory=lambda: StageSettings(window=20, hidden=(512,) * 2))
    projector: StageSettings = field(default_factory=lambda: StageSettings(hidden=(512,) * 4))
    closed_loop: StageSettings | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, least, most in (("latent", 1, 4096), ("stepper_noise", 0, 10)):
            check_range(name, getattr(self, name), least, most)
        _check_widths("compressor", self.compressor)
        for name in ("decompressor", "stepper"):
            if getattr(self, name).window < 2:
                raise ConfigError((name, "window"), "1 frame has no rate of change", remedy="give at least 2")

    def longest(self, fps: float) -> int:
        return max(self.decompressor.window, self.stepper_window(fps), self.projector.window)

    def stepper_window(self, fps: float) -> int:
        """Frames of the stepper's windows at a rate."""
        return max(2, round(self.stepper.window * fps / 60))


def check_range(name: str, value: float, least: float, most: float) -> None:
    """A ConfigError where a setting is out of range."""
    if not least <= value <= most:
        remedy = f"give a number from {least:g} to {most:g}"
        raise ConfigError(name, f"{shown(value)} is out of range", remedy=remedy)


def _check_widths(name: str, widths: tuple[int, ...]) -> None:
    if not 1 <= len(widths) <= 16 or not all(1 <= width <= 16_384 for width in widths):
        remedy = "give 1 to 16 widths from 1 to 16,384"
        raise ConfigError(name, f"{shown(list(widths))} are no layers", remedy=remedy)


def preset(recipe: str = "ours", name: str = "full") -> Settings:
    """The settings of a recipe in a size; an unknown one is a UserError that lists those known.

    "reference" is the published recipe to the letter (REFERENCE 3.2), "ours" reaches its quality in less
    time. "quick" takes less than half an hour on two cores; "full" three times as long where the recipe is
    ours, to the published end in the reference; "smoke" seconds, to see that all of it runs.
    """
    names: dict[str, Any] = {"recipe": recipe, "preset": name}
    check_names(names, {"recipe": RECIPES, "preset": PRESETS})
    return replace((_ours if recipe == "ours" else _reference)(name), **names)


def check_names(names: Mapping[str, str], known: Mapping[str, Sequence[str]]) -> None:
    """A UserError that lists the choices where a name is none of them."""
    for what, choice in names.items():
        if choice not in known[what]:
            raise UserError(f"no {what} {choice!r}", remedy=choices(known[what]))


def _reference(name: str) -> Settings:
    """As published: batches of 32, half a million iterations a stage, one rate for all."""
    iterations = {"full": 500_000, "quick": 20_000, "smoke": 30}[name]
    return _each(Settings(), iterations=iterations, evaluate=max(iterations // 100, 15))


def _ours(name: str) -> Settings:
    """Fewer, larger batches at a higher rate that falls to 0, averaged weights, products of bfloat16; a
    Stepper that finds back, a Projector that knows what the networks themselves ask."""
    share = {"full": 3.0, "quick": 1.0, "smoke": 0.0}[name]
    settings = Settings(
        precision="bfloat16",
        decompressor=StageSettings(window=2, batch=256, learning_rate=4e-3, iterations=6_000),
        stepper=StageSettings(window=20, hidden=(512,) * 2, batch=128, learning_rate=4e-3, iterations=5_000),
        stepper_noise=0.6,
        projector=StageSettings(hidden=(512,) * 4, batch=512, learning_rate=3e-3, iterations=24_000),
        closed_loop=StageSettings(hidden=(512,) * 4, batch=512, learning_rate=2e-3, iterations=24_000),
    )
    for stage in ("decompressor", "stepper", "projector", "closed_loop"):
        one = getattr(settings, stage)
        count = max(round(share * one.iterations), 30)
        evaluate = max(count // 50, 15)
        changes = {"schedule": "cosine", "warm_up": 0.02, "average": 0.999, "clip": 1.0}
        one = replace(one, iterations=count, evaluate=evaluate, **changes)
        settings = replace(settings, **{stage: one})
    return settings


def _each(settings: Settings, **changes: Any) -> Settings:
    """Settings with the same changes to every stage."""
    stages = [f.name for f in fields(settings) if isinstance(getattr(settings, f.name), StageSettings)]
    return replace(settings, **{name: replace(getattr(settings, name), **changes) for name in stages})


def load(path: str | os.PathLike[str], base: Told) -> Told:
    """Settings of a TOML file; what it leaves out is as in base. Faults are UserErrors with file and line.

    So are other `BEGUN_AS` than base's, which would not bring the settings that they name.
    """
    found = config.load(type(base), path, base=base)
    for name in BEGUN_AS:
        asked = getattr(found, name, None)
        if asked != getattr(base, name, None):
            line = config.line_of(config.read_toml(path)[1], (name,))
            what = f"{name}: {shown(asked)} is what all settings begin as"
            raise UserError(what, path=path, line=line, remedy=f"give --{name} {asked}")
    return found
