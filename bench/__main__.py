"""``python -m bench``: compare systems, indexes, crowds, readers and builds."""

from .cli import main

main(prog_name="python -m bench")
