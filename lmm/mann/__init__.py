"""Mode-adaptive networks (REFERENCE 5): vectors, weights, torch-free runtime, controller."""
