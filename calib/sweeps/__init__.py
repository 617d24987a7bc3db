"""Sweeps: many trainings over a grid of options, robots and logs."""
