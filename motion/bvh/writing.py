"""A document as text."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import digits
from .document import BvhDocument


def serialise(document: BvhDocument, *, decimals: int | None = None) -> bytes:
    """Text of a document; None decimals prints the fewest digits that read back as the same doubles."""
    children: list[list[int]] = [[] for _ in document.names]
    for j, parent in enumerate(document.parents.tolist()):
        if parent >= 0:
            children[parent].append(j)

    def offset(value: NDArray[np.float64]) -> str:
        return "OFFSET " + digits.write_table(np.asarray(value)[None], decimals).decode()

    lines = ["HIERARCHY\n"]
    stack: list[tuple[int, int, bool]] = [(0, 0, True)]
    while stack:
        j, depth, opening = stack.pop()
        tabs = "\t" * depth
        if not opening:
            lines.append(f"{tabs}}}\n")
            continue
        lines.append(f"{tabs}{'JOINT' if depth else 'ROOT'} {document.names[j]}\n{tabs}{{\n")
        lines.append(f"{tabs}\t{offset(document.offsets[j])}")
        lines.append(
            " ".join([f"{tabs}\tCHANNELS {len(document.channels[j])}", *document.channels[j]]) + "\n"
        )
        for end in document.end_sites[j]:
            lines.append(f"{tabs}\tEnd Site\n{tabs}\t{{\n{tabs}\t\t{offset(end)}{tabs}\t}}\n")
        stack.append((j, depth, False))
        stack.extend((child, depth + 1, True) for child in reversed(children[j]))
    lines.append(f"MOTION\nFrames: {len(document.values)}\nFrame Time: {document.frame_time}\n")
    return "".join(lines).encode() + digits.write_table(document.values, decimals)
