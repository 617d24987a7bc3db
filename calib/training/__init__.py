"""Training: from samples to a model, and the model's errors."""
