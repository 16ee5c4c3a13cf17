"""Results that are kept on disk, so that who was interrupted goes on.

What a result follows from is plain data: fingerprints of the database and the model, the course and all
settings, the code, the machine. It stands in the file, and its hash in the file's name: a result of anything
else is not found, and so never taken for it.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from motion import files
from motion.errors import UserError

KIND, VERSION = "kept result", 1
# What numbers come from: packages, and of this one the modules that measure.
PACKAGES = ("motion", "features", "mm", "lmm")
MODULES = ("comparison", "crowd", "entry", "learned", "pose_error", "runs", "small", "systems", "timing")

Arrays = dict[str, NDArray]


@dataclass(frozen=True)
class Kept:
    """Results in a folder, which all share something that they are of; without a folder nothing is kept."""

    folder: Path | None = None
    shared: Mapping[str, Any] = field(default_factory=dict)

    def find(self, of: Mapping[str, Any]) -> tuple[dict[str, Any], Arrays] | None:
        """Metadata and arrays of what was kept of that; None without, or where the file is damaged."""
        path = self._path(of)
        if path is None or not path.is_file():
            return None
        try:
            metadata, arrays, _ = files.load(path, KIND, VERSION)
        except UserError:
            return None
        return (metadata["found"], arrays) if metadata.get("of") == self._all(of) else None

    def keep(self, of: Mapping[str, Any], found: Mapping[str, Any], arrays: Mapping[str, NDArray]) -> None:
        """Write a result: all of it or nothing. found is data for JSON."""
        path = self._path(of)
        if path is not None:
            files.save(path, KIND, VERSION, {"of": self._all(of), "found": dict(found)}, arrays)

    def _all(self, of: Mapping[str, Any]) -> Any:
        return json.loads(json.dumps({**self.shared, **of}, sort_keys=True))

    def _path(self, of: Mapping[str, Any]) -> Path | None:
        if self.folder is None:
            return None
        text = json.dumps(self._all(of), sort_keys=True)
        words = [str(of[name]) for name in ("system", "crowd", "course", "seed", "characters") if name in of]
        name = re.sub(r"[^A-Za-z0-9.+-]+", "-", "_".join(words))[:100]
        return self.folder / f"{name}_{hashlib.blake2b(text.encode(), digest_size=8).hexdigest()}.run"


NOTHING = Kept()


@cache
def code() -> str:
    """A hash (hex) of the source of all that numbers come from."""
    digest = hashlib.blake2b(digest_size=16)
    for package in PACKAGES:
        root = Path(str(resources.files(package)))
        for path in sorted(root.rglob("*.py")):
            digest.update(f"{package}/{path.relative_to(root).as_posix()}\0".encode() + path.read_bytes())
    here = Path(__file__).parent
    for module in MODULES:
        digest.update(f"{module}\0".encode() + (here / f"{module}.py").read_bytes())
    return digest.hexdigest()
