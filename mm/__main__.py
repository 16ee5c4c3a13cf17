"""``python -m mm``."""

from .cli import cli

cli(prog_name="python -m mm")
