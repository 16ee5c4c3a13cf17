"""Feature schemas: columns, presets, TOML, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from features import custom, presets
from features.schema import KINDS, TRAJECTORY, Feature, Schema, register
from motion.config import dumps
from motion.errors import UserError
from motion.roles import ROLES


@pytest.fixture
def registry():
    """Custom features of one test; forgotten afterwards."""
    before = dict(custom._registry)
    yield
    custom._registry.clear()
    custom._registry.update(before)


def test_lmm27_has_the_published_columns_in_order():
    schema = presets.load("lmm27")
    expected = [
        f"{joint}.{kind}.{axis}"
        for joint, kind in (
            ("left_foot", "position"),
            ("right_foot", "position"),
            ("left_foot", "velocity"),
            ("right_foot", "velocity"),
            ("hips", "velocity"),
        )
        for axis in "xyz"
    ]
    for what in ("position", "direction"):
        expected += [
            f"trajectory.{what}[{t}].{axis}" for t in ("+0.333", "+0.667", "+1.000") for axis in "xz"
        ]
    assert list(schema.columns) == expected
    assert schema.size == 27
    assert [f.weight for f in schema.features] == [0.75, 0.75, 1, 1, 1, 1, 1.5]
    assert schema.euclidean
    assert schema.roles() == ("left_foot", "right_foot", "hips")
    layout = schema.trajectory()
    np.testing.assert_allclose(layout.times * 60, [20, 40, 60])
    assert layout.position_columns.tolist() == [15, 17, 19]
    assert layout.direction_columns.tolist() == [21, 23, 25]
    assert schema.pose_columns().tolist() == list(range(15))


def test_quadruped39_has_four_feet_and_mm27s_trajectory():
    schema, two = presets.load("quadruped39"), presets.load("mm27")
    assert schema.size == 39 and schema.columns[24:] == two.columns[12:]
    assert schema.features[8:] == two.features[4:]
    assert schema.roles() == ("left_foot", "right_foot", "left_hand", "right_hand", "hips")
    assert [f.weight for f in schema.features[:8]] == [0.75] * 4 + [1.0] * 4


def test_o3de59_has_the_published_blocks():
    schema = presets.load("o3de59")
    assert schema.size == 59
    assert not schema.euclidean
    assert len(schema.trajectory_columns()) == 44
    layout = schema.trajectory()
    assert len(layout) == 11
    assert np.sum(layout.times < 0) == 4
    assert layout.times[[0, 4, -1]].tolist() == [-0.7, 0.0, 1.2]
    for time, position, direction in zip(*vars(layout).values(), strict=True):
        assert schema.columns[position] == f"trajectory.position[{time:+.3f}].x"
        assert schema.columns[direction + 1] == f"trajectory.direction[{time:+.3f}].z"


@pytest.mark.parametrize("name", presets.names())
def test_presets_cover_their_columns_and_survive_toml(name, tmp_path):
    schema = presets.load(name)
    covered = np.concatenate([np.arange(schema.size)[part] for part in schema.slices.values()])
    assert covered.tolist() == list(range(schema.size))
    both = np.concatenate([schema.pose_columns(), schema.trajectory_columns()])
    assert sorted(both.tolist()) == list(range(schema.size))
    schema.save(tmp_path / "schema.toml")
    again = presets.load(tmp_path / "schema.toml")
    assert again == schema
    assert again.fingerprint == schema.fingerprint


def test_fingerprint_tells_schemas_apart():
    lmm = presets.load("lmm27")
    changed = Schema.from_dict({**lmm.to_dict(), "features": lmm.to_dict()["features"][:-1]})
    assert len({lmm.fingerprint, changed.fingerprint, presets.load("o3de59").fingerprint}) == 3


joint_features = st.builds(
    lambda kind, role, weight, residual, group: Feature(
        f"{role}_{kind}", kind, role, (), weight, residual, group
    ),
    st.sampled_from([kind for kind in KINDS if kind not in (*TRAJECTORY, "custom")]),
    st.sampled_from(ROLES),
    st.just(0.0) | st.floats(1e-6, 1e6),
    st.sampled_from(["squared", "absolute"]),
    st.none() | st.text(min_size=1),
)
trajectory_features = st.builds(
    lambda kind, times, residual: Feature(
        kind, kind, times=tuple(t / 1000 for t in sorted(times)), residual=residual
    ),
    st.sampled_from(TRAJECTORY),
    st.sets(st.integers(-5000, 5000), min_size=1),
    st.sampled_from(["squared", "absolute"]),
)


@given(st.lists(joint_features | trajectory_features, min_size=1, unique_by=lambda feature: feature.name))
def test_any_schema_survives_its_own_description(features):
    schema = Schema("any", tuple(features))
    assert Schema.from_dict(schema.to_dict()) == schema
    assert len(set(schema.columns)) == schema.size
    layout = schema.trajectory()
    assert np.all(np.diff(layout.times) > 0)
    used = np.concatenate([layout.position_columns, layout.direction_columns])
    assert np.sum(used >= 0) * 2 == len(schema.trajectory_columns())


def test_times_of_position_and_direction_may_differ():
    schema = Schema(
        "mixed",
        (
            Feature("p", "trajectory_position", times=(0.5, 1.0)),
            Feature("d", "trajectory_direction", times=(-0.5, 1.0)),
        ),
    )
    layout = schema.trajectory()
    assert layout.times.tolist() == [-0.5, 0.5, 1.0]
    assert layout.position_columns.tolist() == [-1, 0, 2]
    assert layout.direction_columns.tolist() == [4, -1, 6]


GOOD = """\
name = "mine"

[[features]]
name = "head_height"
kind = "height"
role = "head"

[[features]]
name = "path"
kind = "trajectory_position"
times = [0.5, 1.0]
"""


def test_height_is_one_column(tmp_path):
    (tmp_path / "a.toml").write_text(GOOD)
    schema = presets.load(tmp_path / "a.toml")
    assert schema.columns[:2] == ("head.height", "trajectory.position[+0.500].x")


@pytest.mark.parametrize(
    ("old", "new", "line", "parts"),
    [
        ('kind = "height"', 'kind = "hight"', 5, ["features[0].kind: 'hight'", *KINDS]),
        ('"head"', '"hed"', 6, ["features[0].role: 'hed' is no joint role", *ROLES]),
        ('role = "head"', "", 3, ["features[0].role: a 'height' feature needs a role", *ROLES]),
        (
            'role = "head"',
            'role = "head"\nwieght = 2',
            7,
            ["features[0].wieght: unknown key", "weight", "scaler"],
        ),
        ('role = "head"', 'role = "head"\nweight = -2', 7, ["features[0].weight: expected 0 or more"]),
        ('role = "head"', 'role = "head"\nresidual = "cubed"', 7, ["residual: 'cubed'", "squared, absolute"]),
        (
            'role = "head"',
            'role = "head"\nresidual = "path"',
            7,
            ["residual", "choose from squared, absolute"],
        ),
        ('role = "head"', 'role = "head"\nscaler = "max"', 7, ["scaler: 'max'", "standard, minmax, none"]),
        (
            'role = "head"',
            'role = "head"\ntimes = [1.0]',
            7,
            ["features[0].times: a 'height' feature has no times"],
        ),
        ("times = [0.5, 1.0]", "", 8, ["features[1].times: a 'trajectory_position' feature needs a times"]),
        ("[0.5, 1.0]", "[1.0, 0.5]", 11, ["features[1].times: expected increasing"]),
        ("[0.5, 1.0]", "[0.5, inf]", 11, ["features[1].times: expected increasing finite"]),
        ("[0.5, 1.0]", "[0.5, 0.5001]", 8, ["both have the column trajectory.position[+0.500].x"]),
        ('"path"', '"head_height"', 9, ["features[1].name: two features are named 'head_height'"]),
        ('kind = "height"\nrole = "head"', 'kind = "custom"', 3, ["features[0].function"]),
        (
            'kind = "height"\nrole = "head"',
            'kind = "custom"\nfunction = "nope"',
            6,
            ["features[0].function: no custom feature function 'nope' is registered"],
        ),
        ('name = "mine"', 'title = "mine"', 1, ["title: unknown key", "name, features"]),
        ("[[features]]", "[[featurs]]", 3, ["featurs: unknown key", "name, features"]),
    ],
)
def test_a_bad_schema_names_the_key_and_the_choices(tmp_path, registry, old, new, line, parts):
    path = tmp_path / "bad.toml"
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(UserError) as caught:
        presets.load(path)
    assert caught.value.path == str(path)
    assert caught.value.line == line
    for part in parts:
        assert part in str(caught.value)


def test_a_schema_in_code_is_checked_too():
    with pytest.raises(UserError, match="role: 'knee' is no joint role"):
        Feature("x", "position", "knee")
    with pytest.raises(UserError, match="at least one feature"):
        Schema("empty", ())
    with pytest.raises(UserError, match="the group 'g' mixes scalers"):
        Schema(
            "mixed",
            (
                Feature("a", "position", "head", group="g"),
                Feature("b", "velocity", "head", group="g", scaler="minmax"),
            ),
        )


def test_an_unknown_name_lists_the_presets(tmp_path):
    with pytest.raises(UserError, match="no schema 'lmm28'; choose from mm27, lmm27, "):
        presets.load("lmm28")
    with pytest.raises(UserError, match="cannot read"):
        presets.load(tmp_path / "none.toml")


def test_custom_columns_travel_with_the_description(registry):
    register("speed", lambda context: np.zeros((len(context), 2)), columns=("now", "soon"))
    schema = Schema("c", (Feature("pace", "custom", function="speed"),))
    assert schema.columns == ("pace.now", "pace.soon")
    description = schema.to_dict()
    custom._registry.clear()
    assert Schema.from_dict(description) == schema
    assert "now" in dumps(description)


def test_registering_needs_distinct_column_names():
    for columns in ("xyz", (), ("a", "a")):
        with pytest.raises(ValueError, match="expected distinct names"):
            register("bad", lambda context: np.zeros(0), columns=columns)


@pytest.mark.parametrize("weight", [1e-7, 1e7, np.inf, -1.0])
def test_weights_and_times_beyond_use_are_refused(weight):
    with pytest.raises(UserError, match="weight"):
        Feature("x", "position", "head", weight=weight)
    with pytest.raises(UserError, match="at most 10 s"):
        Feature("x", "trajectory_position", times=(0.2, 11.0))
