"""``bench data`` from the command line: its page, tables and JSON, and what it says of bad input."""

from __future__ import annotations

import json
import re

import page_html
import pandas as pd
import pytest
from click.testing import CliRunner

from bench.cli import main
from bench.data import page
from mm import courses
from mm.build import build
from mm.controller import Controller
from mm.recording import record

QUICK = ("--courses", "circle", "--seconds", "2")


@pytest.fixture(scope="module")
def folder(walker_files, walker_database, tmp_path_factory):
    folder, database = tmp_path_factory.mktemp("data"), walker_database
    database.save(folder / "walker.mmdb")
    record(Controller(database), courses.load("circle"), seconds=3).save(folder / "run.rec")
    build([walker_files / "run.bvh"], jobs=1).save(folder / "other.mmdb")
    return folder


def run(*arguments):
    return CliRunner().invoke(main, ["data", *map(str, arguments)])


@pytest.fixture(scope="module")
def written(folder):
    result = run(folder / "walker.mmdb", "--run", folder / "run.rec", *QUICK, "-o", folder / "out")
    assert result.exit_code == 0, result.output
    return result, folder / "out"


def test_it_prints_columns_and_the_verdict(written):
    shown = written[0].stdout
    assert "left_foot.position.x" in shown and "is there twice" in shown
    assert "the run looks wrong" in shown or "nothing looks wrong" in shown


def test_all_files_are_written_and_agree(written):
    _, out = written
    assert page_html.files(out) == set(page.names(with_run=True))
    facts = json.loads((out / "data.json").read_text())
    for name in page.FILES:
        if name not in page.LONG:
            table = pd.read_csv(out / f"{name}.csv") if (out / f"{name}.csv").stat().st_size > 1 else []
            assert len(table) == len(facts["tables"][name]), name
    assert len(pd.read_csv(out / "run_costs.csv")) == 180
    assert facts["clips"] == 5 and len(facts["tables"]["features"]) == 27
    assert facts["bounds"]["slip_cm"] >= 3


def test_the_page_needs_nothing_else(written):
    text = (written[1] / "report.html").read_text()
    page_html.check(text)
    assert text.count("<svg") == 9
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL).lower().split()


def test_without_a_run_there_is_none(folder):
    result = run(folder / "other.mmdb", *QUICK, "--json")
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    assert not any(name.startswith("run_") for name in facts["tables"])
    assert facts["clips"] == 1 and len(facts["verdict"]) == 4


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("nope.mmdb",), "No such file"),
        (("{folder}",), "a folder"),
        (("{folder}/run.rec",), "expected a motion database"),
        (("{folder}/walker.mmdb", "--near", "0"), "give a number above 0"),
        (("{folder}/walker.mmdb", "--courses", "nope"), "no course 'nope'"),
        (("{folder}/walker.mmdb", "-o", "{folder}/run.rec"), "it is a file"),
        (("{folder}/walker.mmdb", "--run", "{folder}/walker.mmdb"), "expected a recording"),
        (("{folder}/other.mmdb", "--run", "{folder}/run.rec"), "another database"),
        (("{folder}/walker.mmdb", "--run", "{folder}/run.rec", "--character", "4"), "no character 4"),
    ],
)
def test_bad_input_is_one_clear_line(folder, arguments, expected):
    result = run(*(argument.format(folder=folder) for argument in arguments))
    assert result.exit_code == 2
    assert result.stderr.startswith("error: ") and expected in result.stderr, result.stderr
