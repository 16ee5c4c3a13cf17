"""``python -m features``: what it prints, and how it fails."""

from __future__ import annotations

import json

import pytest

from features import presets
from features.cli import main
from features.schema import Schema


def run(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as caught:
        main([*arguments])
    return int(caught.value.code or 0), *capsys.readouterr()


@pytest.mark.parametrize("name", ["lmm27", "o3de59"])
def test_what_it_prints_is_a_schema_file(capsys, tmp_path, name):
    code, out, _ = run(capsys, "schema", name)
    assert code == 0
    (tmp_path / "a.toml").write_text(out)
    assert presets.load(tmp_path / "a.toml") == presets.load(name)
    assert all(column in out for column in presets.load(name).columns)


def test_writes_a_file(capsys, tmp_path):
    assert run(capsys, "schema", "lmm27", "-o", str(tmp_path / "a.toml"))[0] == 0
    assert run(capsys, "schema", str(tmp_path / "a.toml"))[1] == run(capsys, "schema", "lmm27")[1]


def test_json(capsys):
    found = json.loads(run(capsys, "schema", "lmm27", "--json")[1])
    assert found["size"] == len(found["columns"]) == 27
    assert Schema.from_dict({key: found[key] for key in ("name", "features")}) == presets.load("lmm27")
    listed = [row["schema"] for row in json.loads(run(capsys, "list", "--json")[1])]
    assert listed[:2] == ["mm27", "lmm27"] and "o3de59" in listed
    assert "lmm27" in run(capsys, "list")[1]


def test_faults_are_one_line(capsys, tmp_path):
    (tmp_path / "bad.toml").write_text('name = "x"\n[[features]]\nname = "a"\nkind = "speed"\n')
    code, out, error = run(capsys, "schema", str(tmp_path / "bad.toml"))
    assert (code, out) == (2, "")
    assert error.startswith("error: ") and error.count("\n") == 1
    assert "bad.toml:4: features[0].kind: 'speed' is no choice; choose from position" in error


@pytest.mark.parametrize("command", ["schema", "list"])
def test_help_ends_with_an_example(capsys, command):
    last = run(capsys, command, "--help")[1].strip().split("\n\n")[-1]
    assert last.strip().startswith(f"Example: python -m features {command}")


def test_does_not_write_over_its_input(capsys, tmp_path):
    path = str(tmp_path / "a.toml")
    run(capsys, "schema", "lmm27", "-o", path)
    assert run(capsys, "schema", path, "-o", path)[0] == 2
