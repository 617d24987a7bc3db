"""Inverse: from a position to joints: starts, Newton steps, branches, self-motions."""
