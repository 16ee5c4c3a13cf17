"""What a motion is, where it comes from, and what is done to it."""
