"""What a frame looks like to a search or a network."""
