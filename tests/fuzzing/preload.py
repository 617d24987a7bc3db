"""What a command needs, imported once: the streams' cases are children of such a process.

Polars is not, whose threads a child would not have.
"""

from __future__ import annotations

import importlib
import pkgutil

import calib_cli

import calib

_LEFT_OUT = ("calib.show", "calib.paper", "calib.recording", "calib.sweeps", "calib_cli.__main__")

for package in (calib, calib_cli):
    for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        if not found.name.startswith(_LEFT_OUT):
            importlib.import_module(found.name)
