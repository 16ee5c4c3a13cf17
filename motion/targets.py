"""Places in a folder for what is written about each of many clips."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from . import files
from . import sources as reading
from .errors import UserError


class Targets:
    """Places in a folder for what is written about each clip, in folders as below the sources."""

    def __init__(self, folder: str, sources: Sequence[str], clips: Sequence[Path], suffix: str) -> None:
        """A UserError if two clips would be written to one place, or one over what is read."""
        if files.kind(folder) not in ("folder", None):
            raise UserError("not a folder", path=folder, remedy="name a folder to write to")
        self._stems: dict[Path, Path] = {}
        self._inputs = reading.inputs(sources)
        taken: set[Path] = set()
        for clip in clips:
            file, animation = reading.split(clip)
            above = next((Path(s) for s in sources if Path(s) in file.parents), file.parent)
            name = file.stem + (f"_{animation}" if animation else "")
            stem = Path(folder, file.relative_to(above).parent, name)
            if stem in taken:  # of two formats
                stem = stem.with_name(f"{name}_{file.suffix[1:]}")
            if stem in taken:
                what = f"another clip would be written to {stem}{suffix}, too"
                raise UserError(what, path=clip, remedy="take them apart")
            taken.add(stem)
            self._stems[clip] = stem
            self.path(clip, suffix)

    def path(self, clip: Path, suffix: str) -> Path:
        """Where to write about a clip."""
        target = self._stems[clip].with_name(self._stems[clip].name + suffix)
        files.check_output(target, inputs=self._inputs)
        return target
