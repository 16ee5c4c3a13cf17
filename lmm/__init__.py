"""Learned Motion Matching: networks in place of the engine's three stages."""
