"""The published weights of the phase-functioned network (REFERENCE 4.2), as a network in our units.

Their files are raw numbers: centimetres, centimetres a frame of 1/60 s, turns of the phase a frame. Axes are
ours (the left leg is at +X, the way leads to +Z), but a turn rate from +Z to +X is negative, and the first
heights are those at +X: raising them raises the left foot.
"""

from __future__ import annotations

import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mm.build import build
from mm.description import Description
from motion import files, sources
from motion.errors import UserError

from ..locomotion.window import SIDES
from .layout import Layout
from .model import PhaseModel
from .network import PhaseNetwork

FPS = 60.0
CONTROL_FILES = ("000", "012", "025", "037")  # their names count fiftieths of a turn
HIDDEN = 512
CENTIMETRE = 0.01
UNIT = 0.056444  # metres, of the animations
JOINTS = 31
WALK, RUN = 1.1, 1.9  # m/s, as it goes when it is asked for more


def network(folder: str | os.PathLike[str], *, joints: int = JOINTS) -> PhaseNetwork:
    """The network of a folder's ``W*.bin``, ``b*.bin`` and statistics, converted to `lmm.pfnn.layout`.

    A missing file, one of another size, or deviations that nothing can be divided by are a UserError.
    """
    folder, layout = Path(folder), Layout(joints)
    sizes = (layout.input_size, HIDDEN, HIDDEN, layout.output_size)
    weights, biases = [], []
    for layer, (inputs, outputs) in enumerate(pairwise(sizes)):
        found = [read(folder / f"W{layer}_{k}.bin", outputs, inputs) for k in CONTROL_FILES]
        weights.append(np.ascontiguousarray(np.stack(found).swapaxes(1, 2)))
        biases.append(np.stack([read(folder / f"b{layer}_{k}.bin", outputs) for k in CONTROL_FILES]))
    into, out = unit_scales(layout)
    divisors = read(folder / "Xstd.bin", sizes[0])
    if not (divisors > 0).all():
        what = f"number {int(np.argmin(divisors > 0)) + 1} is not above 0, and inputs are divided by it"
        raise UserError(what, path=folder / "Xstd.bin", remedy="restore a whole copy of the file")
    order = np.arange(sizes[0])
    heights = layout.inputs["heights"]
    order[heights] = order[heights].reshape(SIDES, -1)[::-1].ravel()
    weights[0] = weights[0][:, order]
    statistics = {
        "input_mean": (read(folder / "Xmean.bin", sizes[0]) * into)[order],
        "input_std": (divisors * into)[order],
        "output_mean": read(folder / "Ymean.bin", sizes[-1]) * out,
        "output_std": read(folder / "Ystd.bin", sizes[-1]) * out,
    }
    return PhaseNetwork(**statistics, weights=tuple(weights), biases=tuple(biases))


def files_of(folder: str | os.PathLike[str]) -> list[Path]:
    """All that `network` reads."""
    layers = [f"{part}{layer}_{k}" for part in "Wb" for layer in range(3) for k in CONTROL_FILES]
    return [Path(folder, f"{name}.bin") for name in (*layers, "Xmean", "Xstd", "Ymean", "Ystd")]


def unit_scales(layout: Layout) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What inputs [I] and outputs [O] of the published network are multiplied by to be in our units."""
    into, out = np.ones(layout.input_size, np.float32), np.ones(layout.output_size, np.float32)
    for columns, scales in ((layout.inputs, into), (layout.outputs, out)):
        for name in ("path", "positions", "heights"):
            if name in columns:
                scales[columns[name]] = CENTIMETRE
        scales[columns["velocities"]] = CENTIMETRE * FPS
    out[layout.outputs["root_velocity"]] = CENTIMETRE * FPS
    out[layout.outputs["turn_rate"]] = -FPS
    out[layout.outputs["phase_rate"]] = 2 * np.pi * FPS
    return into, out


def read(path: Path, *shape: int) -> NDArray[np.float32]:
    """Raw little-endian float32 numbers of a shape; a file of another size is a UserError."""
    files.check_input(path)
    expected, found = 4 * int(np.prod(shape)), path.stat().st_size
    if found != expected:
        size = " x ".join(map(str, shape))
        raise UserError(
            f"{found:,} bytes, expected {expected:,} for {size} numbers",
            path=path,
            remedy="give the network of the published release: 342 inputs, 311 outputs, 512 between",
        )
    values = np.fromfile(path, "<f4").astype(np.float32).reshape(shape)
    if not np.isfinite(values).all():
        raise UserError("numbers that are not finite", path=path, remedy="restore a whole copy of the file")
    return values


def model(network_folder: str | os.PathLike[str], animations: str | os.PathLike[str]) -> PhaseModel:
    """The published network with the skeleton, legs and speeds of the published animations (BVH, 120 fps)."""
    loaded = network(network_folder)  # first: what is wrong with it is told at once
    found = describe(animations)
    joints = len(found.skeleton) - 1
    if joints != JOINTS:
        raise UserError(
            f"clips of {joints} joints, but the published network moves {JOINTS}",
            path=animations,
            remedy="give the animations that were published with it",
        )
    return PhaseModel(description=found, network=loaded)


def describe(animations: str | os.PathLike[str]) -> Description:
    """Skeleton and legs of a folder of the published animations; speeds are those that the network goes."""
    exclude = tuple({"rest"}.intersection(map(sources.name_of, sources.find(animations))))
    database = build(animations, fps=FPS, source_unit=UNIT, mirror=False, exclude=exclude)
    found = Description.of(database)
    legs = found.legs
    if legs is not None:
        # In one clip feet in the air count as contacts: the foot that is surer serves for both.
        sure = legs.heights[np.argmin(np.ptp(legs.heights, axis=1))]
        legs = replace(legs, heights=np.tile(sure, (len(legs.heights), 1)))
    return replace(found, legs=legs, walk_mps=WALK, run_mps=RUN)
