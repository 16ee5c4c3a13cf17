"""The experiment of the thesis on phase-functioned networks in a game engine, on data at hand."""
