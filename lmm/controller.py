"""Characters driven by networks: `mm.controller` with any of its stages learned."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from mm import search
from mm.controller import Controller
from mm.database import Database
from mm.settings import Settings

from .evaluator import Products
from .mixtures import LETTERS, letters, stages
from .model import Model


def controller(
    model: Model,
    *,
    learned: str = LETTERS,
    database: Database | None = None,
    index: str | search.Index = "exact",
    latents: NDArray | None = None,
    settings: Settings | None = None,
    products: Products = "float32",
    compiled: bool = True,
    **options: Any,
) -> Controller:
    """A controller whose stages are a model's; it holds of the database what they need, nothing else.

    learned, database, index, latents, products : see `lmm.mixtures.stages`; options : of
    `mm.controller.Controller`.
    """
    learned = letters(learned)
    three = stages(
        model,
        learned=learned,
        database=database,
        index=index,
        latents=latents,
        settings=settings,
        products=products,
        compiled=compiled,
    )
    options = {"name": f"lmm-{learned}" if learned else "mm"} | options
    return Controller(model.description, three_stages=three, settings=settings, compiled=compiled, **options)
