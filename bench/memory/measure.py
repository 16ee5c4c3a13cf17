"""The memory question, measured: a row a system, what it holds and what its poses are worth."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bench import timing
from bench.compare import memory_mb
from bench.entry import Entry
from bench.learned import ENDINGS
from bench.pose_error import COLUMNS, PARTS, PoseErrors, held_by_all
from bench.systems import choose, entries, without_legs
from lmm.pfnn.spline import SETS
from mm import course as courses
from mm.database import Database
from mm.driving import Clock, at_data_speeds, drive
from motion import console, files
from motion.errors import UserError

from . import allocations, published, resident, stored
from .pareto import front

if TYPE_CHECKING:
    from lmm.models import AnyModel

COUNTS = (1, 256)
FRAMES = 150  # of which the first do not count
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
    database, models, machine : as `bench.compare.Comparison` has them.
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
        stored_mb, stored_PART_mb : the files that it is read from.
        memory_mb, memory_PART_mb : what it holds of one character (`mm.control.System.memory`).
        peak_mb, resident_mb : see `bench.memory.resident`.
        frame_bytes_N, search_bytes_N, blocks_N, kept_bytes_N : see `allocations`, of N characters.
        pose_cm and so on : see `bench.pose_error`; of networks of locomotion the same after one step from a
            true frame, which is harder, as error says ("decoded" or "one step").
        drift_cm : joints after 10 frames of the Stepper's own, on training clips.
        front, front_held : whether nothing smaller decodes poses better, on training and held-out clips.
    """
    models = dict(models or {})
    legs = without_legs(database) is None
    chosen = _chosen(systems, models, codecs, legs=legs)
    held = held_by_all(model.held_out for model in models.values())
    errors, notes, rows = PoseErrors(database, held), [], []
    with tempfile.TemporaryDirectory(prefix="memory-") as folder:
        made_of = _Files(database, path, models, Path(folder))
        steps = _Steps(database, models)
        for entry in progress(chosen, label="memory", unit="systems"):
            try:
                system = entry.make(database, 1)
            except UserError as why:
                notes.append(f"{entry.name} is left out: {why}")
                continue
            row: dict[str, Any] = {"system": entry.name, "kind": _kind(entry, models), "about": entry.about}
            row |= made_of.sizes(entry) | memory_mb(system)
            del system
            row |= made_of.peaks(entry) if peaks and resident.known_here() else {}
            row |= steps.allocated(entry, counts)
            with suppress(UserError):
                row |= steps.errors(entry) if entry.decoder is None else errors.of(entry.decoder)
            row["error"] = "one step" if entry.decoder is None else "decoded"
            row |= steps.drift(entry, held)
            rows.append(row)
    if not rows:
        raise UserError("no system could be measured", path=path, remedy=notes[0] if notes else "name some")
    table = pd.DataFrame(rows)
    parts = sorted(
        c for c in table if c.startswith(("memory_", "stored_")) and c not in ("memory_mb", "stored_mb")
    )
    table = table[[c for c in table if c not in parts] + parts]
    for name, column in (("front", "pose_cm"), ("front_held", "pose_held_cm")):
        if column in table:
            error = table[column].where(table["error"] == "decoded")
            table[name] = front(np.column_stack([table["memory_mb"], error]))
    if peaks and not resident.known_here():
        notes.append("resident memory is not known: this machine has no /proc/self/clear_refs")
    if not held:
        notes.append("errors are of all clips: no model is given that was trained without some of them")
    return Memory(
        table,
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


class _Files:
    """The files that systems are read from; those of a codec or of other weights are made for the while."""

    def __init__(self, database: Database, path: str, models: Mapping[str, AnyModel], folder: Path) -> None:
        self._database, self._path, self._models, self._folder = database, path, models, folder
        self._made: tuple[Any, ...] = ()

    def sizes(self, entry: Entry) -> dict[str, float]:
        """stored_mb and by part."""
        subject = self._subject(entry)
        out: dict[str, float] = {}
        for path in (*subject.models, *subject.codecs, *filter(None, [subject.database])):
            for part, size in stored.parts(path).items():
                name = f"stored_{part.replace(' ', '_')}_mb"
                out[name] = out.get(name, 0) + size / 1e6
        return {"stored_mb": sum(out.values())} | out

    def peaks(self, entry: Entry) -> dict[str, float]:
        """peak_mb and resident_mb."""
        found = resident.measure(self._subject(entry))
        return {"peak_mb": found.peak / 1e6, "resident_mb": found.kept / 1e6}

    def _subject(self, entry: Entry) -> resident.Subject:
        """What a process of its own needs to make a system: the files, and its name there."""
        if not entry.source:
            return resident.Subject(entry.name, self._path)
        made = self._file(entry)
        free = "" if entry.locked else "-free"
        if entry.source not in self._models:
            index = entry.name.split("-", 2)[1]
            return resident.Subject(f"mm-{index}-{made.stem}{free}", codecs=[str(made)])
        kind = made.suffix.removeprefix(".")
        ending = ENDINGS[entry.weights] if entry.weights == "bfloat16" else ""
        database = None if entry.alone else self._path
        return resident.Subject(f"{kind}-{entry.way}{ending}{free}", database, [str(made)])

    def _file(self, entry: Entry) -> Path:
        """A codec's file, or a model's, its weights as they are held, without what it needs no more."""
        from lmm.model import Model
        from lmm.models import kind_of, with_weights
        from mm.codecs.compressed import compress

        if entry.source not in self._models and files.kind(entry.source) == "file":
            return Path(entry.source)
        model = self._models.get(entry.source)
        key = entry.source, entry.weights, entry.alone
        path = self._folder / ("small.mmdb" if model is None else f"model.{kind_of(model)}")
        if self._made != key:
            self._made = key
            if model is None:
                compress(self._database, entry.source, rigs=False).save(path)
            else:
                held, _ = with_weights(model, entry.weights)
                (held.without_latents() if entry.alone and isinstance(held, Model) else held).save(path)
        return path


class _Steps:
    """What is found by running systems: allocations, and errors of those that decode no frames."""

    def __init__(self, database: Database, models: Mapping[str, AnyModel]) -> None:
        self._database, self._models = database, models
        self._course = at_data_speeds(courses.load("random"), database)
        self._truths: dict[str, Any] = {}
        self._drifts: dict[tuple[str, str | None], float] = {}

    def allocated(self, entry: Entry, counts: Sequence[int]) -> dict[str, float]:
        """frame_bytes_N, search_bytes_N, blocks_N and kept_bytes_N."""
        out: dict[str, float] = {}
        for count in counts:
            system = entry.make(self._database, count)
            clock = Clock(self._course, count, system.fps, spread=True)
            next(frame for frame in drive(system, clock) if frame == FRAMES)
            system.reset(clock.starts, clock.yaws)
            found = allocations.of_steps(system, clock.commands[:FRAMES])
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
        truth.model = with_weights(model, entry.weights)[0]
        mode: Any = entry.way if entry.way in SETS else "cubic"
        return {
            f"{PARTS[part]}_{end}": errors[what][which]
            for part, errors in frames.poses(truth, frames.step(truth, mode)).items()
            for end, (what, which) in COLUMNS.items()
        }

    def drift(self, entry: Entry, held: set[str]) -> dict[str, float]:
        """drift_cm, where the Stepper is learned and the latents of true frames are known."""
        from lmm.evaluation import stepper
        from lmm.model import Model
        from lmm.models import with_weights

        model, key = self._models.get(entry.source), (entry.source, entry.weights)
        if not isinstance(model, Model) or "S" not in entry.way or not model.knows_latents:
            return {}
        if key not in self._drifts:
            database, (as_held, _) = self._database, with_weights(model, entry.weights)
            trained = ~np.isin(database.names, list(held))
            found = stepper.drift(
                as_held,
                database,
                model.latents(database),
                steps=DRIFT_STEPS,
                starts=DRIFT_STARTS,
                ranges=trained,
            )
            self._drifts[key] = next(row["joints_cm"] for row in found.table() if row["steps"] == DRIFT_STEPS)
        return {"drift_cm": self._drifts[key]}
