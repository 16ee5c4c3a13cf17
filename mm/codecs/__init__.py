"""Compressed databases: the usual ways to make motion matching's data small, to compare others with.

    codec - encode - tables - decode a frame - pose

What is stored is what is held in memory: frames are decoded when they are played (`stages`), all but the
features, which are decoded once, for the search.
"""
