"""``python -m viewer``."""

from .cli import main

main(prog_name="python -m viewer")
