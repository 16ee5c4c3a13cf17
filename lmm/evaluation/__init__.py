"""How good the learned stages are, each alone and all together."""
