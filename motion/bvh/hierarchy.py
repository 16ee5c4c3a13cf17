"""The text before MOTION: joints, their offsets, channels and end sites."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field

from .. import digits, text
from ..errors import UserError
from .document import CHANNELS

MOST_JOINTS, MOST_DEPTH = 1_000, 1_000
_CANONICAL = {name.lower(): name for name in CHANNELS}
_NAMED = re.compile(r"(ROOT|JOINT)\b\s*([^{]*)(.*)", re.IGNORECASE)

MakeFault = Callable[..., UserError]


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
    """The joints of the text before MOTION."""
    joints: list[Joint] = []
    blocks: list[tuple[int, bool]] = []  # open blocks: joint, whether it is an end site of that joint
    announced: tuple[int, bool] | None = None  # by ROOT, JOINT or End, before its "{"
    line = 0

    def fault(what: str, remedy: str = text.WHOLE_COPY) -> UserError:
        return UserError(what, path=path, line=line, remedy=remedy)

    for line, rest in enumerate(header.split("\n"), 1):
        rest = rest.strip()
        while rest and not rest.startswith(("#", "//")):
            if rest[0] == "{":
                if announced is None:
                    raise fault("'{' without ROOT, JOINT or End Site before it")
                blocks.append(announced)
                announced, rest = None, rest[1:].lstrip()
                if len(blocks) > MOST_DEPTH:
                    raise fault(f"joints nested more than {MOST_DEPTH} deep", "no body has such a skeleton")
                continue
            if announced is not None:
                raise fault(f"expected '{{', found {text.shown(rest)}")
            if rest[0] == "}":
                if not blocks:
                    raise fault("'}' without its '{'")
                blocks.pop()
                rest = rest[1:].lstrip()
                continue
            word, *tail = rest.split(None, 1)
            keyword, rest = word.upper(), tail[0] if tail else ""
            named = _NAMED.match(f"{word} {rest}") if keyword.startswith(("ROOT", "JOINT")) else None
            if named is not None:
                _check_place(named[1].upper(), blocks, joints, fault)
                name = named[2].strip()
                if not name:
                    raise fault("a joint without a name", "write one behind " + named[1])
                joints.append(Joint(name, blocks[-1][0] if blocks else -1, line))
                if len(joints) > MOST_JOINTS:
                    raise fault(f"more than {MOST_JOINTS} joints", "no body has such a skeleton")
                announced, rest = (len(joints) - 1, False), named[3]
            elif keyword == "END":
                if not blocks or blocks[-1][1]:
                    raise fault("End Site outside of a joint")
                announced, rest = (blocks[-1][0], True), "{" + rest.partition("{")[2] if "{" in rest else ""
            elif keyword == "OFFSET":
                if not blocks:
                    raise fault("OFFSET outside of a joint")
                words = rest.split(None, 3)
                offset, rest = _numbers(words[:3], fault), words[3] if len(words) > 3 else ""
                joint, is_end = joints[blocks[-1][0]], blocks[-1][1]
                if is_end:
                    joint.ends.append(offset)
                elif joint.offset is not None:
                    raise fault(f"a second OFFSET in joint {text.shown(joint.name)}")
                else:
                    joint.offset = offset
            elif keyword == "CHANNELS":
                if not blocks or blocks[-1][1] or joints[blocks[-1][0]].channels is not None:
                    raise fault("CHANNELS outside of a joint, or a second time")
                joints[blocks[-1][0]].channels, rest = _channel_list(rest, fault)
            elif keyword != "HIERARCHY":
                raise fault(f"unexpected {text.shown(word)} in the hierarchy")
    if announced is not None or blocks:
        open_joint = joints[(announced or blocks[-1])[0]]
        raise fault(f"the hierarchy ends inside joint {text.shown(open_joint.name)}: '}}' is missing")
    if not joints:
        raise fault("no ROOT joint")
    for joint in joints:
        if joint.offset is None:
            line = joint.line
            raise fault(f"joint {text.shown(joint.name)} has no OFFSET")
    return joints


def _check_place(keyword: str, blocks: list[tuple[int, bool]], joints: list[Joint], fault: MakeFault) -> None:
    if blocks and blocks[-1][1]:
        raise fault(f"{keyword} inside an End Site")
    if keyword == "ROOT" and blocks:
        raise fault("ROOT inside a joint", "write JOINT there")
    if keyword == "JOINT" and not blocks:
        raise fault("JOINT outside of a joint", "write ROOT for the first one")
    if keyword == "ROOT" and joints:
        raise fault("a second ROOT", "put each character into its own file")


def _numbers(words: list[str], fault: MakeFault) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != 3 or not all(abs(value) <= digits.LIMIT for value in values):
        raise fault(f"OFFSET needs three finite numbers, found {text.shown(' '.join(words))}")
    return values


def _channel_list(rest: str, fault: MakeFault) -> tuple[tuple[str, ...], str]:
    """The channels behind CHANNELS, and what follows them on the line."""
    count, *words = rest.split(None, 7) or [""]
    if not count.isdecimal() or int(count) > 6:
        raise fault(f"CHANNELS needs a count of 0 to 6, found {text.shown(count)}")
    found = words[: int(count)]
    if len(found) < int(count):
        raise fault(f"CHANNELS {count} lists only {len(found)}")
    channels = tuple(_CANONICAL.get(word.lower(), "") for word in found)
    if "" in channels:
        unknown = found[channels.index("")]
        raise fault(f"unknown channel {text.shown(unknown)}", f"the channels are {', '.join(CHANNELS)}")
    if len(set(channels)) < len(channels):
        raise fault("a channel is listed twice", "each joint may have each channel once")
    return channels, " ".join(words[int(count) :])
