"""Readouts: how a query is answered from the maps, in both directions."""
