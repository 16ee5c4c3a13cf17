"""What a database holds, in numbers a user asks for."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from motion import console
from motion.roles import ROLES

from .database import Database

PERCENTILES = (1, 5, 25, 50, 75, 95, 99)


def describe(db: Database, path: str | os.PathLike[str]) -> dict[str, Any]:
    """All of it as plain data, with bytes by part and the coverage of speeds and turns."""
    lengths = db.stops - db.starts
    plain = ~db.mirrored
    return {
        "path": str(path),
        "fingerprint": db.fingerprint,
        "clips": int(plain.sum()),
        "mirrored": int(db.mirrored.sum()),
        "frames": len(db),
        "fps": db.fps,
        "minutes": round(db.seconds / 60, 3),
        "minutes_without_mirrored": round(float(lengths[plain].sum()) / db.fps / 60, 3),
        "file_bytes": Path(path).stat().st_size,
        "bytes": db.memory(),
        "joints": list(db.skeleton.names),
        "parents": db.skeleton.parents.tolist(),
        "roles": {
            role: db.skeleton.names[db.skeleton.roles[role]] for role in ROLES if role in db.skeleton.roles
        },
        "contacts": _contacts(db),
        "schema": {"name": db.schema.name, "size": db.schema.size, "columns": list(db.schema.columns)},
        "tags": _tags(db),
        "coverage": coverage(db),
        "ranges": [
            {"name": name, "mirrored": bool(mirrored), "start": int(start), "frames": int(frames)}
            for name, mirrored, start, frames in zip(db.names, db.mirrored, db.starts, lengths, strict=True)
        ],
    }


def coverage(db: Database) -> dict[str, dict[str, float]]:
    """Percentiles over frames of the ground root's speed, sideways and forward speed and turn rate."""
    from motion import quat

    velocity = db.poses.velocities[:, 0]
    own = quat.rotate(quat.inv(db.poses.rotations[:, 0]), velocity)
    values = {
        "speed_mps": np.linalg.norm(velocity[:, ::2], axis=-1),
        "forward_mps": own[:, 2],
        "left_mps": own[:, 0],
        "turn_deg_per_s": np.degrees(db.poses.angular_velocities[:, 0, 1]),
    }
    return {
        name: {
            f"p{p}": round(float(v), 3)
            for p, v in zip(PERCENTILES, np.percentile(x, PERCENTILES), strict=True)
        }
        for name, x in values.items()
    }


def show(facts: Mapping[str, Any]) -> None:
    """Print it for people."""
    mirrored = f" and {facts['mirrored']} mirrored copies" * bool(facts["mirrored"])
    print(
        f"{facts['path']}: {facts['clips']} clips{mirrored}, {facts['minutes']:.1f} minutes, "
        f"{facts['frames']:,} frames at {facts['fps']:g} fps"
    )
    print(f"fingerprint  {facts['fingerprint']}")
    sizes = ", ".join(f"{name} {size / 1e6:.2f}" for name, size in facts["bytes"].items())
    print(f"megabytes    {facts['file_bytes'] / 1e6:.2f} in the file: {sizes}")
    print(f"skeleton     {len(facts['joints'])} joints: {', '.join(facts['joints'])}")
    print(f"roles        {', '.join(f'{role} {joint}' for role, joint in facts['roles'].items())}")
    touching = ", ".join(f"{name} {share:.0%}" for name, share in facts["contacts"].items())
    print(f"contacts     {touching or 'none'}")
    schema = facts["schema"]
    print(f"schema       {schema['name']}, {schema['size']} columns: {', '.join(schema['columns'])}")
    tags = ", ".join(f"{name} {frames:,} frames" for name, frames in facts["tags"].items())
    print(f"tags         {tags or 'none'}")
    console.print_table([{"": name, **values} for name, values in facts["coverage"].items()], "coverage")
    ranges = [r for r in facts["ranges"] if not r["mirrored"]]
    rows = [
        {
            "clip": r["name"],
            "start": r["start"],
            "frames": r["frames"],
            "seconds": round(r["frames"] / facts["fps"], 2),
        }
        for r in ranges[:20]
    ]
    console.print_table(rows, "clips")
    if len(ranges) > len(rows):
        print(f"... and {len(ranges) - len(rows)} more clips (--json lists all)")


def _contacts(db: Database) -> dict[str, float]:
    """Share of frames in which each foot touches the ground."""
    return {role: round(float(db.contacts[:, c].mean()), 4) for c, role in enumerate(db.contact_roles)}


def _tags(db: Database) -> dict[str, int]:
    """Frames that bear each tag."""
    return {name: int((db.tags >> np.uint32(bit) & 1).sum()) for bit, name in enumerate(db.tag_names)}
