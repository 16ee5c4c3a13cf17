"""What happened in a training, a JSON object a line, and the same for TensorBoard.

A line has ``stage``, ``iteration``, ``seconds`` (of training so far, all stages, without evaluating and
writing), ``learning_rate``, ``loss`` (terms, weighted, averaged over the last hundred or so iterations) and
``errors`` (by part of the data, by name).
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from motion import files
from motion.console import needs
from motion.errors import UserError

Record = dict[str, Any]


def path_of(output: str | os.PathLike[str]) -> Path:
    """Where the log of a model's training stands."""
    return Path(f"{os.fspath(output)}.jsonl")


def read(path: str | os.PathLike[str]) -> list[Record]:
    """All lines; one that is none of a log is a UserError with its number. A cut last line is left out."""
    lines = files.read_text(path, remedy="give the .jsonl that `lmm train` wrote beside a model").split("\n")
    records = []
    for number, line in enumerate(lines[:-1], 1):
        record = _parsed(line)
        if record is None:
            raise UserError("not a line of a training's log", path=path, line=number)
        records.append(record)
    if not records:
        raise UserError("an empty log", path=path, remedy="wait for the first evaluation")
    return records


def _parsed(line: str) -> Record | None:
    try:
        found = json.loads(line)
        names = isinstance(found["stage"], str) and isinstance(found["iteration"], int)
        numbers = all(isinstance(v, int | float) for part in found["errors"].values() for v in part.values())
        whole = names and numbers and isinstance(found["loss"], dict)
        return found if whole and isinstance(found["seconds"], int | float) else None
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None


class Log:
    """Appends lines to a file, each written out at once.

    keep decides which of the lines already there stay, up to the first that does not; without it the file
    begins anew. A full disk is a UserError, and so is another training that writes the same log.
    """

    def __init__(self, path: Path, keep: Callable[[Record], bool] | None = None) -> None:
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream: IO[bytes] = open(path, "a+b")  # noqa: SIM115
            try:
                _lock(self._stream, path)
                self._stream.truncate(0 if keep is None else self._length(keep))
            except (OSError, UserError):
                self._stream.close()
                raise
        except OSError as error:
            raise self._cannot(error) from error

    def _length(self, keep: Callable[[Record], bool]) -> int:
        """Bytes of the lines that stay."""
        self._stream.seek(0)
        length = 0
        for line in self._stream:
            record = _parsed(line.decode(errors="replace")) if line.endswith(b"\n") else None
            if record is None or not keep(record):
                break
            length += len(line)
        return length

    def write(self, record: Record) -> None:
        """Add a line."""
        line = json.dumps(record, allow_nan=False).encode() + b"\n"
        try:
            self._stream.write(line)
            self._stream.flush()
        except OSError as error:
            raise self._cannot(error) from error

    def sync(self) -> None:
        """Wait until the disk has all of it."""
        try:
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise self._cannot(error) from error

    def close(self) -> None:
        try:
            self._stream.close()
        except OSError as error:
            raise self._cannot(error) from error

    def _cannot(self, error: OSError) -> UserError:
        return UserError(
            f"cannot write: {error.strerror or error}", path=self.path, remedy="make room and begin anew"
        )


def check_free(path: Path) -> None:
    """A UserError where another training writes a log at this moment."""
    with contextlib.suppress(OSError), open(path, "rb") as stream:
        _lock(stream, path)


def _lock(stream: IO[bytes], path: Path) -> None:
    """Until it is closed the stream's file is this training's alone, where the system can see to that."""
    try:
        import fcntl

        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        what = "another training of this model is under way"
        raise UserError(what, path=path, remedy="wait for it, stop it, or name another model") from error
    except (ImportError, OSError):
        pass


@needs("train", "tensorboard")
def check_board(folder: str | os.PathLike[str]) -> None:
    """A UserError where a `Board` could not be written."""
    files.check_output(Path(folder, "events"))


class Board:
    """Writes the same records for TensorBoard, a run a stage; steps from purge on are told to be void."""

    @needs("train", "tensorboard")
    def __init__(self, folder: str | os.PathLike[str], stage: str, *, purge: int | None = None) -> None:
        from torch.utils.tensorboard import SummaryWriter

        try:
            self._writer = SummaryWriter(os.path.join(folder, stage), purge_step=purge)
        except OSError as error:
            raise UserError(f"cannot write: {error.strerror or error}", path=folder) from error

    def write(self, record: Record) -> None:
        """The numbers of a line of the log."""
        step = record["iteration"]
        scalars = {"learning_rate": record["learning_rate"]}
        scalars |= {f"loss/{name}": value for name, value in record["loss"].items()}
        for part, errors in record["errors"].items():
            scalars |= {f"{name}/{part}": value for name, value in errors.items()}
        for name, value in scalars.items():
            self._writer.add_scalar(name, value, step)
        self._writer.flush()

    def close(self) -> None:
        self._writer.close()
