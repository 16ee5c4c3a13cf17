"""What tests of characters on networks share: any commands, and bodies that glide with feet in contact."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import mann_models
import numpy as np
import pfnn_models

from lmm.locomotion.controller import LocomotionController
from lmm.locomotion.model import LocomotionModel
from lmm.mann import frames as mann_frames
from lmm.mann.controller import MannController
from lmm.pfnn import frames as pfnn_frames
from lmm.pfnn.controller import PhaseController
from mm.control import Command
from motion import kinematics

# What controllers that are not compiled, which take long to settle, are given by monkeypatch.
HASTY = "lmm.locomotion.controller.SETTLING", 0.05
NETWORKS: dict[str, Any] = {"pfnn": pfnn_models.network, "mann": mann_models.network}
MODELS: dict[str, Any] = {"pfnn": pfnn_models.model, "mann": mann_models.model}
FRAMES: dict[str, Any] = {"pfnn": pfnn_frames.frames, "mann": mann_frames.frames}
CONTROLLERS: dict[str, Any] = {"pfnn": PhaseController, "mann": MannController}


def commands(count: int, seed: int = 0) -> Command:
    rng = np.random.default_rng(seed)
    command = Command.still(count)
    command.velocity[:] = rng.uniform(-2, 2, (count, 2))
    command.yaw[:] = rng.uniform(-3, 3, count)
    command.turn_rate[:] = rng.uniform(-1, 1, count)
    command.crouch[:] = rng.random(count) < 0.5
    return command


def part(command: Command, n: int) -> Command:
    return Command(*(getattr(command, field.name)[n : n + 1] for field in fields(Command)))


def still_turned(model: Any) -> Any:
    """A model that does not turn."""
    mean, std = model.network.output_mean.copy(), model.network.output_std.copy()
    turned = model.layout.outputs["turn_rate"]
    mean[turned], std[turned] = 0, 1e-6
    return replace(model, network=replace(model.network, output_mean=mean, output_std=std))


def gliding(model: Any, *, bent: bool = False, speed: float = 0.3) -> Any:
    """A model of a body that glides forward at a speed, m/s, all contacts on; bent knees reach back."""
    mean, std = model.network.output_mean.copy(), model.network.output_std.copy()
    outputs = model.layout.outputs
    mean[outputs["contacts"]], std[outputs["contacts"]] = 1, 1e-4
    mean[outputs["root_velocity"]], std[outputs["root_velocity"]] = (0, speed), 1e-4
    for side in ("left", "right") if bent else ():
        knee = model.description.skeleton.role(f"{side}_leg") - 1
        mean[outputs["positions"]][3 * knee + 2] += 0.25
    return replace(model, network=replace(model.network, output_mean=mean, output_std=std))


def drift(model: LocomotionModel, joint: int, **options: Any) -> tuple[float, LocomotionController]:
    """How far a joint moves over 18 frames of a body that is asked to go at 0.3 m/s."""
    controller = CONTROLLERS[model.family](model, **options)
    command, places = Command.still(1), []
    command.velocity[0, 1] = 0.3
    for _ in range(24):
        poses = controller.step(command)
        world, _ = kinematics.forward(controller.skeleton, poses.positions[0], poses.rotations[0])
        places.append(world[joint, [0, 2]])
    return float(np.linalg.norm(places[-1] - places[6])), controller
