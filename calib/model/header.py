"""The header: a model as C99 source, from numbers alone, for queries and `calib export`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..body.covariance import NORMAL_95
from ..body.curves import HARMONICS
from ..body.views import LEAST_DEPTH
from ..common.arrays import Array, Index
from ..common.rows import thinned
from ..errors import CalibError, OptionError
from ..inverse.settings import SEARCH
from ..kernel.arm import KernelArm
from ..kernel.compiled import Compiled, compile_source
from ..kernel.posterior import CompactPosterior
from ..kernel.source import braces, c_number, c_source, source, table
from ..maps.local_models import blend_size, exponents
from ..maps.settings import LOCAL
from ..samples.roles import ROUNDING
from .answers import SURE
from .nominal import nominal_for_kernel
from .parts import ROUNDED, Parts
from .space import Space
from .turns import joint_limits

_FILES = (
    *("chain", "nodes", "bound", "local", "answers"),
    *("task", "newton", "search", "many"),
)
_NO_LIMIT = 3e38  # of corrections
_FLOATS = (
    "root",
    "coupled",
    "own",
    "waved",
)  # tables of beliefs, in single precision always


@dataclass(frozen=True)
class Precision:
    """What a search can expect of a C type."""

    real: str
    calm: float  # least damping
    enough: float  # residual that ends a search, of the extent
    close: float  # residual of a solution, of the extent


DOUBLE = Precision("double", calm=1e-12, enough=2e-15, close=SEARCH.close)
SINGLE = Precision("float", calm=1e-7, enough=1e-6, close=1e-4)


@dataclass(frozen=True)
class TableSizes:
    """How many starts of positions a header holds: its source grows by 20 bytes a number."""

    cells: int = 576  # cells of the workspace, of arms without spare joints
    postures: int = 128  # postures, of arms with spare joints


SIZES = TableSizes()


@dataclass(frozen=True, eq=False)
class StartTable:
    """Joints from which the inverse is sought: of a grid of places, or of postures."""

    q: Array  # (s, dof), joint values
    x: Array  # (s, m), positions there
    # grid of places: cells (m,), lower corner and size of a cell (m,), first row of each cell
    grid: Index | None = None
    lower: Array | None = None
    step: Array | None = None
    first: Index | None = None

    @staticmethod
    def of(model: Parts) -> StartTable:
        """The table of a model."""
        if model.solver.redundant:
            return StartTable.of_postures(model)
        return StartTable.of_places(model)

    @staticmethod
    def of_postures(model: Parts) -> StartTable:
        """Postures all over the ranges: redundant joints have too many for each place."""
        nodes = np.flatnonzero(model.visited)
        nodes = nodes[thinned(len(nodes), SIZES.postures)]
        u = np.clip(model.motor.units[nodes], 0.0, 1.0)
        return StartTable(
            model.motor.scale.from_unit(u), model.predictor.value(u)
        )

    @staticmethod
    def of_places(model: Parts) -> StartTable:
        """Starts of the middle of each cell of a grid over the workspace, one for each branch."""
        scale = model.sensory.scale
        dimensions = len(scale.span)
        side = max(2, int(SIZES.cells ** (1 / dimensions)))
        cells = np.full(dimensions, side)
        step = scale.span / side
        corners = np.indices((side,) * dimensions).reshape(dimensions, -1).T
        middles = scale.lower + (corners + 0.5) * step
        cell, u = model.solver.search.starts.of(middles)
        first = np.append(
            0, np.cumsum(np.bincount(cell, minlength=len(middles)))
        )
        value = model.predictor.value(u)
        return StartTable(
            model.motor.scale.from_unit(u),
            value,
            cells,
            scale.lower,
            step,
            first,
        )

    @staticmethod
    def none(model: Parts) -> StartTable:
        """No starts: joints are sought from `near` alone."""
        return StartTable(
            np.zeros((0, len(model.about.lower))),
            np.zeros((0, len(model.axes))),
        )

    def tables(self) -> dict[str, NDArray[np.generic]]:
        """Its constant arrays of C, by name."""
        tables: dict[str, NDArray[np.generic]] = {
            "start_q": self.q,
            "start_x": self.x,
        }
        if (
            self.grid is not None
            and self.lower is not None
            and self.step is not None
        ):
            assert self.first is not None  # noqa: S101
            tables["grid"] = self.grid.astype(int)
            tables["grid_lower"] = self.lower
            tables["grid_step"] = self.step
            tables["cell"] = self.first.astype(int)
        return tables


@dataclass(frozen=True, eq=False)
class Placement:
    """The arm that places and poses are asked of, and the sensor's frame that they stand in."""

    arm: KernelArm | None  # None where it is the body
    aim: Array  # (3, 3), orientation of the sensor
    origin: Array  # (3,), shift of the sensor
    scale: float  # of the sensor's unit
    known: bool  # whether the base frame is known

    @staticmethod
    def of(model: Parts, arm: KernelArm) -> Placement:
        """The placement of a model."""
        behind = Placement(None, arm.aim, arm.shift, 1.0, known=False)
        if arm.outputs != 3:
            return behind
        if getattr(arm.structure, "informed", False):
            scale = float(np.cbrt(abs(np.linalg.det(arm.view))))
            return replace(behind, scale=scale, known=True)
        try:
            body = Space.of(model).body
        except CalibError:
            return behind
        drawn = KernelArm.of(body.structure, body.beta)
        if drawn.chain.joints != arm.chain.joints:
            return behind
        return Placement(drawn, np.eye(3), np.zeros(3), 1.0, known=True)


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
                "the model has no body, which a C header needs: train it with body='auto'"
            )
        arm = KernelArm.of(model.body.structure, model.body.beta)
        nominal, correcting = nominal_for_kernel(model, arm)
        limit = np.full(len(model.about.lower), _NO_LIMIT)
        return Header(model, arm, nominal, correcting, limit, small)

    @property
    def local(self) -> bool:
        """Whether local models stand on the body."""
        return self.model.predictor.models.degree >= 0 and not self.small

    @property
    def trusted(self) -> bool:
        """Whether there is an answer wherever joints are within their ranges."""
        return self.model.everywhere or self.small

    @property
    def posterior(self) -> CompactPosterior | None:
        """What bounds positions; None where bounds are blended between nodes."""
        return None if self.small else self.model.posterior

    @cached_property
    def placement(self) -> Placement:
        """Of what arm poses are asked."""
        return Placement.of(self.model, self.arm)

    @property
    def placed(self) -> bool:
        """Whether joints are found for poses."""
        return self.placement.known and self.arm.outputs == 3

    @cached_property
    def starts(self) -> StartTable:
        """Where the inverse begins."""
        return (
            StartTable.none(self.model)
            if self.small
            else StartTable.of(self.model)
        )

    def text(
        self,
        prefix: str = "calib_",
        single: bool = False,
        words: Mapping[str, object] | None = None,
    ) -> tuple[str, str]:
        """The whole header, and its tables alone; `words` are comments: texts without harm."""
        tables = "\n" + self._tables(single)
        head, *rest = source("head").partition("static inline")
        whole = head + tables + "\n" + "".join(rest) + source(*_FILES)
        none = dict.fromkeys(("title", "checksum", "facts", "bound_of"), "")
        known = {"unit": "the sensor's unit", "guard": "CALIB_MODEL_H"}
        filled = {**none, **known, **self._words(single), **(words or {})}
        return c_source(whole, filled, prefix, single), tables

    def _words(self, single: bool) -> dict[str, object]:
        """What the templates of C are filled with."""
        model = self.model
        arm = self.arm
        dof = len(self.limit)
        models = model.predictor.models
        blended = self.posterior is None and not self.small
        words: dict[str, object] = asdict(SEARCH) | asdict(
            SINGLE if single else DOUBLE
        )
        words |= self._bound_words(single)
        if self.starts.grid is None:
            words["tries"] = SEARCH.spare_tries
        words |= {
            "dof": dof,
            "out": arm.outputs,
            "chain": arm.chain.joints,
            "nodes": model.motor.size,
            "near": min(blend_size(dof), model.motor.size - 1),
            "nodes_asked": self.local or blended or not self.trusted,
            "starts": len(self.starts.q),
            "gridded": self.starts.grid is not None,
            "harmonics": HARMONICS,
            "curved": len(arm.curves) > 0,
            "gravity": arm.sag is not None,
            "coupled": len(arm.coupling) > 0,
            "points": 1 if arm.sag is None else len(arm.sag.loads.links),
            "flexible": arm.flex is not None,
            "projective": arm.lens is not None,
            "nearest": LEAST_DEPTH,
            "local": self.local,
            "silent": LOCAL.silent,
            "full": LOCAL.full,
            "terms": models.coefficients.shape[1] if self.local else 1,
            "slides_slack": SEARCH.slack,
            "slack": -float(ROUNDED),
            "extent": float(model.solver.extent),
            "lever": _length(arm),
            "sure": SURE,
            "corrected": self.nominal is not None,
            "correcting": self.correcting,
            "placed": self.placed,
            "placing": "calib_body"
            if self.placement.arm is None
            else "calib_drawn_arm",
            "scale": self.placement.scale,
        }
        return words

    def _bound_words(self, single: bool) -> dict[str, object]:
        """What of the templates is about bounds."""
        posterior = self.posterior
        if self.small:
            bound = model_bound = "calib_not_a_number()"
        elif posterior is None:
            bound = "calib_blended(calib_bound, inside)"
            model_bound = "calib_blended(calib_true_bound, inside)"
        else:
            bound = "calib_posterior(inside, calib_more)"
            model_bound = "calib_posterior(inside, calib_less)"
        plays = self.model.approach is not None and not self.small
        if plays:
            bound += " + calib_play_reach(inside)"
            model_bound += " + calib_play_reach(inside)"
        most = c_number(self.model.most_bound, single)
        refused = f" || !(calib_blended(calib_position_bound, q) <= {most})"
        return {
            "bounded": int(not self.small),
            "plays": plays,
            "posterior": posterior is not None,
            "waved": posterior is not None and bool(posterior.waved.any()),
            "normal": NORMAL_95,
            "bound": bound,
            "model_bound": model_bound,
            "trusted": "" if self.trusted else refused,
        }

    def _tables(self, single: bool) -> str:
        """Constant arrays of C."""
        model = self.model
        arm = self.arm
        posterior = self.posterior
        limits = joint_limits(model)
        tables: dict[str, NDArray[np.generic]] = {
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
            "aim": self.placement.aim.ravel(),
            "origin": self.placement.origin,
            **self.starts.tables(),
            **_arm_tables(arm, bounded=posterior is not None),
        }
        blended = posterior is None and not self.small
        if self.local or blended or not self.trusted:
            tables["node"] = model.motor.units
        if blended:
            tables["bound"] = model.bounds
            tables["true_bound"] = model.model_bounds
        if model.approach is not None:
            tables["play"] = model.approach.play
        if not self.trusted:
            tables["position_bound"] = model.model_bounds
        if self.local:
            tables |= self._local_tables
        arms = _arm("calib_body", arm, single, own=True)
        if self.nominal is not None:
            tables["limit"] = self.limit
            arms += _arm("calib_nominal", self.nominal, single, own=False)
        if self.placement.arm is not None:
            arms += _arm(
                "calib_drawn_arm", self.placement.arm, single, own=False
            )
        if posterior is not None:
            arms += _sizes(posterior, arm)
            tables |= self._belief_tables(posterior)
        return arms + "".join(
            table(f"calib_{name}", values, single, name in _FLOATS)
            for name, values in tables.items()
        )

    @property
    def _local_tables(self) -> dict[str, NDArray[np.generic]]:
        """Local models of the nodes, and how their monomials are made of each other."""
        models = self.model.predictor.models
        terms = exponents(self.model.motor.units.shape[1], models.degree)
        place = {tuple(term): k for k, term in enumerate(terms.tolist())}
        along = [int(np.argmax(term > 0)) for term in terms]
        unit = np.eye(terms.shape[1], dtype=int)
        below = [
            [place.get(tuple((t - e).tolist()), 0) for e in unit] for t in terms
        ]
        flat = models.coefficients.reshape(len(models.coefficients), -1)
        return {
            "radius": models.radius,
            "local_terms": flat,
            "talks": flat.any(axis=1).astype(int),
            "along": np.array(along),
            "parent": np.array(
                [row[k] for row, k in zip(below, along, strict=True)]
            ),
            "power": terms.ravel().astype(int),
            "below": np.ravel(below),
        }

    def _belief_tables(
        self, posterior: CompactPosterior
    ) -> dict[str, NDArray[np.generic]]:
        """The posterior's arrays; cosine and sine of each order stand next to each other."""
        order = np.arange(2 * HARMONICS).reshape(2, -1).T.ravel()
        size = len(posterior.residual)
        less = np.zeros(3)
        less[:size] = posterior.residual
        more = less.copy()
        if self.model.about.bound_of == "sensor reading":
            more[:size] += posterior.noise
        tables: dict[str, NDArray[np.generic]] = {
            "root": posterior.root,
            "coupled": posterior.coupled,
            "gains": posterior.gains.astype(int),
            "scale": posterior.scale,
            "more": more,
            "less": less,
        }
        if posterior.waved.any():
            directions = posterior.coupled.shape[2]
            waved = posterior.waved[:, :, order]
            tables["waved"] = waved.reshape(len(waved), -1, directions)
            tables["own"] = posterior.alone.reshape(
                -1, posterior.alone.shape[2]
            )
        return tables


def _sizes(posterior: CompactPosterior, arm: KernelArm) -> str:
    """Sizes of the posterior's arrays, as constants of C."""
    beliefs, geometry, rank = posterior.root.shape
    sizes = {
        "LOADS": 0 if arm.sag is None else len(arm.sag.elastic),
        "GEOMETRY": geometry,
        "ROOT": rank,
        "BELIEFS": beliefs,
        "WAYS": posterior.coupled.shape[2],
    }
    listed = ", ".join(
        f"CALIB_{name} = {number}" for name, number in sizes.items()
    )
    return f"enum {{ {listed} }};\n"


def _length(arm: KernelArm) -> float:
    """Length of an arm [m]: of its links, one after another."""
    links = np.vstack([arm.links.strides[1:-1, :, 0], arm.links.tip[0]])
    return max(float(np.linalg.norm(links, axis=1).sum()), 1e-9)


def _arm_tables(
    arm: KernelArm, *, bounded: bool
) -> dict[str, NDArray[np.generic]]:
    """Lens, curves, coupling and bending of an arm, those that it has; `bounded` by a posterior."""
    chain = arm.chain
    tables: dict[str, NDArray[np.generic]] = {}
    if arm.lens is not None:
        tables["lens"] = arm.lens
    if len(arm.curves):
        waves = arm.curves.reshape(-1, 2, HARMONICS)
        tables["curve_cos"] = waves[:, 0].T
        tables["curve_sin"] = waves[:, 1].T
    if arm.flex is not None:
        tables["way"] = arm.way
        tables["flex_cos"] = arm.flex[0]
        tables["flex_sin"] = arm.flex[1]
    if len(arm.coupling):
        tables["neighbour"] = np.concatenate([[0.0], arm.coupling])
    if arm.sag is not None:
        loads = arm.sag.loads
        tables["drawn"] = chain.still.strides[:-1, :, 0]
        tables["carrier"] = loads.links
        tables["point"] = loads.points - chain.points[loads.links]
        tables["gravity"] = arm.sag.gravity
        tables["bending"] = arm.sag.bending
        if bounded:
            tables["loaded"] = loads.joints
            tables["weight"] = loads.weights
            tables["elastic"] = arm.sag.elastic
            tables["tilt"] = arm.sag.tilts
    return tables


def _arm(name: str, arm: KernelArm, single: bool, *, own: bool) -> str:
    """The constant of one arm; with its `own` curves and bending, or without."""
    links = arm.links
    place, turn = links.tip
    parts = (
        arm.gain,
        arm.offset,
        arm.chain.axes,
        links.strides[:-1, :, 0],
        links.turns.reshape(-1, 9),
        place,
        turn.ravel(),
    )
    words = [braces(np.asarray(part, dtype=float), single) for part in parts]
    return (
        f"static const calib_arm {name} = {{\n"
        + ",\n".join([*words, str(int(own))])
        + "};\n"
    )


def compiled_of(model: Parts) -> tuple[Compiled | None, str]:
    """A model's compiled kernel, or None, and a sentence on what queries are answered by."""
    started = time.perf_counter()
    try:
        header = Header.of(model)
        words: dict[str, object] = {
            "placed": header.placed,
            "corrected": header.nominal is not None,
            "rounding": ROUNDING,
        }
        compiled = compile_source(
            header.text()[0], words, len(header.limit), header.arm.outputs
        )
    except CalibError as error:
        return None, f"queries are answered by the batch in NumPy: {error}"
    seconds = time.perf_counter() - started
    return (
        compiled,
        f"queries are answered by compiled C, made in {seconds:.2g} s",
    )
