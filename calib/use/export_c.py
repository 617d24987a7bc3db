"""Export: a model as one C99 header, for controllers and microcontrollers without Python."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..body.curves import HARMONICS
from ..body.planar import PlanarStructure
from ..body.views import cubic
from ..common.wording import one_line
from ..errors import OptionError
from ..maps.local_models import blend_size
from . import c_source as c
from .nominal import nominal_in_view

if TYPE_CHECKING:
    from ..body.belief import Body
    from ..model.model import Model

Array = NDArray[np.float64]

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,40}")
_CALM = 1e-9  # damping of a Newton step, as a share of the Jacobian's power
_ENOUGH = {False: 1e-13, True: 1e-6}  # of the extent: a corrected tip that is as close as this
_CLOSE = {False: 1e-9, True: 1e-4}  # of the extent: what counts as corrected


@dataclass(frozen=True)
class CHeader:
    """A C header and what it takes.

    Attributes
    ----------
    text : str
        The header.
    tables : int
        Bytes of its constant tables.
    notes : tuple of str
        What the user should be told.
    """

    text: str
    tables: int
    notes: tuple[str, ...]


def c_header(model: Model, *, prefix: str = "calib_", single: bool = False) -> CHeader:
    """One C99 header (also valid C++) that answers as the model does.

    Parameters
    ----------
    model : Model
        With a planar body.
    prefix : str
        Starts every name.
    single : bool
        ``float`` instead of ``double``, for microcontrollers.

    Raises
    ------
    OptionError
        If the model has no planar body, or the prefix is no C name.

    Notes
    -----
    The header holds the body: local models of what it leaves over stay behind, and a note
    says by how much they differ.
    """
    if not _NAME.fullmatch(prefix):
        raise OptionError(f"prefix {prefix!r}: expected a C name such as 'calib_'")
    body = model.body
    if body is None or not isinstance(body.structure, PlanarStructure):
        raise OptionError(
            "the model has no planar body, which is what a C header is made of: train it with "
            "body='auto'"
        )
    if body.structure.seen_as.bend is not cubic and body.beta[8]:
        raise OptionError(f"the lens of view {body.structure.view!r} has no C form")
    notes = []
    if model.predictor.models.degree >= 0:
        u = np.clip(model.motor.units, 0.0, 1.0)
        apart = np.linalg.norm(model.predictor.value(u) - model.smooth().value(u), axis=1)
        notes.append(
            "the header holds the body without the local models, which move positions by "
            f"{apart.mean():.3g} {model.about.unit} on average, {apart.max():.3g} at most"
        )
    text = _Writer(model, body, body.structure, prefix, single).text()
    size = 4 if single else 8
    nodes = model.motor.size * (model.motor.units.shape[1] + 1)
    curves = 2 * HARMONICS * body.structure.dof
    tables = size * (nodes + curves + 2 * body.structure.size)
    return CHeader(text, tables, tuple(notes))


@dataclass(frozen=True)
class _Writer:
    """Fills the templates with the numbers of one model."""

    model: Model
    body: Body
    structure: PlanarStructure
    prefix: str
    single: bool

    def text(self) -> str:
        """The whole header."""
        words, p = self._words(), self.prefix
        tables = self._tables()
        trusted = bool((self.model.model_bounds <= self.model.trust.most).all())
        words["trusted"] = (
            ""
            if trusted
            else f" || !({p}blended({p}position_bound, q) <= {self._n(self.model.trust.most)})"
        )
        parts = [c.HEAD, tables, c.HELPERS, c.NODES, c.QUERIES]
        nominal = self._nominal()
        if nominal is not None:
            parts[1] += nominal
            parts.append(c.CORRECT)
        out = [part if k == 1 else part.format(**words) for k, part in enumerate(parts)]
        return "".join(out) + f"\n#endif /* {words['guard']} */\n"

    def _n(self, value: float) -> str:
        return c.number(value, self.single)

    def _words(self) -> dict[str, object]:
        lay, p, f = self.structure.layout, self.prefix, "f" if self.single else ""
        extent = self.model.solver.extent
        return {
            "title": one_line(f"{self.model.about.robot or 'An arm'}, calibrated").replace(
                "*/", ""
            ),
            "checksum": _checksum(self.model),
            "facts": self._facts(),
            "unit": _comment(self.model.about.unit),
            "bound_of": _comment(self.model.about.bound_of),
            "guard": f"{p.upper()}MODEL_H",
            "real": "float" if self.single else "double",
            "p": p,
            "P": p.upper(),
            "dof": self.structure.dof,
            "nodes": self.model.motor.size,
            "harmonics": HARMONICS,
            "near": min(blend_size(self.structure.dof), self.model.motor.size - 1),
            "gain": int(lay.gain[0]),
            "offset": int(lay.offset[0]),
            "length": int(lay.length[0]),
            "elastic": int(lay.elastic[0]) if len(lay.elastic) else 0,
            "curves": int(self._has_curves()),
            "slide": self._n(self.structure.slide),
            "slack": self._n(-1e-6 if self.single else -1e-9),
            "one": self._n(1.0),
            "calm": self._n(_CALM),
            "enough": self._n(_ENOUGH[self.single] * extent),
            "close": self._n(_CLOSE[self.single] * extent),
            **{name: name + f for name in ("cos", "sin", "sqrt", "floor")},
        }

    def _facts(self) -> str:
        about = self.model.about
        lines = []
        for name, low, high in zip(about.joint_names, about.lower, about.upper, strict=True):
            lines.append(f" *   {_comment(name)}: {low:.6g} to {high:.6g}")
        return " * Joints, base to tip:\n" + "\n".join(lines) + "\n"

    def _has_curves(self) -> bool:
        return any(self.body.beta[ix].any() for ix in self.structure.layout.curve.values())

    def _tables(self) -> str:
        p, real, one = self.prefix, f"{self.prefix}real", self.single
        st, beta, motor = self.structure, self.body.beta, self.model.motor
        dof, nodes = f"{p.upper()}DOF", f"{p.upper()}NODES"
        matrix = st.matrix(beta)
        view = np.concatenate([matrix.ravel(), beta[4:8]])
        lens = np.concatenate([beta[8:11], st.centre, [st.size_of_lens]])
        zero = np.zeros(HARMONICS)
        waves = [
            np.split(beta[st.layout.curve[i]], 2) if i in st.layout.curve else (zero, zero)
            for i in range(st.dof)
        ]
        geometry = beta.copy()
        geometry[: st.layout.length[0]] = 0.0
        short = int(max(st.layout.elastic, default=st.layout.gain[-1])) + 1
        out = [
            "\n",
            c.array(real, f"{p}lower", [dof], motor.scale.lower, one),
            c.array(real, f"{p}span", [dof], motor.scale.span, one),
            c.integers(f"{p}periodic", dof, motor.scale.periodic),
            c.integers(f"{p}turns", dof, st.revolute),
            c.array(real, f"{p}sign", [dof], np.asarray(st.signs, dtype=float), one),
            c.array(real, f"{p}beta", [str(short)], geometry[:short], one),
            c.array(real, f"{p}view", ["8"], view, one),
            c.array(real, f"{p}lens", ["6"], lens, one),
            c.array(
                real,
                f"{p}curve_cos",
                [dof, f"{p.upper()}HARMONICS"],
                np.array([w[0] for w in waves]),
                one,
            ),
            c.array(
                real,
                f"{p}curve_sin",
                [dof, f"{p.upper()}HARMONICS"],
                np.array([w[1] for w in waves]),
                one,
            ),
            c.array(real, f"{p}node", [nodes, dof], motor.units, one),
            c.array(real, f"{p}bound", [nodes], self.model.bounds, one),
        ]
        if not (self.model.model_bounds <= self.model.trust.most).all():
            out.append(c.array(real, f"{p}position_bound", [nodes], self.model.model_bounds, one))
        return "".join(out)

    def _nominal(self) -> str | None:
        """Table of the nominal arm, None where the model knows no URDF."""
        try:
            nominal = nominal_in_view(self.model)
        except OptionError:
            return None
        if nominal.structure.signs != self.structure.signs:
            return None  # a reversed joint: the wiring has to be mended first
        lay = self.structure.layout
        short = int(max(lay.elastic, default=lay.gain[-1])) + 1
        return c.array(
            f"{self.prefix}real",
            f"{self.prefix}nominal",
            [str(short)],
            nominal.beta[:short],
            self.single,
        )


def _comment(text: str) -> str:
    """Text of a stranger's file that cannot end a C comment or start a trigraph."""
    return one_line(text).replace("*", "x").replace("/", "-").replace("?", "-").replace("\\", "-")


def _checksum(model: Model) -> str:
    """SHA-256 of the model's file."""
    import hashlib

    from ..model_file.storage import to_bytes

    return hashlib.sha256(to_bytes(model)).hexdigest()
