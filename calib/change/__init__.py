"""Change: whether a model still fits its arm, what changed, and the model that follows."""
