"""What systems hold in memory, by part, stored, loaded and at the peak, and what errors they have for it."""
