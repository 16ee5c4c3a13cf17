"""``python -m mm`` from the outside: what it prints, what it writes, how it fails."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from mm import summary, tags
from mm.cli import main
from mm.database import KIND, VERSION, Database
from motion import facts, files, sources

REPOSITORY = Path(__file__).resolve().parents[1]


def _mm(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def _fails(*arguments: object) -> str:
    """The one line of a command that fails as it should."""
    result = _mm(*arguments)
    lines = result.stderr.splitlines()
    errors = [line for line in lines if not line.startswith("note: ")]
    assert result.exit_code == 2 and len(errors) == 1 and errors[0].startswith("error: "), result.output
    return errors[0]


@pytest.fixture(scope="module")
def db(walker_files: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mm") / "walk.mmdb"
    (path.parent / "tags.csv").write_text("tag,clips\nturn,*_turn\n")
    result = _mm("build", walker_files, "-o", path, "--tags", path.parent / "tags.csv")
    assert result.exit_code == 0, result.output
    return path


def test_build_says_what_it_built(walker_files: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "walk.mmdb"
    result = _mm("build", walker_files, "-o", out, "--jobs", 1)
    assert result.exit_code == 0 and result.stderr == ""
    assert f"{out}: 5 clips, 0.4 minutes, 3,000 frames with their mirrored copies at 60 fps" in result.stdout
    assert "times real time" in result.stdout
    assert len(Database.load(out)) == 3000
    assert [path.name for path in out.parent.iterdir()] == ["walk.mmdb"]


def test_build_passes_its_options(walker_files: Path, tmp_path: Path) -> None:
    out, schema = tmp_path / "db", tmp_path / "schema.toml"
    schema.write_text(
        'name = "own"\n[[features]]\nname = "foot"\nkind = "position"\nrole = "left_foot"\n'
        '[[features]]\nname = "ahead"\nkind = "trajectory_position"\ntimes = [0.5]\n'
    )
    options = ["--fps", 30, "--no-mirror", "--roles-only", "--schema", schema, "--folder-tags"]
    assert (
        _mm("build", walker_files / "run.bvh", walker_files / "stand.bvh", "-o", out, *options).exit_code == 0
    )
    found = Database.load(out)
    assert found.fps == 30 and found.names == ("run", "stand") and found.schema.name == "own"
    assert len(found.skeleton) == 3 and found.features.shape == (300, 5)
    assert found.tag_names == (walker_files.name,) and (found.tags == 1).all()


def test_build_leaves_out_what_is_excluded(walker_files: Path, tmp_path: Path) -> None:
    arguments = ["build", walker_files, "-o", tmp_path / "db", "--exclude", "*_turn", "--exclude"]
    assert "no clip to exclude is named like 'jump'" in _fails(*arguments, "jump")
    result = _mm(*arguments, "run")
    assert result.exit_code == 0 and "note: 3 of 5 clips are left out" in result.stderr
    assert set(Database.load(tmp_path / "db").names) == {"stand", "straight"}


def test_the_tags_in_the_help_are_a_tags_file(tmp_path: Path) -> None:
    lines = [line.strip() for line in _mm("build", "--help").stdout.splitlines()]
    start = lines.index("tag,clips,start,stop")
    (tmp_path / "tags.csv").write_text("\n".join(lines[start : start + 3]))
    assert tags.load(tmp_path / "tags.csv") == (
        tags.Rule("run", "run*"),
        tags.Rule("turn", "walk_07", 120, 240),
    )


def test_the_rules_in_the_help_are_a_file_of_rules(tmp_path: Path) -> None:
    lines = [line.strip() for line in _mm("build", "--help").stdout.splitlines()]
    start = lines.index("[[clips]]")
    (tmp_path / "clips.toml").write_text("\n".join(lines[start : start + 4]))
    assert facts.load(tmp_path / "clips.toml") == (facts.Rule(files="old/*", fps=60, unit="inch"),)
    told = " ".join(lines)
    keys = told[told.index("Its keys are") :].partition(".")[0]
    assert all(field.name in keys for field in dataclasses.fields(facts.Rule) if field.name != "files")


@pytest.mark.parametrize("command", [("info",), ("run", "--course", "circle")])
def test_a_folder_of_clips_is_no_database(command: tuple[str, ...], db: Path) -> None:
    name, *options = command
    assert "expected a motion database; build a database of it" in _fails(name, db.parent, *options)


def test_info(db: Path) -> None:
    facts = json.loads(_mm("info", db, "--json").stdout)
    assert facts["clips"] == 5 and facts["mirrored"] == 5 and facts["frames"] == 3000 and facts["fps"] == 60
    assert facts["minutes"] == pytest.approx(50 / 60, abs=1e-3)
    assert facts["minutes_without_mirrored"] == pytest.approx(25 / 60, abs=1e-3)
    assert facts["file_bytes"] == db.stat().st_size > sum(facts["bytes"].values())
    assert facts["joints"][:2] == ["root", "Hips"] and facts["roles"]["left_foot"] == "LeftFoot"
    assert facts["schema"]["name"] == "mm27" and len(facts["schema"]["columns"]) == 27
    assert facts["tags"] == {"turn": 1200}
    assert facts["ranges"][1] == {"name": "left_turn", "mirrored": True, "start": 300, "frames": 300}
    assert facts["fingerprint"] == Database.load(db).fingerprint
    assert set(facts["contacts"]) == {"left_toe", "right_toe"}
    speeds, turns = facts["coverage"]["speed_mps"], facts["coverage"]["turn_deg_per_s"]
    assert speeds["p1"] < 0.1 and speeds["p50"] == pytest.approx(1.2, abs=0.1)
    assert speeds["p99"] == pytest.approx(3.0, abs=0.2)
    assert turns["p5"] == pytest.approx(-turns["p95"], abs=1) and 45 < turns["p95"] < 65

    text = _mm("info", db).stdout
    for part in (
        "5 clips and 5 mirrored copies",
        "23 joints",
        "mm27, 27 columns",
        "turn 1,200 frames",
        "straight",
    ):
        assert part in text


def test_coverage_tells_directions(db: Path) -> None:
    loaded = Database.load(db)
    found = summary.coverage(loaded)
    assert found["forward_mps"]["p50"] == pytest.approx(1.2, abs=0.1)
    assert abs(found["left_mps"]["p50"]) < 0.05


def test_export_and_import(db: Path, tmp_path: Path) -> None:
    folder, again = tmp_path / "reference", tmp_path / "again.mmdb"
    result = _mm("export", db, "-o", folder)
    assert result.exit_code == 0 and "database.bin" in result.stdout and "features.bin" in result.stdout
    names, roles, loaded = tmp_path / "names.txt", tmp_path / "roles.toml", Database.load(db)
    names.write_text("\n".join(f"bone {j}" for j in range(len(loaded.skeleton))))
    roles.write_text(
        "[roles]\n" + "".join(f'{role} = "bone {j}"\n' for role, j in loaded.skeleton.roles.items())
    )
    result = _mm("import", folder, "-o", again, "--names", names, "--roles", roles)
    assert result.exit_code == 0 and "10 ranges, 3,000 frames" in result.stdout
    imported = Database.load(again)
    assert imported.skeleton.names[3] == "bone 3"
    np.testing.assert_array_equal(imported.features, loaded.features)
    np.testing.assert_array_equal(imported.poses.velocities, loaded.poses.velocities)
    np.testing.assert_array_equal(imported.contacts, loaded.contacts)
    assert imported.skeleton.roles == loaded.skeleton.roles
    assert imported.mirrored.tolist() == [False, True] * 5


def test_bad_input_is_one_line(db: Path, walker_files: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mmdb"
    (tmp_path / "clips").mkdir()
    (tmp_path / "clips" / "bad.bvh").write_bytes((walker_files / "run.bvh").read_bytes()[:20000])
    (tmp_path / "none").mkdir()
    line = _fails("build", walker_files, tmp_path / "clips", "-o", out)
    assert f"{tmp_path}/clips/bad.bvh:" in line and line.count(";") >= 1
    assert "no clips in this folder" in _fails("build", tmp_path / "none", "-o", out)
    assert "no schema 'lmm28'" in _fails("build", walker_files, "-o", out, "--schema", "lmm28")
    assert "it is a folder" in _fails("build", walker_files, "-o", tmp_path)
    assert "cannot write" in _fails("build", walker_files / "run.bvh", "-o", "/dev/null")
    assert "Missing option" in _fails("build", walker_files)
    assert "No such option" in _fails("build", walker_files, "-o", out, "--mirrored")
    assert "give a number 1 to 1,000" in _fails("build", walker_files, "-o", out, "--fps", "nan")
    assert "no database.bin" in _fails("import", tmp_path, "-o", out)
    assert "cannot read" in _fails("info", tmp_path / "absent")
    assert "cannot read" in _fails("build", walker_files, "-o", out, "--tags", tmp_path / "absent.toml")
    assert not out.exists()


def test_damaged_databases_are_one_line(db: Path, tmp_path: Path) -> None:
    raw, path = db.read_bytes(), tmp_path / "db"
    path.write_bytes(raw[:-100])
    assert "cut short" in _fails("info", path)
    flipped = bytearray(raw)
    flipped[len(raw) // 2] ^= 1
    path.write_bytes(flipped)
    assert "the checksum differs" in _fails("info", path)
    path.write_bytes(b"not a database")
    assert f"not a {KIND}" in _fails("export", path, "-o", tmp_path / "out")
    files.save(path, KIND, VERSION - 1, {}, {})
    assert f"format version {VERSION - 1}, this program reads {VERSION}; make it again" in _fails(
        "info", path
    )
    assert not (tmp_path / "out").exists()


def test_notes_go_to_standard_error(walker_files: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.bvh").write_text("nothing")
    result = _mm("build", walker_files / "run.bvh", tmp_path / "bad.bvh", "-o", tmp_path / "db", "--skip-bad")
    assert result.exit_code == 0 and result.stderr.startswith(
        f"note: left out: {tmp_path / 'bad.bvh'}:1: not a BVH"
    )
    assert "1 clip, " in result.stdout and len(result.stdout.splitlines()) == 1


FULL_DISK = """
import resource, runpy, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
sys.argv = ["mm", *sys.argv[1:]]
runpy.run_module("mm", run_name="__main__")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on file sizes")
def test_a_full_disk_leaves_nothing(db: Path, walker_files: Path, tmp_path: Path) -> None:
    for arguments in (["build", str(walker_files), "-o"], ["export", str(db), "-o"]):
        out = tmp_path / arguments[0] / "out"
        done = subprocess.run(
            [sys.executable, "-c", FULL_DISK, *arguments, str(out)],
            cwd=REPOSITORY,
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 2, done.stderr
        assert "cannot write: File too large; nothing was written" in done.stderr
        assert "Traceback" not in done.stderr and len(done.stderr.splitlines()) == 1
        assert [path for path in (tmp_path / arguments[0]).rglob("*") if path.is_file()] == []


@pytest.mark.parametrize("moment", ["while reading", "while writing"])
def test_an_interrupt_leaves_nothing(
    walker_files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    if moment == "while reading":
        monkeypatch.setattr(sources, "load", interrupted)
    else:
        monkeypatch.setattr(os, "fsync", interrupted)
    result = _mm("build", walker_files, "-o", tmp_path / "out" / "db")
    assert result.exit_code == 130
    assert result.stderr.strip() == "error: interrupted; nothing half-written was left"
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.parametrize("command", ["build", "info", "import", "export", "run"])
def test_every_command_has_help_with_an_example(command: str) -> None:
    result = _mm(command, "--help")
    assert result.exit_code == 0 and f"python -m mm {command}" in " ".join(result.stdout.split())


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys\nfrom mm.cli import main\ntry: main(['--help'])\n"
        "except SystemExit: pass\nprint('HEAVY', *({'numpy', 'numba', 'scipy', 'rich'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "HEAVY"


def test_import_of_the_reference_oracle(data: Path, tmp_path: Path) -> None:
    out = tmp_path / "oracle.mmdb"
    assert _mm("import", data / "reference" / "oracle", "-o", out).exit_code == 0
    assert _mm("export", out, "-o", tmp_path / "back").exit_code == 0
    for name in ("database.bin", "features.bin"):
        assert (tmp_path / "back" / name).read_bytes() == (data / "reference" / "oracle" / name).read_bytes()


def test_real_mixed_skeletons(data: Path, tmp_path: Path) -> None:
    sources = [data / "cmu" / "daz_bvh" / "02", data / "dog_mann" / "D1_010_KAN01_002.bvh"]
    line = _fails("build", *sources, "-o", tmp_path / "db")
    assert "4 clips with 43 joints" in line and "1 clip with 21 joints" in line and "--roles-only" in line
    assert _mm("build", *sources, "-o", tmp_path / "db", "--roles-only").exit_code == 0
    assert np.isfinite(Database.load(tmp_path / "db").features).all()


def test_an_output_that_is_an_input_is_refused_and_kept(db: Path, walker_files: Path, tmp_path: Path) -> None:
    clip, roles, course = tmp_path / "clip.bvh", tmp_path / "roles.toml", tmp_path / "way.toml"
    clip.write_bytes((walker_files / "run.bvh").read_bytes())
    roles.write_text("[roles]\n")
    course.write_text("seconds = 1\n[[stick]]\ntime = 0\n")
    copy = tmp_path / "copy.mmdb"
    copy.write_bytes(db.read_bytes())
    rules = tmp_path / "clips.toml"
    rules.write_text('[[clips]]\nfiles = "*"\nroles = "few.toml"\n')
    (tmp_path / "few.toml").write_text("[roles]\n")
    kept = {path: path.read_bytes() for path in (clip, roles, course, copy, rules)}
    for command in (
        ("build", clip, "-o", clip),
        ("build", tmp_path, "-o", clip, "--exclude", "clip"),
        ("build", walker_files, "-o", roles, "--roles", roles),
        ("build", walker_files, "-o", roles, "--tags", roles),
        ("build", walker_files, "-o", clip, "--skeleton", clip),
        ("build", walker_files, "-o", rules, "--clips", rules),
        ("build", tmp_path, "-o", rules),
        ("build", tmp_path, "-o", tmp_path / "few.toml"),
        ("build", walker_files, "-o", roles, "--schema", roles),
        ("run", copy, "--course", "circle", "-o", copy),
        ("run", copy, "--course", "circle", "--record", copy),
        ("run", copy, "--course", course, "-o", course),
        ("run", copy, "--course", "circle", "--record", tmp_path / "x", "-o", tmp_path / "x"),
        ("courses", course, "--plot", course),
    ):
        assert "would be written over" in _fails(*command), command
    assert {path: path.read_bytes() for path in kept} == kept
    (tmp_path / "database.bin").write_bytes(b"kept")
    assert "would be written over" in _fails("import", tmp_path, "-o", tmp_path / "database.bin")


@pytest.mark.parametrize("value", ["nan", "inf", "0", "-1", "1e9"])
def test_numbers_that_make_no_sense_are_refused(db: Path, walker_files: Path, value: str) -> None:
    for command in (
        ("build", walker_files, "-o", "never", "--source-fps", value),
        ("import", walker_files, "-o", "never", "--fps", value),
        ("run", db, "--course", "circle", "--seconds", value),
        ("run", db, "--course", "circle", "--walk", value),
        ("run", db, "--course", "circle", "--size", value),
    ):
        assert "out of range" in _fails(*command)
