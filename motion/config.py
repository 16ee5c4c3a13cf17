"""Configuration: TOML files to validated dataclasses and back.

A dataclass describes its keys by its fields: types are bool, int, float, str, Path, ``Literal[...]``
(choices), tuple, list, dict with string keys, another dataclass, or any of them ``| None``. Fields without a
default are required.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import os
import re
import sys
import tomllib
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, Union

import tomli_w

from .errors import UserError
from .files import atomic, read_text

T = TypeVar("T")
Key = tuple[str | int, ...]
_hints: Callable[[Any], dict[str, Any]] = functools.cache(typing.get_type_hints)


class ConfigError(UserError):
    """A fault at one key: ``features[2].role: ...``.

    A dataclass's own ``__post_init__`` raises it with the name of the field; the enclosing keys are put
    before it on the way up.
    """

    def __init__(self, key: str | int | Key, what: str, *, remedy: str | None = None) -> None:
        super().__init__(what, remedy=remedy)
        self.key: Key = key if isinstance(key, tuple) else (key,)

    def __str__(self) -> str:
        where = dotted(self.key)
        return f"{where}: {super().__str__()}" if where else super().__str__()


def dotted(key: Key) -> str:
    """``("features", 2, "role")`` as ``features[2].role``."""
    text = ""
    for part in key:
        if isinstance(part, str) and not (part.isprintable() and len(part) <= 60):
            part = shown(part)
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def choices(names: Iterable[str]) -> str:
    """The remedy that lists the choices."""
    return f"choose from {', '.join(names) or 'nothing: there is none'}"


def from_dict(cls: type[T], data: Any, where: str = "") -> T:
    """A dataclass from plain data (as TOML gives it).

    where is put before the key in messages. An unknown or missing key, a wrong type or a bad choice is a
    `ConfigError` that names the key.
    """
    try:
        return _build(cls, data)
    except ConfigError as error:
        error.key = (where, *error.key) if where else error.key
        raise


def to_dict(obj: Any) -> dict[str, Any]:
    """Plain data of a dataclass; None is left out, for TOML has none."""
    return {
        field.name: _plain(getattr(obj, field.name))
        for field in dataclasses.fields(obj)
        if field.init and getattr(obj, field.name) is not None
    }


def load(cls: type[T], path: str | os.PathLike[str], *, base: T | None = None) -> T:
    """A dataclass from a TOML file; faults are UserErrors with file and, where it can be told, line.

    What the file leaves out, within its tables too, is as in base, if there is one.
    """
    data, text = read_toml(path)
    try:
        return from_dict(cls, data if base is None else _over(to_dict(base), data))
    except ConfigError as error:
        where = dotted(error.key)
        what = f"{where}: {error.what}" if where else error.what
        raise UserError(what, path=path, line=line_of(text, error.key), remedy=error.remedy) from error
    except UserError as error:
        raise UserError(error.what, path=error.path or path, line=error.line, remedy=error.remedy) from error


def dumps(obj: Any) -> str:
    """TOML text of a dataclass, or of plain data."""
    return tomli_w.dumps(to_dict(obj) if dataclasses.is_dataclass(obj) else dict(obj))


def dump(obj: Any, path: str | os.PathLike[str]) -> None:
    """Write a dataclass as TOML, atomically."""
    with atomic(path, "w") as stream:
        stream.write(dumps(obj))


def read_toml(path: str | os.PathLike[str]) -> tuple[dict[str, Any], str]:
    """Data and text of a TOML file; one that is missing, binary or no TOML is a UserError."""
    text = read_text(path, remedy="give a TOML file in UTF-8")
    try:
        return tomllib.loads(text), text
    except tomllib.TOMLDecodeError as error:
        raise _toml_error(error, path) from error
    except RecursionError as error:
        raise UserError("not valid TOML: nested too deeply", path=path, remedy="give a flat file") from error
    except ValueError as error:  # a whole number of thousands of digits
        raise UserError(f"not valid TOML: {error}", path=path, remedy="give smaller numbers") from error


def validate(obj: Any) -> None:
    """Check and coerce every field of a dataclass made in code; call it in ``__post_init__``."""
    hints = _hints(type(obj))
    for field in dataclasses.fields(obj):
        value = _convert(hints[field.name], getattr(obj, field.name), (field.name,))
        object.__setattr__(obj, field.name, value)


def _over(base: Any, data: Any) -> Any:
    """Plain data with what it leaves out taken from base."""
    if not (isinstance(base, Mapping) and isinstance(data, Mapping)):
        return data
    return {**base, **{key: _over(base.get(key), value) for key, value in data.items()}}


def _build(cls: type[T], data: Any) -> T:
    if not isinstance(data, Mapping):
        raise ConfigError((), f"expected a table, found {_describe(data)}")
    hints = _hints(cls)
    fields = {field.name: field for field in dataclasses.fields(cls) if field.init}  # type: ignore[arg-type]
    for key in data:
        if key not in fields:
            raise ConfigError(str(key), "unknown key", remedy=choices(fields))
    values = {}
    for name, field in fields.items():
        if name in data:
            values[name] = _convert(hints[name], data[name], (name,))
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise ConfigError(name, "missing key")
    return cls(**values)


def _convert(kind: Any, value: Any, key: Key) -> Any:
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return value
    if origin is Literal:
        if value not in args:
            raise ConfigError(key, f"{shown(value)} is no choice", remedy=choices(map(str, args)))
        return value
    if origin in (Union, types.UnionType):
        return _convert_union(args, value, key)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        if isinstance(value, kind):
            return value
        try:
            return _build(kind, value)
        except ConfigError as error:
            error.key = (*key, *error.key)
            raise
    if origin in (tuple, list):
        return _convert_sequence(origin, args, value, key)
    if origin in (dict, Mapping):
        if not isinstance(value, Mapping):
            raise ConfigError(key, f"expected a table, found {_describe(value)}")
        return {str(k): _convert(args[1], v, (*key, str(k))) for k, v in value.items()}
    return _convert_scalar(kind, value, key)


def _convert_union(kinds: tuple, value: Any, key: Key) -> Any:
    if value is None and types.NoneType in kinds:
        return None
    kinds = tuple(kind for kind in kinds if kind is not types.NoneType)
    for kind in kinds[:-1]:
        try:
            return _convert(kind, value, key)
        except ConfigError:
            continue
    return _convert(kinds[-1], value, key)


def _convert_sequence(origin: type, args: tuple, value: Any, key: Key) -> Any:
    if isinstance(value, str) or not isinstance(value, (list, tuple)):
        raise ConfigError(key, f"expected a list, found {_describe(value)}")
    if origin is tuple and not (len(args) == 2 and args[1] is Ellipsis):
        if len(value) != len(args):
            raise ConfigError(key, f"expected {len(args)} values, found {len(value)}")
        return tuple(_convert(args[i], v, (*key, i)) for i, v in enumerate(value))
    return origin(_convert(args[0], v, (*key, i)) for i, v in enumerate(value))


def _convert_scalar(kind: Any, value: Any, key: Key) -> Any:
    if kind is float:
        whole = isinstance(value, int) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
        if whole or (isinstance(value, float) and not math.isnan(value)):
            return float(value)
    elif kind is int:
        if isinstance(value, int) and not isinstance(value, bool) and -(1 << 63) <= value < 1 << 63:
            return value
    elif kind is Path:
        if isinstance(value, (str, os.PathLike)):
            return Path(value)
    elif kind in (bool, str):
        if isinstance(value, kind):
            return value
    else:
        raise TypeError(f"{dotted(key)}: fields of type {kind} are not supported")
    names = {float: "a number", int: "a whole number", bool: "true or false", str: "a string", Path: "a path"}
    raise ConfigError(key, f"expected {names[kind]}, found {_describe(value)}")


def _describe(value: Any) -> str:
    return "a table" if isinstance(value, Mapping) else "a list" if isinstance(value, list) else shown(value)


def shown(value: Any) -> str:
    """A value in a message, cut where it is long."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return to_dict(value)
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return str(value) if isinstance(value, os.PathLike) else value


def _toml_error(error: tomllib.TOMLDecodeError, path: str | os.PathLike[str]) -> UserError:
    found = re.match(r"(.*) \(at line (\d+), column \d+\)$", str(error))
    what, line = (found[1], int(found[2])) if found else (str(error), None)
    return UserError(f"not valid TOML: {what}", path=path, line=line, remedy="correct the line")


def line_of(text: str, key: Key) -> int | None:
    """1-based line of a key in TOML text, or of the nearest enclosing key; None when it is at no line.

    Knows table headers, arrays of tables and inline tables one a line; what it cannot tell it leaves to the
    enclosing key.
    """
    lines = text.split("\n")
    table: Key = ()
    counts: dict[Key, int] = {}
    best, best_length = None, 0
    for number, line in enumerate(lines, 1):
        if header := re.match(r"\s*(\[\[?)\s*([^\]]+?)\s*\]", line):
            table = ()
            parts = _split(header[2])
            for i, part in enumerate(parts):
                table = (*table, part)
                if header[1] == "[[" and i == len(parts) - 1:
                    counts[table] = counts.get(table, -1) + 1
                if table in counts:
                    table = (*table, counts[table])
            here = table
        elif found := re.match(r"\s*((?:[\w.\- ]|\"[^\"]*\"|'[^']*')+?)\s*=", line):
            here = (*table, *_split(found[1]))
        else:
            continue
        shared = min(len(here), len(key))
        if shared > best_length and key[:shared] == here[:shared]:
            best, best_length = number, shared
    rest = key[best_length:]
    if best is not None and len(rest) > 1 and isinstance(rest[0], int):
        inline = [n for n in range(best, len(lines) + 1) if "{" in lines[n - 1]]
        if rest[0] < len(inline) and re.search(rf"\b{re.escape(str(rest[1]))}\b", lines[inline[rest[0]] - 1]):
            return inline[rest[0]]
    return best


def _split(name: str) -> Key:
    return tuple(part.strip(" \"'") for part in name.split("."))
