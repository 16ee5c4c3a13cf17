"""lmm.pfnn.controller: what is its own beside `lmm.locomotion.controller`: modes of the phase."""

from __future__ import annotations

import pfnn_models
import pytest

from lmm.pfnn.controller import PhaseController
from motion.errors import UserError


def test_memory_names_the_weights_of_the_mode() -> None:
    model = pfnn_models.model()
    sizes = {mode: PhaseController(model, mode=mode).memory() for mode in ("cubic", "linear", "constant")}
    for mode, memory in sizes.items():
        assert memory["network"] == model.network.weight_bytes(mode)
    assert sizes["cubic"]["state"] == PhaseController(model, count=64).memory()["state"]


def test_an_unknown_mode_is_refused() -> None:
    with pytest.raises(UserError, match="no phase mode"):
        PhaseController(pfnn_models.model(), mode="square")  # type: ignore[arg-type]
