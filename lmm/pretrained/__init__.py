"""Networks that ship with the project, trained on its generated data; ``make pretrained`` remakes them."""

from __future__ import annotations

import os
from pathlib import Path

from motion import files

FOLDER, SUFFIX = Path(__file__).parent, ".lmm"
SUFFIXES = (SUFFIX, ".pfnn")


def names() -> list[str]:
    """What ships, trained on the clips that ``python -m motion dancecard`` writes by default: "dancecard",
    learned motion matching, and "dancecard.pfnn", a phase-functioned network."""
    return sorted(path.name.removesuffix(SUFFIX) for path in FOLDER.iterdir() if path.suffix in SUFFIXES)


def find(model: str | os.PathLike[str]) -> Path:
    """The file of a model: what ships by that name, unless a file of that name stands here."""
    name = os.fspath(model)
    if name not in names() or files.kind(model) is not None:
        return Path(model)
    return FOLDER / (name if name.endswith(SUFFIXES) else name + SUFFIX)
