"""The memory question, measured: a row a system, what it holds and what its poses are worth."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bench import timing
from bench.comparison import memory_mb
from bench.entry import Entry
from bench.pose_error import COLUMNS, PARTS, PoseErrors, held_by_all
from bench.systems import choose, entries, without_legs
from lmm.pfnn.spline import SETS
from mm.database import Database
from motion import console
from motion.errors import UserError

from . import allocations, published, resident, stored
from .pareto import with_fronts

if TYPE_CHECKING:
    from lmm.models import AnyModel

COUNTS = (1, 16)
DRIFT_STEPS, DRIFT_STARTS = 10, 500
KINDS = {
    "mm": "search in all of the data",
    "small": "compressed",
    "lmm": "learned",
    "pfnn": "PFNN",
    "mann": "MANN",
}


@dataclass(eq=False)
class Memory:
    """What was measured.

    Attributes
    ----------
    systems : a row a system, see `measure`.
    features : bytes of features by the hour, ours beside those of others.
    published : what others hold, by frame of their data.
    notes : what a reader must know.
    database, models, machine : as `bench.comparison.Comparison` has them.
    """

    systems: pd.DataFrame
    features: pd.DataFrame
    published: pd.DataFrame
    notes: list[str]
    database: dict[str, Any]
    models: dict[str, dict[str, Any]] = field(default_factory=dict)
    machine: dict[str, str] = field(default_factory=timing.machine)


def measure(
    database: Database,
    path: str,
    *,
    models: Mapping[str, AnyModel] | None = None,
    codecs: Sequence[str] = (),
    systems: Sequence[str] | None = None,
    counts: Sequence[int] = COUNTS,
    peaks: bool = True,
    progress: Callable[..., Iterator[Any]] = console.silent,
) -> Memory:
    """Measure systems on a database, which stands in the file path.

    systems : names, families or patterns; None is all that hold the feet (or not, where legs are not whole),
        every codec (`bench.small.CODECS`) and format of weights among them.
    counts : of characters whose steps' allocations are counted.
    peaks : whether resident memory is measured, in a process a system.

    Columns, MB of 10^6 bytes:
        kind, about, source, way : what a system is, what it is made of, and how that runs (`Entry`).
        stored_mb, stored_PART_mb : the files that it is read from.
        memory_mb, memory_PART_mb : what it holds of one character (`mm.control.System.memory`).
        peak_mb, resident_mb : see `bench.memory.resident`.
        frame_bytes_N, search_bytes_N, blocks_N, kept_bytes_N : see `allocations`, of N characters.
        pose_cm and so on : see `bench.pose_error`; of networks of locomotion the same after one step from a
            true frame, which is harder, as error says ("decoded" or "one step").
        drift_cm, drift_held_cm : joints after 10 frames of the Stepper's own, on training and held-out clips.
        front, front_held : whether nothing smaller decodes poses better, on training and held-out clips.
    """
    models = dict(models or {})
    legs = without_legs(database) is None
    chosen = _chosen(systems, models, codecs, legs=legs)
    held = held_by_all(model.held_out for model in models.values())
    errors, notes, rows = PoseErrors(database, held), [], []
    with tempfile.TemporaryDirectory(prefix="memory-") as folder:
        made_of = stored.Files(database, path, models, Path(folder))
        steps = _Steps(database, models)
        for entry in progress(chosen, label="memory", unit="systems"):
            try:
                system = entry.make(database, 1)
            except UserError as why:
                notes.append(f"{entry.name} is left out: {why}")
                continue
            row: dict[str, Any] = {"system": entry.name, "kind": _kind(entry, models), "about": entry.about}
            row |= {"source": entry.source, "way": entry.way}
            subject = made_of.subject(entry)
            row |= stored.sizes(subject) | memory_mb(system)
            del system
            if peaks and resident.known_here():
                found = resident.measure(subject)
                row |= {"peak_mb": found.peak / 1e6, "resident_mb": found.kept / 1e6}
            row |= steps.allocated(entry, counts)
            row["error"] = "one step" if entry.decoder is None else "decoded"
            try:
                row |= steps.errors(entry) if entry.decoder is None else errors.of(entry.decoder)
                row |= steps.drift(entry, held)
            except UserError as why:
                notes.append(f"the error of {entry.name} is not known: {why}")
            rows.append(row)
    if not rows:
        raise UserError("no system could be measured", path=path, remedy=notes[0] if notes else "name some")
    table = pd.DataFrame(rows)
    parts = sorted(
        c for c in table if c.startswith(("memory_", "stored_")) and c not in ("memory_mb", "stored_mb")
    )
    table = table[[c for c in table if c not in parts] + parts]
    if peaks and not resident.known_here():
        notes.append("resident memory is not known: this machine has no /proc/self/clear_refs")
    if not held:
        notes.append("errors are of all clips where no others stand: no clip was held out of all the models")
    return Memory(
        with_fronts(table),
        pd.DataFrame(published.features(database)),
        pd.DataFrame(published.beside(database, table)),
        notes,
        {
            "name": path,
            "fingerprint": database.fingerprint,
            "frames": len(database),
            "fps": database.fps,
            "minutes": database.seconds / 60,
            "ranges": len(database.starts),
            "mirrored_ranges": int(database.mirrored.sum()),
            "joints": len(database.skeleton),
            "features": database.schema.size,
            "held_out": sorted(held),
        },
        {
            name: {
                "fingerprint": model.fingerprint,
                "database": model.database,
                "parameters": model.parameters,
            }
            for name, model in models.items()
        },
    )


def _chosen(
    systems: Sequence[str] | None, models: Mapping[str, AnyModel], codecs: Sequence[str], *, legs: bool
) -> list[Entry]:
    """What is asked for; else one of each pair of all that there is, weights as they are stored not twice."""
    if systems is not None:
        return choose(systems, models=models, codecs=codecs, legs=legs)
    stored_as = {
        name: {network.weight_type for network in model.networks.values()} for name, model in models.items()
    }
    return [
        entry
        for entry in entries(models=models, codecs=codecs)
        if entry.locked == legs and stored_as.get(entry.source) != {entry.weights}
    ]


def _kind(entry: Entry, models: Mapping[str, AnyModel]) -> str:
    from lmm.models import kind_of

    if entry.source in models:
        return KINDS[kind_of(models[entry.source])]
    return KINDS["small" if entry.source else "mm"]


class _Steps:
    """What is found by running systems: allocations, and errors of those that decode no frames."""

    def __init__(self, database: Database, models: Mapping[str, AnyModel]) -> None:
        self._database, self._models = database, models
        self._truths: dict[str, Any] = {}
        self._latents: dict[str, Any] = {}
        self._drifts: dict[tuple[str, str | None], dict[str, float]] = {}

    def allocated(self, entry: Entry, counts: Sequence[int]) -> dict[str, float]:
        """frame_bytes_N, search_bytes_N, blocks_N and kept_bytes_N."""
        out: dict[str, float] = {}
        for count in counts:
            found = allocations.of_steps(entry.make(self._database, count), allocations.wander(count))
            out |= {f"{name}_{count}": value for name, value in asdict(found).items()}
        return out

    def errors(self, entry: Entry) -> dict[str, float]:
        """Of a network of locomotion after one step from true frames, as `bench.pose_error` names them."""
        from lmm.evaluation import frames
        from lmm.evaluation.locomotion import truth_of
        from lmm.models import with_weights

        model: Any = self._models[entry.source]
        if entry.source not in self._truths:
            self._truths[entry.source] = truth_of(model, self._database)
        truth = self._truths[entry.source]
        truth.model, products = with_weights(model, entry.weights)
        mode: Any = entry.way if entry.way in SETS else "cubic"
        return {
            f"{PARTS[part]}_{end}": errors[what][which]
            for part, errors in frames.poses(truth, frames.step(truth, mode, products)).items()
            for end, (what, which) in COLUMNS.items()
        }

    def drift(self, entry: Entry, held: set[str]) -> dict[str, float]:
        """drift_cm, and drift_held_cm where clips are held out, if the Stepper is learned, its products are
        float32, and true latents are known."""
        from lmm.evaluation import stepper
        from lmm.model import Model
        from lmm.models import with_weights

        model, key = self._models.get(entry.source), (entry.source, entry.weights)
        if not isinstance(model, Model) or "S" not in entry.way or not model.knows_latents:
            return {}
        as_held, products = with_weights(model, entry.weights)
        if products != "float32":
            return {}
        if entry.source not in self._latents:
            self._latents[entry.source] = model.latents(self._database)
        if key not in self._drifts:
            database, latents = self._database, self._latents[entry.source]
            unseen, out = np.isin(database.names, list(held)), self._drifts.setdefault(key, {})
            for name, ranges in (("drift_cm", ~unseen), ("drift_held_cm", unseen)):
                if ranges.any():
                    found = stepper.drift(
                        as_held, database, latents, steps=DRIFT_STEPS, starts=DRIFT_STARTS, ranges=ranges
                    )
                    row = next(row for row in found.table() if row["steps"] == DRIFT_STEPS)
                    out[name] = row["joints_cm"]
        return self._drifts[key]
