"""Model: what was learned, and the answers it gives in both directions."""
