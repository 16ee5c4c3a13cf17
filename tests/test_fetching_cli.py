"""``python -m motion fetch`` end to end, from a server that stands here."""

from __future__ import annotations

import hashlib
import io
import json
import sys
import zipfile
from pathlib import Path

import click
import pytest
import tomli_w
from faulty_server import Server, serving

from motion import cli
from motion.errors import UserError
from motion.fetching import cli as commands
from motion.fetching import download, fetch, lock
from motion.fetching.download import Patience


@pytest.fixture
def server(monkeypatch):
    for name in ("http_proxy", "https_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)
    monkeypatch.setattr(download, "Patience", lambda timeout=5: Patience(timeout, 2, 0.001))
    with serving() as running:
        yield running


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    """Run ``motion fetch`` in tmp_path; returns exit code, standard output and standard error."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        with pytest.raises(SystemExit) as stop:
            cli.main(["fetch", *map(str, arguments)])
        out = capsys.readouterr()
        return stop.value.code, out.out, out.err

    return call


def zipped(members: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


WALKS = zipped({"set/walk.bvh": b"walk", "set/run.bvh": b"run", "set/film.avi": b"film"})


@pytest.fixture
def studio(server: Server, tmp_path: Path) -> Path:
    """A registry of a set with an archive and a plain file, and of one by subjects, both on the server."""
    server.put("/walks.zip", WALKS, etag='"1"')
    server.put("/terms.txt", b"do as you like\n")
    for part in ("01", "02"):
        server.put(f"/{part}/{part}.asf", f"skeleton {part}".encode())
        for take in ("01", "02"):
            server.put(f"/{part}/{part}_{take}.amc", f"take {part} {take}".encode())
    about = {
        "title": "Walks of ours",
        "holds": "walks and runs",
        "homepage": "https://example.org",
        "credit": "walked by us",
        "licence": {"name": "ours", "allows": "what you like", "address": "https://example.org/l"},
    }
    files = [
        {
            "address": server.address("/walks.zip"),
            "into": "bvh",
            "kind": "zip",
            "size": len(WALKS),
            "sha256": hashlib.sha256(WALKS).hexdigest(),
            "strip": "set",
            "keep": ["*.bvh"],
        },
        {"address": server.address("/terms.txt"), "into": "terms.txt"},
    ]
    series = {
        "once": [server.address("/{part}/{part}.asf")],
        "take": server.address("/{part}/{part}_{take}.amc"),
        "into": "{part}",
        "takes": {"01": "1-3", "02": "1-2"},
        "default": "01",
        "part_name": "subject",
    }
    sets = [
        {"name": "walks", **about, "files": files, "options": "--fps 30"},
        {"name": "people", **about, "series": series},
    ]
    (tmp_path / "mine.toml").write_text(tomli_w.dumps({"sets": sets}))
    return tmp_path / "mine.toml"


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def edited(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_the_list_of_sets(run):
    code, out, _ = run()
    assert code == 0 and "lafan1" in out and "CC BY-NC-ND 4.0" in out and "144 MB" in out
    code, out, _ = run("--json")
    rows = {row["name"]: row for row in json.loads(out)}
    assert code == 0 and rows["lafan1"]["size"] == 144_064_638 and rows["cmu"]["size"] is None
    assert rows["lafan1"]["licence"]["name"] == "CC BY-NC-ND 4.0" and "16" in rows["cmu"]["series"]["parts"]


def test_all_about_a_set(run):
    _, out, _ = run("cmu", "--list")
    assert "do not" not in out and "may not be sold" in out and "0.0564444 m" in out and "locomotion" in out
    _, out, _ = run("lafan1", "--list")
    assert "lafan1.zip (144 MB, sha256)" in out and "rate: 30 frames a second" in out
    _, out, _ = run("100style", "--list", "--json")
    assert json.loads(out)["files"][0]["md5"]


def test_a_set_is_fetched_and_then_left_alone(run, studio, server, tmp_path):
    code, out, err = run("walks", "--registry", studio, "--yes")
    assert code == 0 and out == ""
    assert contents(tmp_path / "data" / "walks") == {
        "bvh/walk.bvh": b"walk",
        "bvh/run.bvh": b"run",
        "terms.txt": b"do as you like\n",
        "fetched.json": (tmp_path / "data" / "walks" / "fetched.json").read_bytes(),
    }
    lines = err.splitlines()
    assert "licence: ours: what you like" in lines and "credit: walked by us" in lines
    assert "data/walks: 2 downloaded, 0 already there" in lines
    assert any(line.startswith("not verified: nobody publishes a checksum of this file") for line in lines)
    assert lines[-1] == "next: python -m motion info data/walks --fps 30"

    server.asked.clear()
    code, out, err = run("walks", "--registry", studio, "--json")  # consent is remembered
    assert code == 0 and server.asked == []
    told = json.loads(out)
    assert told["downloaded"] == [] and len(told["present"]) == 2
    assert told["unverified"] == [server.address("/terms.txt")]


def test_the_lock_says_what_came_from_where(run, studio, server, tmp_path):
    run("walks", "--registry", studio, "--yes")
    record = json.loads((tmp_path / "data/walks/fetched.json").read_text())
    assert record["set"] == "walks" and record["licence"] == "ours"
    source = record["sources"][server.address("/walks.zip")]
    assert source == {"size": len(WALKS), "sha256": hashlib.sha256(WALKS).hexdigest(), "published": "sha256"}
    held = record["files"]["bvh/walk.bvh"]
    assert held["sha256"] == hashlib.sha256(b"walk").hexdigest() and held["size"] == 4


def test_without_a_terminal_the_licence_needs_yes(run, studio, server, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("y\n"))
    code, out, err = run("walks", "--registry", studio)
    assert code == 2 and out == "" and server.asked == []
    assert err.splitlines()[-1].startswith("error: no terminal") and "--yes" in err
    assert not (tmp_path / "data").exists()


def test_on_a_terminal_the_licence_is_asked_for_once(run, studio, server, monkeypatch):
    asked = []
    monkeypatch.setattr(commands.console, "is_terminal", lambda stream: stream is not None)
    monkeypatch.setattr(click, "confirm", lambda text, err: asked.append(text) or len(asked) > 1)
    code, _, err = run("walks", "--registry", studio)
    assert code == 2 and "the licence was not accepted" in err and server.asked == []
    assert run("walks", "--registry", studio)[0] == 0
    assert run("walks", "--registry", studio)[0] == 0
    assert len(asked) == 2


def test_a_licence_that_changed_is_asked_for_again(run, studio):
    run("walks", "--registry", studio, "--yes")
    edited(studio, 'name = "ours"', 'name = "stricter"')
    assert run("walks", "--registry", studio)[0] == 2


def test_what_is_lost_or_changed_is_fetched_again(run, studio, server, tmp_path):
    folder = tmp_path / "out"
    run("walks", "--registry", studio, "--yes", "-o", folder)
    (folder / "bvh/run.bvh").unlink()
    (folder / "terms.txt").write_bytes(b"do as I like!!\n")
    server.asked.clear()
    code, _, err = run("walks", "--registry", studio, "-o", folder)
    assert code == 0 and "2 downloaded, 0 already there" in err
    assert contents(folder)["bvh/run.bvh"] == b"run" and contents(folder)["terms.txt"] == b"do as you like\n"


def test_a_touched_file_is_recognised_by_its_content(run, studio, server, tmp_path):
    run("walks", "--registry", studio, "--yes")
    (tmp_path / "data/walks/terms.txt").touch()
    server.asked.clear()
    assert run("walks", "--registry", studio)[0] == 0 and server.asked == []


def test_verify_finds_what_size_and_date_hide(run, studio, server, tmp_path):
    import os

    run("walks", "--registry", studio, "--yes")
    file = tmp_path / "data/walks/bvh/walk.bvh"
    date = file.stat().st_mtime_ns
    file.write_bytes(b"wolf")
    os.utime(file, ns=(date, date))
    assert "0 downloaded" in run("walks", "--registry", studio)[2]
    assert "1 downloaded, 1 already there" in run("walks", "--registry", studio, "--verify")[2]
    assert file.read_bytes() == b"walk"


def test_a_new_checksum_in_the_registry_fetches_anew(run, studio, server):
    run("walks", "--registry", studio, "--yes")
    new = zipped({"set/new.bvh": b"new"})
    server.put("/walks.zip", new)
    edited(studio, hashlib.sha256(WALKS).hexdigest(), hashlib.sha256(new).hexdigest())
    edited(studio, f"size = {len(WALKS)}", f"size = {len(new)}")
    assert run("walks", "--registry", studio)[0] == 0
    assert {p.name for p in Path("data/walks/bvh").iterdir()} == {"new.bvh"}


def test_an_unpublished_file_that_changes_is_refused(run, studio, server, tmp_path):
    run("walks", "--registry", studio, "--yes")
    server.put("/terms.txt", b"pay\n")
    (tmp_path / "data/walks/terms.txt").unlink()
    code, _, err = run("walks", "--registry", studio)
    assert code == 2 and "when first fetched it was" in err and "move the folder away" in err
    assert not (tmp_path / "data/walks/terms.txt").exists()


def test_files_of_the_user_are_not_written_over(run, studio, tmp_path):
    folder = tmp_path / "data/walks"
    (folder / "bvh").mkdir(parents=True)
    (folder / "bvh" / "mine.bvh").write_bytes(b"mine")
    (folder / "other.txt").write_bytes(b"kept")
    code, _, err = run("walks", "--registry", studio, "--yes")
    assert code == 2 and "mine.bvh: stands where fetched files are to be put" in err
    (folder / "bvh/mine.bvh").rename(folder / "mine.bvh")
    assert run("walks", "--registry", studio, "--yes")[0] == 0
    assert contents(folder)["mine.bvh"] == b"mine" and contents(folder)["other.txt"] == b"kept"


def test_a_link_in_the_place_of_a_folder_is_not_followed(run, studio, tmp_path):
    (tmp_path / "data/walks").mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "data/walks/bvh").symlink_to(tmp_path / "elsewhere")
    assert "stands where" in run("walks", "--registry", studio, "--yes")[2]
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_subjects_are_added_one_after_the_other(run, studio, server, tmp_path):
    code, out, err = run("people", "--registry", studio, "--yes", "--subject", "1", "--json")
    assert code == 0 and json.loads(out)["missing"] == [server.address("/01/01_03.amc")]
    server.asked.clear()
    code, _, err = run("people", "--registry", studio, "--subject", "01", "--subject", "2")
    assert code == 0 and "3 downloaded, 3 already there" in err and "not on the server: 01_03.amc" in err
    assert all(path.startswith("/02/") for path, _ in server.asked)
    found = set(contents(tmp_path / "data/people"))
    assert found == {f"{p}/{p}{t}" for p in ("01", "02") for t in (".asf", "_01.amc", "_02.amc")} | {
        "fetched.json"
    }


def test_a_subject_without_a_skeleton_is_a_fault(run, studio, server):
    del server.files["/02/02.asf"]
    code, _, err = run("people", "--registry", studio, "--yes", "--subject", "2")
    assert code == 2 and "02.asf: the server answers 404 Not Found" in err


def test_files_downloaded_elsewhere_are_taken(run, studio, server, tmp_path):
    (tmp_path / "usb").mkdir()
    (tmp_path / "usb/walks.zip").write_bytes(WALKS)
    (tmp_path / "usb/terms.txt").write_bytes(b"do as you like\n")
    assert run("walks", "--registry", studio, "--yes", "--from", tmp_path / "usb")[0] == 0
    assert server.asked == [] and (tmp_path / "data/walks/bvh/run.bvh").read_bytes() == b"run"
    assert (tmp_path / "usb/walks.zip").read_bytes() == WALKS


def test_files_downloaded_elsewhere_are_checked(run, studio, server, tmp_path):
    (tmp_path / "usb").mkdir()
    (tmp_path / "usb/walks.zip").write_bytes(WALKS[:-1] + b"x")
    code, _, err = run("walks", "--registry", studio, "--yes", "--from", tmp_path / "usb")
    assert code == 2 and "walks.zip: its sha256 is" in err and server.asked == []
    (tmp_path / "usb/walks.zip").write_bytes(WALKS[:-1])
    assert "its size is" in run("walks", "--registry", studio, "--from", tmp_path / "usb")[2]


def test_a_cut_download_is_continued_by_the_same_command(run, studio, server, tmp_path):
    server.files["/walks.zip"].cuts = [100, 0, 0]
    code, _, err = run("walks", "--registry", studio, "--yes")
    assert code == 2 and err.splitlines()[-1].count("error: ") == 1 and "give the same command again" in err
    (part,) = (tmp_path / "data/walks/.fetching").glob("*-walks.zip.part")
    assert part.stat().st_size == 100
    server.files["/walks.zip"].cuts = []
    server.asked.clear()
    assert run("walks", "--registry", studio)[0] == 0
    assert server.asked[0] == ("/walks.zip", "bytes=100-")
    assert not (tmp_path / "data/walks/.fetching").exists()


def test_an_interrupt_leaves_the_part_and_exits_with_130(run, studio, tmp_path, monkeypatch):
    def stop(answer, stream, *rest):
        stream.write(answer.read(50))
        raise KeyboardInterrupt

    monkeypatch.setattr(download, "_copy", stop)
    code, _, err = run("walks", "--registry", studio, "--yes")
    assert code == 130 and err.splitlines()[-1].startswith("error: interrupted")
    assert "what arrived is kept" in err
    found = sorted(path.partition("-")[2] or path for path in contents(tmp_path / "data/walks"))
    assert found == [".fetching/lock", "fetched.json", "walks.zip.part", "walks.zip.part.json"]


def test_a_hostile_archive_leaves_nothing(run, studio, server, tmp_path):
    evil = zipped({"set/walk.bvh": b"walk", "../../../evil.bvh": b"evil"})
    server.put("/walks.zip", evil)
    edited(studio, hashlib.sha256(WALKS).hexdigest(), hashlib.sha256(evil).hexdigest())
    edited(studio, f"size = {len(WALKS)}", f"size = {len(evil)}")
    code, _, err = run("walks", "--registry", studio, "--yes")
    assert code == 2 and "leads out of the folder" in err
    assert not list(tmp_path.rglob("evil*")) and set(contents(tmp_path / "data/walks")) == {"fetched.json"}


def test_an_archive_that_found_no_room_is_not_downloaded_again(run, studio, server, tmp_path, monkeypatch):
    def full(*args, **options):
        raise UserError("the disk is full", path=tmp_path)

    with monkeypatch.context() as patch:
        patch.setattr(fetch.unpack, "unpack", full)
        assert run("walks", "--registry", studio, "--yes")[0] == 2
    (tmp_path / "data/walks/.fetching/.unpacked.left").mkdir()
    server.asked.clear()
    assert run("walks", "--registry", studio)[0] == 0
    assert [path for path, _ in server.asked] == ["/terms.txt"]
    assert not (tmp_path / "data/walks/.fetching").exists()


def test_an_archive_that_turns_bad_leaves_what_was_there(run, studio, server, tmp_path):
    run("walks", "--registry", studio, "--yes")
    evil = zipped({"../evil.bvh": b"evil"})
    server.put("/walks.zip", evil)
    edited(studio, hashlib.sha256(WALKS).hexdigest(), hashlib.sha256(evil).hexdigest())
    edited(studio, f"size = {len(WALKS)}", f"size = {len(evil)}")
    assert "leads out of the folder" in run("walks", "--registry", studio)[2]
    assert (tmp_path / "data/walks/bvh/walk.bvh").read_bytes() == b"walk"


def test_two_fetches_into_one_folder(run, studio, tmp_path):
    pytest.importorskip("fcntl")
    with lock.alone(tmp_path / "data/walks"):
        code, _, err = run("walks", "--registry", studio, "--yes")
    assert code == 2 and "another fetch is at work here" in err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "damaged lock file"),
        ("[]", "damaged lock file"),
        ('{"set": 3}', "damaged lock file: set: expected a string"),
        ('{"set": "walks", "version": 9}', "lock file of version 9"),
        ('{"set": "other"}', "this folder holds the set 'other', not 'walks'"),
    ],
)
def test_a_lock_file_that_cannot_be_used(run, studio, tmp_path, text, message):
    (tmp_path / "data/walks").mkdir(parents=True)
    (tmp_path / "data/walks/fetched.json").write_text(text)
    code, _, err = run("walks", "--registry", studio, "--yes")
    assert code == 2 and message in err and "fetched.json" in err


def test_paths_out_of_a_lock_file_are_not_followed(run, studio, server, tmp_path):
    """A lock file from a stranger must not delete files elsewhere."""
    (tmp_path / "precious").write_bytes(b"1")
    (tmp_path / "data/walks").mkdir(parents=True)
    entry = {"address": server.address("/terms.txt"), "size": 9, "sha256": "", "mtime_ns": 0}
    text = json.dumps({"set": "walks", "licence": "ours", "files": {"../../precious": entry}})
    (tmp_path / "data/walks/fetched.json").write_text(text)
    code, _, err = run("walks", "--registry", studio)
    assert code == 2 and "damaged lock file" in err and (tmp_path / "precious").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nope",), "no data set 'nope'; choose from walks, people"),
        (("walks", "--subject", "3"), "walks has no parts"),
        (("people", "--subject", "3"), "no subject '3'; choose from 01, 02"),
        (("walks", "-o", "file"), "file: not a folder"),
        (("walks", "-o", "file/below"), "file/below"),
        (("walks", "--from", "none"), "none: no such folder"),
        (("walks", "--timeout", "0"), "above 0"),
        (("--yes", "-o", "x"), "name the set to fetch"),
        (("walks", "--registry", "none.toml"), "none.toml: cannot read"),
    ],
)
def test_faults_of_the_user_are_one_line(run, studio, server, tmp_path, arguments, message):
    (tmp_path / "file").write_text("")
    given = arguments if "--registry" in arguments else (*arguments, "--registry", studio)
    code, out, err = run(*given, "--yes")
    assert code == 2 and out == "" and server.asked == []
    assert err.splitlines()[-1].startswith("error: ") and message in err and err.count("error: ") == 1
    assert not (tmp_path / "data").exists()


def test_room_for_all_files_is_asked_for_before_the_first(run, studio, server, monkeypatch):
    usage = fetch.download.shutil.disk_usage("/")
    monkeypatch.setattr(fetch.download.shutil, "disk_usage", lambda folder: usage._replace(free=1000))
    code, _, err = run("walks", "--registry", studio, "--yes")
    assert code == 2 and "the disk has 1 kB free" in err and server.asked == []
