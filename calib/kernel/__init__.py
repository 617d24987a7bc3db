"""Kernel: a model as C, its own fast path, and as the C of `calib export`."""
