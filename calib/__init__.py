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
    from .arm.arm import PlanarArm as PlanarArm
    from .arm.loading import load_arm as load_arm
    from .arm.robots import list_robots as list_robots
    from .change.adapt import Adaptation as Adaptation
    from .change.adapt import adapt as adapt
    from .change.check import Recognition as Recognition
    from .change.check import check as check
    from .change.check import recognise as recognise
    from .change.judge import Verdict as Verdict
    from .change.judge import judge as judge
    from .errors import CalibError as CalibError
    from .errors import LogError as LogError
    from .errors import ModelError as ModelError
    from .errors import OptionError as OptionError
    from .errors import QueryError as QueryError
    from .errors import RobotError as RobotError
    from .maps.association import Association as Association
    from .maps.density import Visit as Visit
    from .maps.map import Map as Map
    from .maps.som import SOM as SOM
    from .model.answers import Answer as Answer
    from .model.answers import Path as Path
    from .model.model import Model as Model
    from .model_file.loading import load as load
    from .model_file.loading import load_maps as load_maps
    from .recording.handeye import HandEye as HandEye
    from .recording.handeye import handeye as handeye
    from .samples.logs import read_log as read_log
    from .samples.logs import write_log as write_log
    from .samples.samples import Samples as Samples
    from .samples.samples import babble as babble
    from .samples.simulation import Simulation as Simulation
    from .show.preview.server import Preview as Preview
    from .show.preview.server import preview as preview
    from .show.report.page import figures as figures
    from .show.report.page import report as report
    from .stream.follow import follow as follow
    from .stream.monitor import Monitor as Monitor
    from .stream.monitor import monitor as monitor
    from .sweeps import Sweep as Sweep
    from .sweeps import Trial as Trial
    from .sweeps import sweep as sweep
    from .training.evaluate import Evaluation as Evaluation
    from .training.evaluate import evaluate as evaluate
    from .training.learn import TrainingOptions as TrainingOptions
    from .training.train import train as train
    from .use.correct import Corrected as Corrected
    from .use.correct import correct as correct
    from .use.plan import Plan as Plan
    from .use.plan import plan as plan

__version__ = "0.1.0"

# names by module: loaded when first used, so that light commands stay light
_NAMES = {
    "arm.arm": "PlanarArm",
    "arm.loading": "load_arm",
    "arm.robots": "list_robots",
    "change.adapt": "Adaptation adapt",
    "change.check": "Recognition check recognise",
    "change.judge": "Verdict judge",
    "errors": "CalibError LogError ModelError OptionError QueryError RobotError",
    "maps.association": "Association",
    "maps.density": "Visit",
    "maps.map": "Map",
    "maps.som": "SOM",
    "model.answers": "Answer Path",
    "model.model": "Model",
    "model_file.loading": "load load_maps",
    "recording.handeye": "HandEye handeye",
    "samples.logs": "read_log write_log",
    "samples.samples": "Samples babble",
    "samples.simulation": "Simulation",
    "show.preview.server": "Preview preview",
    "show.report.page": "figures report",
    "stream.follow": "follow",
    "stream.monitor": "Monitor monitor",
    "sweeps": "Sweep Trial sweep",
    "training.evaluate": "Evaluation evaluate",
    "training.learn": "TrainingOptions",
    "training.train": "train",
    "use.correct": "Corrected correct",
    "use.plan": "Plan plan",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = ["__version__", *_HOME]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'calib' has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
