"""Databases of large rigs: the same motion, and joints that go where their parents go."""

from __future__ import annotations

import lmm_models
import numpy as np
import pytest
from click.testing import CliRunner

from lmm.pfnn.layout import Layout
from mm import enlarged
from mm.cli import main
from mm.database import Database
from motion import kinematics, quat
from motion.errors import UserError


@pytest.fixture(scope="module")
def small():
    return lmm_models.database()


@pytest.fixture(scope="module")
def large(small):
    return enlarged.enlarged(small)


def test_its_own_joints_move_as_they_did(small, large):
    assert len(large.skeleton) == 192 and large.skeleton.names[0] == small.skeleton.names[0]
    own = [0, *enlarged.shared(small.skeleton, large.skeleton)]
    assert [large.skeleton.names[j] for j in own] == list(small.skeleton.names)
    for name, array in large.poses.arrays().items():
        np.testing.assert_array_equal(array[:, own], small.poses.arrays()[name])
    before, _ = kinematics.forward(small.skeleton, small.poses.positions, small.poses.rotations)
    after, _ = kinematics.forward(large.skeleton, large.poses.positions, large.poses.rotations)
    np.testing.assert_allclose(after[:, own], before, atol=1e-5)


def test_what_is_added_is_fixed_to_its_parent(small, large):
    added = sorted(set(range(192)) - {0, *enlarged.shared(small.skeleton, large.skeleton)})
    assert len(added) == 192 - len(small.skeleton)
    places, turns = kinematics.forward(large.skeleton, large.poses.positions, large.poses.rotations)
    parents = large.skeleton.parents[added]
    offsets = np.broadcast_to(large.skeleton.offsets[added], (len(large), len(added), 3))
    np.testing.assert_allclose(
        places[:, added], places[:, parents] + quat.rotate(turns[:, parents], offsets), atol=1e-4
    )
    np.testing.assert_allclose(turns[:, added], turns[:, parents], atol=1e-6)
    assert not large.poses.velocities[:, added].any()


def test_what_searches_see_stays_and_it_is_a_database(small, large, tmp_path):
    assert large.features is small.features and large.names == small.names
    large.save(tmp_path / "large")
    loaded = Database.load(tmp_path / "large")
    assert loaded.skeleton.names == large.skeleton.names and loaded.fingerprint != small.fingerprint
    assert {role: loaded.skeleton.names[j] for role, j in loaded.skeleton.roles.items()} == {
        role: small.skeleton.names[j] for role, j in small.skeleton.roles.items()
    }


def test_a_network_for_it_is_as_large_as_the_published_one(large):
    layout = Layout(len(large.skeleton) - 1)
    assert (layout.input_size, layout.output_size) == (1302, 1751)  # of 191 joints


def test_fewer_joints_than_there_are_are_refused(small):
    with pytest.raises(UserError, match=f"ask for {len(small.skeleton)} or more"):
        enlarged.enlarged(small, 3)


def test_the_command(small, tmp_path):
    small.save(tmp_path / "small")

    def run(*arguments, code=0):
        result = CliRunner().invoke(main, ["enlarge", *map(str, arguments)])
        assert result.exit_code == code, result.output
        return result

    shown = run(tmp_path / "small", "-o", tmp_path / "large", "--joints", 60).stdout
    assert "480 frames" in shown and len(Database.load(tmp_path / "large").skeleton) == 60
    assert "error: " in run(tmp_path / "small", "-o", tmp_path / "small", code=2).stderr
    assert "ask for 23 or more" in run(tmp_path / "small", "-o", tmp_path / "x", "--joints", 5, code=2).stderr
    assert not (tmp_path / "x").exists()
