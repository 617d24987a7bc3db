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

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .adaptation.adapting import Adaptation as Adaptation
    from .adaptation.adapting import adapt as adapt
    from .answers import Answer as Answer
    from .arm.loading import load_arm as load_arm
    from .arm.planar_arm import PlanarArm as PlanarArm
    from .data.babbling import babble as babble
    from .data.logs import read_log as read_log
    from .data.logs import write_log as write_log
    from .data.samples import Samples as Samples
    from .data.simulation import Simulation as Simulation
    from .drift.checking import Drift as Drift
    from .drift.monitor import Monitor as Monitor
    from .errors import CalibError as CalibError
    from .errors import LogError as LogError
    from .errors import ModelError as ModelError
    from .errors import OptionError as OptionError
    from .errors import QueryError as QueryError
    from .errors import RobotError as RobotError
    from .evaluation import Evaluation as Evaluation
    from .evaluation import evaluate as evaluate
    from .maps.som import SOM as SOM
    from .model import Model as Model
    from .paths import Path as Path
    from .planning.planning import Plan as Plan
    from .planning.planning import plan as plan
    from .robots import list_robots as list_robots
    from .storage import load as load
    from .sweeping import sweep as sweep
    from .training import train as train
    from .trials import Sweep as Sweep
    from .trials import Trial as Trial

__version__ = "0.1.0"

# name -> module: loaded when first used, so that light commands stay light
_HOME = {
    "Adaptation": "adaptation.adapting",
    "Answer": "answers",
    "CalibError": "errors",
    "Drift": "drift.checking",
    "Evaluation": "evaluation",
    "LogError": "errors",
    "Model": "model",
    "ModelError": "errors",
    "Monitor": "drift.monitor",
    "OptionError": "errors",
    "Path": "paths",
    "Plan": "planning.planning",
    "PlanarArm": "arm.planar_arm",
    "QueryError": "errors",
    "RobotError": "errors",
    "SOM": "maps.som",
    "Samples": "data.samples",
    "Simulation": "data.simulation",
    "Sweep": "trials",
    "Trial": "trials",
    "adapt": "adaptation.adapting",
    "babble": "data.babbling",
    "evaluate": "evaluation",
    "list_robots": "robots",
    "load": "storage",
    "load_arm": "arm.loading",
    "plan": "planning.planning",
    "read_log": "data.logs",
    "sweep": "sweeping",
    "train": "training",
    "write_log": "data.logs",
}

__all__ = ["__version__", *_HOME]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'calib' has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
