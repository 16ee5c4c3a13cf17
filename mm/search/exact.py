"""The fast exact index (for now the obvious one under its name)."""

from __future__ import annotations

from .brute import Brute


class Exact(Brute):
    name = "exact"
