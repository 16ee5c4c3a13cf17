"""One file over HTTP, with the faults of real servers and lines."""

from __future__ import annotations

import hashlib
import json
import os
import random
import shutil
import socket
import ssl
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from faulty_server import Server, serving

from motion.errors import UserError
from motion.fetching import download, meter
from motion.fetching.download import Missing, Patience

CONTENT = random.Random(0).randbytes(1_000_000)
OTHER = random.Random(1).randbytes(1_000_000)
SHA256 = hashlib.sha256(CONTENT).hexdigest()
HASTY = Patience(timeout=5, attempts=3, pause=0.001)


@pytest.fixture
def server(monkeypatch):
    for name in ("http_proxy", "https_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)
    with serving() as running:
        yield running


def get(server: Server, folder: Path, path: str = "/a.zip", **options) -> download.Arrived:
    options.setdefault("patience", HASTY)
    return download.download(server.address(path), folder / "a.zip", **options)


def ranges(server: Server) -> list[str | None]:
    return [asked for _, asked in server.asked]


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_arrives_whole_and_leaves_nothing_beside_it(server, tmp_path):
    server.put("/a.zip", CONTENT)
    arrived = get(server, tmp_path)
    assert (tmp_path / "a.zip").read_bytes() == CONTENT
    assert arrived == download.Arrived(len(CONTENT), SHA256, None)
    assert names(tmp_path) == ["a.zip"] and ranges(server) == [None]


def test_published_size_and_checksums_are_compared(server, tmp_path):
    server.put("/a.zip", CONTENT)
    md5 = hashlib.md5(CONTENT).hexdigest()
    assert get(server, tmp_path, size=len(CONTENT), sha256=SHA256, md5=md5).published == "sha256"
    assert get(server, tmp_path, md5=md5).published == "md5"


@pytest.mark.parametrize("identified", [{"etag": '"1"'}, {"modified": "Mon, 02 Nov 2026 10:00:00 GMT"}])
def test_a_cut_connection_is_continued_where_it_was_cut(server, tmp_path, identified):
    server.put("/a.zip", CONTENT, cuts=[300_000, 200_000], **identified)
    assert get(server, tmp_path).sha256 == SHA256
    assert ranges(server) == [None, "bytes=300000-", "bytes=500000-"]


def test_a_later_run_continues_what_an_earlier_one_left(server, tmp_path):
    served = server.put("/a.zip", CONTENT, etag='"1"', cuts=[400_000, 0, 0, 0])
    with pytest.raises(UserError, match=r"cut after 400,000 of 1,000,000 bytes.*give the same command again"):
        get(server, tmp_path)
    assert names(tmp_path) == ["a.zip.part", "a.zip.part.json"]
    served.cuts.clear()
    server.asked.clear()
    assert get(server, tmp_path).sha256 == SHA256
    assert ranges(server) == ["bytes=400000-"] and names(tmp_path) == ["a.zip"]


def test_an_interrupt_leaves_what_arrived_to_continue(server, tmp_path, monkeypatch):
    server.put("/a.zip", CONTENT, etag='"1"')

    def stop(answer, stream, *rest):
        stream.write(answer.read(500_000))
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(download, "_copy", stop)
        get(server, tmp_path)
    assert names(tmp_path) == ["a.zip.part", "a.zip.part.json"]
    assert get(server, tmp_path).sha256 == SHA256
    assert ranges(server) == [None, "bytes=500000-"]


def test_a_server_without_ranges_is_read_from_the_start(server, tmp_path):
    server.put("/a.zip", CONTENT, etag='"1"', ranges=False, cuts=[300_000])
    assert get(server, tmp_path).sha256 == SHA256
    assert ranges(server) == [None, "bytes=300000-"]


def test_a_file_that_changes_between_two_attempts_is_read_from_the_start(server, tmp_path):
    served = server.put("/a.zip", OTHER, etag='"old"', cuts=[300_000, 0, 0, 0])
    with pytest.raises(UserError):
        get(server, tmp_path)
    served.content, served.etag = CONTENT, '"new"'
    served.cuts.clear()
    assert get(server, tmp_path).sha256 == SHA256


def test_a_changed_file_is_seen_where_the_server_does_not_look_at_if_range(server, tmp_path):
    server.put("/a.zip", CONTENT, etag='"new"')
    (tmp_path / "a.zip.part").write_bytes(OTHER[:300_000])
    about = {"address": server.address("/a.zip"), "validator": None, "total": 900_000}
    (tmp_path / "a.zip.part.json").write_text(json.dumps(about))
    assert get(server, tmp_path, sha256=SHA256).sha256 == SHA256
    assert ranges(server) == ["bytes=300000-", None]


def test_what_nothing_identifies_is_not_continued(server, tmp_path):
    server.put("/a.zip", CONTENT, cuts=[300_000])
    assert get(server, tmp_path).sha256 == SHA256
    assert ranges(server) == [None, None]


def test_a_checksum_makes_up_for_a_server_that_does_not_identify_its_file(server, tmp_path):
    server.put("/a.zip", CONTENT, cuts=[300_000])
    assert get(server, tmp_path, sha256=SHA256).sha256 == SHA256
    assert ranges(server) == [None, "bytes=300000-"]


def test_two_halves_of_different_files_are_thrown_away_and_read_again(server, tmp_path):
    (tmp_path / "a.zip.part").write_bytes(OTHER[:300_000])
    about = {"address": server.address("/a.zip"), "validator": None, "total": len(CONTENT)}
    (tmp_path / "a.zip.part.json").write_text(json.dumps(about))
    server.put("/a.zip", CONTENT)
    assert get(server, tmp_path, sha256=SHA256).sha256 == SHA256
    assert ranges(server) == ["bytes=300000-", None]


def test_what_was_left_of_another_address_is_not_continued(server, tmp_path):
    server.put("/b.zip", OTHER, etag='"1"', cuts=[300_000, 0, 0, 0])
    with pytest.raises(UserError):
        get(server, tmp_path, "/b.zip")
    server.put("/a.zip", CONTENT, etag='"1"')
    server.asked.clear()
    assert get(server, tmp_path).sha256 == SHA256
    assert ranges(server) == [None]


@pytest.mark.parametrize("about", ["{", "[]", '{"address": 3, "more": 1}'])
def test_a_damaged_note_beside_the_part_costs_a_new_start_only(server, tmp_path, about):
    server.put("/a.zip", CONTENT, etag='"1"')
    (tmp_path / "a.zip.part").write_bytes(OTHER[:100])
    (tmp_path / "a.zip.part.json").write_text(about)
    assert get(server, tmp_path).sha256 == SHA256


def test_a_wrong_checksum_names_both_and_leaves_nothing(server, tmp_path):
    server.put("/a.zip", OTHER)
    with pytest.raises(UserError) as fault:
        get(server, tmp_path, sha256=SHA256)
    found = hashlib.sha256(OTHER).hexdigest()
    assert found in str(fault.value) and SHA256 in str(fault.value) and "homepage" in str(fault.value)
    assert names(tmp_path) == [] and len(server.asked) == 1


def test_a_wrong_md5_is_found_too(server, tmp_path):
    server.put("/a.zip", CONTENT)
    with pytest.raises(UserError, match="its md5 is"):
        get(server, tmp_path, sha256=SHA256, md5="0" * 32)


def test_another_length_than_published_is_said_before_the_download(server, tmp_path):
    server.put("/a.zip", CONTENT)
    with pytest.raises(UserError, match="announces 1,000,000 bytes, published are 5"):
        get(server, tmp_path, size=5)
    assert names(tmp_path) == []


def test_a_length_that_is_announced_too_large_ends_after_some_attempts(server, tmp_path):
    server.put("/a.zip", CONTENT, ranges=False, length=len(CONTENT) + 7)
    with pytest.raises(UserError, match=r"cut after 1,000,000 of 1,000,007 bytes \(3 attempts\)"):
        get(server, tmp_path)
    assert len(server.asked) == 3


def test_a_length_that_is_announced_too_small_is_found_by_the_checksum(server, tmp_path):
    server.put("/a.zip", CONTENT, length=len(CONTENT) - 7)
    with pytest.raises(UserError, match="its sha256 is"):
        get(server, tmp_path, sha256=SHA256)


@pytest.mark.parametrize("how", [{"length": ""}, {"chunked": True}])
def test_a_server_that_announces_no_length(server, tmp_path, how):
    server.put("/a.zip", CONTENT, **how)
    assert get(server, tmp_path, size=len(CONTENT)).sha256 == SHA256
    with pytest.raises(UserError, match=r"bytes arrived, published are 999"):
        get(server, tmp_path, size=999)


def test_an_endless_answer_ends_when_the_disk_is_full(server, tmp_path, monkeypatch):
    server.put("/a.zip", CONTENT, chunked=True)
    monkeypatch.setattr(download, "SPARE", 500_000)
    usage = shutil.disk_usage(tmp_path)
    free = iter([10**9, 400_000])
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage._replace(free=next(free)))
    with pytest.raises(UserError, match="the disk has 400 kB free"):
        get(server, tmp_path)
    assert 500_000 <= (tmp_path / "a.zip.part").stat().st_size < 900_000


def test_a_cut_is_noticed_in_chunks(server, tmp_path):
    server.put("/a.zip", CONTENT, chunked=True, cuts=[200_000])
    assert get(server, tmp_path).sha256 == SHA256
    assert len(server.asked) == 2


def test_errors_that_pass_are_waited_out(server, tmp_path):
    server.put("/a.zip", CONTENT, answers=[500, 503])
    assert get(server, tmp_path).sha256 == SHA256
    server.put("/a.zip", CONTENT, answers=[502, 503, 504])
    with pytest.raises(UserError, match=r"the server answers 504 Gateway Timeout \(3 attempts\)"):
        get(server, tmp_path)


def test_no_such_file(server, tmp_path):
    with pytest.raises(Missing, match=r"404 Not Found.*--registry"):
        get(server, tmp_path)
    server.put("/a.zip", CONTENT, answers=[403])
    with pytest.raises(UserError, match="403 Forbidden"):
        get(server, tmp_path)
    assert len(server.asked) == 2 and names(tmp_path) == []


def test_redirects_are_followed_with_the_range(server, tmp_path):
    server.put("/a.zip", b"", redirect="/b.zip")
    server.put("/b.zip", CONTENT, etag='"1"', cuts=[400_000])
    assert get(server, tmp_path).sha256 == SHA256
    assert server.asked[-1] == ("/b.zip", "bytes=400000-")


@pytest.mark.parametrize(
    ("to", "what"), [("ftp://127.0.0.1/a.zip", "not protected"), ("file:///etc/passwd", "not allowed")]
)
def test_redirects_to_other_than_http_are_refused(server, tmp_path, to, what):
    server.put("/a.zip", CONTENT, redirect=to)
    with pytest.raises(UserError, match=what):
        get(server, tmp_path)


def test_no_redirect_from_a_protected_address_to_an_open_one(tmp_path):
    request = urllib.request.Request("https://example.org/a.zip")
    with open(tmp_path / "body", "wb") as body, pytest.raises(UserError, match="not protected"):
        download._Redirects().redirect_request(request, body, 302, "", {}, "http://example.org/a.zip")


def test_redirects_in_a_circle_end(server, tmp_path):
    server.put("/a.zip", CONTENT, redirect="/a.zip")
    with pytest.raises(UserError, match="infinite loop"):
        get(server, tmp_path)


@pytest.mark.parametrize("how", [{"stall": True}, {"delay": 1.0}])
def test_a_server_that_falls_silent(server, tmp_path, how):
    server.put("/a.zip", CONTENT, etag='"1"', **how)
    with pytest.raises(UserError, match="the server does not answer"):
        get(server, tmp_path, patience=Patience(timeout=0.1, attempts=2, pause=0.001))
    if "stall" in how:
        assert (tmp_path / "a.zip.part").stat().st_size >= 500_000


def test_a_part_that_was_not_asked_for_is_not_taken(server, tmp_path):
    server.put("/a.zip", CONTENT, etag='"1"', cuts=[300_000], shift=1)
    # Once it is taken for a change and read from the start, whole this time.
    assert get(server, tmp_path).sha256 == SHA256
    assert ranges(server) == [None, "bytes=300000-", None]


def test_an_encoded_answer_is_refused(server, tmp_path):
    server.put("/a.zip", CONTENT, headers={"Content-Encoding": "gzip"})
    with pytest.raises(UserError, match="sends it encoded"):
        get(server, tmp_path)


def test_nobody_listens(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    with pytest.raises(UserError, match=r"127\.0\.0\.1: the connection was refused; try again later"):
        download.download(f"http://127.0.0.1:{port}/a", tmp_path / "a", patience=HASTY)


@pytest.mark.parametrize(
    ("reason", "message"),
    [
        (
            socket.gaierror(-2, "Name or service not known"),
            "example.org: no such host, or no network.*--from",
        ),
        (OSError(101, "Network is unreachable"), "example.org: Network is unreachable; connect"),
        (OSError("Tunnel connection failed: 403 Forbidden"), "the proxy refuses: 403 Forbidden"),
        (ssl.SSLError(1, "wrong version number"), "the connection failed"),
    ],
)
def test_faults_of_the_network_are_one_clear_line(tmp_path, monkeypatch, reason, message):
    def fail(*args, **options):
        raise urllib.error.URLError(reason)

    monkeypatch.setattr(urllib.request.OpenerDirector, "open", fail)
    with pytest.raises(UserError, match=message):
        download.download("https://example.org/a", tmp_path / "a", patience=HASTY)


def test_a_certificate_that_is_not_trusted(tmp_path, monkeypatch):
    fault = ssl.SSLCertVerificationError(1, "certificate verify failed")
    fault.verify_message = "certificate has expired"

    def fail(*args, **options):
        raise urllib.error.URLError(fault)

    monkeypatch.setattr(urllib.request.OpenerDirector, "open", fail)
    with pytest.raises(UserError, match=r"not trusted: certificate has expired; .*SSL_CERT_FILE"):
        download.download("https://example.org/a", tmp_path / "a", patience=HASTY)


def test_the_proxy_of_the_environment_is_used(server, tmp_path, monkeypatch):
    monkeypatch.setenv("http_proxy", server.address(""))
    server.put("http://example.invalid/a.zip", CONTENT)
    download.download("http://example.invalid/a.zip", tmp_path / "a.zip", patience=HASTY)
    assert (tmp_path / "a.zip").read_bytes() == CONTENT


def test_a_proxy_that_nobody_answers_at_is_named(tmp_path, monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as unused:
        proxy = f"127.0.0.1:{unused.getsockname()[1]}"
    monkeypatch.setenv("http_proxy", f"http://user:secret@{proxy}")
    with pytest.raises(
        UserError, match=f"example.org by the proxy {proxy}: the connection was refused"
    ) as fault:
        download.download("http://example.org/a.zip", tmp_path / "a.zip", patience=HASTY)
    assert "secret" not in str(fault.value)


def test_a_full_disk_is_said_before_the_download(server, tmp_path, monkeypatch):
    server.put("/a.zip", CONTENT)
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage._replace(free=1_000_000))
    with pytest.raises(UserError, match=r"the disk has 1 MB free, 68\.1 MB are needed"):
        get(server, tmp_path)


def test_a_disk_that_fills_up_meanwhile(server, tmp_path, monkeypatch):
    server.put("/a.zip", CONTENT)

    def fail(*args):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(download, "_copy", fail)
    with pytest.raises(UserError, match="the disk is full; make room"):
        get(server, tmp_path)


def test_amounts_and_plain_progress(monkeypatch, capsys):
    assert [meter.amount(n) for n in (None, 0, 999, 1500, 144_051_503, 1.4685e9)] == [
        "-",
        "0 B",
        "999 B",
        "1.5 kB",
        "144 MB",
        "1.47 GB",
    ]
    now = [0.0]
    monkeypatch.setattr(meter.time, "monotonic", lambda: now[0])
    with meter.meter("a.zip", 100_000_000, 20_000_000) as report:
        for seconds, done in ((5, 30_000_000), (10, 40_000_000), (15, 50_000_000), (20, 60_000_000)):
            now[0] = float(seconds)
            report(done)
    assert capsys.readouterr().err.splitlines() == [
        "a.zip: 40 MB of 100 MB, 2 MB/s, 30 s left",
        "a.zip: 60 MB of 100 MB, 2 MB/s, 20 s left",
    ]


def test_progress_on_a_terminal_shows_bytes_and_rate(monkeypatch, capsys):
    monkeypatch.setattr(meter.console, "is_terminal", lambda stream: True)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    with meter.meter("a.zip", 2_000_000) as report:
        report(1_000_000)
    shown = capsys.readouterr().err
    assert "a.zip" in shown and "2.0 MB" in shown
