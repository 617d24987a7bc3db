"""The commands `calib query forward`, `calib query inverse` and `calib query path`."""

from __future__ import annotations

import typer

from .forward import forward
from .inverse import inverse
from .path import path

query_app = typer.Typer(
    add_completion=False,
    help="Ask a model for positions or for joint values.",
    rich_markup_mode=None,
)
_NEGATIVE = {"ignore_unknown_options": True}  # -0.1 is a number, not an option
query_app.command(context_settings=_NEGATIVE)(forward)
query_app.command(context_settings=_NEGATIVE)(inverse)
query_app.command()(path)
