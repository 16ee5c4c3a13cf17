"""The shape of the house: what imports what, quietly, and commands that explain themselves."""

from __future__ import annotations

import ast
import configparser
import importlib
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = [p for p in ("motion", "features", "mm", "lmm", "bench", "viewer") if (ROOT / p).is_dir()]
COMMANDS = [p for p in PACKAGES if (ROOT / p / "__main__.py").is_file()]
TRAINING = ROOT / "lmm" / "training"  # of the whole program the part that needs torch
WINDOW = ROOT / "viewer" / "window"  # is drawn by open3d
EXTRAS = ["torch", "open3d", "onnx", "onnxruntime", "pygltflib", "pybvh", "av"]
SLOW = [
    "matplotlib",
    "pandas",
    "jinja2",
]  # core, but a command that does not need them must not wait for them


def imported_by(code: str) -> list[str]:
    """Top-level modules that a fresh interpreter holds after running code, which must print nothing."""
    report = "; import sys; sys.stdout.write('@' + ' '.join({m.partition('.')[0] for m in sys.modules}))"
    done = subprocess.run(
        [sys.executable, "-c", code + report], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    printed, _, modules = done.stdout.rpartition("@")
    assert printed == ""
    assert done.stderr == ""
    return modules.split()


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_everything_needs_no_extra_and_prints_nothing(package: str) -> None:
    names = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in sorted((ROOT / package).rglob("*.py"))
        if path.name != "__main__.py" and not {TRAINING, WINDOW} & set(path.parents)
    ]
    modules = imported_by("import " + ", ".join(names))
    assert package in modules
    assert not set(EXTRAS) & set(modules)


@pytest.mark.parametrize("package", COMMANDS)
def test_the_command_starts_without_slow_libraries(package: str) -> None:
    modules = imported_by(f"import {package}.cli")
    assert "click" in modules
    assert not {*SLOW, *EXTRAS} & set(modules)


def test_what_is_told_of_a_training_needs_no_torch() -> None:
    names = [f"lmm.training.{name}" for name in ("settings", "split", "log", "curves", "checkpoint")]
    assert not set(EXTRAS) & set(imported_by("import " + ", ".join(names)))


def neighbours(package: str) -> dict[str, set[str]]:
    """Modules of a package, and which others of it each imports: at the top, in a function, or for types."""
    files = {path.relative_to(ROOT).with_suffix(""): path for path in (ROOT / package).rglob("*.py")}
    modules = {".".join(place.parts).removesuffix(".__init__"): path for place, path in files.items()}
    found: dict[str, set[str]] = {}
    for name, path in modules.items():
        parts = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
        imported = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                above = parts[: len(parts) - node.level + 1] if node.level else []
                base = ".".join([*above, *([node.module] if node.module else [])])
                imported |= {one if (one := f"{base}.{a.name}") in modules else base for a in node.names}
        found[name] = imported & modules.keys() - {name}
    return found


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_is_imported_by_what_it_imports(package: str) -> None:
    graph = neighbours(package)
    assert sum(map(len, graph.values())) >= len(graph) / 2
    list(TopologicalSorter(graph).static_order())  # a CycleError names the modules of a circle


def test_import_rules_and_metadata_cover_every_package() -> None:
    tools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
    assert tools["importlinter"]["root_packages"] == PACKAGES
    assert tools["mypy"]["packages"] == PACKAGES
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg")
    patterns = setup["options.packages.find"]["include"].split()
    assert {f"{package}*" for package in PACKAGES} <= set(patterns)
    scripts = setup["options.entry_points"]["console_scripts"].split("\n")
    assert {f"{p} = {p}.cli:main" for p in COMMANDS} == {line.strip() for line in scripts if line.strip()}


def commands() -> Iterator[tuple[str, click.Command]]:
    """Every command of every package: its full name ("mm build") and the click command."""

    def walk(name: str, command: click.Command) -> Iterator[tuple[str, click.Command]]:
        if isinstance(command, click.Group):
            for child, below in command.commands.items():
                yield from walk(f"{name} {child}", below)
        else:
            yield name, command

    for package in COMMANDS:
        yield from walk(package, importlib.import_module(f"{package}.cli").main)


ALL = dict(commands())


def test_the_commands_promised_are_there() -> None:
    promised = ["motion info", "motion convert", "mm build", "mm info", "mm run", "mm import", "mm export"]
    promised += ["lmm train", "lmm info", "lmm curves"]
    assert set(promised) | {"bench compare", "bench search"} <= set(ALL)


def check_usage(line: str) -> None:
    """Whether "mm build clips -o DB" names a command there is, with options it has."""
    known = [command for command in ALL if f"{line} ".startswith(f"{command} ")]
    assert known, f"no such command: python -m {line}"
    flags = {flag for p in ALL[known[0]].params for flag in [*p.opts, *p.secondary_opts]}
    used = {word.partition("=")[0] for word in line.split() if re.match(r"--?[a-z]", word)}
    assert used <= flags, f"python -m {line}: no such option"


@pytest.mark.parametrize("name", ALL)
def test_help_ends_with_an_example_that_the_command_would_accept(name: str) -> None:
    package, *rest = name.split()
    group = importlib.import_module(f"{package}.cli").main
    result = CliRunner().invoke(group, [*rest, "--help"], prog_name=f"python -m {package}")
    assert result.exit_code == 0
    last = " ".join(result.output.strip().split("\n\n")[-1].split())
    start, *lines = re.split(r"(?:^Examples?: |(?<=\s))python -m (?=[a-z])", last)
    assert start == "" and lines, f"{name} --help does not end with 'Example: python -m {name} ...'"
    assert f"{lines[0]} ".startswith(f"{name} ")
    for line in lines:
        check_usage(line)


def test_the_commands_in_the_documents_exist() -> None:
    texts = [path.read_text() for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md"))]
    lines = re.findall(r"^    python -m ([a-z]\S* [a-z]\S* .*)", "\n".join(texts), re.M)
    ours = [line for line in lines if line.split()[0] in PACKAGES]
    assert {line.split()[0] for line in ours} >= {"motion", "mm", "bench"}
    for line in ours:
        check_usage(line)


@pytest.mark.parametrize("package", COMMANDS)
def test_the_package_runs_as_a_program(package: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", package, "no-such-command"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
