"""Pages of one kind: a template of `templates/` in the skeleton, style and script that all of them share."""

from __future__ import annotations

import math
from importlib import resources
from typing import Any

from . import kept


def render(name: str, **values: Any) -> str:
    """The page that a template makes of values; it holds all that it needs."""
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, loader=jinja2.FunctionLoader(_text)
    )
    environment.globals |= {"style": Markup(_text("page.css")), "script": Markup(_text("page.js"))}
    environment.globals["source"] = kept.code
    return environment.get_template(name).render(**values)


def _text(name: str) -> str:
    return (resources.files("bench") / "templates" / name).read_text("utf-8")


def known(value: Any) -> bool:
    """Whether a cell has a number."""
    return value is not None and math.isfinite(value)


def number(value: Any, digits: int) -> str:
    """A number with so many digits after the point, a dash where there is none."""
    return f"{value:,.{digits}f}" if known(value) else "–"
