"""Fuzzing of every reader: no input may end in anything but a result or one clear error.

    python -m tests.fuzz bvh --seconds 300

`targets` says what is read and what must hold, `documents` makes valid files to begin with, `mutation` spoils
them, `engine` is the coverage-guided loop (atheris, in a process of its own), and `__main__` runs it and
sums up. `tests/test_fuzz.py` runs a fixed small share of it with every test run.
"""
