"""What a phase-functioned network is: sizes, memory by mode, what it was trained from, its errors."""

from __future__ import annotations

import os
from typing import Any

from .model import PhaseModel
from .spline import SETS


def describe(model: PhaseModel, path: str) -> dict[str, Any]:
    """What a model is, as plain data; bytes are those of the weights by mode (REFERENCE 4.3)."""
    about, network = model.description, model.network
    return {
        "path": path,
        "kind": "pfnn",
        "fingerprint": model.fingerprint,
        "file_bytes": os.stat(path).st_size,
        "parameters": model.parameters,
        "bytes": {mode: network.weight_bytes(mode) for mode in SETS},
        "sizes": list(network.sizes),
        "weights": network.weight_type,
        "joints": len(about.skeleton),
        "fps": about.fps,
        "contacts": list(model.contacts),
        "database": model.database,
        "database_frames": model.frames,
        "database_ranges": model.ranges,
        "held_out": list(model.held_out),
        "training": model.training,
        "errors": model.errors,
    }


def show(facts: dict[str, Any]) -> None:
    """Print it for people."""
    from ..summary import show_errors, show_origin

    sizes = ", ".join(f"{mode} {size / 1e6:.2f}" for mode, size in facts["bytes"].items())
    print(
        f"{facts['path']}: phase-functioned network {'-'.join(map(str, facts['sizes']))} of "
        f"{facts['parameters']:,} parameters, {facts['joints']} joints at {facts['fps']:g} fps"
    )
    show_origin(facts)
    print(f"contacts     {', '.join(facts['contacts'])}")
    print(f"megabytes    {facts['file_bytes'] / 1e6:.2f} in the file; weights at run time by mode: {sizes}")
    show_errors(facts["errors"])
