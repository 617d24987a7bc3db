"""Drift: whether a map still fits the arm, and what changed if it does not."""
