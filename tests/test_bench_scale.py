"""``bench scale``: data of any length, fitted powers, what fits into memory, and what is kept."""

from __future__ import annotations

import json
from dataclasses import replace

import linear_models
import numpy as np
import page_html
import pandas as pd
import pytest
from click.testing import CliRunner

from bench.cli import main
from bench.scale import cli, fits, lengths, measure, page, room
from mm import build, courses
from mm.nearness import RealPoses, to_nearest
from motion import dancecard
from motion.errors import UserError


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


@pytest.fixture(scope="module")
def taken(database):
    return lengths.Taken(database, seed=1)


def bench(*arguments, code=0):
    result = CliRunner().invoke(main, ["scale", *map(str, arguments)])
    assert result.exit_code == code, result.output + result.stderr
    return result


def test_a_power_is_found_again():
    x = np.array([1, 2, 5, 10, 60.0])
    fit = fits.power(x, 3 * x**0.7)
    assert (fit.exponent, fit.error, fit.at_one) == pytest.approx((0.7, 0, 3), abs=1e-9)
    assert fit.half == pytest.approx(0, abs=1e-9) and fit.points == 5
    assert fit.at([100.0]) == pytest.approx([3 * 100**0.7])


def test_the_error_of_an_exponent_is_how_much_it_scatters():
    """Over many draws of noise the slopes differ by what each says of itself."""
    rng, x = np.random.default_rng(0), np.geomspace(1, 100, 9)
    drawn = [fits.power(x, x**0.5 * np.exp(rng.normal(scale=0.2, size=9))) for _ in range(2000)]
    slopes, errors = (np.array([getattr(f, name) for f in drawn]) for name in ("exponent", "error"))
    assert slopes.mean() == pytest.approx(0.5, abs=0.01)
    assert np.sqrt((errors**2).mean()) == pytest.approx(slopes.std(), rel=0.06)
    within = [abs(fit.exponent - 0.5) <= fit.half for fit in drawn]
    assert 0.94 < np.mean(within) < 0.96


def test_what_cannot_be_fitted():
    assert np.isnan(fits.power([1.0, 1.0], [2.0, 3.0]).exponent)
    two = fits.power([1.0, 4.0], [1.0, 2.0])
    assert two.exponent == pytest.approx(0.5) and np.isnan([two.error, two.half]).all()
    assert fits.power([1, 2, 4, 8], [1, 0, np.nan, 8]).exponent == pytest.approx(1)


def test_lengths_are_as_long_as_asked_and_nested(taken, database):
    minutes = np.array([0.05, 0.1, 0.2])
    made = [taken.of(m) for m in minutes]
    assert [len(one) for one in made] == (2 * 3600 * minutes).round().astype(int).tolist()  # and mirrored
    rows = [{row.tobytes() for row in one.poses.positions} for one in made]
    assert rows[0] < rows[1] < rows[2] < {row.tobytes() for row in database.poses.positions}
    for one in made:
        one.validate()
        assert one.mirrored.sum() == len(one.starts) / 2
        np.testing.assert_allclose(one.features.mean(axis=0), 0, atol=1e-4)  # normalised by itself


def test_all_of_the_data_is_the_longest_and_what_is_held_out(taken, database):
    whole = taken.of(taken.longest)
    assert taken.held_out and set(whole.names) | taken.held_out == set(database.names)
    assert not set(whole.names) & taken.held_out
    held = sum(
        int(b - a)
        for a, b, name in zip(database.starts, database.stops, database.names, strict=True)
        if name in taken.held_out
    )
    assert len(whole) + held == len(database) and held >= 0.1 * len(database)
    # Other poses of the same features are other data, whether a file holds them or not.
    unsaved = replace(database, fingerprint="")
    other = replace(unsaved, contacts=np.zeros_like(database.contacts))
    assert lengths.Taken(unsaved).facts() == lengths.Taken(unsaved).facts() != lengths.Taken(other).facts()
    other = lengths.Taken(database, seed=2).of(0.05)
    assert other.names != taken.of(0.05).names  # another seed, another order
    assert lengths.Taken(database, held_out={"run"}).held_out == {"run"}


def test_the_dance_grows_and_another_dancer_is_not_in_it():
    danced = lengths.Danced(mirror=False)
    short, long = danced.of(0.2), danced.of(0.6)
    assert (len(short), len(long)) == (720, 2160) and len(long.skeleton) == danced.joints
    # As from files, but for what a file rounds.
    clip = next(dancecard.dances(12.0)).clip
    assert short.names == (clip.name,)
    np.testing.assert_allclose(long.poses.rotations[:600], short.poses.rotations[:600], atol=0.05)
    assert danced.facts() == lengths.Danced(mirror=False).facts() != lengths.Danced(7, mirror=False).facts()


def test_clips_without_files_make_the_database_that_files_make(walker_files, walker_clips, database):
    order = [next(c for c in walker_clips if c.name == name) for name in dict.fromkeys(database.names)]
    made = build.of_clips(order)
    assert made.names == database.names and len(made) == len(database)
    np.testing.assert_allclose(made.poses.positions, database.poses.positions, atol=2e-3)
    with pytest.raises(UserError, match="no clips"):
        build.of_clips([])


def test_the_nearest_pose_by_one_look_at_all(database):
    rng = np.random.default_rng(0)
    poses = RealPoses(database)._poses[rng.integers(0, len(database), 40)].reshape(40, -1, 3)
    poses = poses + rng.normal(scale=0.05, size=poses.shape)
    expected = RealPoses(database).distances(poses)
    np.testing.assert_allclose(to_nearest(database, poses), expected, rtol=1e-4)


def test_unseen_poses_come_nearer_the_more_there_are(taken):
    unseen = taken.unseen()
    apart = [to_nearest(taken.of(minutes), unseen).mean() for minutes in (0.05, taken.longest)]
    assert apart[1] < apart[0]


def test_what_does_not_fit_is_told_before_any_work(taken, monkeypatch):
    monkeypatch.setattr(room, "available", lambda: room.needed(taken, 0.15, ("exact",)))
    assert "0.1 minutes need about" in room.check(taken, [0.1], ("exact",))[0]
    with pytest.raises(UserError, match=r"0\.2 minutes need about .* GB are free; --minutes 0\.1 fit"):
        measure.measure(taken, [0.1, 0.2], plan=measure.Plan(indexes=("exact",)))


def test_an_hour_needs_what_its_arrays_are(database):
    """At least the arrays of the database, at most a few times as much."""
    danced = lengths.Danced()
    arrays = 2 * 3600 * 60 * (4 * 13 * danced.joints + 4 * danced.features)
    few, all_of_them = (room.needed(danced, 60, names) for names in (("exact",), tuple(room.INDEX)))
    assert arrays < few < all_of_them < 5 * arrays
    assert room.needed(danced, 120, ("exact",)) - room.BASE == pytest.approx(2 * (few - room.BASE))


PLAN = measure.Plan(indexes=("exact", "brute"), queries=40, repeats=1, courses=("circle",), seconds=1.0)


def test_a_length_that_was_measured_is_not_measured_again(taken, tmp_path, monkeypatch):
    first = measure.measure(taken, [0.05, 0.1], plan=PLAN, work=tmp_path)
    asked = []

    def stand_in(lengths, minutes, *rest):
        asked.append(minutes)
        return first.indexes.to_dict("records"), first.systems.to_dict("records")[0]

    monkeypatch.setattr(measure, "of_length", stand_in)
    again = measure.measure(taken, [0.1, 0.05], plan=PLAN, work=tmp_path)
    pd.testing.assert_frame_equal(again.indexes, first.indexes)
    pd.testing.assert_frame_equal(again.systems, first.systems)
    assert not asked
    # Nothing of other data, or of another plan.
    measure.measure(lengths.Taken(taken.database, seed=5), [0.1], plan=PLAN, work=tmp_path)
    measure.measure(taken, [0.1], plan=replace(PLAN, queries=41), work=tmp_path)
    assert asked == [0.1, 0.1]


@pytest.fixture(scope="module")
def report(database, tmp_path_factory):
    folder = tmp_path_factory.mktemp("scale")
    database.save(folder / "walker.mmdb")
    shown = CliRunner().invoke(
        main,
        [
            *("scale", str(folder / "walker.mmdb"), "--quick", "--indexes", "exact,two-phase"),
            *("--queries", "40", "-o", str(folder / "out")),
        ],
    )
    assert shown.exit_code == 0, shown.output
    return folder / "out", shown


def test_the_report_has_tables_fits_and_pictures(report, taken):
    out, shown = report
    assert page_html.files(out) == {*page.FILES, "work"} - {"models.csv"}
    facts = json.loads((out / "scale.json").read_text())
    assert {row["index"] for row in facts["indexes"]} == {"exact", "two-phase"}
    assert [row["minutes"] for row in facts["systems"]] == pytest.approx(
        [lengths.Taken(taken.database).longest]
    )
    assert all(row["recall"] == 1 for row in facts["indexes"] if row["index"] == "exact")
    text = (out / "report.html").read_text()
    assert "http" not in text.replace("http://www.w3.org", "") and "<svg" in text
    assert "minutes need about" in shown.stderr and "search indexes" in shown.stdout


def test_no_length_changes_what_a_model_holds(taken, database):
    """On its database it is driven as motion matching is; without one there is what it costs."""
    model = linear_models.fitted(database)
    played = [courses.load("circle")]
    (own,) = measure.of_models(taken, {"lmm": model}, played, PLAN)
    (alone,) = measure.of_models(lengths.Danced(), {"lmm": model}, played, PLAN)
    assert own["system"] == alone["system"] == "lmm-PSD"
    assert own["memory_mb"] == alone["memory_mb"] > 0 and own["frame_us"] > 0 and alone["frame_us"] > 0
    assert own["minutes"] == pytest.approx(len(database) / 2 / 3600) and np.isnan(alone["minutes"])
    assert own["path_cm"] > 0 and "path_cm" not in alone


def test_lengths_by_default_are_those_there_are(taken):
    assert cli._lengths(taken, None, (0.1, 0.2, 5.0)) == (0.1, 0.2, taken.longest)
    assert cli._lengths(lengths.Danced(), None, (1.0, 2.0)) == (1.0, 2.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--minutes", "0"), "0 minutes; give numbers from 0.5"),
        (("--minutes", "many"), "not a list of numbers"),
        (("--indexes", "nope"), "no search index 'nope'; choose from brute"),
        (("--fps", "30"), "the built-in data is generated; leave out --fps"),
        (("missing.mmdb",), "no such file"),
    ],
)
def test_bad_input(arguments, message):
    stderr = bench(*arguments, code=2).stderr
    assert message in stderr, stderr


def test_more_minutes_than_there_are(report):
    stderr = bench(report[0].parent / "walker.mmdb", "--minutes", "90", code=2).stderr
    assert "no 90 minutes in" in stderr
