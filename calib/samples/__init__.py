"""Samples: what the arm did and what the sensor saw, simulated or read from logs."""
