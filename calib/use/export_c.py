"""Export: a model as one C99 header, for controllers and microcontrollers without Python."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ..body.belief import Body
from ..body.curves import HARMONICS
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.views import cubic
from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..common.wording import one_line
from ..errors import OptionError
from ..maps.local_models import FULL, SILENT, blend_size, exponents, predict, reach_of
from ..maps.predictor import BodyInBox
from ..model.model import Model
from ..model.trust import MOST_BLENDED, ROUNDED
from ..model_file.storage import to_bytes
from . import c_bound, c_tables
from .c_tables import DOF, REAL, array, c_number, c_source, integers, source
from .correct import usual_limit
from .nominal import nominal_in_plane, nominal_in_space

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,40}")
_CALM = 1e-9  # damping of a Newton step, as a share of the Jacobian's power
_ENOUGH = {False: 1e-12, True: 1e-6}  # of the extent: a corrected tip that is as close as this
_CLOSE = {False: 1e-9, True: 1e-4}  # of the extent: what counts as corrected


@dataclass(frozen=True)
class CHeader:
    """A C header and what it takes."""

    text: str
    tables: int  # bytes of its constant tables
    notes: tuple[str, ...]  # what the user should be told


def c_header(model: Model, *, prefix: str = "calib_", single: bool = False) -> CHeader:
    """One C99 header (also valid C++) that answers as the model does.

    model : with a body, planar or spatial
    prefix : starts every name
    single : ``float`` instead of ``double``, for microcontrollers
    Raises OptionError if the model has no body, or the prefix is no C name.

    Notes
    -----
    The header holds the body and, where there are some, the local models of what it leaves over.
    Where a trend stands between them both stay behind, and a note says by how much they differ.
    """
    if not _NAME.fullmatch(prefix):
        raise OptionError(f"prefix {prefix!r}: expected a C name such as 'calib_'")
    if model.body is None:
        raise OptionError(
            "the model has no body, which a C header needs: train it with body='auto'"
        )
    structure = model.body.structure
    if structure.seen_as.bend is not cubic:
        raise OptionError(f"the lens of view {structure.view!r} has no C form")
    writer = _Writer(model, model.body, prefix, single)
    with one_blas_thread():  # the same bytes on any number of cores
        text, tables = writer.text()
    notes = []
    apart = writer.left_out()
    if apart.max() > 1e-9 * model.solver.extent:
        notes.append(
            "the header holds the body without its local models, which move positions by "
            f"{apart.mean():.3g} {model.about.unit} on average, {apart.max():.3g} at most"
        )
    return CHeader(text, tables, tuple(notes))


@dataclass(frozen=True)
class _Writer:
    """Fills the templates with the numbers of one model."""

    model: Model
    body: Body
    prefix: str
    single: bool

    def text(self) -> tuple[str, int]:
        """The whole header, and the bytes of its tables."""
        structure, beta = self.body.structure, self.body.beta
        words, nominal = self._words(), ""
        if isinstance(structure, PlanarStructure):
            tables, own_words = c_tables.planar(structure, beta, self.single)
            nominal = self._nominal_in_plane(structure)
        else:
            assert isinstance(structure, SpatialStructure)  # noqa: S101
            tables, own_words = c_tables.spatial(structure, beta, self.single)
            if structure.informed:
                there = nominal_in_space(structure, beta)
                nominal = c_tables.spatial_arm("calib_nominal", structure, there, self.single)
            keeps = bool(nominal) and structure.dof >= 6
            words["limit"] = self._n(usual_limit(self.model).max() if keeps else 0.0)
        words |= {**own_words, "corrected": bool(nominal)}
        if self._posterior:
            about, noisy = self.model.about, self.model.about.bound_of == "sensor reading"
            q = np.random.default_rng(0).uniform(about.lower, about.upper, (400, structure.dof))
            words |= c_bound.words(self.body)
            tables += c_bound.tables(structure, self.body, q, noise=noisy, single=self.single)
        tables += c_tables.curves(structure, beta, self.single)
        tables = self._ranges() + tables + self._nodes() + nominal
        whole = source("head") + tables + source("common", structure.kind, "answers")
        return c_source(whole, words, self.prefix, self.single), _bytes(tables)

    @property
    def _posterior(self) -> bool:
        """Whether the expected error is the posterior's, as in `Model.bound_at`."""
        return self.body.structure.dof > MOST_BLENDED

    @property
    def _trusted(self) -> bool:
        """Whether there is an answer wherever joints are within their range."""
        return bool((self.model.model_bounds <= self.model.trust.most).all())

    @property
    def _asks_nodes(self) -> bool:
        """Whether anything is told by the motor map's nodes: a bound, local models."""
        return self._local or not (self._posterior and self._trusted)

    @property
    def _local(self) -> bool:
        """Whether local models stand right on the body."""
        own = isinstance(self.model.predictor.smooth, BodyInBox)
        return own and self.model.predictor.models.degree >= 0

    def left_out(self) -> Array:
        """By how much (nodes,) the header differs from the model at the nodes [unit]."""
        model = self.model
        u = np.clip(model.motor.units, 0.0, 1.0)
        held = model.predicted(u, "body")
        if self._local:
            held = held + predict(model.predictor.models, model.motor, u)[0]
        return np.asarray(np.linalg.norm(model.predictor.value(u) - held, axis=1))

    def _n(self, value: float) -> str:
        return c_number(value, self.single)

    def _words(self) -> dict[str, object]:
        model = self.model
        extent, dof = model.solver.extent, self.body.structure.dof
        blended = f" || !(calib_blended(calib_position_bound, q) <= {self._n(model.trust.most)})"
        models = model.predictor.models
        return {
            "title": one_line(f"{model.about.robot or 'An arm'}, calibrated").replace("*/", ""),
            "checksum": _checksum(model),
            "facts": self._facts(),
            "unit": _comment(model.about.unit),
            "bound_of": _comment(model.about.bound_of),
            "how": "",
            "posterior": self._posterior,
            "bound": "calib_posterior(inside)"
            if self._posterior
            else "calib_blended(calib_bound, inside)",
            "nodes_asked": self._asks_nodes,
            "spatial": self.body.structure.kind == "spatial",
            "guard": "CALIB_MODEL_H",
            "real": "float" if self.single else "double",
            "dof": dof,
            "out": len(model.axes),
            "nodes": model.motor.size,
            "near": min(blend_size(dof), model.motor.size - 1),
            "harmonics": HARMONICS,
            "trusted": "" if self._trusted else blended,
            "local": self._local,
            "silent": self._n(SILENT),
            "full": self._n(FULL),
            "terms": models.coefficients.shape[1] if self._local else 1,
            "slack": self._n(-ROUNDED),
            "calm": self._n(_CALM),
            "enough": self._n(_ENOUGH[self.single] * extent),
            "close": self._n(_CLOSE[self.single] * extent),
        }

    def _facts(self) -> str:
        about = self.model.about
        lines = []
        for name, low, high in zip(about.joint_names, about.lower, about.upper, strict=True):
            lines.append(f" *   {_comment(name)}: {low:.6g} to {high:.6g}")
        return " * Joints, base to tip:\n" + "\n".join(lines) + "\n"

    def _ranges(self) -> str:
        scale = self.model.motor.scale
        return (
            "\n"
            + array(REAL, "calib_lower", [DOF], scale.lower, self.single)
            + array(REAL, "calib_span", [DOF], scale.span, self.single)
            + integers("calib_periodic", DOF, scale.periodic)
        )

    def _nodes(self) -> str:
        """Nodes of the motor map, their bounds and their local models."""
        if not self._asks_nodes:
            return ""
        model, one = self.model, self.single
        nodes = "CALIB_NODES"
        out = array(REAL, "calib_node", [nodes, DOF], model.motor.units, one)
        if not self._posterior:
            out += array(REAL, "calib_bound", [nodes], model.bounds, one)
        if not self._trusted:
            out += array(REAL, "calib_position_bound", [nodes], model.model_bounds, one)
        if not self._local:
            return out
        models = model.predictor.models
        terms = exponents(model.motor.units.shape[1], models.degree)
        place = {tuple(term): k for k, term in enumerate(terms.tolist())}
        along = [int(np.flatnonzero(term)[0]) if term.any() else 0 for term in terms]
        unit = np.eye(terms.shape[1], dtype=int)
        below = [[place.get(tuple((t - e).tolist()), 0) for e in unit] for t in terms]
        parent = [row[k] for row, k in zip(below, along, strict=True)]
        count = str(len(terms))
        flat = models.coefficients.reshape(len(models.coefficients), -1)
        return (
            out
            + array(REAL, "calib_radius", [nodes], models.radius, one)
            + array(REAL, "calib_says", [nodes], reach_of(model.motor), one)
            + array(REAL, "calib_local_terms", [nodes, str(flat.shape[1])], flat, one)
            + integers("calib_talks", nodes, [bool(c.any()) for c in models.coefficients])
            + integers("calib_parent", count, parent)
            + integers("calib_along", count, along)
            + integers("calib_power", str(terms.size), terms.ravel())
            + integers("calib_below", str(terms.size), np.ravel(below))
        )

    def _nominal_in_plane(self, structure: PlanarStructure) -> str:
        """Table of the nominal arm, "" where the model knows no URDF."""
        try:
            nominal, beta = nominal_in_plane(self.model)
        except OptionError:
            return ""
        if nominal.signs != structure.signs:
            return ""  # a reversed joint: the wiring has to be mended first
        return c_tables.planar_arm("calib_nominal", structure, beta, self.single)


def _bytes(tables: str) -> int:
    """Size of constant tables, from their numbers: double ones have a point and no suffix."""
    found = re.findall(r"(?<=[\s{])-?\d[\d.e+-]*f?(?=[,}])", tables)
    return sum(4 if text.endswith("f") or not re.search("[.e]", text) else 8 for text in found)


def _comment(text: str) -> str:
    """Text of a stranger's file that cannot end a C comment or start a trigraph."""
    return one_line(text).replace("*", "x").replace("/", "-").replace("?", "-").replace("\\", "-")


def _checksum(model: Model) -> str:
    """SHA-256 of the model's file."""
    import hashlib

    return hashlib.sha256(to_bytes(model)).hexdigest()
