"""What a page has to be: read once, by a parser that looks at what refers to what."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

VOID = {"meta", "br", "input", "img", "link", "hr"}


class Page(HTMLParser):
    """A page's ids, what refers to them, what it would fetch, its marked parts, and elements left open."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.uses: set[str] = set()
        self.fetched: list[str] = []
        self.marked: list[tuple[str, list[str]]] = []
        self.open: list[str] = []
        self.crossed: list[str] = []
        self.feed(text)
        self.uses |= set(re.findall(r"url\(#([^)]+)\)", text))

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            elif name in ("for", "aria-labelledby", "aria-describedby", "aria-controls"):
                self.uses |= set(value.split())
            elif name in ("src", "href", "xlink:href"):
                if value.startswith("#"):
                    self.uses.add(value[1:])
                elif not value.startswith("data:"):
                    self.fetched.append(value)
            elif name == "data-of":
                self.marked.append((tag, json.loads(value)))

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.crossed.append(tag)


def check(text: str) -> Page:
    """A page that is sound and stands alone."""
    page = Page(text)
    assert not page.crossed and not page.open
    assert len(page.ids) == len(set(page.ids))
    assert page.uses <= set(page.ids)
    assert page.fetched == []
    assert not re.search(r"url\((?!#)|@import|\bfetch\(|XMLHttpRequest", text)
    assert text.count("<script>") == 1 and "light-dark(" in text and "@media print" in text
    return page


def files(folder: Path) -> set[str]:
    """Names of what lies beside a page, but for what is there a second time, as Parquet."""
    names = {path.name for path in folder.iterdir()}
    return names - {f"{name.removesuffix('.csv')}.parquet" for name in names}
