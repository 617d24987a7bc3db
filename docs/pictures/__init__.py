"""The pictures of the manual, a function each; `docs/make_pictures.py` draws them."""
