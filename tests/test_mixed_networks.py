"""lmm.training.mixed_networks: weight sets multiplied side by side are weights mixed sample by sample."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from lmm.pfnn.spline import coefficients  # noqa: E402
from lmm.training.mixed_networks import ExpertLayers, MixedLayers, PhaseLayers  # noqa: E402

KINDS = ("pfnn", "mann")


def layers(kind: str, *sizes: int) -> MixedLayers:
    """Of random numbers, biases and normalisation too."""
    rng = np.random.default_rng(2)
    if kind == "pfnn":
        found: MixedLayers = PhaseLayers(sizes, seed=1, name="any")
    else:
        columns = rng.permutation(sizes[0])[: sizes[0] // 2].astype(np.int64)
        found = ExpertLayers(sizes, columns, experts=3, hidden=8, seed=1, name="any")
    with torch.no_grad():
        draw = torch.Generator().manual_seed(3)
        for name, parameter in found.named_parameters():
            if "bias" in name:
                parameter.normal_(generator=draw)
    ends = {"input_mean": 0, "input_std": 0, "output_mean": -1, "output_std": -1}
    found.normalise(**{n: rng.uniform(0.5, 2, sizes[i]).astype(np.float32) for n, i in ends.items()})
    return found


def inputs(kind: str, count: int, width: int) -> list[np.ndarray]:
    """Vectors, and what else a network takes of each."""
    rng = np.random.default_rng(0)
    x = rng.standard_normal((count, width)).astype(np.float32)
    return [x, rng.uniform(-7, 14, count)] if kind == "pfnn" else [x]


@pytest.mark.parametrize("kind", KINDS)
def test_a_batch_is_what_weights_mixed_sample_by_sample_give(kind: str) -> None:
    """Outputs and gradients of products side by side are those of a mixture for each sample."""
    network, rng = layers(kind, 7, 12, 12, 5), np.random.default_rng(0)
    x, *phases = inputs(kind, 30, 7)
    more = [torch.from_numpy(coefficients(p).astype(np.float32)) for p in phases]
    x, aim = torch.from_numpy(x), torch.from_numpy(rng.standard_normal((30, 5)).astype(np.float32))

    def elu(h: torch.Tensor, i: int) -> torch.Tensor:
        return torch.where(h > 0, h, torch.exp(h) - 1) if i else h

    def naive() -> torch.Tensor:
        rows = []
        for n in range(len(x)):
            if more:
                share = more[0][n]
            else:
                h = x[n, network.gate_columns]
                gates = zip(network.gate_weights, network.gate_biases, strict=True)
                for i, (weight, bias) in enumerate(gates):
                    h = elu(h, i) @ weight + bias
                share = torch.exp(h) / torch.exp(h).sum()
            h = x[n]
            for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
                h = elu(h, i) @ (share[:, None, None] * weight).sum(0) + (share[:, None] * bias).sum(0)
            rows.append(h)
        return torch.stack(rows)

    both = []
    for outputs in (network.inner(x, *more), naive()):
        network.zero_grad()
        (outputs * aim).sum().backward()
        both.append([outputs.detach(), *(parameter.grad.clone() for parameter in network.parameters())])
    assert len(both[0]) == (7 if kind == "pfnn" else 13)
    for ours, expected in zip(*both, strict=True):
        np.testing.assert_allclose(ours, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_the_network_of_torch_and_the_stored_one_agree(kind: str) -> None:
    network, given = layers(kind, 9, 16, 16, 16, 6), inputs(kind, 50, 9)
    found = network.evaluate(*given, chunk=20)
    np.testing.assert_allclose(found, network.network().evaluate(*given), atol=2e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_dropout_leaves_a_share_and_draws_what_it_is_given(kind: str) -> None:
    network = layers(kind, 40, 6)
    x, more = torch.ones(2000, 40), [torch.full((2000, 4), 0.25)] if kind == "pfnn" else []

    def draw(seed: int) -> torch.Tensor:
        return network.inner(x, *more, keep=0.7, draw=torch.Generator().manual_seed(seed)).detach()

    assert torch.equal(draw(1), draw(1)) and not torch.equal(draw(1), draw(2))
    if kind == "mann":
        draw_gate = torch.Generator().manual_seed(1)
        dropped = network.gate(x, 0.7, draw_gate)
        assert len(torch.unique(dropped, dim=0)) > 1000
        np.testing.assert_allclose(dropped.detach().sum(dim=1), 1, atol=1e-5)
        return
    whole = network.inner(x, *more).detach()
    np.testing.assert_allclose(draw(1).mean(dim=0), whole.mean(dim=0), atol=0.1)


def test_a_gate_heeds_inputs_as_if_they_were_scaled() -> None:
    network = layers("mann", 10, 8, 4)
    x = torch.from_numpy(inputs("mann", 20, 10)[0])
    before, scale = network.gate(x).detach(), np.linspace(0.5, 4, 5, dtype=np.float32)
    network.heed(1 / scale)
    x[:, network.gate_columns] *= torch.from_numpy(scale)
    np.testing.assert_allclose(network.gate(x).detach(), before, atol=1e-5)
