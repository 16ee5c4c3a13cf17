"""Small valid files of every format, made here: nothing of real motion."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

BVH = b"""HIERARCHY
ROOT Hips
{
  OFFSET 0 90 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Left Leg
  {
    OFFSET 10 -40.5 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 -40 1e1
    }
  }
  JOINT RightLeg { OFFSET -10 -40 0 CHANNELS 1 Yposition }
}
MOTION
Frames: 3
Frame Time: 0.0333333
0 90 0 0 0 0  1 2 3  -40
1 90 0 0 -45.25 0  1 2 3  -41
2 90.123456789012345678901 0 0 0 1E-3  1 2 3  -42
"""
BVH_WORDS = (
    b"HIERARCHY ROOT JOINT End Site EndSite OFFSET CHANNELS MOTION Frames: Frame Time: Xposition Yposition "
    b"Zposition Xrotation Yrotation Zrotation Xscale 3 6 { } CHANNELS\x200 ROOT\x20a End\x20Site{OFFSET"
).split(b" ")

ASF = b""":version 1.10
:name test
:units
  mass 1.0
  length 0.45
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    id 1
    name lfemur
    direction 0.3 -0.9 0
    length 7
    axis 0 0 20 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
  end
  begin
    name ltibia
    direction 0 -1 0
    length 7.5
    axis 0 0 20 XYZ
    dof rx
  end
  begin
    name lfoot
    direction 0 -0.2 0.9
    length 2
    axis 0 0 0 ZYX
  end
:hierarchy
  begin
    root lfemur
    lfemur ltibia
    ltibia lfoot
  end
"""
AMC = b"""#!OML:ASF
:FULLY-SPECIFIED
:DEGREES
1
root 1 17 2 3 -4 5.5
lfemur -20 3 1e1
ltibia 30.25
2
root 1.1 17 2.1 3 -4 5.123456789012345678901
lfemur -21 3 10
ltibia 31
"""
ACCLAIM_WORDS = (
    b":version :units length angle deg rad mass :root order axis position orientation :bonedata begin end id "
    b"name direction dof limits :hierarchy root lfemur ltibia lfoot TX TY TZ RX RY RZ XYZ ZYX xyz 1 2 3 "
    b":DEGREES :RADIANS :FULLY-SPECIFIED #"
).split(b" ")

TOML_WORDS = (
    *b"true false [[a]] [a.b] [[features]] [settings] = == { } [ ] ''' inf nan 07:32:00 1979-05-27".split(),
    *(b'"""', b"= {a = 1}", b"\n[roles]\n", b"= " + b"[" * 40, b"= 0x7fffffffffffffffffffffff", b"a.b.c = 1"),
)

ROLES = b'[roles]\nleft_foot = "LeftAnkle"\nhips = "Hips"\nright_hand = ""\n'
TAGS = b'tag,clips,start,stop\nrun,run*,,\nturn,walk_07,120,240\n"a, b",x?,5,\n'
TAGS_TOML = (
    b'[[tags]]\ntag = "run"\nclips = "run*"\n\n[[tags]]\ntag = "turn"\nclips = "w"\nstart = 3\nstop = 9\n'
)
NAMES = b"Hips\nLeft Leg\n\nRightLeg\n"


def sealed(header: bytes, body: bytes) -> bytes:
    """A container of named arrays with this JSON header, its checksum set right (see `motion.files`)."""
    table = json.loads(header)
    mark = str(table["__metadata__"]["checksum"])
    header += b" " * (-(8 + len(header)) % 64)
    prefix = len(header).to_bytes(8, "little")
    blank = prefix + header.replace(mark.encode(), b"0" * 32, 1) if mark else prefix + header
    digest = hashlib.sha256(blank)
    # The hash goes over the arrays one by one; each of them is smaller than a chunk here.
    spans = [entry.get("data_offsets") for name, entry in table.items() if name != "__metadata__"]
    for start, stop in spans:
        if stop > start:
            digest.update(hashlib.sha256(body[start:stop]).digest())
    return prefix + header.replace(mark.encode(), digest.hexdigest()[:32].encode(), 1) + body


def written(write: Callable[[Path], object], suffix: str = "") -> bytes:
    """The bytes of a file that write makes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"file{suffix}")
        write(path)
        return path.read_bytes()


def chain() -> tuple[list[int], np.ndarray]:
    """Parents and unit rotations [5 frames, 4 joints, 4] of a small skeleton."""
    rng = np.random.default_rng(1)
    rotations = rng.normal(size=(5, 4, 4))
    return [-1, 0, 1, 1], rotations / np.linalg.norm(rotations, axis=-1, keepdims=True)


def reference_database(*, short: bool) -> bytes:
    """``database.bin`` of 5 frames and 4 joints in the layout of the public reference."""
    parents, rotations = chain()
    frames, joints = rotations.shape[:2]

    def put(array: np.ndarray, dimensions: int, dtype: str) -> bytes:
        return np.array(array.shape[:dimensions], "<i4").tobytes() + array.astype(dtype).tobytes()

    vectors = np.linspace(-1, 1, frames * joints * 3).reshape(frames, joints, 3)
    pieces = [
        put(vectors, 2, "<f4"),
        put(vectors, 2, "<f4"),
        put(rotations, 2, "<f4"),
        put(vectors, 2, "<f4"),
    ]
    if short:
        pieces = [pieces[0], pieces[2]]
    pieces += [put(np.array(a), 1, "<i4") for a in (parents, [0, 3], [3, 5])]
    if not short:
        pieces.append(put(np.ones((frames, 2)), 2, "u1"))
    return b"".join(pieces)


def reference_features() -> bytes:
    """``features.bin`` of 5 frames and 3 columns."""
    table, vector = np.zeros((5, 3), "<f4"), np.ones(3, "<f4")
    size = np.array([3], "<i4").tobytes()
    return np.array([5, 3], "<i4").tobytes() + table.tobytes() + 2 * (size + vector.tobytes())


def gltf(*, binary: bool) -> bytes:
    """An animation of 5 keys on 4 nodes, as GLB or as glTF with its buffer inside."""
    rotations = chain()[1]
    blocks: dict[str, np.ndarray] = {
        "times": np.arange(5) / 30,
        "places": np.linspace(0, 1, 15).reshape(5, 3),
        **{f"turns_{j}": rotations[:, j, [1, 2, 3, 0]] for j in range(4)},
        "inverse": np.tile(np.eye(4), (4, 1, 1)).reshape(4, 16),
    }
    body, views, accessors = b"", [], []
    for values in blocks.values():
        data = values.astype("<f4").tobytes()
        views.append({"buffer": 0, "byteOffset": len(body), "byteLength": len(data)})
        kind = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}[values.size // len(values)]
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": 5126, "count": len(values), "type": kind}
        )
        body += data
    accessors[0] |= {"min": [0.0], "max": [4 / 30]}
    samplers = [{"input": 0, "output": k} for k in range(1, 6)]
    channels = [{"sampler": 0, "target": {"node": 0, "path": "translation"}}]
    channels += [{"sampler": 1 + j, "target": {"node": j, "path": "rotation"}} for j in range(4)]
    nodes: list[dict[str, object]] = [{"name": f"joint {j}", "translation": [0, 0.5, 0]} for j in range(4)]
    nodes[0]["children"], nodes[1]["children"] = [1], [2, 3]
    nodes[3] |= {"rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
    data = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "skins": [{"joints": [0, 1, 2, 3], "inverseBindMatrices": 6}],
        "animations": [{"name": "walk", "samplers": samplers, "channels": channels}],
        "buffers": [{"byteLength": len(body)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    if not binary:
        uri = "data:application/octet-stream;base64," + base64.b64encode(body).decode()
        return json.dumps(data | {"buffers": [{"byteLength": len(body), "uri": uri}]}, indent=1).encode()
    text = json.dumps(data).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def npz(**arrays: object) -> bytes:
    """An archive of arrays."""
    out = io.BytesIO()
    np.savez(out, **arrays)  # type: ignore[arg-type]
    return out.getvalue()


def npz_files() -> list[bytes]:
    """Motion as rotations, as places, and as SMPL parameters."""
    parents, rotations = chain()
    offsets = np.ones((4, 3))
    places = np.cumsum(np.tile(offsets, (5, 1, 1)), axis=1) + np.arange(5)[:, None, None] / 10
    common = {"fps": 30, "parents": parents, "names": ["hips", "spine", "a", "b"]}
    smpl = np.linspace(-1, 1, 5 * 72).reshape(5, 72)
    return [
        npz(**common, rotations=rotations, offsets=offsets, root_positions=places[:, 0], unit="cm", up="z"),
        npz(**common, positions=places),
        npz(**common, euler=np.zeros((5, 4, 3)), euler_order="zxy", angle_unit="degrees", positions=places),
        npz(mocap_framerate=60.0, poses=smpl, trans=places[:, 0], betas=np.zeros(10), gender="neutral"),
    ]
