"""Body: the smooth part of what was learned, from joints to positions."""
