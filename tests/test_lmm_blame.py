"""lmm.evaluation.blame: tables that were made up so that it is known which stage is at fault."""

from __future__ import annotations

import pytest

from lmm.evaluation import blame
from lmm.mixtures import COMBINATIONS


def rows(of, column="skate_cm_s"):
    """Rows of all mixtures; of gives a metric of the letters that are learned."""
    return [
        {"system": f"lmm-{letters}" if letters else "mm", column: of(letters)} for letters in COMBINATIONS
    ]


def test_what_each_adds_is_what_it_adds_where_nothing_depends_on_others():
    adds = {"P": 3.0, "S": -1.0, "D": 0.5}
    found = blame.shares({letters: 10 + sum(adds[letter] for letter in letters) for letters in COMBINATIONS})
    assert found == pytest.approx(adds)


def test_what_only_two_do_together_is_shared_and_the_sum_is_the_whole():
    values = {letters: 10 + 4.0 * ("P" in letters and "S" in letters) for letters in COMBINATIONS}
    assert blame.shares(values) == pytest.approx({"P": 2.0, "S": 2.0, "D": 0.0})
    uneven = {letters: float(i * i) for i, letters in enumerate(COMBINATIONS)}
    assert sum(blame.shares(uneven).values()) == pytest.approx(uneven["PSD"] - uneven[""])


def test_the_stage_at_fault_is_named():
    (sentence,) = blame.told(rows(lambda letters: 10 + 3 * ("P" in letters) + 0.2 * ("D" in letters)))
    assert sentence == (
        "All three networks together have 3.2 cm/s more foot skate than motion matching; most of it comes "
        "with the Projector (+3; alone, as lmm-P, +3)."
    )
    (sentence,) = blame.told(rows(lambda letters: 100 + 30 * ("D" in letters), "jerk_m_s3"))
    assert "30 m/s³ more jerk" in sentence and "the Decompressor (+30" in sentence
    (sentence,) = blame.told(rows(lambda letters: 10 + len(letters)))
    assert "the largest part of it" in sentence


def test_where_there_is_no_fault_none_is_found():
    (sentence,) = blame.told(rows(lambda letters: 10.0))
    assert sentence.endswith("no more foot skate than motion matching, and none of them adds to it.")
    (sentence,) = blame.told(rows(lambda letters: 10 + 4 * ("S" in letters) - 5 * ("D" in letters)))
    assert "no more foot skate" in sentence and "the Stepper (+4; alone" in sentence
    assert sentence.endswith("which the others make up for.")


def test_what_is_not_known_is_not_said():
    table = rows(lambda letters: 10.0)
    assert blame.told(table[1:]) == [] and blame.told([]) == []
    for column, value in (("broke", 1), ("skate_cm_s", None), ("skate_cm_s", float("inf"))):
        assert blame.told([table[0] | {column: value}, *table[1:]]) == []
    free = [row | {"system": f"{row['system']}-free"} for row in table]
    assert len(blame.told(free)) == 1
