"""Recording: logs made from pictures and videos of an arm with a printed tag on its tip."""
