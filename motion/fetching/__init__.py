"""Public motion data sets: a registry of them, their download, their safe unpacking."""
