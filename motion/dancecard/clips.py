"""The built-in data as files: a BVH clip a passage, its labels beside it, and tags of what is crouched."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from .. import bvh, files
from . import labels as label_files
from .dance import Passage
from .labels import GAITS


def write(
    folder: Path, passages: Iterable[Passage], *, labels: bool = True
) -> Iterator[tuple[Path, Passage]]:
    """Write passages in centimetres as they come, and give each when it is written; the tags come last."""
    tags: list[str] = []
    for passage in passages:
        target = folder / f"{passage.name}.bvh"
        bvh.write(target, passage.clip, unit_to_m=0.01)
        if labels:
            label_files.write(target.with_suffix(".labels.csv"), passage.labels)
            crouched = passage.labels.gait == GAITS.index("crouch")
            tags += [f"crouch,{passage.name},{a},{b}" for a, b in label_files.spans(crouched)]
        yield target, passage
    if labels:
        with files.atomic(folder / "tags.csv") as stream:
            stream.write("\n".join(["tag,clips,start,stop", *tags, ""]).encode())
