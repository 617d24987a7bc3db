"""The header: a model as C99 source, from numbers alone, for queries and `calib export`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arm.spatial_chain import Deviations
from ..body.covariance import NORMAL_95
from ..body.curves import HARMONICS
from ..body.views import LEAST_DEPTH
from ..common.arrays import Array
from ..common.rows import spread_rows
from ..errors import CalibError, OptionError
from ..inverse.settings import SEARCH
from ..inverse.ways import distinct
from ..kernel.arm import KernelArm
from ..kernel.compiled import MOST
from ..kernel.posterior import COMPACT, CompactPosterior
from ..kernel.source import braces, c_number, c_source, source, table
from ..maps.blend import blend_size
from ..maps.local_models import exponents
from ..maps.settings import LOCAL
from ..samples.roles import ROUNDING
from .answers import SURE
from .nominal import nominal_for_kernel
from .parts import ROUNDED, Parts
from .space import Space, measured_chain
from .turns import joint_limits

_FILES = (
    *("head", "chain", "nodes", "bound", "local", "answers"),
    *("task", "newton", "search", "many"),
)
_NO_LIMIT = 3e38  # of corrections
_BENDS = ("curve", "gravity", "neighbour", "local_terms")

Tables = dict[str, NDArray[np.generic]]


# what a search can expect of a C type: least damping, and residuals that end a search and of a
# solution, of the extent
_DOUBLE = {
    "real": "double",
    "calm": 1e-12,
    "enough": 2e-15,
    "close": SEARCH.close,
}
_SINGLE = {"real": "float", "calm": 1e-7, "enough": 1e-6, "close": 1e-4}


@dataclass(frozen=True, eq=False)
class Header:
    """What of a model its C source is made of."""

    model: Parts
    arm: KernelArm
    nominal: KernelArm | None
    correcting: int  # kind of the task that `calib_correct` solves, see task.h
    limit: Array  # (dof,) [rad or m], largest correction that is trusted
    # whether the body alone is written, without tables of bounds and starts
    small: bool = False

    @staticmethod
    def of(model: Parts, *, small: bool = False) -> Header:
        """What the C source of a model is made of; OptionError if the model has no body."""
        if model.body is None:
            raise OptionError(
                "the model has no body, which a C header needs: train it with `body=auto`"
            )
        arm = KernelArm.of(model.body.structure, model.body.beta)
        nominal, correcting = nominal_for_kernel(model, arm)
        limit = np.full(len(model.about.lower), _NO_LIMIT)
        return Header(model, arm, nominal, correcting, limit, small)

    def text(
        self,
        prefix: str = "calib_",
        single: bool = False,
        comments: Mapping[str, str] | None = None,
    ) -> tuple[str, str]:
        """The whole header, and its tables alone; `comments` are texts without harm."""
        tables = "\n" + "".join(
            _arm(f"calib_{name}", arm, single, bends=bends)
            for name, (arm, bends) in self._arms.items()
        )
        tables += "".join(
            table(f"calib_{name}", values, single)
            for name, values in self._tables.items()
        )
        whole = source(*_FILES).replace("@tables@", tables)
        words: dict[str, object] = dict.fromkeys(self._tables, True)
        words |= dict.fromkeys(("title", "checksum", "facts", "bound_of"), "")
        words |= {"unit": "the sensor's unit", "guard": "CALIB_MODEL_H"}
        words |= self._words(single) | self._bound_words(single)
        return c_source(
            whole, words | dict(comments or {}), prefix, single
        ), tables

    @property
    def _answers_in_ranges(self) -> bool:
        """Whether there is an answer wherever joints are within their ranges."""
        return self.model.everywhere or self.small

    @property
    def _posterior(self) -> CompactPosterior | None:
        """What bounds positions; None where bounds are blended between nodes."""
        return None if self.small else self.model.posterior

    @cached_property
    def _space(self) -> Space | None:
        """The arm that poses are asked of; None where its base frame is not known."""
        if self.arm.outputs != 3:
            return None
        try:
            return Space.of(self.model)
        except CalibError:
            return None

    @cached_property
    def _arms(self) -> dict[str, tuple[KernelArm, bool]]:
        """Arms by name, and whether they have the body's curves and bending."""
        arms = {"body": (self.arm, True)}
        if self.nominal is not None:
            arms["nominal"] = (self.nominal, False)
        if self._space is not None:
            body = self._space.body
            placed = KernelArm.of(body.structure, body.beta)
            if placed.chain.joints == self.arm.chain.joints:
                measured = measured_chain(self.model.body) is not None
                arms["placed"] = (placed, measured)
        if self.arm.sag is not None:
            drawn = Deviations.none(self.arm.chain.joints)
            arms["drawn"] = (replace(self.arm, deviations=drawn), False)
        return arms

    def _words(self, single: bool) -> dict[str, object]:
        """Numbers and choices that the templates of C are filled with."""
        arm = self.arm
        dof = len(self.limit)
        tables = self._tables
        sag = arm.sag
        links = np.vstack([arm.links.strides[1:-1, :, 0], arm.links.tip[0]])
        length = float(np.linalg.norm(links, axis=1).sum())
        together = tables.get("by_view", np.zeros((1, 1))).shape[1]
        settings = asdict(SEARCH) | asdict(MOST)
        if "grid" not in tables:
            settings["tries"] = SEARCH.spare_tries
            settings["budget"] = SEARCH.spare_budget
        return (
            settings
            | (_SINGLE if single else _DOUBLE)
            | {
                "dof": dof,
                "out": arm.outputs,
                "chain": arm.chain.joints,
                "nodes": self.model.motor.size,
                "near": min(blend_size(dof), self.model.motor.size - 1),
                "starts": len(tables["start_q"]),
                "harmonics": HARMONICS,
                "knots": COMPACT.knots,
                "loads": 0 if sag is None else len(sag.elastic),
                "together": together,
                "beliefs": len(tables.get("belief_scale", [0])),
                "bent": int(any(name in tables for name in _BENDS)),
                "nearest": LEAST_DEPTH,
                "silent": LOCAL.silent,
                "full": LOCAL.full,
                "terms": len(tables.get("along", [0])),
                "slides_slack": SEARCH.slack,
                "slack": -float(ROUNDED),
                "extent": float(self.model.solver.extent),
                "lever": max(length, 1e-9),
                "sure": SURE,
                "correcting": self.correcting,
                "placed": "placed" in self._arms,
                "scale": 1.0 if self._space is None else self._space.sensor[2],
                "rounding": ROUNDING,
            }
        )

    def _bound_words(self, single: bool) -> dict[str, object]:
        """What of the templates is about bounds."""
        ways = {
            "bound": "calib_blended(calib_bound, inside)",
            "model_bound": "calib_blended(calib_true_bound, inside)",
        }
        if self.small:
            ways = dict.fromkeys(ways, "calib_not_a_number()")
        elif self._posterior is not None:
            ways["bound"] = "calib_posterior(inside, calib_more)"
            ways["model_bound"] = "calib_posterior(inside, calib_less)"
        most = c_number(self.model.most_bound, single)
        refused = f" || !(calib_blended(calib_position_bound, q) <= {most})"
        return {
            **ways,
            "bounded": int(not self.small),
            "normal": NORMAL_95,
            "trusted": "" if self._answers_in_ranges else refused,
        }

    @cached_property
    def _tables(self) -> Tables:
        """Constant arrays of C by name; the templates ask which there are."""
        model = self.model
        arm = self.arm
        posterior = self._posterior
        limits = joint_limits(model)
        tables: Tables = {
            "lower": model.motor.scale.lower,
            "span": model.motor.scale.span,
            "periodic": model.motor.scale.periodic.astype(int),
            "least": limits[:, 0],
            "most": limits[:, 1],
            "bends": np.array(arm.chain.revolute, int),
            "coupling": arm.chain.coupling,
            "bias": arm.chain.bias,
            "view": arm.view.ravel(),
            "shift": arm.shift,
            **_arm_tables(arm),
        }
        if self.small:
            middle = np.full((1, len(self.limit)), 0.5)
            tables["start_q"] = model.motor.scale.from_unit(middle)
            tables["start_x"] = model.predictor.value(middle)
        else:
            tables |= _starts(model)
        if not self._answers_in_ranges:
            tables["position_bound"] = model.model_bounds
        if not self.small and posterior is None:
            tables["bound"] = model.bounds
            tables["true_bound"] = model.model_bounds
        if model.approach is not None and not self.small:
            tables["play"] = model.approach.play
        if model.predictor.models.degree >= 0 and not self.small:
            tables |= _local_tables(model)
        if {"position_bound", "bound", "local_terms"} & set(tables):
            tables["node"] = model.motor.units
        if self.nominal is not None:
            tables["limit"] = self.limit
        if "placed" in self._arms and self._space is not None:
            turn, shift, _ = self._space.sensor
            tables |= {"aim": turn.ravel(), "origin": shift}
        if posterior is not None:
            reads = model.about.bound_of == "sensor reading"
            tables |= _belief_tables(posterior, noise=reads)
        if arm.flex is not None and (arm.flex.any() or posterior is not None):
            tables["way"] = arm.way
            tables["flex_cos"] = arm.flex[0]
            tables["flex_sin"] = arm.flex[1]
        return tables


def _starts(
    model: Parts, cells: int = 576, apart: float = 0.1, postures: int = 128
) -> Tables:
    """Joints from which positions are sought, and where they lead: of a grid, or postures.

    Redundant joints have too many for each place.  The source grows by 20 bytes a number.

    cells : of the workspace
    apart : starts of a cell that are closer count as one
    postures : of redundant joints
    """
    place = model.sensory.scale
    dimensions = len(place.span)
    side = max(2, int(cells ** (1 / dimensions)))
    corners = np.indices((side,) * dimensions).reshape(dimensions, -1).T
    tables: Tables = {}
    if model.solver.redundant:
        nodes = np.flatnonzero(model.visited)
        nodes = nodes[spread_rows(len(nodes), postures)]
        u = np.clip(model.motor.units[nodes], 0.0, 1.0)
    else:
        step = place.span / side
        middles = place.lower + (corners + 0.5) * step
        cell, u = model.solver.starts.of(middles)
        single = distinct(model.motor.scale, cell, u, apart)
        cell = cell[single]
        u = u[single]
        count = np.bincount(cell, minlength=len(middles))
        tables["grid"] = np.full(dimensions, side)
        tables["grid_lower"] = place.lower
        tables["grid_step"] = step
        tables["cell"] = np.append(0, np.cumsum(count))
    tables["start_q"] = model.motor.scale.from_unit(u)
    tables["start_x"] = model.predictor.value(u)
    return tables


def _local_tables(model: Parts) -> Tables:
    """Local models of the nodes, and how their monomials are made of each other."""
    models = model.predictor.models
    terms = exponents(model.motor.units.shape[1], models.degree)
    place = {tuple(term): k for k, term in enumerate(terms.tolist())}
    along = np.argmax(terms > 0, axis=1)
    unit = np.eye(terms.shape[1], dtype=int)
    below = np.array(
        [
            [place.get(tuple(t), 0) for t in (term - unit).tolist()]
            for term in terms
        ]
    )
    flat = models.coefficients.reshape(len(models.coefficients), -1)
    return {
        "radius": models.radius,
        "local_terms": flat,
        "talks": flat.any(axis=1).astype(int),
        "along": along,
        "parent": below[np.arange(len(terms)), along],
        "power": terms.ravel().astype(int),
        "below": below.ravel(),
    }


def _belief_tables(posterior: CompactPosterior, *, noise: bool) -> Tables:
    """The posterior's arrays: rows of directions of each part, and variances."""
    more = np.zeros(3)
    less = np.zeros(3)
    size = len(posterior.residual)
    less[:size] = posterior.residual
    more[:size] = posterior.residual + noise * posterior.noise
    tables: Tables = {
        "belief_scale": posterior.scale,
        "more": more,
        "less": less,
    }
    for name, part in posterior.geometry.items():
        tables[f"by_{name}"] = part.reshape(len(part), -1)
    if posterior.curves.any():
        waves = posterior.curves.reshape(
            len(posterior.curves), 2, HARMONICS, -1
        )
        tables["by_cos"] = waves[:, 0]
        tables["by_sin"] = waves[:, 1]
        tables["alone"] = posterior.alone
    return tables


def _arm_tables(arm: KernelArm) -> Tables:
    """Lens, curves, coupling and bending of an arm, those that it has."""
    tables: Tables = {}
    if arm.lens is not None:
        tables["lens"] = arm.lens
    if len(arm.curves):
        waves = arm.curves.reshape(-1, 2, HARMONICS)
        order = np.arange(1.0, HARMONICS + 1)
        cosines = waves[:, 0]
        sines = waves[:, 1]
        series = [cosines, sines, order * sines, -order * cosines]
        tables["curve"] = np.vstack(series).T
    if len(arm.coupling):
        tables["neighbour"] = np.concatenate([[0.0], arm.coupling])
    if arm.sag is not None:
        loads = arm.sag.loads
        tables |= {
            "gravity": arm.sag.gravity,
            "bending": arm.sag.bending,
            "loaded": loads.joints,
            "load": arm.sag.on_links,
            "tilt": arm.sag.tilts,
        }
    return tables


def _arm(name: str, arm: KernelArm, single: bool, *, bends: bool) -> str:
    """The constant of one arm; whether it has the body's curves and bending."""
    links = arm.links
    place, turn = links.tip
    parts = (
        arm.gain,
        arm.offset,
        arm.chain.axes,
        np.vstack([links.strides[:-1, :, 0], place]),
        np.concatenate([links.turns, turn[None]]).reshape(-1, 9),
    )
    words = [braces(np.asarray(part, dtype=float), single) for part in parts]
    listed = ",\n".join([*words, str(int(bends))])
    return f"static const calib_arm {name} = {{\n{listed}}};\n"
