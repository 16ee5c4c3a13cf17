"""The classical motion-matching engine: database, search, stages, controller."""
