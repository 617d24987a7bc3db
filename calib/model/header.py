"""The header: a model as C99 source, from numbers alone, for single queries and `calib export`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.covariance import NORMAL_95
from ..body.curves import HARMONICS
from ..body.views import LEAST_DEPTH
from ..common.arrays import Array
from ..common.rows import thinned
from ..errors import CalibError, OptionError
from ..kernel.arm import KernelArm
from ..kernel.compiled import Compiled, braces, c_number, c_source, compile_source, source, table
from ..kernel.posterior import CompactPosterior
from ..maps.local_models import FULL, SILENT, blend_size, exponents
from ..samples.roles import ROUNDING
from .answers import SURE
from .nominal import nominal_for_kernel
from .parts import ROUNDED, Parts

_FILES = ("chain", "nodes", "bound", "local", "answers", "inverse")
_NO_LIMIT = 3e38  # of corrections
_PLACES, _POSTURES = 256, 128  # rows of the table of starts: places, of redundant joints postures

_FLOATS = ("root", "coupled", "own", "waved")  # tables of beliefs, in single precision always

_SEARCH = {
    "longest": 0.25,  # of the joints' range: no step is longer
    "pulled": 1e-4,  # of the joints' range: redundant joints that slide by less are there
    "folded": 0.1,  # share of the Jacobian's power below which a fold may be near
    "beyond": 0.3,  # of the joints' range: the other side of a fold is not looked for further away
    "beside": 0.005,  # of the joints' range: an answer so near is on the same branch
    "surely": 0.3,  # the same, of redundant joints and of poses
    "margin": 0.1,  # of the joints' range: by so much a start may be further away than its answer
    "tries": 24,  # starts; out of reach all of them are tried, else a third
}
_PRECISION = (
    # in double and in single precision: damping, and what counts as met and as close, of the extent
    {"calm": 1e-12, "enough": 2e-15, "close": 1e-9, "real": "double"},
    {"calm": 1e-7, "enough": 1e-6, "close": 1e-4, "real": "float"},
)


@dataclass(frozen=True, eq=False)
class Header:
    """What of a model its C source is made of."""

    model: Parts
    arm: KernelArm
    nominal: KernelArm | None
    correcting: int  # kind of the task that `calib_correct` solves, see inverse.h
    limit: Array  # (dof,) [rad or m], largest correction that is trusted

    @staticmethod
    def of(model: Parts) -> Header:
        """What the C source of a model is made of; OptionError if the model has no body."""
        if model.body is None:
            raise OptionError(
                "the model has no body, which a C header needs: train it with body='auto'"
            )
        arm = KernelArm.of(model.body.structure, model.body.beta)
        limit = np.full(len(model.about.lower), _NO_LIMIT)
        return Header(model, arm, *nominal_for_kernel(model, arm), limit)

    @property
    def local(self) -> bool:
        """Whether local models stand on the body."""
        return self.model.predictor.models.degree >= 0

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
        model, arm, posterior = self.model, self.arm, self.model.posterior
        dof, models, local = len(self.limit), model.predictor.models, self.local
        trusted, most = model.everywhere, c_number(model.most_bound, single)
        blended = f" || !(calib_blended(calib_position_bound, q) <= {most})"
        bound, model_bound = (
            f"calib_blended(calib_{nodes}, inside)" if posterior is None
            else f"calib_posterior(inside, calib_{extra})"
            for nodes, extra in (("bound", "more"), ("true_bound", "less"))
        )  # fmt: skip
        if model.approach is not None:
            bound += " + calib_play_reach(inside)"
            model_bound += " + calib_play_reach(inside)"
        stops = [arm.links.strides[1:-1, :, 0], arm.links.tip[0]]
        lengths = np.linalg.norm(np.vstack(stops), axis=1)
        return {
            **_SEARCH, **_PRECISION[single],
            "plays": model.approach is not None,
            "posterior": posterior is not None, "bound": bound, "model_bound": model_bound,
            "nodes_asked": local or posterior is None or not trusted,
            "dof": dof, "out": arm.outputs, "chain": arm.chain.joints, "nodes": model.motor.size,
            "near": min(blend_size(dof), model.motor.size - 1), "starts": len(self._starts[0]),
            "harmonics": HARMONICS, "normal": NORMAL_95, "curved": len(arm.curves) > 0,
            "waved": posterior is not None and bool(posterior.waved.any()),
            "gravity": arm.sag is not None, "coupled": len(arm.coupling) > 0,
            "points": 1 if arm.sag is None else len(arm.sag.loads.links),
            "flexible": arm.flex is not None,
            "projective": arm.lens is not None, "placed": arm.outputs == 3, "nearest": LEAST_DEPTH,
            "trusted": "" if trusted else blended, "local": local, "silent": SILENT,
            "full": float(FULL), "terms": models.coefficients.shape[1] if local else 1,
            "slack": -float(ROUNDED), "extent": float(model.solver.extent),
            "lever": max(float(lengths.sum()), 1e-9),
            "scale": float(np.cbrt(abs(np.linalg.det(arm.view)))) if arm.outputs == 3 else 1.0,
            "corrected": self.nominal is not None, "correcting": self.correcting,
        }  # fmt: skip

    @cached_property
    def _starts(self) -> tuple[Array, Array]:
        """Joints (s, dof) and the positions (s, m) there, from where the inverse is sought."""
        # of places all over the workspace; of redundant joints, which have too many, all postures
        model, solver = self.model, self.model.solver
        if solver.redundant:
            nodes = np.flatnonzero(model.visited)
            u = np.clip(model.motor.units[nodes[thinned(len(nodes), _POSTURES)]], 0.0, 1.0)
        else:
            places = model.sensory.weights
            start, _ = solver.starts.of(places[thinned(len(places), _PLACES)])
            u = start.reshape(-1, start.shape[2])
            u = u[np.isfinite(u[:, 0])]
        return model.motor.scale.from_unit(u), model.predictor.value(u)

    def _tables(self, single: bool) -> str:
        model, arm, motor, kept = self.model, self.arm, self.model.motor, self.model.posterior
        chain, trusted = arm.chain, model.everywhere
        tables: dict[str, NDArray[Any]] = {
            "lower": motor.scale.lower, "span": motor.scale.span,
            "periodic": motor.scale.periodic.astype(int), "bends": np.array(chain.revolute, int),
            "coupling": chain.coupling, "bias": chain.bias, "view": arm.view.ravel(),
            "shift": arm.shift, "aim": arm.aim.ravel(),
            "start_q": self._starts[0], "start_x": self._starts[1],
        }  # fmt: skip
        if arm.lens is not None:
            tables["lens"] = arm.lens
        if len(arm.curves):
            waves = arm.curves.reshape(-1, 2, HARMONICS)
            tables |= {"curve_cos": waves[:, 0].T, "curve_sin": waves[:, 1].T}
        if arm.flex is not None:
            tables |= {"way": arm.way, "flex_cos": arm.flex[0], "flex_sin": arm.flex[1]}
        if len(arm.coupling):
            tables["neighbour"] = np.concatenate([[0.0], arm.coupling])
        if arm.sag is not None:
            loads = arm.sag.loads
            tables |= {
                "drawn": chain.still.strides[:-1, :, 0],
                "carrier": loads.links,
                "point": loads.points - chain.points[loads.links],
                "gravity": arm.sag.gravity,
                "bending": arm.sag.bending,
            }
            if kept is not None:
                tables |= {
                    "loaded": loads.joints,
                    "weight": loads.weights,
                    "elastic": arm.sag.elastic,
                    "tilt": arm.sag.tilts,
                }
        if self.local or kept is None or not trusted:
            tables["node"] = motor.units
        if kept is None:
            tables |= {"bound": model.bounds, "true_bound": model.model_bounds}
        if model.approach is not None:
            tables["play"] = model.approach.play
        if not trusted:
            tables["position_bound"] = model.model_bounds
        if self.local:
            tables |= self._local_tables
        arms = _arm("calib_body", arm, single, own=True)
        if self.nominal is not None:
            tables["limit"] = self.limit
            arms += _arm("calib_nominal", self.nominal, single, own=False)
        if kept is not None:
            beliefs, size, rank = kept.root.shape
            sizes = {
                "LOADS": 0 if arm.sag is None else len(arm.sag.elastic),
                "GEOMETRY": size,
                "ROOT": rank,
                "BELIEFS": beliefs,
                "WAYS": kept.coupled.shape[2],
            }
            listed = ", ".join(f"CALIB_{name} = {number}" for name, number in sizes.items())
            arms += f"enum {{ {listed} }};\n"
            tables |= self._beliefs(kept)
        return arms + "".join(
            table(f"calib_{name}", values, single, name in _FLOATS)
            for name, values in tables.items()
        )

    @property
    def _local_tables(self) -> dict[str, NDArray[Any]]:
        """Local models of the nodes, and how their monomials are made of each other."""
        models = self.model.predictor.models
        terms = exponents(self.model.motor.units.shape[1], models.degree)
        place = {tuple(term): k for k, term in enumerate(terms.tolist())}
        along = [int(np.flatnonzero(term)[0]) if term.any() else 0 for term in terms]
        unit = np.eye(terms.shape[1], dtype=int)
        below = [[place.get(tuple((t - e).tolist()), 0) for e in unit] for t in terms]
        flat = models.coefficients.reshape(len(models.coefficients), -1)
        return {
            "radius": models.radius, "local_terms": flat,
            "talks": flat.any(axis=1).astype(int), "along": np.array(along),
            "parent": np.array([row[k] for row, k in zip(below, along, strict=True)]),
            "power": terms.ravel().astype(int), "below": np.ravel(below),
        }  # fmt: skip

    def _beliefs(self, kept: CompactPosterior) -> dict[str, NDArray[Any]]:
        # cosine and sine of each order next to each other, as the C source makes them
        order = np.arange(2 * HARMONICS).reshape(2, -1).T.ravel()
        more = np.zeros((2, 3))
        noise = kept.noise if self.model.about.bound_of == "sensor reading" else 0.0
        more[:, : len(kept.residual)] = kept.residual + noise, kept.residual
        tables = {
            "root": kept.root, "coupled": kept.coupled, "gains": kept.gains.astype(int),
            "scale": kept.scale, "more": more[0], "less": more[1],
        }  # fmt: skip
        if kept.waved.any():
            waved = kept.waved[:, :, order].reshape(len(kept.root), -1, kept.coupled.shape[2])
            tables |= {"own": kept.own.reshape(-1, kept.own.shape[2]), "waved": waved}
        return tables


def _arm(name: str, arm: KernelArm, single: bool, *, own: bool) -> str:
    """The constant of one arm, the body's or the nominal one's."""
    links, (place, turn) = arm.links, arm.links.tip
    parts = (
        arm.gain, arm.offset, arm.chain.axes, links.strides[:-1, :, 0],
        links.turns.reshape(-1, 9), place, turn.ravel(),
    )  # fmt: skip
    words = [braces(np.asarray(part, dtype=float), single) for part in parts]
    return f"static const calib_arm {name} = {{\n" + ",\n".join([*words, str(int(own))]) + "};\n"


def compiled_of(model: Parts) -> tuple[Compiled | None, str]:
    """A model's compiled kernel, or None, and a sentence on what single queries are answered by."""
    started = time.perf_counter()
    try:
        header = Header.of(model)
        arm = header.arm
        words: dict[str, Any] = {
            "placed": arm.outputs == 3 and getattr(arm.structure, "informed", False),
            "corrected": header.nominal is not None, "sure": SURE, "rounding": ROUNDING,
            "extent": float(model.solver.extent),
        }  # fmt: skip
        made = compile_source(header.text()[0], words, len(header.limit), arm.outputs)
    except CalibError as error:
        return None, f"single queries are answered by the batch: {error}"
    taken = time.perf_counter() - started
    return made, f"single queries are answered by compiled C, made in {taken:.2g} s"
