"""``python -m lmm``."""

from .cli import main

main(prog_name="python -m lmm")
