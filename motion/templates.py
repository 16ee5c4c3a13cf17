"""TOML to start from: what a dataclass holds, as a person would write it, and what its keys mean."""

from __future__ import annotations

import dataclasses
import inspect
import json
import os
import re
import textwrap
from collections.abc import Mapping
from typing import Any

WIDTH = 100


def compact(obj: Any) -> str:
    """TOML text of a dataclass without what is at its default: a line a key, a line a table in a list.

    `motion.config.load` reads the same dataclass back.
    """
    return "".join(f"{key} = {_value(value, top=True)}\n" for key, value in _changed(obj).items())


def explained(obj: Any) -> str:
    """TOML text of a flat dataclass with all its keys, under what its docstring's Attributes say of them."""
    summary, about = documentation(type(obj))
    lines, before = [_comment(summary)], ""
    for key, value in ((field.name, getattr(obj, field.name)) for field in dataclasses.fields(obj)):
        if about.get(key, "") != before or not before:
            before = about.get(key, "")
            lines += ["", _comment(before)]
        lines.append(f"# {key} = (not set)" if value is None else f"{key} = {_value(value)}")
    return "\n".join(lines) + "\n"


def _changed(obj: Any) -> dict[str, Any]:
    """Plain data of a dataclass without what is at its default, those inside it likewise."""
    found = {}
    for field in dataclasses.fields(obj):
        value, default = getattr(obj, field.name), field.default
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        if value is not None and value != default:
            found[field.name] = _plain(value)
    return found


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return _changed(value)
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, os.PathLike) else value


def _value(value: Any, *, top: bool = False) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        rows = [_value(item) for item in value]
        if top and any(isinstance(item, Mapping) for item in value):
            return "[\n" + "".join(f"    {row},\n" for row in rows) + "]"
        return "[" + ", ".join(rows) + "]"
    return json.dumps(value, ensure_ascii=False)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key)


def documentation(cls: type) -> tuple[str, dict[str, str]]:
    """A docstring's first paragraph, and its Attributes by name, each on one line."""
    text = inspect.getdoc(cls) or ""
    entries = re.findall(r"^(\w[\w, ]*) : (.*(?:\n +.*)*)", text.partition("-\n")[2], re.M)
    about = {name: " ".join(words.split()) for names, words in entries for name in names.split(", ")}
    return " ".join(text.partition("\n\n")[0].split()), about


def _comment(text: str) -> str:
    return textwrap.fill(text, WIDTH, initial_indent="# ", subsequent_indent="# ")
