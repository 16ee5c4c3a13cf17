"""What networks that make locomotion of a trajectory have in common (REFERENCE 4.2, 5)."""
