"""What a network of locomotion is: sizes, memory, what it was trained from, its errors."""

from __future__ import annotations

from typing import Any

from .. import pretrained
from .model import LocomotionModel


def describe(model: LocomotionModel, path: str) -> dict[str, Any]:
    """What a model is, as plain data; bytes are those of its weights, by part or by mode (REFERENCE 4.3)."""
    about, network = model.description, model.network
    return {
        "path": path,
        "kind": model.family,
        "fingerprint": model.fingerprint,
        "file_bytes": pretrained.find(path).stat().st_size,
        "parameters": model.parameters,
        "bytes": model.weight_bytes(),
        "sizes": list(network.sizes),
        **({"experts": network.experts} if hasattr(network, "experts") else {}),
        "weights": network.weight_type,
        "joints": len(about.skeleton),
        "fps": about.fps,
        "contacts": list(model.contacts),
        "sees_ground": model.sees_ground,
        "database": model.database,
        "database_frames": model.frames,
        "database_ranges": model.ranges,
        "held_out": list(model.held_out),
        "training": model.training,
        "errors": model.errors,
    }


def show(facts: dict[str, Any], model: LocomotionModel) -> None:
    """Print it for people."""
    from ..summary import show_errors, show_origin

    sizes = ", ".join(f"{name} {size / 1e6:.2f}" for name, size in facts["bytes"].items())
    experts = f"{facts['experts']} experts and " if "experts" in facts else ""
    print(
        f"{facts['path']}: {model.kind} {'-'.join(map(str, facts['sizes']))} of {experts}"
        f"{facts['parameters']:,} parameters, {facts['joints']} joints at {facts['fps']:g} fps"
    )
    show_origin(facts)
    print(f"contacts     {', '.join(facts['contacts']) or 'none'}")
    print(f"ground       {_ground(facts)}")
    print(f"megabytes    {facts['file_bytes'] / 1e6:.2f} in the file; weights at run time: {sizes}")
    show_errors(facts["errors"])


def _ground(facts: dict[str, Any]) -> str:
    """What ground a network knows."""
    if not facts["sees_ground"]:
        return "level ground only"
    terrain = facts["training"].get("terrain")
    if not terrain:
        return "uneven ground was learned"
    feet = "feet rested on level ground" if terrain["level_motion"] else "feet went up and down"
    return f"uneven ground was learned ({', '.join(terrain['maps'])}); in the data {feet}"
