"""Hostile input: made from a seed, given to calib under guard, and judged."""
