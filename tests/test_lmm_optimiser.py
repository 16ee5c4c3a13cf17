"""lmm.training.optimiser: rates that begin anew, and the decay of weights between restarts."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from lmm.training.mann_settings import MannStageSettings  # noqa: E402
from lmm.training.optimiser import groups, optimiser, period, rate  # noqa: E402

EPOCH = 7
STAGE = MannStageSettings(epochs=0, iterations=150 * EPOCH)


def test_rates_restart_after_10_30_and_70_of_150_epochs() -> None:
    """Each time over twice as long (REFERENCE 5): at its height after a restart, half in the middle."""
    for start, stop in ((0, 10), (10, 30), (30, 70), (70, 150)):
        first, last = start * EPOCH, stop * EPOCH - 1
        assert period(STAGE, first) == period(STAGE, last) == (first, last + 1)
        assert rate(STAGE, first) == pytest.approx(1e-4)
        assert rate(STAGE, (start + stop) * EPOCH // 2) == pytest.approx(0.5e-4)
        assert rate(STAGE, last) < 0.01 * 1e-4
        rates = [rate(STAGE, i) for i in range(first, last + 1)]
        assert (np.diff(rates) < 0).all()


def test_weights_without_a_gradient_decay_by_what_is_normalised() -> None:
    """Over a whole period by half of 2.5e-3 times the root of its iterations, whatever the rate."""
    weight = torch.nn.Parameter(torch.ones(3))
    moves = optimiser(STAGE, [weight])
    for start, stop in ((0, 10), (10, 30)):
        before = float(weight[0].detach())
        for i in range(start * EPOCH, stop * EPOCH):
            for group in moves.param_groups:
                group.update(groups(STAGE, i))
            weight.grad = torch.zeros(3)
            moves.step()
        iterations = (stop - start) * EPOCH
        decayed = -np.log(float(weight[0].detach()) / before)
        assert decayed == pytest.approx(2.5e-3 / np.sqrt(iterations) * iterations / 2, rel=0.02)
    assert "weight_decay" not in groups(MannStageSettings(optimiser="adam"), 0)
