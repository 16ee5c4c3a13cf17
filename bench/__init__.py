"""The harness: memory, cost per frame and quality of every system on the same data."""
