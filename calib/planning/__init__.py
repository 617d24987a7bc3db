"""Planning: which poses to measure with a real arm, and in which order."""
