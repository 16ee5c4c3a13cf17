"""The project's own files: what is written comes back, and nothing damaged is ever read."""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from motion import files
from motion.errors import UserError

KIND = "test file"


def _arrays() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    return {
        "bits": rng.integers(0, 2, 7).astype(bool),
        "empty": np.zeros((0, 4), np.float32),
        "half": rng.standard_normal(5).astype(np.float16),
        "numbers": rng.integers(-(2**31), 2**31, (3, 5)).astype(np.int32),
        "poses": rng.standard_normal((11, 3, 4)).astype(np.float32),
        "precise": rng.standard_normal(3),
        "tags": rng.integers(0, 2**32, 9).astype(np.uint32),
        "bytes": rng.integers(0, 256, 13).astype(np.uint8),
    }


METADATA = {"fps": 60.0, "names": ["walk", "läufe"], "nested": {"rate": 0.1 + 0.2, "none": None}}


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "saved.bin"
    files.save(path, KIND, 2, METADATA, _arrays())
    return path


def test_round_trip_keeps_metadata_types_shapes_and_values(saved: Path) -> None:
    metadata, arrays, mark = files.load(saved, KIND, 2)
    assert metadata == {"format": KIND, "version": 2, **METADATA}
    assert arrays.keys() == _arrays().keys()
    for name, array in _arrays().items():
        assert arrays[name].dtype == array.dtype and arrays[name].shape == array.shape, name
        np.testing.assert_array_equal(arrays[name], array)
    assert mark == files.fingerprint(_arrays(), metadata)


def test_another_reader_of_the_container_agrees(saved: Path) -> None:
    arrays = safetensors.numpy.load_file(saved)
    for name, array in _arrays().items():
        np.testing.assert_array_equal(arrays[name], array)
    with safetensors.safe_open(saved, "numpy") as stream:
        assert json.loads(stream.metadata()["metadata"])["names"] == METADATA["names"]


def test_arrays_are_memory_mapped_aligned_and_read_only(saved: Path) -> None:
    for name, array in files.load(saved, KIND, 2)[1].items():
        assert not array.flags.writeable, name
        assert array.flags.aligned and array.flags.c_contiguous, name
        if array.size:
            assert isinstance(array, np.memmap), name
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0


def test_same_content_gives_the_same_bytes_and_other_content_another_fingerprint(tmp_path: Path) -> None:
    arrays = _arrays()
    backwards = dict(reversed(arrays.items()))
    one = files.save(tmp_path / "one", KIND, 2, METADATA, arrays)
    two = files.save(tmp_path / "two", KIND, 2, dict(reversed(METADATA.items())), backwards)
    assert one == two
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()

    changed = arrays | {"poses": np.nextafter(arrays["poses"], 9)}
    renamed = {("pose" if name == "poses" else name): array for name, array in arrays.items()}
    reshaped = arrays | {"poses": arrays["poses"].reshape(11, 12)}
    others = [files.fingerprint(other, METADATA) for other in (changed, renamed, reshaped)]
    others.append(files.fingerprint(arrays, METADATA | {"fps": 30.0}))
    assert len({files.fingerprint(arrays, METADATA), *others}) == 5


def test_strided_and_big_endian_arrays_are_stored_plainly(tmp_path: Path) -> None:
    grid = np.arange(24, dtype=np.float32).reshape(4, 6)
    files.save(tmp_path / "x", KIND, 1, {}, {"strided": grid[::2, 1::2].T, "big": grid.astype(">f4")})
    arrays = files.load(tmp_path / "x", KIND, 1)[1]
    np.testing.assert_array_equal(arrays["strided"], grid[::2, 1::2].T)
    np.testing.assert_array_equal(arrays["big"], grid)
    assert arrays["big"].dtype == np.dtype("<f4")


def test_data_longer_than_a_hashing_chunk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_CHUNK", 64)
    path = tmp_path / "long"
    files.save(path, KIND, 1, {}, {"long": np.arange(1000, dtype=np.int32)})
    np.testing.assert_array_equal(files.load(path, KIND, 1)[1]["long"], np.arange(1000))
    raw = bytearray(path.read_bytes())
    one, other = len(raw) - 64, len(raw) - 128  # the hash must see an exchange of two equal-sized chunks
    raw[one:], raw[other:one] = raw[other:one], raw[one:]
    path.write_bytes(raw)
    with pytest.raises(UserError, match="checksum"):
        files.load(path, KIND, 1)


def test_every_kind_of_truncation_is_refused(saved: Path, tmp_path: Path) -> None:
    raw = saved.read_bytes()
    header = 8 + int.from_bytes(raw[:8], "little")
    cuts = {0, 1, 4, 7, 8, 9, header // 2, header - 1, header, header + 1, len(raw) - 1}
    cuts |= {int(cut) for cut in np.linspace(0, len(raw) - 1, 40)}
    cut_short = tmp_path / "cut"
    for cut in sorted(cuts):
        cut_short.write_bytes(raw[:cut])
        with pytest.raises(UserError) as caught:
            files.load(cut_short, KIND, 2)
        assert caught.value.path == str(cut_short) and caught.value.remedy, cut


def test_trailing_bytes_are_refused(saved: Path) -> None:
    with open(saved, "ab") as stream:
        stream.write(b"\0")
    with pytest.raises(UserError, match="damaged"):
        files.load(saved, KIND, 2)


@pytest.mark.parametrize("change", [0xFF, 0x01, 0x20, 0x80])
def test_every_flipped_byte_is_refused(saved: Path, tmp_path: Path, change: int) -> None:
    raw = saved.read_bytes()
    header = 8 + int.from_bytes(raw[:8], "little")
    flipped = tmp_path / "flipped"
    for place in [*range(header), *range(header, len(raw), 3), len(raw) - 1]:
        wrong = bytearray(raw)
        wrong[place] ^= change
        flipped.write_bytes(wrong)
        with pytest.raises(UserError):
            files.load(flipped, KIND, 2)


def test_a_changed_space_of_the_padding_is_refused(saved: Path) -> None:
    raw = bytearray(saved.read_bytes())
    header = 8 + int.from_bytes(raw[:8], "little")
    if raw[header - 1] != ord(" "):
        pytest.skip("this header needs no padding")
    raw[header - 1] = ord("\n")  # the same JSON, other bytes
    saved.write_bytes(raw)
    with pytest.raises(UserError, match="checksum"):
        files.load(saved, KIND, 2)


@pytest.mark.parametrize("version", [1, 3])
def test_another_format_version_is_refused_by_number(saved: Path, version: int) -> None:
    with pytest.raises(UserError, match=f"format version 2, this program reads {version}") as caught:
        files.load(saved, KIND, version)
    assert "make it again" in str(caught.value)


def test_another_kind_of_file_is_named(saved: Path) -> None:
    with pytest.raises(UserError, match="a test file, expected a motion database"):
        files.load(saved, "motion database", 2)


FOREIGN = {
    "empty": b"",
    "text": b"HIERARCHY\nROOT Hips\n" * 40,
    "binary": np.random.default_rng(0).bytes(5000),
    "zeros": bytes(5000),
    "nested": (50_000).to_bytes(8, "little") + b"[" * 50_000,
    "list": (2).to_bytes(8, "little") + b"[]",
    "number": (1).to_bytes(8, "little") + b"7",
    "no format": (34).to_bytes(8, "little") + b'{"__metadata__":{"metadata":"{}"}}',
    "safetensors": safetensors.numpy.save({"weights": np.zeros(4, np.float32)}, {"format": "pt"}),
}


@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN.keys())
def test_a_foreign_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "foreign"
    path.write_bytes(content)
    with pytest.raises(UserError, match=KIND):
        files.load(path, KIND, 1)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "absent", tmp_path):
        with pytest.raises(UserError, match="cannot read") as caught:
            files.load(path, KIND, 1)
        assert caught.value.path == str(path)


def test_atomic_replaces_only_on_success(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "er" / "out.txt"
    with files.atomic(path, "w") as stream:
        stream.write("first\n")
    assert path.read_bytes() == b"first\n"
    assert stat.S_IMODE(path.stat().st_mode) == 0o644 or os.name == "nt"
    for interruption in (KeyboardInterrupt(), ZeroDivisionError(), UserError("no")):
        with pytest.raises(interruption.__class__), files.atomic(path, "w") as stream:
            stream.write("second")
            raise interruption
    assert path.read_bytes() == b"first\n"
    assert [entry.name for entry in path.parent.iterdir()] == ["out.txt"]


def test_writing_through_a_link_keeps_the_link(tmp_path: Path) -> None:
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("old")
    link.symlink_to(target)
    with files.atomic(link, "w") as stream:
        stream.write("new")
    assert link.is_symlink() and target.read_text() == "new"


def test_a_folder_a_device_and_a_file_as_folder_are_refused_as_output(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    for path in (tmp_path, Path(os.devnull), tmp_path / "file" / "below"):
        with pytest.raises(UserError, match="cannot write"), files.atomic(path) as stream:
            stream.write(b"x")
    assert not Path(os.devnull).is_file()
    assert (tmp_path / "file").read_text() == "kept"


def test_an_output_without_a_name_is_refused() -> None:
    with pytest.raises(UserError, match="an output without a name; name a file to write"):
        files.check_output("")


FULL_DISK = """
import resource, sys
import numpy as np
from motion import files
from motion.errors import UserError
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
try:
    files.save(sys.argv[1], "test file", 1, {}, {"x": np.zeros(1_000_000)})
except UserError as error:
    print(error)
    sys.exit(2)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on file sizes")
def test_a_disk_that_fills_up_leaves_nothing_and_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "full"
    mark = files.save(path, KIND, 1, {}, {"x": np.zeros(3)})
    root = Path(__file__).resolve().parents[1]
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(path)], cwd=root, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2, done.stderr
    assert done.stdout.startswith(f"{path}: cannot write: File too large")
    assert [entry.name for entry in tmp_path.iterdir()] == ["full"]
    assert files.load(path, KIND, 1)[2] == mark


def test_what_lies_at_a_path(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    os.mkfifo(tmp_path / "pipe")
    found = {
        name: files.kind(tmp_path / name) for name in ("file", ".", "pipe", "absent", "file/below", "loop")
    }
    assert found == {
        "file": "file",
        ".": "folder",
        "pipe": "other",
        "absent": None,
        "file/below": None,
        "loop": None,
    }
    for path in (tmp_path / ("n" * 300), Path("nul\0")):
        with pytest.raises(UserError, match="cannot read"):
            files.kind(path)


def test_a_pipe_is_refused_instead_of_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for read in (lambda p: files.load(p, KIND, 1), lambda p: files.read_text(p, remedy="")):
        with pytest.raises(UserError, match="not a regular file"):
            read(tmp_path / "pipe")


def test_an_output_that_is_an_input_is_refused_however_it_is_spelt(tmp_path: Path) -> None:
    (tmp_path / "in").write_text("kept")
    (tmp_path / "link").symlink_to(tmp_path / "in")
    os.link(tmp_path / "in", tmp_path / "hard")
    for name in ("in", "link", "hard", "./in"):
        with pytest.raises(UserError, match="would be written over"):
            files.check_output(f"{tmp_path}/{name}", inputs=[None, tmp_path / "in"])
    with pytest.raises(UserError, match="would be written over"):  # two outputs, neither of which exists
        files.check_output(tmp_path / "out", inputs=[tmp_path / "." / "out"])
    files.check_output(tmp_path / "deep" / "out", inputs=[tmp_path / "in", tmp_path / "absent"])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["hard", "in", "link"]


@pytest.mark.skipif(sys.platform != "linux", reason="needs a folder that nobody can write")
def test_an_output_that_cannot_be_made_is_refused_before_and_at_writing() -> None:
    for path in ("/proc/none/out", "/proc/out", "n" * 300, "/dev/null", "/dev/null/out"):
        with pytest.raises(UserError, match="cannot"):
            files.check_output(path)
        with pytest.raises(UserError, match="cannot"), files.atomic(path):
            pytest.fail("there is nothing to write to")


def test_a_file_is_on_the_disk_before_it_takes_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    replace = os.replace
    monkeypatch.setattr(os, "fsync", lambda file: done.append(f"{os.fstat(file).st_size} bytes"))
    monkeypatch.setattr(os, "replace", lambda *paths: (done.append("name"), replace(*paths)))
    with files.atomic(tmp_path / "file") as stream:
        stream.write(b"all of it")
    assert done == ["9 bytes", "name"] and (tmp_path / "file").read_bytes() == b"all of it"


def test_only_errors_about_other_files_pass_through_a_write(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), files.atomic(tmp_path / "new" / "out"):
        open(tmp_path / "absent").close()
    with pytest.raises(UserError, match="cannot write: full"), files.atomic(tmp_path / "new" / "out"):
        raise OSError(28, "full")
    assert list(tmp_path.iterdir()) == []  # nor is the folder left that was made for it


def test_a_working_folder_that_is_gone_is_a_clear_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    for write in (lambda: files.check_output("out"), lambda: files.save("out", KIND, 1, {}, {})):
        with pytest.raises(UserError, match="cannot write"):
            write()


def test_the_kind_of_a_file_is_known_by_its_header(saved: Path, tmp_path: Path) -> None:
    assert files.format_of(saved) == KIND
    for content in (b"", b"{}", (10**9).to_bytes(8, "little") + b"x", (2).to_bytes(8, "little") + b"[]"):
        other = tmp_path / "other"
        other.write_bytes(content)
        assert files.format_of(other) is None
    with pytest.raises(UserError, match="No such file"):
        files.format_of(tmp_path / "nothing")


def test_sizes_of_arrays_are_told_by_the_header(saved: Path, tmp_path: Path) -> None:
    assert files.array_sizes(saved) == {name: array.nbytes for name, array in _arrays().items()}
    for content in (b"no such file at all", b"\x02" + bytes(7) + b"{}", b"\x02" + bytes(7) + b"[]", b""):
        (tmp_path / "other").write_bytes(content)
        with pytest.raises(UserError, match="not a file of arrays"):
            files.array_sizes(tmp_path / "other")


def test_texts_and_bytes_are_written_together_or_not_at_all(tmp_path: Path) -> None:
    written = files.write_together(tmp_path / "new", {"a.txt": "läufe\n", "b.bin": b"\xff\r\n"})
    assert [path.read_bytes() for path in written] == ["läufe\n".encode(), b"\xff\r\n"]
    (tmp_path / "new" / "c").mkdir()
    with pytest.raises(UserError, match="cannot write"):
        files.write_together(tmp_path / "new", {"a.txt": "other", "c": b""})
    assert written[0].read_text("utf-8") == "läufe\n"
