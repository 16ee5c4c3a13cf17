"""Networks that ship with the project, trained on its generated data; ``make pretrained`` remakes them."""

from __future__ import annotations

import os
from pathlib import Path

from motion import files

FOLDER, SUFFIX = Path(__file__).parent, ".lmm"


def names() -> list[str]:
    """What ships: "dancecard", trained on the clips that ``python -m motion dancecard`` writes by default."""
    return sorted(path.stem for path in FOLDER.glob(f"*{SUFFIX}"))


def find(model: str | os.PathLike[str]) -> Path:
    """The file of a model: what ships by that name, unless a file of that name stands here."""
    if os.fspath(model) in names() and files.kind(model) is None:
        return FOLDER / f"{os.fspath(model)}{SUFFIX}"
    return Path(model)
