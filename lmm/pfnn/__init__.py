"""Phase-functioned neural networks (REFERENCE 4): vectors, weights, torch-free runtime, controller."""
