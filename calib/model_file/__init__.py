"""Model file: how a model is kept in one file and rebuilt from it."""
