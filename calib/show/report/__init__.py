"""Report: what was learned, from what and how well, as one page."""
