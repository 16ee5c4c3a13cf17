"""Small valid files of every format, made here: nothing of real motion."""

from __future__ import annotations

import hashlib
import json
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
