"""Show: pictures, previews and reports of a model."""
