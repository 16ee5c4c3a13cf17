"""Archives: what is unpacked, and what hostile ones are refused for."""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import io
import shutil
import stat
import tarfile
import zipfile
from pathlib import Path

import pytest

from motion.errors import UserError
from motion.fetching import unpack
from motion.fetching.unpack import Limits

KINDS = ["zip", "tar.gz"]
FILES = {"set/walk/1.bvh": b"one" * 1000, "set/walk/2.BVH": b"two", "set/readme.txt": b"text", "x.exe": b"no"}


def pack(path: Path, kind: str, members: dict[str, bytes]) -> Path:
    """An archive of members as they are named, however odd."""
    if kind == "zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in members.items():
                info = zipfile.ZipInfo("x")
                info.filename = name  # the constructor would change it
                info.external_attr = (stat.S_IFREG | 0o600) << 16
                info.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(info, content)
    else:
        with tarfile.open(path, "w:gz") as archive:
            for name, content in members.items():
                info = tarfile.TarInfo(name)
                info.size = len(content)
                archive.addfile(info, io.BytesIO(content))
    return path


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def refused(archive: Path, folder: Path, kind: str, match: str, **options) -> None:
    """Unpacking fails with one message about the archive and leaves nothing anywhere."""
    before = {p for p in folder.rglob("*") if p != archive}
    with pytest.raises(UserError, match=match) as fault:
        unpack.unpack(archive, folder / "out", kind, **options)
    assert str(fault.value).startswith(str(archive)) and "\n" not in str(fault.value)
    assert {p for p in folder.rglob("*") if p != archive} == before


@pytest.mark.parametrize("kind", KINDS)
def test_everything_is_unpacked_with_its_checksums(tmp_path, kind):
    found = unpack.unpack(pack(tmp_path / "a", kind, FILES), tmp_path / "deep" / "out", kind)
    assert contents(tmp_path / "deep" / "out") == FILES
    expected = [(n, len(c), hashlib.sha256(c).hexdigest()) for n, c in FILES.items()]
    assert [(one.path, one.size, one.sha256) for one in found] == expected
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["out"]


@pytest.mark.parametrize("kind", KINDS)
def test_only_what_the_patterns_say_is_kept_below_the_folder_to_strip(tmp_path, kind):
    archive = pack(tmp_path / "a", kind, FILES)
    unpack.unpack(archive, tmp_path / "out", kind, strip="set", keep=["*.bvh"])
    assert set(contents(tmp_path / "out")) == {"walk/1.bvh", "walk/2.BVH"}
    refused(archive, tmp_path, kind, "holds none of the files to take", keep=["*.amc"])


@pytest.mark.parametrize("kind", KINDS)
def test_folders_and_dots_are_no_fault(tmp_path, kind):
    archive = tmp_path / "a"
    if kind == "zip":
        with zipfile.ZipFile(archive, "w") as opened:
            opened.mkdir("walk")
            opened.writestr("./walk/1.bvh", b"1")
            opened.writestr("..hidden/a...b", b"2")
    else:
        with tarfile.open(archive, "w:gz") as opened:
            folder = tarfile.TarInfo("./walk")
            folder.type = tarfile.DIRTYPE
            opened.addfile(folder)
            for name in ("./walk/1.bvh", "..hidden/a...b"):
                info = tarfile.TarInfo(name)
                info.size = 1
                opened.addfile(info, io.BytesIO(b"1" if "walk" in name else b"2"))
    unpack.unpack(archive, tmp_path / "out", kind)
    assert contents(tmp_path / "out") == {"walk/1.bvh": b"1", "..hidden/a...b": b"2"}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("../evil.bvh", "leads out"),
        ("walk/../../evil.bvh", "leads out"),
        ("walk/..", "leads out"),
        ("/tmp/evil.bvh", "absolute"),
        ("//server/share/evil.bvh", "absolute"),
        ("C:/evil.bvh", "absolute"),
        ("c:evil.bvh", "absolute"),
        ("..\\evil.bvh", "backslash"),
        ("walk\\evil.bvh", "backslash"),
        ("walk/evil.bvh:stream", "colon"),
        ("walk/ev\nil.bvh", "control character"),
        ("walk/nul", "names a device"),
        ("walk/COM1.bvh", "names a device"),
        ("a" * 300 + ".bvh", "too long"),
        ("a/" * 600 + "b.bvh", "too long"),
    ],
)
def test_a_path_that_is_none_everywhere_is_refused(tmp_path, kind, name, why):
    refused(pack(tmp_path / "a", kind, {"good.bvh": b"1", name: b"2"}), tmp_path, kind, why)


def test_a_name_with_a_nul_is_refused(tmp_path):
    archive = pack(tmp_path / "a", "zip", {"good.bvhX.exe": b"1"})
    archive.write_bytes(archive.read_bytes().replace(b"good.bvhX.exe", b"good.bvh\0.exe"))
    refused(archive, tmp_path, "zip", "control character")


def test_a_hostile_path_is_refused_even_among_what_is_not_kept(tmp_path):
    archive = pack(tmp_path / "a", "zip", {"good.bvh": b"1", "../evil.sh": b"2"})
    refused(archive, tmp_path, "zip", "leads out", keep=["*.bvh"])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("other", ["1.bvh", "1.BVH", "./1.bvh", "1.bvh. ", "1.bvh/2.bvh"])
def test_two_members_of_one_place_are_refused(tmp_path, kind, other):
    archive = tmp_path / "a"
    if other == "1.bvh":
        with pytest.warns(UserWarning, match="Duplicate") if kind == "zip" else contextlib.nullcontext():
            pack_twice(archive, kind, "1.bvh")
    else:
        pack(archive, kind, {"1.bvh": b"1", other: b"2"})
    refused(archive, tmp_path, kind, "are one place")


@pytest.mark.parametrize(
    "names", [("caf\u00e9.bvh", "cafe\u0301.bvh"), ("a/b/1.bvh", "a/B"), ("\u00c5", "\u00e5")]
)
def test_accents_and_folders_collide_too(tmp_path, names):
    archive = pack(tmp_path / "a", "zip", dict.fromkeys(names, b"1"))
    refused(archive, tmp_path, "zip", "are one place")


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFCHR, stat.S_IFBLK, stat.S_IFIFO, stat.S_IFSOCK])
def test_links_and_devices_in_a_zip(tmp_path, kind):
    archive = tmp_path / "a"
    with zipfile.ZipFile(archive, "w") as opened:
        info = zipfile.ZipInfo("walk.bvh")
        info.external_attr = (kind | 0o777) << 16
        opened.writestr(info, "/etc/passwd")
    refused(archive, tmp_path, "zip", "is a link or a device")


def test_a_link_that_looks_like_a_folder_writes_nothing_outside(tmp_path):
    archive = tmp_path / "a"
    with zipfile.ZipFile(archive, "w") as opened:
        info = zipfile.ZipInfo("walk/")
        info.external_attr = (stat.S_IFLNK | 0o777) << 16
        opened.writestr(info, str(tmp_path))
        opened.writestr("walk/evil.bvh", "1")
    refused(archive, tmp_path, "zip", "is a link or a device")


@pytest.mark.parametrize(
    "kind",
    [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.BLKTYPE, tarfile.FIFOTYPE, b"Z"],
)
def test_links_and_devices_in_a_tar(tmp_path, kind):
    archive = tmp_path / "a"
    with tarfile.open(archive, "w:gz") as opened:
        info = tarfile.TarInfo("walk.bvh")
        info.type, info.linkname = kind, "/etc/passwd"
        opened.addfile(info)
    refused(archive, tmp_path, "tar.gz", "is a link or a device")


def test_a_link_that_is_not_kept_is_no_fault(tmp_path):
    archive = tmp_path / "a"
    with tarfile.open(archive, "w:gz") as opened:
        link = tarfile.TarInfo("latest")
        link.type, link.linkname = tarfile.SYMTYPE, "walk.bvh"
        opened.addfile(link)
        info = tarfile.TarInfo("walk.bvh")
        info.size = 1
        opened.addfile(info, io.BytesIO(b"1"))
    unpack.unpack(archive, tmp_path / "out", "tar.gz", keep=["*.bvh"])
    assert contents(tmp_path / "out") == {"walk.bvh": b"1"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_bomb_is_refused_for_its_ratio(tmp_path, kind):
    archive = pack(tmp_path / "a", kind, {"zeros.bvh": bytes(3_000_000)})
    refused(archive, tmp_path, kind, "far more than its size allows", limits=Limits(free=1_000_000))
    assert unpack.unpack(archive, tmp_path / "out", kind, limits=Limits(free=3_000_000))


@pytest.mark.parametrize("kind", KINDS)
def test_a_bomb_of_many_small_zeros_is_refused(tmp_path, kind):
    archive = pack(tmp_path / "a", kind, {f"{i}.bvh": bytes(100_000) for i in range(30)})
    refused(archive, tmp_path, kind, "hostile", limits=Limits(free=1_000_000))


def test_text_of_numbers_is_no_bomb(tmp_path):
    text = "\n".join(f"{i * 0.37:.6f} 0.000000 0.000000" for i in range(60_000)).encode()
    archive = pack(tmp_path / "a", "zip", {"1.bvh": text})
    assert unpack.unpack(archive, tmp_path / "out", "zip", limits=Limits(free=1))


@pytest.mark.parametrize("kind", KINDS)
def test_limits_of_size_and_count(tmp_path, kind):
    archive = pack(tmp_path / "a", kind, {f"{i}.bvh": b"12345" for i in range(5)})
    refused(archive, tmp_path, kind, "more than 24 B", limits=Limits(size=24))
    refused(archive, tmp_path, kind, "more than 4 members", limits=Limits(count=4))
    assert len(unpack.unpack(archive, tmp_path / "out", kind, limits=Limits(size=25, count=5))) == 5


def test_a_size_that_lies_is_found_while_unpacking(tmp_path):
    archive = pack(tmp_path / "a", "zip", {"1.bvh": bytes(3_000_000)})
    data = bytearray(archive.read_bytes())
    for mark, place in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        at = data.index(mark) + place
        data[at : at + 4] = (10).to_bytes(4, "little")
    archive.write_bytes(data)
    refused(archive, tmp_path, "zip", "damaged")


def test_headers_that_would_fill_the_memory_are_refused(tmp_path):
    """A pax header is read whole into memory before any member is seen."""
    archive = tmp_path / "a"
    header = tarfile.TarInfo("pax")
    header.type, header.size = tarfile.XHDTYPE, 40_000_000
    with gzip.open(archive, "wb") as stream:
        stream.write(header.tobuf() + bytes(header.size))
    refused(archive, tmp_path, "tar.gz", "far more than its members")


def test_an_encrypted_member_is_refused(tmp_path):
    archive = pack(tmp_path / "a", "zip", {"1.bvh": b"1"})
    data = bytearray(archive.read_bytes())
    data[data.index(b"PK\x03\x04") + 6] |= 1
    data[data.index(b"PK\x01\x02") + 8] |= 1
    archive.write_bytes(data)
    refused(archive, tmp_path, "zip", "is encrypted")


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_archive_or_is_cut_is_refused(tmp_path, kind):
    archive = tmp_path / "a"
    archive.write_bytes(b"<html>not found</html>")
    refused(archive, tmp_path, kind, "not an archive, or damaged")
    archive.write_bytes(b"")
    refused(archive, tmp_path, kind, "not an archive, or damaged|holds none")
    whole = pack(archive, kind, {"1.bvh": bytes(range(256)) * 500, "2.bvh": b"2"}).read_bytes()
    archive.write_bytes(whole[: len(whole) // 2])
    refused(archive, tmp_path, kind, "damaged")


@pytest.mark.parametrize("kind", KINDS)
def test_a_flipped_bit_is_found(tmp_path, kind):
    archive = pack(tmp_path / "a", kind, {"1.bvh": bytes(range(256)) * 500})
    data = bytearray(archive.read_bytes())
    data[len(data) // 2] ^= 16
    archive.write_bytes(data)
    refused(archive, tmp_path, kind, "damaged")


def test_room_is_asked_for_before_a_zip_is_unpacked(tmp_path, monkeypatch):
    archive = pack(tmp_path / "a", "zip", {"1.bvh": b"1" * 1_000_000, "film.avi": b"2" * 1_000_000})
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage._replace(free=(64 << 20) + 900_000))
    with pytest.raises(UserError, match=r"the disk has 68 MB free, 68\.1 MB are needed"):
        unpack.unpack(archive, tmp_path / "out", "zip", keep=["*.bvh"])


def test_a_full_disk_leaves_nothing(tmp_path, monkeypatch):
    archive = pack(tmp_path / "a", "zip", {"1.bvh": b"1"})

    def fail(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(unpack.hashlib, "sha256", fail)
    with pytest.raises(UserError, match="the disk is full"):
        unpack.unpack(archive, tmp_path / "out", "zip")
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def pack_twice(path: Path, kind: str, name: str) -> None:
    if kind == "zip":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr(name, b"1")
            archive.writestr(name, b"2")
    else:
        with tarfile.open(path, "w:gz") as archive:
            for _ in range(2):
                archive.addfile(tarfile.TarInfo(name))
