"""mm.wrapped: what stands around a controller answers as the controller does."""

from __future__ import annotations

import numpy as np
import pytest
from test_retarget import stocky

from features import terrain
from mm.control import Command
from mm.controller import Controller
from mm.grounded import Grounded
from mm.rigged import Rigged
from mm.wrapped import Wrapped
from motion import rig
from motion.anatomy import anatomy
from motion.errors import UserError


@pytest.fixture(scope="module")
def database(walker_database):
    return walker_database


WRAPPERS = {
    "plain": Wrapped,
    "grounded": lambda controller: Grounded(controller, terrain.flat),
    "rigged": lambda controller: Rigged(controller, anatomy(rig.enlarge(stocky()))),
}


@pytest.mark.parametrize("name", WRAPPERS)
def test_it_answers_as_the_controller_does(database, name):
    controller = Controller(database, count=2)
    system = WRAPPERS[name](controller)
    for attribute in ("name", "skeleton", "fps", "count", "description", "settings"):
        assert getattr(system, attribute) is getattr(controller, attribute), attribute
    system.timed = True
    assert controller.timed and system.timed
    system.reset(np.array([[1.0, 2.0], [3.0, 4.0]], np.float32), np.zeros(2, np.float32))
    np.testing.assert_array_equal(controller.poses().positions[:, 0, [0, 2]], [[1, 2], [3, 4]])
    if name != "plain":
        system.step(Command.still(2))
        assert set(controller.stage_seconds) < set(system.stage_seconds)
        np.testing.assert_array_equal(system.poses().positions, controller.poses().positions)
    np.testing.assert_array_equal(system.contacts(), controller.contacts())
    np.testing.assert_array_equal(system.planted(), controller.planted())
    assert set(controller.record()) <= set(system.record())
    assert controller.memory().items() <= system.memory().items()
    with pytest.raises(UserError):
        system.check_tags(1, 1)
