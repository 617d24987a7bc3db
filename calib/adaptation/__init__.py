"""Adaptation: a map re-calibrated from new samples, many in a stream or a few in a log."""
