"""Training of the learned stages; the one part of the package that needs torch."""
