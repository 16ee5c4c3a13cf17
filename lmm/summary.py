"""What a model is: sizes, what it was trained from and how, its errors."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from mm.settings import Settings
from motion import console

from . import pretrained
from .controller import controller
from .model import Model

PARTS = {"training": "training", "held_out": "held out"}

# What errors of stages (`Stage.evaluate`) are, for people who read a table of them.
ERRORS = {
    "error_cm": "joints off, cm",
    "regret": "query distance / true neighbour's",
    "latent": "latents off / their spread",
    "ran_away": "share of queries left out, far off the data",
}
STAGES = ("decompressor", "stepper", "projector", "closed_loop")  # as they are trained
AFTER_10 = ("stepper",)  # whose error_cm is that after ten frames


def describe(model: Model, path: str) -> dict[str, Any]:
    """What a model is, as plain data."""
    about = model.description
    networks = model.networks | ({"compressor": model.compressor} if model.compressor else {})
    return {
        "path": path,
        "fingerprint": model.fingerprint,
        "file_bytes": pretrained.find(path).stat().st_size,
        "parameters": model.parameters,
        "bytes": model.memory(),
        "state_bytes": _state(model),
        "networks": {
            name: {
                "sizes": list(network.sizes),
                "activation": network.activation,
                "weights": network.weight_type,
                "parameters": network.parameters,
                "bytes": network.nbytes,
            }
            for name, network in networks.items()
        },
        "joints": len(about.skeleton),
        "fps": about.fps,
        "schema": about.schema.name,
        "features": model.F,
        "latent": model.L,
        "stored_latents_bytes": 0 if model.stored_latents is None else model.stored_latents.nbytes,
        "database": model.database,
        "database_frames": model.frames,
        "database_ranges": model.ranges,
        "held_out": list(model.held_out),
        "training": model.training,
        "errors": model.errors,
    }


def _state(model: Model) -> int:
    """Bytes that a controller holds of a character: where it is, what it shows, its learned state."""
    return controller(model, settings=Settings(foot_lock=False), compiled=False).memory()["state"]


def show(facts: dict[str, Any]) -> None:
    """Print it for people."""
    sizes = ", ".join(f"{name} {size / 1e6:.2f}" for name, size in facts["bytes"].items())
    print(
        f"{facts['path']}: {facts['parameters']:,} parameters, {facts['joints']} joints at "
        f"{facts['fps']:g} fps, schema {facts['schema']}, "
        f"{facts['features']} features, {facts['latent']} latents"
    )
    show_origin(facts)
    print(f"megabytes    {facts['file_bytes'] / 1e6:.2f} in the file; at run time {sizes}")
    print(f"a character  {facts['state_bytes'] / 1e3:.1f} kB of state more")
    stored = facts["stored_latents_bytes"]
    if stored:
        print(
            f"latents      {stored / 1e6:.2f} MB in the file, of the database's frames; only stages that "
            "read the database need them"
        )
    rows = [
        {"network": name, **network, "sizes": "-".join(map(str, network["sizes"]))}
        for name, network in facts["networks"].items()
    ]
    console.print_table(rows)
    print()
    show_errors(facts["errors"])


def show_origin(facts: dict[str, Any]) -> None:
    """Print what a model was trained from and how."""
    training = facts["training"].get("settings", {})
    asked = ("recipe", "preset", "configuration", "seed")
    how = ", ".join(f"{name} {training[name]}" for name in asked if name in training)
    print(f"fingerprint  {facts['fingerprint']}")
    print(
        f"database     {facts['database'] or 'unknown'}, {facts['database_frames']:,} frames "
        f"in {facts['database_ranges']} ranges"
    )
    print(f"held out     {', '.join(facts['held_out']) or 'nothing'}")
    print(f"training     {how or 'unknown'}")


def show_errors(errors: dict[str, Any]) -> None:
    """Print a model's errors as a table, a column a part of the data."""
    rows: dict[str, dict[str, Any]] = {}
    for keys, value in sorted(_flat(errors), key=_place):
        part = next((key for key in keys if key in PARTS), "all")
        name = _told([key for key in keys if key != part])
        rows.setdefault(name, {})[PARTS.get(part, part)] = value
    found = dict.fromkeys(column for row in rows.values() for column in row)
    columns = [c for c in PARTS.values() if c in found] + [c for c in found if c not in PARTS.values()]
    if rows:
        console.print_table([{"error": name, **dict.fromkeys(columns), **row} for name, row in rows.items()])


def _place(found: tuple[Sequence[str], Any]) -> tuple[int, bool, int, str]:
    """Order of errors: by stage, what is true of its own queries last, later frames after earlier ones."""
    stage, name = found[0][0], found[0][-1]
    frames = re.search(r"\d+", name)
    rank = 0 if name == "error_cm" else int(frames[0]) if frames else 1000
    return STAGES.index(stage) if stage in STAGES else len(STAGES), name.startswith("own_"), rank, name


def _told(keys: Sequence[str]) -> str:
    """Words for an error by the keys that lead to it: a stage and what is off."""
    *stages, name = keys
    own, plain = name.startswith("own_"), name.removeprefix("own_")
    after = re.fullmatch(r"after_(\d+)_cm", plain)
    if after or (plain == "error_cm" and stages and stages[0] in AFTER_10):
        words = f"joints off after {after[1] if after else 10} frames, cm"
    else:
        words = ERRORS.get(plain, plain.replace("_", " "))
    stage = " ".join(stages).replace("_", " ")
    return f"{stage}{', own queries' * own}: {words}" if stage else words


def _flat(values: dict[str, Any], keys: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], Any]]:
    """Nested values, each with the keys that lead to it."""
    found: list[tuple[tuple[str, ...], Any]] = []
    for key, value in values.items():
        nested = isinstance(value, dict)
        found += _flat(value, (*keys, key)) if nested else [((*keys, key), value)]
    return found
