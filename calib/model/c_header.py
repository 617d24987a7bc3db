"""The header: a model as C99 source, from numbers alone, for queries and `calib export`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..common.arrays import Array
from ..errors import OptionError
from ..inverse.settings import SOLVER
from ..kernel.arm import KernelArm
from ..kernel.source import braces, c_source, source, table
from . import sections
from .nominal import Goal, nominal_for_kernel
from .parts import ModelParts
from .sections import Section, Tables, Words

# files of the source, and the table or word of a model that each is for
_FILES = {
    **dict.fromkeys(("head", "frames"), "dof"),
    "curve": "curve",
    "sag": "gravity",
    "lens": "lens",
    "chain": "dof",
    "nodes": "node",
    "ways": "belief_scale",
    "loads": "load",
    "curve_off": "alone",
    "bound": "belief_scale",
    "local": "local_terms",
    "model": "dof",
    "play": "play",
    **dict.fromkeys(("answers", "task", "newton", "search"), "dof"),
    "grid": "grid",
    "postures": "start_x",
    "inverse": "dof",
    "poses": "placed",
    "correct": "limit",
    "many": "dof",
}
_NO_LIMIT = 3e38  # of corrections

# what a search can expect of a C type: least damping, and residuals that end a search and of a
# solution, of the extent
_DOUBLE: Words = {
    "real": "double",
    "calm": 1e-12,
    "enough": 2e-15,
    "close": SOLVER.close,
}
_SINGLE: Words = {"real": "float", "calm": 1e-7, "enough": 1e-6, "close": 1e-4}

_NO_COMMENTS: Words = {
    "title": "",
    "checksum": "",
    "facts": "",
    "bound_of": "",
    "unit": "the sensor's unit",
    "guard": "CALIB_MODEL_H",
}


@dataclass(frozen=True, eq=False)
class Header:
    """What of a model its C source is made of."""

    model: ModelParts
    arm: KernelArm
    # the nominal arm, and those of its residuals that `calib_correct` uses
    nominal: tuple[KernelArm, Goal] | None
    limit: Array  # (dof,) [rad or m], largest correction that is trusted
    # whether the body alone is written, without tables of bounds and starts
    small: bool = False

    @staticmethod
    def of(model: ModelParts, *, small: bool = False) -> Header:
        """What the C source of a model is made of; OptionError if the model has no body."""
        if model.body is None:
            raise OptionError(
                "the model has no body, which a C header needs: train it with `body=auto`"
            )
        arm = KernelArm.of(model.body.structure, model.body.beta)
        nominal = nominal_for_kernel(model, arm)
        limit = np.full(len(model.about.lower), _NO_LIMIT)
        return Header(model, arm, nominal, limit, small)

    def text(
        self,
        prefix: str = "calib_",
        single: bool = False,
        comments: Mapping[str, str] | None = None,
    ) -> tuple[str, str]:
        """The whole header, and its tables alone; `comments` are texts without harm."""
        precision = _SINGLE if single else _DOUBLE
        tables: Tables = {}
        words = {**_NO_COMMENTS, **sections.SETTINGS, **precision}
        constants = ["\n"]
        arms: dict[str, KernelArm] = {}
        for section in self._sections:
            tables |= section.tables
            words |= section.words
            arms |= section.arms
        for name, arm in arms.items():
            constants.append(_arm(f"calib_{name}", arm, single))
        for name, values in tables.items():
            constants.append(table(f"calib_{name}", values, single))
        text = "".join(constants)
        # files and templates ask which tables there are
        words = {**dict.fromkeys(tables, True), **words, **(comments or {})}
        names = [name for name, word in _FILES.items() if word in words]
        whole = source(*names).replace("@tables@", text)
        return c_source(whole, words, prefix, single), text

    @cached_property
    def _sections(self) -> list[Section]:
        """The sections of the source; a small one ends after those of the body."""
        model = self.model
        arm = self.arm
        parts = [sections.joint_ranges(model), sections.body_arm(arm)]
        if self.nominal is not None:
            nominal, goal = self.nominal
            local = model.predictor.models.degree >= 0
            seen = int(local or goal == Goal.POSITION)
            words = {"correcting": int(goal), "correcting_seen": seen}
            arms = {"nominal": nominal}
            parts.append(Section({"limit": self.limit}, words, arms))
        parts += sections.placed_arm(model, arm)
        if self.small:
            return [*parts, sections.middle_start(model)]
        blended = []
        if not model.answers_whole_range:
            most = {"most_bound": model.most_bound}
            bounds = {"position_bound": model.model_bounds}
            blended.append(Section(bounds, most))
        if model.posterior is None:
            bounds = {"bound": model.bounds, "true_bound": model.model_bounds}
            blended.append(Section(bounds))
        else:
            noise = model.about.bound_of == "sensor reading"
            parts.append(sections.belief(model.posterior, noise=noise))
        if model.predictor.models.degree >= 0:
            blended.append(sections.local_models(model))
        if blended:
            parts += [sections.motor_nodes(model), *blended]
        if model.approach is not None:
            parts.append(Section({"play": model.approach.play}))
        if model.solver.redundant:
            return [*parts, sections.posture_starts(model)]
        return [*parts, sections.grid_starts(model)]


def _arm(name: str, arm: KernelArm, single: bool) -> str:
    """The constant of one arm."""
    frames = arm.frames
    before = np.concatenate([arm.root[None, :3], frames.axes[:-1]])
    axes = np.swapaxes(frames.sides, 1, 2) @ before
    strides = np.einsum("ni,nij->nj", frames.strides, before)
    strides[0] += arm.root[3]
    numbers = (arm.mix, arm.bias, strides, axes.reshape(-1, 9))
    rows = [braces(np.asarray(part, dtype=float), single) for part in numbers]
    listed = ",\n".join(rows)
    return f"static const calib_arm {name} = {{\n{listed}}};\n"
