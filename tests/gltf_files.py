"""Writes glTF files for tests: a builder of nodes, accessors and animations, and clips as such files."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from motion.clip import Clip

CODES = {"b": 5120, "B": 5121, "h": 5122, "H": 5123, "I": 5125, "f": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Builder:
    """A file in the making: `json` may be changed at will before it is written."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "nodes": []}

    def node(self, name: str | None = None, parent: int | None = None, **data: Any) -> int:
        """Add a node; returns its index."""
        node = {key: np.asarray(v).tolist() if isinstance(v, np.ndarray) else v for key, v in data.items()}
        self.json["nodes"].append(node | ({} if name is None else {"name": name}))
        index = len(self.json["nodes"]) - 1
        if parent is not None:
            self.json["nodes"][parent].setdefault("children", []).append(index)
        return index

    def view(self, data: bytes, **more: int) -> int:
        """Add a buffer view of bytes; returns its index."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        views = self.json.setdefault("bufferViews", [])
        views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **more})
        self.binary += data
        return len(views) - 1

    def accessor(self, values: Any, code: str = "f", *, stride: int = 0, normalized: bool = False) -> int:
        """Add an accessor of numbers [K] or [K, C]; integers are given as stored."""
        values = np.asarray(values).astype(np.dtype(code).newbyteorder("<"))
        width = values.shape[1] if values.ndim > 1 else 1
        rows = values.reshape(len(values), -1)
        blocks = [row.tobytes() for row in rows]
        data = b"".join(block.ljust(stride, b"\xff") for block in blocks)
        view = self.view(data, **({"byteStride": stride} if stride else {}))
        return self.raw_accessor(
            bufferView=view, componentType=CODES[code], count=len(rows), type=KINDS[width],
            **({"normalized": True} if normalized else {}),
        )  # fmt: skip

    def raw_accessor(self, **data: Any) -> int:
        """Add an accessor as JSON; returns its index."""
        self.json.setdefault("accessors", []).append(data)
        return len(self.json["accessors"]) - 1

    def animation(self, channels: dict[tuple[int, str], tuple], name: str | None = None) -> None:
        """Add an animation: (node, path) to (times, values[, interpolation]), numbers or accessor indices."""
        found: dict[str, Any] = {"samplers": [], "channels": []} | ({} if name is None else {"name": name})
        for (node, path), (times, values, *kind) in channels.items():
            sampler = {
                key: data if isinstance(data, int) else self.accessor(data)
                for key, data in (("input", times), ("output", values))
            }
            found["channels"].append(
                {"sampler": len(found["samplers"]), "target": {"node": node, "path": path}}
            )
            found["samplers"].append(sampler | ({"interpolation": kind[0]} if kind else {}))
        self.json.setdefault("animations", []).append(found)

    def write(self, path: Path, *, data_uri: bool = False) -> Path:
        """Write it as the suffix says: .glb, or .gltf with its buffer beside it or as a data URI."""
        buffer: dict[str, Any] = {"byteLength": len(self.binary)}
        if self.binary:
            self.json["buffers"] = [buffer]
        if path.suffix.lower() != ".glb":
            if data_uri:
                buffer["uri"] = (
                    "data:application/octet-stream;base64," + base64.b64encode(self.binary).decode()
                )
            else:
                buffer["uri"] = f"{path.stem}.bin"
                path.with_suffix(".bin").write_bytes(self.binary)
            path.write_text(json.dumps(self.json))
            return path
        text, binary = json.dumps(self.json).encode(), bytes(self.binary)
        body = b""
        for kind, data, pad in ((b"JSON", text, b" "), (b"BIN\0", binary, b"\0")):
            data += pad * (-len(data) % 4)
            body += struct.pack("<I4s", len(data), kind) + data
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
        return path


def of_clips(clips: list[Clip], *, skin: bool = True) -> Builder:
    """A character with the first clip's skeleton, and each clip as an animation of all its joints."""
    builder, skeleton = Builder(), clips[0].skeleton
    for j, name in enumerate(skeleton.names):
        parent = int(skeleton.parents[j])
        builder.node(name, parent if parent >= 0 else None, translation=skeleton.offsets[j])
    for joint, offset in skeleton.end_sites.items():
        builder.node(f"{skeleton.names[joint]}_end", joint, translation=offset)
    if skin:
        builder.json["skins"] = [{"joints": list(range(len(skeleton)))}]
    for clip in clips:
        times = builder.accessor(np.arange(len(clip)) / clip.fps)
        channels: dict[tuple[int, str], tuple] = {(0, "translation"): (times, clip.positions[:, 0])}
        for j in range(len(skeleton)):
            channels[j, "rotation"] = (times, np.roll(clip.rotations[:, j], -1, axis=-1))
        builder.animation(channels, clip.name)
    return builder
