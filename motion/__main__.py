"""``python -m motion``."""

from .cli import main

main(prog_name="python -m motion")
