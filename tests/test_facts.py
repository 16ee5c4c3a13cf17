"""Rules about clips: which clip they reach, which of them goes before, and how a fault in them is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motion import axes, bvh, facts, sources
from motion.clip import Clip
from motion.errors import UserError
from motion.facts import Facts


@pytest.fixture
def tree(walker: Clip, tmp_path: Path) -> Path:
    """Clips a, sub/b and sub/deep/c."""
    for name in ("a", "sub/b", "sub/deep/c"):
        path = tmp_path / "clips" / f"{name}.bvh"
        path.parent.mkdir(parents=True, exist_ok=True)
        bvh.write(path, walker)
    return tmp_path / "clips"


def _book(tree: Path, rules: str = "", **options: object) -> facts.Book:
    if rules:
        (tree.parent / "rules.toml").write_text(rules)
        options["rules"] = tree.parent / "rules.toml"
    return facts.book(sources.find(tree), [tree], **options)  # type: ignore[arg-type]


def _rates(tree: Path, book: facts.Book) -> dict[str, float | None]:
    return {path.stem: book.of(path).fps for path in sources.find(tree)}


@pytest.mark.parametrize(
    ("pattern", "reached"),
    [
        ("*", "abc"),
        ("a", "a"),
        ("sub/*", "bc"),
        ("sub/deep/*", "c"),
        ("[ab]", "ab"),
        ("b.bvh", ""),
        ("sub/b.bvh", "b"),
        ("clips/sub/*", "bc"),
    ],
)
def test_patterns_reach_clips_by_name_and_by_path(tree: Path, pattern: str, reached: str) -> None:
    rules = f'[[clips]]\nfiles = "{pattern}"\nfps = 25\n'
    if not reached:
        with pytest.raises(UserError, match=r"no clip is named like 'b\.bvh'; the clips are a, b, c"):
            _book(tree, rules)
        return
    book = _book(tree, rules)
    assert _rates(tree, book) == {name: 25 if name in reached else None for name in "abc"}
    assert book.notes == (f"{tree.parent / 'rules.toml'} has rules for {len(reached)} of 3 clips",)


def test_later_rules_go_before_and_options_come_last(tree: Path) -> None:
    common = Facts(fps=10, unit="cm")
    book = _book(
        tree,
        '[[clips]]\nfiles = "sub/*"\nfps = 20\nunit = "mm"\n[[clips]]\nfiles = "c"\nfps = 30\n',
        common=common,
    )
    a, b, c = (book.of(path) for path in sources.find(tree))
    assert (a.fps, a.unit, b.fps, b.unit, c.fps, c.unit) == (10, "cm", 20, "mm", 30, "mm")


def test_files_of_rules_in_folders_reach_what_lies_below_them(tree: Path) -> None:
    (tree / "clips.toml").write_text('[[clips]]\nfiles = "*"\nfps = 20\n')
    (tree / "sub" / "clips.toml").write_text('[[clips]]\nfiles = "deep/*"\nfps = 30\n')
    book = _book(tree)
    assert _rates(tree, book) == {"a": 20, "b": 20, "c": 30} and len(book.notes) == 2
    assert _rates(tree, _book(tree, '[[clips]]\nfiles = "c"\nfps = 40\n')) == {"a": 20, "b": 20, "c": 40}
    # Above the source nothing is looked for.
    inner = facts.book(sources.find(tree / "sub/deep"), [tree / "sub/deep"])
    assert inner.told == {} and inner.notes == ()


def test_clips_are_excluded_until_a_later_rule_takes_them_back(tree: Path) -> None:
    first = '[[clips]]\nfiles = "sub/*"\nexclude = true\n'
    assert {p.stem for p in _book(tree, first).excluded} == {"b", "c"}
    assert {p.stem for p in _book(tree, first + '[[clips]]\nfiles = "*"\nfps = 20\n').excluded} == {"b", "c"}
    again = first + '[[clips]]\nfiles = "c"\nexclude = false\n'
    assert {p.stem for p in _book(tree, again).excluded} == {"b"}
    with pytest.raises(UserError, match="all 3 clips are excluded"):
        _book(tree, '[[clips]]\nfiles = "*"\nexclude = true\n')


FAULTS = {
    "unknown key": ("fsp = 60", r"clips\[0\].fsp: unknown key; choose from"),
    "no rate": ("fps = 0", r"clips\[0\].fps: 0 frames per second"),
    "a text as rate": ('fps = "60"', r"clips\[0\].fps: expected a number"),
    "no such unit": ('unit = "ell"', r"clips\[0\].unit: 'ell' is no unit; give m, cm"),
    "a negative unit": ("unit = -1", r"clips\[0\].unit: -1 metres"),
    "no such axis": ('up = "w"', r"clips\[0\].up: 'w' is no choice; choose from x, y, z"),
    "one axis twice": ('up = "z"\nforward = "-z"', r"clips\[0\].up: up z and forward -z lie along one axis"),
    "no frames": ("start = 9\nstop = 9", r"clips\[0\].stop: frames 9 to 9 are none"),
    "before the start": ("start = -1", r"clips\[0\].start: frames -1 to the end are none"),
    "no such role": ('roles = { left_paw = "Hand" }', "unknown role 'left_paw'"),
    "no such joint": ('roles = { left_foot = "Paw" }', "no joint 'Paw'"),
    "no such roles file": ('roles = "absent.toml"', "absent.toml: cannot read"),
    "beyond the end": ("stop = 301", "frames 0 to 301 of a clip of 300; correct start and stop"),
    "all beyond the end": ("start = 300", "frames 300 to the end of a clip of 300"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_name_the_key_or_the_file(tree: Path, case: str) -> None:
    text, message = FAULTS[case]
    with pytest.raises(UserError, match=message) as caught:
        book = _book(tree, f'[[clips]]\nfiles = "a"\n{text}\n')
        facts.read(tree / "a.bvh", book.of(tree / "a.bvh"))
    assert caught.value.path is not None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "clips: missing key"),
        ("clips = []", "no rules in this file; write tables"),
        ("[[clips]]\nfps = 60", r":1: clips\[0\].files: missing key"),
        ("[[clip]]", "clip: unknown key"),
        ("[[clips", "not valid TOML"),
    ],
)
def test_files_that_are_no_rules(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "rules.toml"
    path.write_text(text)
    with pytest.raises(UserError, match=message):
        facts.load(path)


def test_what_is_told_is_what_a_clip_becomes(walker: Clip, tmp_path: Path) -> None:
    """A clip written in other axes, a unit that nobody guesses and at another rate comes back as it was."""
    odd = axes.convert(walker, up="z", forward="x", handedness="left", scale=1 / 3.7).replace(fps=20)
    bvh.write(tmp_path / "odd.bvh", odd)
    told = Facts(fps=60, unit=3.7, up="z", forward="x", handedness="left", roles={"head": "Neck"})
    found = facts.read(tmp_path / "odd.bvh", told)
    assert found.fps == 60 and found.skeleton.names[found.skeleton.role("head")] == "Neck"
    np.testing.assert_allclose(found.positions, walker.positions, atol=1e-4)
    same = np.abs(np.sum(found.rotations * walker.rotations, axis=-1))
    np.testing.assert_allclose(same, 1, atol=1e-6)


def test_roles_files_lie_beside_the_rules(tree: Path) -> None:
    (tree.parent / "roles.toml").write_text('[roles]\nhead = "Neck"\n')
    book = _book(tree, '[[clips]]\nfiles = "a"\nroles = "roles.toml"\n')
    assert book.of(tree / "a.bvh").roles == {"head": "Neck"}
