"""The fast path: what of a model becomes C, for single queries and for `calib export`."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from ..arm.arm import SpatialArm
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure, structure_of
from ..common.arrays import Array
from ..errors import CalibError, OptionError
from ..kernel.arm import KernelArm
from ..kernel.compiled import Compiled, compile_source
from ..kernel.header import Kernel
from ..maps.local_models import NO_MODELS
from ..maps.predictor import BodyInBox
from ..samples.roles import ROUNDING
from .answers import SURE
from .nominal import moves_in_space, nominal_arm, nominal_in_plane, nominal_in_space
from .parts import Parts
from .trust import ROUNDED

_PLACES, _POSTURES = 256, 128  # rows of the table of starts: places, of redundant joints postures
_NO_LIMIT = 3e38


def kernel_of(model: Parts, limit: Array | None = None) -> Kernel:
    """What the C source of a model is made of.

    limit : (dof,) [rad or m], largest correction that is trusted
    Raises OptionError if the model has no body, or one that has no C form.
    """
    body, dof = model.body, len(model.about.lower)
    if body is None:
        raise OptionError(
            "the model has no body, which a C header needs: train it with body='auto'"
        )
    structure = body.structure
    arm = KernelArm.of(structure, body.beta)
    own = isinstance(model.predictor.smooth, BodyInBox)
    nominal, correcting = _nominal(model, arm)
    posterior = model.posterior
    if posterior is not None and model.about.bound_of != "sensor reading":
        posterior = replace(posterior, noise=np.zeros_like(posterior.noise))
    reach = float(np.linalg.norm(np.vstack([arm.links.strides[1:], arm.links.tip]), axis=1).sum())
    return Kernel(
        arm,
        model.motor,
        model.predictor.models if own else NO_MODELS,
        model.solver.extent,
        max(reach, 1e-9),
        float(np.cbrt(abs(np.linalg.det(arm.view)))) if arm.outputs == 3 else 1.0,
        model.trust.most,
        model.bounds,
        model.model_bounds,
        ROUNDED,
        _starts(model),
        posterior,
        nominal,
        correcting,
        np.full(dof, _NO_LIMIT) if limit is None else limit,
    )


def compiled_of(model: Parts) -> tuple[Compiled | None, str]:
    """The compiled kernel of a model, and a sentence that says what single queries are answered by.

    None where the batch has to: without a compiler, without a body, or with `CALIB_NO_CC=1`.
    """
    started = time.perf_counter()
    if model.body is None or not isinstance(model.predictor.smooth, BodyInBox):
        return None, "single queries are answered by the batch: the model stands on maps alone"
    try:
        kernel = kernel_of(model)
        text, _ = kernel.text()
    except CalibError as error:
        return None, f"single queries are answered by the batch: {error}"
    words: dict[str, Any] = {
        "placed": kernel.arm.outputs == 3 and getattr(model.body.structure, "informed", False),
        "corrected": kernel.nominal is not None,
        "sure": SURE,
        "extent": kernel.extent,
        "rounding": ROUNDING,
    }
    made = compile_source(text, words, len(kernel.limit), kernel.arm.outputs)
    if isinstance(made, str):
        return None, f"single queries are answered by the batch: {made}"
    taken = time.perf_counter() - started
    return made, f"single queries are answered by compiled C, made in {taken:.2g} s"


def _starts(model: Parts) -> tuple[Array, Array]:
    """Joints (s, dof) and the positions (s, m) there, from where the inverse is sought.

    The solutions that the links lead to, of places all over the workspace; of redundant joints,
    which have too many, postures all over their ranges.
    """
    solver, scale = model.solver, model.motor.scale
    if solver.redundant:
        nodes = np.flatnonzero(model.visited)
        u = np.clip(model.motor.units[_some(nodes, _POSTURES)], 0.0, 1.0)
    else:
        places = model.sensory.weights
        start, _, _ = solver.starts.of(places[_some(np.arange(len(places)), _PLACES)])
        u = start.reshape(-1, start.shape[2])
        u = u[np.isfinite(u[:, 0])]
    return scale.from_unit(u), model.predictor.value(u)


def _some(rows: Any, most: int) -> Any:
    """At most so many of the rows, evenly spread."""
    return rows[:: max(1, -(-len(rows) // most))]


def _nominal(model: Parts, arm: KernelArm) -> tuple[KernelArm | None, int]:
    """The nominal arm, and what a correction asks for: a position (0), a place (1), a pose (2)."""
    body, simulated = model.body, model.about.source == "simulation" and not model.history
    assert body is not None  # noqa: S101
    own = body.structure
    if not model.about.urdf:
        return None, 0
    try:
        if isinstance(own, PlanarStructure):
            nominal, beta = nominal_in_plane(model, based=simulated)
            same = nominal.signs == own.signs  # of a reversed joint the wiring has to be mended
            return (KernelArm.of(nominal, beta) if same else None), 0
        if isinstance(own, SpatialStructure) and own.informed:
            beta = nominal_in_space(own, body.beta)
            kind = 2 if own.dof >= 6 else 1 if own.outputs == 2 else 0
            return KernelArm.of(own, beta), kind
        drawn = nominal_arm(model) if simulated and moves_in_space(model) else None
    except CalibError:
        return None, 0
    if not isinstance(drawn, SpatialArm) or drawn.chain.joints != len(arm.bends):
        return None, 0
    structure = structure_of(drawn, "base")
    return KernelArm.of(structure, structure.neutral()), 0
