"""Motion beside motion: two sources at the same speeds and moves, in pictures and numbers."""
