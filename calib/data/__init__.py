"""Data: samples, simulated by babbling or read from a measured log."""
