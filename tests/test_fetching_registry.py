"""The registry of data sets: the built-in one, and what is wrong with others."""

from __future__ import annotations

import copy
import shlex
import tomllib
from importlib import resources

import pytest

from motion import cli, config
from motion.errors import UserError
from motion.fetching import registry
from motion.fetching.registry import DataSet, Registry, numbers

BUILT_IN = registry.load()
ONE = {
    "name": "studio",
    "title": "Our own",
    "holds": "walks",
    "homepage": "https://example.org",
    "credit": "",
    "licence": {"name": "ours", "allows": "all", "address": "https://example.org/licence"},
    "files": [{"address": "https://example.org/a.zip", "into": "bvh", "kind": "zip"}],
}
SERIES = {
    "once": ["https://example.org/{part}/{part}.asf"],
    "take": "https://example.org/{part}/{part}_{take}.amc",
    "into": "{part}",
    "takes": {"01": "1-3", "16": "1-2 58", "102": "7"},
    "groups": {"some": ["16", "102"]},
    "default": "some",
}


def changed(path: str, value) -> dict:
    """The entry with one key set (removed, if the value is None)."""
    one = copy.deepcopy({**ONE, "series": SERIES})
    *above, last = path.split(".")
    table = one
    for key in above:
        table = table[int(key) if key.isdigit() else key]
    if value is None:
        del table[last]
    else:
        table[last] = value
    return one


def test_the_sets_that_are_promised_are_there():
    names = {one.name for one in BUILT_IN.sets}
    assert {"cmu", "lafan1", "100style", "bandai-namco", "pfnn", "mann-dog", "geno-lafan1"} <= names


@pytest.mark.parametrize("one", BUILT_IN.sets, ids=lambda one: one.name)
def test_every_set_says_all_that_a_user_must_know(one: DataSet):
    assert one.title and one.holds and one.credit and one.verified
    assert one.licence.name and len(one.licence.allows) > 10 and "\n" not in one.licence.allows
    files = one.choose([])
    assert files and len({file.into for file in files}) == len(files)
    for address in (one.homepage, one.licence.address, *(file.address for file in files)):
        assert address.startswith("https://")
    assert len({file.name for file in one.files}) == len(one.files)
    for file in one.files:
        assert (file.kind != "plain") == file.address.partition("?")[0].endswith((".zip", ".tar.gz"))


@pytest.mark.parametrize("one", BUILT_IN.sets, ids=lambda one: one.name)
def test_the_options_of_a_set_are_options_of_motion_info(one: DataSet):
    arguments = cli.main.commands["info"].make_context("info", ["x.bvh", *shlex.split(one.options)])
    assert (arguments.params["source_unit"] is None) == (one.notes.unit == "")


def test_the_wheel_carries_the_registry():
    text = (resources.files(registry.__package__) / "registry.toml").read_text()
    assert len(tomllib.loads(text)["sets"]) == len(BUILT_IN.sets)


def test_subjects_of_cmu():
    cmu = BUILT_IN.find("cmu")
    files = cmu.choose(["9", "35"])
    assert [file.into for file in files[:3]] == ["09/09.asf", "09/09_01.amc", "09/09_02.amc"]
    assert files[1].address == "https://mocap.cs.cmu.edu/subjects/09/09_01.amc"
    assert len(files) == 1 + 12 + 1 + 34
    assert [file.into for file in files if not file.optional] == ["09/09.asf", "35/35.asf"]
    assert {file.into.split("/")[0] for file in cmu.choose([])} > {"09", "16", "35"}
    assert cmu.choose(["102"])[-1].into == "102/102_33.amc"


def test_parts_and_groups_are_chosen_once_each():
    series = config.from_dict(registry.Series, SERIES)
    assert series.chosen(["16", "some", "1"]) == ["16", "102", "01"]
    assert [file.into for file in series.files(["102"])] == ["102/102.asf", "102/102_07.amc"]
    with pytest.raises(UserError, match="no part '4'; choose from some, 01, 16, 102"):
        series.chosen(["4"])


def test_numbers():
    assert numbers("1-3 7 10-11") == [1, 2, 3, 7, 10, 11]


def test_an_unknown_set_lists_the_choices():
    with pytest.raises(UserError, match=r"no data set 'cnu'; choose from cmu, "):
        BUILT_IN.find("cnu")
    with pytest.raises(UserError, match="lafan1 has no parts"):
        BUILT_IN.find("lafan1").choose(["1"])


def test_the_size_is_known_only_where_all_sizes_are():
    assert BUILT_IN.find("lafan1").size == sum(file.size or 0 for file in BUILT_IN.find("lafan1").files)
    assert BUILT_IN.find("cmu").size is None and BUILT_IN.find("pfnn").size is None


def test_a_file_is_named_after_its_address():
    names = {"a.zip?x=1": "a.zip", "b%20c.zip": "b_c.zip", "": "download", "..%2f..%2fevil": "evil"}
    for path, name in names.items():
        assert registry.File(f"https://example.org/{path}", "x").name == name


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("name", "Ours!", "name: 'Ours!' is no name"),
        ("title", None, "title: missing key"),
        ("colour", "red", "colour: unknown key"),
        ("homepage", "ftp://example.org", "homepage: 'ftp://example.org' is no address"),
        ("homepage", "https://[", "is no address"),
        ("licence.address", "https:///x", "licence.address: 'https:///x' is no address"),
        ("files.0.address", "https://example.org/a b", r"files\[0\].address: .* is no address"),
        ("files.0.kind", "rar", "'rar' is no choice; choose from zip, tar.gz, plain"),
        ("files.0.kind", None, None),
        ("files.0.size", 0, "size: expected a number of bytes"),
        ("files.0.sha256", "ABC", "sha256: expected 64 hexadecimal digits in lower case"),
        ("files.0.md5", "0" * 31, "md5: expected 32 hexadecimal digits"),
        ("files.0.into", "../x", "into: '../x' is no place below"),
        ("files.0.into", "/x", "is no place below"),
        ("files.0.into", "", "is no place below"),
        ("files.0.into", "C:x", "is no place below"),
        ("files.0.into", "fetched.json", "is no place below"),
        ("files.0.into", ".fetching/x", "is no place below"),
        ("files.0.strip", "a/../b", "strip: 'a/../b' is no place below"),
        ("series.take", "https://example.org/{subject}", r"take: only \{part\} and \{take\}"),
        ("series.takes.16", "3-1", "takes.16: '3-1' is no range"),
        ("series.takes.16", "", "takes.16: no number"),
        ("series.takes.16", "1-99999", "is no range"),
        ("series.takes.a/b", "1", "expected a name of letters and digits"),
        ("series.default", "all", "default: no part or group 'all'"),
        ("series.groups.some", ["17"], "groups.some: no part '17'"),
    ],
)
def test_what_is_wrong_in_an_entry_is_named(key, value, message):
    if message is None:
        del (entry := changed("name", "x"))["files"][0]["kind"]
        assert config.from_dict(DataSet, entry).files[0].kind == "plain"
        return
    with pytest.raises(UserError, match=message):
        config.from_dict(DataSet, changed(key, value))


def test_a_set_needs_files_with_places_of_their_own():
    with pytest.raises(UserError, match="a set without files"):
        config.from_dict(DataSet, {**ONE, "files": []})
    with pytest.raises(UserError, match=r"files\[1\].into: BVH is taken by another file"):
        config.from_dict(DataSet, {**ONE, "files": [*ONE["files"], {**ONE["files"][0], "into": "BVH"}]})
    with pytest.raises(UserError, match="strip and keep are for archives"):
        config.from_dict(DataSet, {**ONE, "files": [{**ONE["files"][0], "kind": "plain", "keep": ["*"]}]})
    with pytest.raises(UserError, match=r"sets\[1\].name: two sets are named 'studio'"):
        config.from_dict(Registry, {"sets": [ONE, ONE]})


def test_a_fault_in_a_registry_file_says_its_line(tmp_path):
    file = tmp_path / "mine.toml"
    config.dump(config.from_dict(Registry, {"sets": [ONE]}), file)
    assert registry.load(file).find("studio").files[0].into == "bvh"
    file.write_text(file.read_text().replace('kind = "zip"', 'kind = "rar"'))
    with pytest.raises(UserError, match=r"mine\.toml:\d+: sets\[0\]\.files\[0\]\.kind: 'rar' is no choice"):
        registry.load(file)
