"""What a compressed database takes and how exact it is, in numbers a user asks for."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from motion import console

from .. import summary
from .compressed import Compressed
from .search import Coded
from .stages import controller

_LABELS = {
    "position_cm": "joint positions, cm",
    "rotation_deg": "joint rotations, degrees",
    "velocity_cm_s": "joint velocities, cm/s",
    "features_deviations": "features, deviations",
}


def describe(compressed: Compressed, path: str | os.PathLike[str]) -> dict[str, Any]:
    """Codec, bytes by part and errors as plain data.

    bytes : as stored. loaded_bytes : what the controller of one character holds: poses as they are stored;
        features as float32 and the exact index, or where they are stored of 8 bits just that and the index
        coded.
    uncompressed_bytes : those of the database that it was made from, without an index.
    """
    index = Coded.name if compressed.codec.features == "8bit" and compressed.schema.euclidean else "exact"
    frames, joints = len(compressed), len(compressed.skeleton)
    whole = {
        "poses": frames * joints * 28,
        "velocities": frames * joints * 24,
        "contacts": frames * len(compressed.description.contact_roles),
        "features": frames * compressed.schema.size * 4,
        "tags": frames * 4,
    }
    return {
        "path": str(path),
        "codec": compressed.codec.name,
        "features_codec": compressed.codec.features,
        "fingerprint": compressed.fingerprint,
        "source": compressed.description.fingerprint,
        "frames": frames,
        "key_frames": len(compressed.tables.keys) or None,
        "file_bytes": Path(path).stat().st_size,
        "bytes": compressed.memory(),
        "index": index,
        "loaded_bytes": controller(compressed, index=index).memory(),
        "uncompressed_bytes": whole,
        "errors": compressed.errors,
    }


def show(facts: Mapping[str, Any]) -> None:
    """Print it for people."""
    stored, whole = facts["bytes"], facts["uncompressed_bytes"]
    total, before = sum(stored.values()), sum(whole.values())
    kept = f", {facts['key_frames']:,} key frames" if facts["key_frames"] else ""
    print(
        f"{facts['path']}: codec {facts['codec']}, features {facts['features_codec']}, "
        f"{facts['frames']:,} frames{kept}"
    )
    print(
        f"{total / 1e6:.2f} of {before / 1e6:.2f} MB, {total / facts['frames']:.1f} bytes a frame; "
        f"loaded with the index {facts['index']}"
    )
    parts = dict.fromkeys((*stored, *whole, *facts["loaded_bytes"]))
    rows = [
        {
            "megabytes": part,
            "uncompressed": _megabytes(whole.get(part)),
            "stored": _megabytes(stored.get(part)),
            "loaded": _megabytes(facts["loaded_bytes"].get(part)),
        }
        for part in parts
    ]
    sums = {"uncompressed": before, "stored": total, "loaded": sum(facts["loaded_bytes"].values())}
    rows.append({"megabytes": "all", **{name: _megabytes(size) for name, size in sums.items()}})
    console.print_table(rows)
    errors = facts["errors"]
    if errors:
        table = [
            {"errors": label, **{key: errors[name][key] for key in ("mean", "p99", "max")}}
            for name, label in _LABELS.items()
        ]
        console.print_table(table)
        print(
            f"the ground root is {errors['root_cm']:.2g} cm off its way at the most, "
            f"and {errors['root_deg']:.2g} degrees; contacts: {errors['contacts_wrong']:.2%} differ"
        )


def show_with_database(facts: Mapping[str, Any]) -> None:
    """Print it, after what is told of any database."""
    summary.show(facts)
    show(facts)


def _megabytes(size: int | None) -> str:
    return "" if size is None else f"{size / 1e6:.3f}"
