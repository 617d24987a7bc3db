"""calib: sensorimotor calibration of robot arms with self-organizing maps.

Give it a URDF, or a log of joint values and measured tip positions, and it learns where
the arm is for any joint values and how to get anywhere, without a kinematic model.

>>> import calib
>>> arm = calib.load_arm("two_link")
>>> model = calib.train(calib.babble(arm, 2000, seed=0), size=20)
>>> q = model.inverse([0.3, 0.3])
>>> bool(abs(model.forward(q) - [0.3, 0.3]).max() < 1e-6)
True
"""

from __future__ import annotations

import pathlib
import re
from importlib import import_module

__version__ = "0.1.0"

# the stub, which editors and type checkers read, tells the module of each name
_STUB = pathlib.Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_MODULES = {
    name: module
    for module, name in re.findall(r"from (\S+) import (\w+)", _STUB)
}

__all__ = ["__version__", *_MODULES]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    """Load a name when it is first used, so that light commands stay light."""
    if name not in _MODULES:
        raise AttributeError(f"module 'calib' has no attribute {name!r}")
    value: object = getattr(import_module(_MODULES[name], __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
