"""The header: a model as C99 source, from numbers alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..body.covariance import NORMAL_95
from ..body.curves import HARMONICS
from ..common.arrays import Array
from ..maps.local_models import FULL, SILENT, LocalModels, blend_size, exponents, reach_of
from ..maps.map import Map
from .arm import KernelArm
from .posterior import CompactPosterior
from .source import array, braces, c_number, c_source, integers, source

_FILES = ("chain", "nodes", "bound", "local", "answers", "inverse")
# in double and in single precision: damping, and what counts as met and as close, of the extent
_CALM, _ENOUGH, _CLOSE = (1e-12, 1e-7), (2e-15, 1e-6), (1e-9, 1e-4)
_LONGEST = 0.25  # of the joints' range: no step is longer
_PULLED = 1e-4  # of the joints' range: redundant joints that slide by less are there
_FOLDED = 0.1  # share of the Jacobian's power below which a fold may be near
_BEYOND = 0.3  # of the joints' range: the other side of a fold is not looked for further away
_BESIDE = 0.005  # of the joints' range: an answer so near is on the same branch
_SURELY = 0.3  # the same, of redundant joints and of poses
_TRIES = 24  # starts; out of reach all of them are tried, else a third
_MARGIN = 0.1  # of the joints' range: by so much a start may be further away than its answer


@dataclass(frozen=True, eq=False)
class Kernel:
    """What of a model its C source is made of."""

    arm: KernelArm
    motor: Map
    models: LocalModels
    extent: float  # diagonal of the workspace [unit]
    reach: float  # length of the chain
    scale: float  # units of the sensor in one of the chain's
    most: float  # largest bound with which a position is still an answer
    bounds: Array  # (nodes,)
    model_bounds: Array  # (nodes,)
    slack: float  # of a joint's range: what counts as within
    # joints (s, dof) and positions (s, m) from where the inverse is sought
    starts: tuple[Array, Array]
    posterior: CompactPosterior | None = None
    nominal: KernelArm | None = None
    correcting: int = 0  # kind of the task that `calib_correct` solves, see inverse.h
    limit: Array = field(default_factory=lambda: np.zeros(0))  # (dof,), largest correction

    @property
    def trusted(self) -> bool:
        """Whether there is an answer wherever joints are within their range."""
        return bool((self.model_bounds <= self.most).all())

    @property
    def local(self) -> bool:
        """Whether local models stand on the body."""
        return self.models.degree >= 0

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
        arm, dof, posterior = self.arm, self.motor.units.shape[1], self.posterior
        bounded = c_number(self.most, single)
        blended = f" || !(calib_blended(calib_position_bound, q) <= {bounded})"
        models, local = self.models, self.local
        told = ("calib_posterior(inside, calib_more)", "calib_posterior(inside, calib_less)")
        nodes = tuple(
            f"calib_blended({name}, inside)" for name in ("calib_bound", "calib_true_bound")
        )
        bound, model_bound = told if posterior is not None else nodes
        return {
            "posterior": posterior is not None,
            "bound": bound,
            "model_bound": model_bound,
            "nodes_asked": local or posterior is None or not self.trusted,
            "real": "float" if single else "double",
            "dof": dof,
            "out": arm.outputs,
            "chain": len(arm.bends),
            "nodes": self.motor.size,
            "near": min(blend_size(dof), self.motor.size - 1),
            "starts": len(self.starts[0]),
            "harmonics": HARMONICS,
            "waves": HARMONICS,
            "normal": NORMAL_95,
            "curved": len(arm.curves) > 0,
            "waved": posterior is not None and bool(posterior.waved.any()),
            "gravity": arm.loaded is not None,
            "flexible": arm.flex is not None,
            "projective": arm.projective,
            "placed": arm.outputs == 3,
            "law": "rise = k1, ratio = r2",
            "nearest": arm.nearest,
            "trusted": "" if self.trusted else blended,
            "local": local,
            "silent": SILENT,
            "full": float(FULL),
            "terms": models.coefficients.shape[1] if local else 1,
            "slack": -float(self.slack),
            "extent": float(self.extent),
            "lever": float(self.reach),
            "scale": float(self.scale),
            "calm": _CALM[single],
            "enough": _ENOUGH[single],
            "close": _CLOSE[single],
            "longest": _LONGEST,
            "pulled": _PULLED,
            "folded": _FOLDED,
            "beyond": _BEYOND,
            "beside": _BESIDE,
            "surely": _SURELY,
            "margin": _MARGIN,
            "tries": _TRIES,
            "corrected": self.nominal is not None,
            "correcting": self.correcting,
        }

    def _tables(self, single: bool) -> str:
        arm, scale = self.arm, self.motor.scale
        parts = [
            array("calib_lower", scale.lower, single),
            array("calib_span", scale.span, single),
            integers("calib_periodic", scale.periodic),
            integers("calib_bends", arm.bends),
            array("calib_coupling", arm.coupling, single),
            array("calib_bias", arm.bias, single),
            array("calib_view", arm.view.ravel(), single),
            array("calib_shift", arm.shift, single),
            array("calib_aim", arm.aim.ravel(), single),
            array("calib_start_q", self.starts[0], single),
            array("calib_start_x", self.starts[1], single),
            _arm("calib_body", arm, single, own=True),
        ]
        if arm.projective:
            parts.append(array("calib_lens", arm.lens, single))
        if len(arm.curves):
            waves = arm.curves.reshape(-1, 2, HARMONICS)
            for k, name in enumerate(("cos", "sin")):
                parts.append(array(f"calib_curve_{name}", waves[:, k].T, single))
        if arm.flex is not None:
            parts.append(array("calib_way", arm.way, single))
            for k, name in enumerate(("cos", "sin")):
                parts.append(array(f"calib_flex_{name}", arm.flex[k], single))
        if arm.loaded is not None:
            drawn = arm.loaded
            strides = np.diff(drawn.points, axis=0, prepend=np.zeros((1, 3)))
            parts += [
                array("calib_drawn", strides, single),
                array("calib_mass", drawn.masses, single),
                array("calib_centre", drawn.centres - drawn.points, single),
                array("calib_gravity", arm.gravity, single),
            ]
        if self.nominal is not None:
            parts.append(_arm("calib_nominal", self.nominal, single, own=False))
            parts.append(array("calib_limit", self.limit, single))
        return "".join(parts) + self._nodes(single) + self._posterior(single)

    def _nodes(self, single: bool) -> str:
        """Nodes of the motor map, their bounds and their local models."""
        motor, models = self.motor, self.models
        out = ""
        if self.local or self.posterior is None or not self.trusted:
            out += array("calib_node", motor.units, single)
        if self.posterior is None:
            out += array("calib_bound", self.bounds, single)
            out += array("calib_true_bound", self.model_bounds, single)
        if not self.trusted:
            out += array("calib_position_bound", self.model_bounds, single)
        if not self.local:
            return out
        terms = exponents(motor.units.shape[1], models.degree)
        place = {tuple(term): k for k, term in enumerate(terms.tolist())}
        along = [int(np.flatnonzero(term)[0]) if term.any() else 0 for term in terms]
        unit = np.eye(terms.shape[1], dtype=int)
        below = [[place.get(tuple((t - e).tolist()), 0) for e in unit] for t in terms]
        flat = models.coefficients.reshape(len(models.coefficients), -1)
        return (
            out
            + array("calib_radius", models.radius, single)
            + array("calib_says", reach_of(motor), single)
            + array("calib_local_terms", flat, single)
            + integers("calib_talks", [bool(c.any()) for c in models.coefficients])
            + integers("calib_parent", [row[k] for row, k in zip(below, along, strict=True)])
            + integers("calib_along", along)
            + integers("calib_power", terms.ravel())
            + integers("calib_below", np.ravel(below))
        )

    def _posterior(self, single: bool) -> str:
        """The beliefs, most of them in single precision."""
        kept = self.posterior
        if kept is None:
            return ""
        beliefs, size, rank = kept.root.shape
        ways = kept.coupled.shape[2]
        sizes = f"CALIB_GEOMETRY = {size}, CALIB_ROOT = {rank}, CALIB_WAYS = {ways}"
        # cosine and sine of each order next to each other, as the C source makes them
        order = np.arange(2 * HARMONICS).reshape(2, -1).T.ravel()
        waved = kept.waved[:, :, order].reshape(beliefs, -1, ways)
        curves = ""
        if waved.any():
            own = kept.own.reshape(-1, kept.own.shape[2])
            curves = array("calib_own", own, True, kind="float")
            curves += array("calib_waved", waved, True, kind="float")
        more = np.zeros((2, 3))
        more[:, : len(kept.residual)] = kept.residual + kept.noise, kept.residual
        return (
            f"enum {{ {sizes}, CALIB_BELIEFS = {beliefs} }};\n"
            + array("calib_root", kept.root, True, kind="float")
            + array("calib_coupled", kept.coupled, True, kind="float")
            + curves
            + integers("calib_gains", kept.gains)
            + array("calib_scale", kept.scale, single)
            + array("calib_more", more[0], single)
            + array("calib_less", more[1], single)
        )


def _arm(name: str, arm: KernelArm, single: bool, *, own: bool) -> str:
    """The constant of one arm, the body's or the nominal one's."""
    joints = len(arm.bends)
    bending = arm.bending if own and len(arm.bending) else np.zeros(joints)
    links = arm.links
    parts = (
        arm.gain, arm.offset, bending, arm.axis, links.strides, links.turns.reshape(-1, 9),
        links.tip, links.tip_turn.ravel(),
    )  # fmt: skip
    words = [braces(np.asarray(part, dtype=float), single) for part in parts]
    return f"static const calib_arm {name} = {{\n" + ",\n".join([*words, str(int(own))]) + "};\n"
