"""Ask a model for positions or for joint values."""
