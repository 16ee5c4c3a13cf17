"""Hypothesis strategies: documents by their grammar, valid and nearly so."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import strategies as st

NUMBERS = st.one_of(
    st.integers(-400, 400).map(str),
    st.floats(-1e6, 1e6, allow_nan=False).map(repr),
    st.sampled_from(["0", "-0", "+1.", ".5", "1e-7", "-3.5E+02", "123456.789012345678901", "1e14"]),
)
ODD_NUMBERS = st.sampled_from(
    ["nan", "-inf", "1e999", "1,5", "", "x", "0x1", "1_0", "9" * 400, "1e", "٣", "{"]
)
NAMES = st.one_of(
    st.sampled_from("Hips LeftUpLeg RightUpLeg LeftFoot RightFoot Spine Head LeftArm a".split()),
    st.sampled_from(
        ["Bip01 L Thigh", "mixamorig:LeftLeg", "ns|Händ", "腰", "End Site", "MOTION", "#1", "a{b"]
    ),
    st.text(st.characters(blacklist_categories=["Cs", "Cc", "Zl", "Zp"]), min_size=1, max_size=8),
)
POSITIONS = [f"{axis}position" for axis in "XYZ"]
TURNS = [f"{axis}rotation" for axis in "XYZ"]


@dataclass
class _Bvh:
    lines: list[str]
    columns: int = 0


@st.composite
def bvh(draw: st.DrawFn) -> str:
    """A BVH file that is valid where its names and numbers are."""
    out = _Bvh(["HIERARCHY"])

    def vector() -> str:
        return " ".join(draw(NUMBERS) for _ in range(3))

    def joint(keyword: str, depth: int) -> None:
        out.lines.append(f"{keyword} {draw(NAMES)}")
        out.lines.append("{")
        channels = draw(st.lists(st.sampled_from(POSITIONS + TURNS), unique=True, max_size=6))
        parts = [f"OFFSET {vector()}", " ".join(["CHANNELS", str(len(channels)), *channels])]
        out.columns += len(channels)
        out.lines += parts if draw(st.booleans()) else parts[::-1]
        children = draw(st.integers(0, 2 if depth < 4 else 0))
        for _ in range(children):
            joint("JOINT", depth + 1)
        if children == 0 and draw(st.booleans()):
            out.lines += ["End Site", "{", f"OFFSET {vector()}", "}"]
        out.lines.append("}")

    joint("ROOT", 0)
    frames = draw(st.integers(1, 4))
    time = draw(st.sampled_from(["0.0333333", "0.008333", "1", "4.1666666667e-02"]))
    out.lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {time}"]
    for _ in range(frames):
        out.lines.append(" ".join(draw(NUMBERS) for _ in range(out.columns)))
    return draw(st.sampled_from(["\n", "\r\n", "\r"])).join([*out.lines, ""])


@st.composite
def acclaim(draw: st.DrawFn) -> tuple[str, str]:
    """An ASF skeleton and an AMC motion of it."""
    count = draw(st.integers(0, 5))
    names = [f"bone{b}" for b in range(count)]
    asf = [":version 1.10", ":units", f"length {draw(st.sampled_from(['0.45', '1.0', '2']))}", "angle deg"]
    root = draw(st.permutations(["TX", "TY", "TZ", "RX", "RY", "RZ"]))
    asf += [
        ":root",
        f"order {' '.join(root)}",
        "axis XYZ",
        "position 0 0 0",
        "orientation 0 0 0",
        ":bonedata",
    ]
    moving = {"root": 6}
    for name in names:
        dof = draw(st.lists(st.sampled_from(["rx", "ry", "rz", "tx"]), unique=True, max_size=3))
        order = "".join(draw(st.permutations("XYZ")))
        asf += ["begin", f"name {name}", f"direction {draw(NUMBERS)} 1 0", f"length {draw(NUMBERS)}"]
        asf += [f"axis {draw(NUMBERS)} 0 0 {order}", *([f"dof {' '.join(dof)}"] if dof else []), "end"]
        moving |= {name: len(dof)} if dof else {}
    asf += [":hierarchy", "begin"]
    for b, name in enumerate(names):
        asf.append(f"{draw(st.sampled_from(['root', *names[:b]]))} {name}")
    amc = [":FULLY-SPECIFIED", ":DEGREES"]
    for frame in range(1, draw(st.integers(1, 3)) + 1):
        amc.append(str(frame))
        amc += [f"{name} {' '.join(draw(NUMBERS) for _ in range(n))}" for name, n in moving.items()]
    return "\n".join([*asf, "end", ""]), "\n".join([*amc, ""])


def _values() -> st.SearchStrategy[str]:
    plain = st.one_of(
        NUMBERS.filter(lambda s: s[0] not in ".+" and not s.endswith(".") and s != "1e14"),
        st.sampled_from(["true", "inf", "nan", '"hips"', '""', "'x'", "[]", "{}", "1979-05-27", "[[1], 2]"]),
        st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF), max_size=6).map(
            lambda s: '"' + s.replace("\\", "\\\\").replace('"', '\\"').replace("\x7f", "") + '"'
        ),
    )
    return st.recursive(
        plain,
        lambda inner: st.one_of(
            st.lists(inner, max_size=3).map(lambda v: f"[{', '.join(v)}]"),
            st.tuples(st.sampled_from("abc"), inner).map(lambda v: f"{{{v[0]} = {v[1]}}}"),
        ),
        max_leaves=5,
    )


def toml(tables: tuple[str, ...], keys: tuple[str, ...]) -> st.SearchStrategy[str]:
    """A TOML file of such tables and keys with values of any kind."""
    line = st.tuples(st.sampled_from(keys), _values()).map(lambda v: f"{v[0]} = {v[1]}")
    heads = st.sampled_from([*(f"[{t}]" for t in tables), *(f"[[{t}]]" for t in tables), "[x.y]"])
    table = st.tuples(heads, st.lists(line, max_size=4)).map(lambda v: "\n".join([v[0], *v[1]]))
    parts = st.tuples(st.lists(line, max_size=3), st.lists(table, max_size=3))
    return parts.map(lambda v: "\n".join([*v[0], *v[1], ""]))


@st.composite
def nearly(draw: st.DrawFn, documents: st.SearchStrategy[str]) -> str:
    """A document with up to three of its words dropped, repeated, swapped or replaced."""
    words = draw(documents).split(" ")
    for _ in range(draw(st.integers(0, 3))):
        at, other = (draw(st.integers(0, len(words) - 1)) for _ in range(2))
        change = draw(st.integers(0, 4))
        if change == 0 and len(words) > 1:
            del words[at]
        elif change == 1:
            words.insert(at, words[other])
        elif change == 2:
            words[at], words[other] = words[other], words[at]
        elif change == 3:
            words[at] = draw(ODD_NUMBERS)
        else:
            words[at] = words[at][: draw(st.integers(0, len(words[at])))]
    return " ".join(words)
