"""The text before MOTION: joints, their offsets, channels and end sites."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from typing import NoReturn

from .. import digits, text
from ..errors import UserError
from .document import CHANNELS, SCALES

MOST_JOINTS, MOST_DEPTH, MOST_END_SITES = 1_000, 1_000, 10_000
_CANONICAL = {name.lower(): name for name in CHANNELS + SCALES}
_WORD = re.compile(r"\s*([{}]|[^\s{}]+)")
_RUNS = [re.compile(rf"\s*[^\s{{}}]++(?:\s++[^\s{{}}]++){{{n - 1}}}") for n in range(1, 10)]  # of n words
_NAME = re.compile(r"[^{]*")
_TOO_LARGE = "no body has such a skeleton"


@dataclass
class Joint:
    """A joint as far as it has been read; `line` is where it is named."""

    name: str
    parent: int
    line: int
    offset: list[float] | None = None
    ends: list[list[float]] = field(default_factory=list)
    channels: tuple[str, ...] | None = None


def read_hierarchy(header: str, path: str | os.PathLike[str]) -> list[Joint]:
    """The joints of the text before MOTION, at least one, each with an offset; else a UserError."""
    return _Hierarchy(header, path).read()


class _Hierarchy:
    """Joints and open blocks on the way through the text, word by word."""

    def __init__(self, header: str, path: str | os.PathLike[str]) -> None:
        self.header, self.path = header, path
        self.content, self.line, self.at = "", 0, 0  # the present line, its number, the place in it
        self.joints: list[Joint] = []
        self.blocks: list[tuple[int, bool]] = []  # open ones: joint, whether it is an end site of that joint
        self.announced: tuple[int, bool] | None = None  # by ROOT, JOINT or End, before its "{"
        self.end_sites = 0  # of all joints

    def read(self) -> list[Joint]:
        for line, content in enumerate(text.lines(self.header), 1):
            self.line, self.content, self.at = line, content.strip(), 0
            while self.at < len(self.content):
                word = self.word()
                if word.startswith(("#", "//")):
                    break
                self.statement(word)
        if self.announced is not None or self.blocks:
            joint = self.joints[(self.announced or self.blocks[-1])[0]]
            self.fault(f"the hierarchy ends inside joint {text.shown(joint.name)}: '}}' is missing")
        if not self.joints:
            self.fault("no ROOT joint")
        for joint in self.joints:
            if joint.offset is None:
                self.line = joint.line
                self.fault(f"joint {text.shown(joint.name)} has no OFFSET")
        return self.joints

    def fault(self, what: str, remedy: str = text.WHOLE_COPY) -> NoReturn:
        raise UserError(what, path=self.path, line=self.line, remedy=remedy)

    def word(self) -> str:
        """The next word or brace of the line; empty at its end."""
        match = _WORD.match(self.content, self.at)
        if match is None:
            return ""
        self.at = match.end()
        return match[1]

    def words(self, count: int) -> list[str]:
        """The next words of the line, at most count, none of them a brace."""
        run = _RUNS[count - 1].match(self.content, self.at) if count else None
        if run is not None:
            self.at = run.end()
            return run[0].split()
        found: list[str] = []
        while len(found) < count:
            before, word = self.at, self.word()
            if word in ("", "{", "}"):
                self.at = before
                break
            found.append(word)
        return found

    def name(self) -> str:
        """What stands on the line before the next "{"."""
        match = _NAME.match(self.content, self.at)
        self.at = match.end() if match else self.at
        return match[0].strip() if match else ""

    def statement(self, word: str) -> None:
        """Read on behind word, the first of a statement."""
        keyword = word.upper()
        if word == "{":
            self.open()
        elif self.announced is not None:
            self.fault(f"expected '{{', found {text.shown(self.content[self.at - len(word) :][:40].strip())}")
        elif word == "}":
            if not self.blocks:
                self.fault("'}' without its '{'")
            self.blocks.pop()
        elif keyword in ("ROOT", "JOINT"):
            self.joint(keyword)
        elif keyword in ("END", "ENDSITE"):
            self.end_site()
        elif keyword == "OFFSET":
            self.offset()
        elif keyword == "CHANNELS":
            self.channels()
        elif keyword != "HIERARCHY":
            self.fault(f"unexpected {text.shown(word)} in the hierarchy")

    def open(self) -> None:
        if self.announced is None:
            self.fault("'{' without ROOT, JOINT or End Site before it")
        self.blocks.append(self.announced)
        self.announced = None
        if len(self.blocks) > MOST_DEPTH:
            self.fault(f"joints nested more than {MOST_DEPTH} deep", _TOO_LARGE)

    def joint(self, keyword: str) -> None:
        if self.blocks and self.blocks[-1][1]:
            self.fault(f"{keyword} inside an End Site")
        if keyword == "ROOT" and self.blocks:
            self.fault("ROOT inside a joint", "write JOINT there")
        if keyword == "JOINT" and not self.blocks:
            self.fault("JOINT outside of a joint", "write ROOT for the first one")
        if keyword == "ROOT" and self.joints:
            self.fault("a second ROOT", "put each character into its own file")
        name = self.name()
        if not name:
            self.fault("a joint without a name", "write one behind " + keyword)
        self.joints.append(Joint(name, self.blocks[-1][0] if self.blocks else -1, self.line))
        if len(self.joints) > MOST_JOINTS:
            self.fault(f"more than {MOST_JOINTS} joints", _TOO_LARGE)
        self.announced = len(self.joints) - 1, False

    def end_site(self) -> None:
        if not self.blocks or self.blocks[-1][1]:
            self.fault("End Site outside of a joint")
        self.name()  # "Site", or whatever an exporter calls it
        self.announced = self.blocks[-1][0], True

    def offset(self) -> None:
        if not self.blocks:
            self.fault("OFFSET outside of a joint")
        words = self.words(3)
        try:
            value = [float(word) for word in words]
        except ValueError:
            value = []
        if len(value) != 3 or not all(abs(x) <= digits.LIMIT for x in value):
            remedy = "write numbers with a decimal point" if "," in "".join(words) else text.WHOLE_COPY
            self.fault(f"OFFSET needs three finite numbers, found {text.shown(' '.join(words))}", remedy)
        joint, is_end = self.joints[self.blocks[-1][0]], self.blocks[-1][1]
        if is_end:
            joint.ends.append(value)
            self.end_sites += 1
            if self.end_sites > MOST_END_SITES:
                self.fault(f"more than {MOST_END_SITES} end sites", _TOO_LARGE)
        elif joint.offset is not None:
            self.fault(f"a second OFFSET in joint {text.shown(joint.name)}")
        else:
            joint.offset = value

    def channels(self) -> None:
        at_end = bool(self.blocks) and self.blocks[-1][1]
        count, most = "".join(self.words(1)), len(_CANONICAL)
        if at_end and count == "0":
            return
        if not self.blocks or at_end or self.joints[self.blocks[-1][0]].channels is not None:
            self.fault("CHANNELS outside of a joint, or a second time")
        if not re.fullmatch(r"0*[0-9]", count):
            self.fault(f"CHANNELS needs a count of 0 to {most}, found {text.shown(count)}")
        found = self.words(int(count[-1]))
        if len(found) < int(count[-1]):
            self.fault(f"CHANNELS {count} lists only {len(found)}")
        channels = tuple(_CANONICAL.get(word.lower(), "") for word in found)
        if "" in channels:
            unknown = found[channels.index("")]
            self.fault(f"unknown channel {text.shown(unknown)}", f"the channels are {', '.join(CHANNELS)}")
        if len(set(channels)) < len(channels):
            self.fault("a channel is listed twice", "each joint may have each channel once")
        self.joints[self.blocks[-1][0]].channels = channels
