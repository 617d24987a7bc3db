"""Deviations of an arm from its drawing, and how far each moves the tip.

Motions of the tip that several parameters share are reported once: a minimal set of parameters, in
the order of `_ORDER`, represents all others (zeros before turned origins, lengths before shifts).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body
from ..body.covariance import Z95
from ..body.curves import waves_of
from ..body.structure import Structure
from ..common.arrays import Array, Index
from ..common.rows import row_lengths, solve_least_squares
from ..common.wording import quantity
from ..errors import CalibError
from ..model.model import Model
from ..model.nominal import nominal_structure
from .settings import SETTINGS

_ORDER = ("length", "offset", "gain", "elastic", "placement")
_WORDS = {
    "offset": "zero",
    "length": "link length",
    "shift": "origin along",
    "turn": "turned about",
    "elastic": "bends",
}


@dataclass(frozen=True)
class Deviation:
    """One difference from the drawing, with half of its 95 % interval."""

    name: str
    value: float  # [unit of the parameter]
    half: float
    unit: str  # "rad", "m", "1" or the sensor's
    effect: float  # [unit of positions], rms motion of the tip that it makes

    @property
    def certain(self) -> bool:
        """Whether its interval excludes zero."""
        return abs(self.value) > self.half

    @property
    def words(self) -> str:
        """Its name, value and interval: "elbow: zero 0.56 ± 0.003 deg"."""
        return f"{self.name} {quantity(self.value, self.unit, self.half)}"


def drawing_behind(model: Model) -> tuple[Structure, Array] | None:
    """Structure and parameters of the drawing's arm behind the sensor that the body knows."""
    if model.body is None or not model.about.urdf:
        return None
    try:
        return nominal_structure(model)
    except CalibError:
        return None


def deviations_of(model: Model) -> list[Deviation]:
    """Return what differs from the drawing, the largest effect first; none without a drawing."""
    body = model.body
    drawn = drawing_behind(model)
    if body is None or drawn is None:
        return []
    structure = body.structure
    candidates = [k for name in _ORDER for k in structure.groups.get(name, ())]
    active = [k for k in candidates if k in body.active]
    steps = body.beta - drawn[1]
    before = body.beta.copy()
    before[active] = drawn[1][active]
    columns, moved = _motions_of_tip(model, body, before)
    sizes = np.linalg.norm(columns, axis=0)
    units = [structure.labels[k].unit for k in active]
    of_arm = _moving(np.array(active, np.intp), sizes, np.array(units))
    chosen = _independent(of_arm, columns)
    others = np.setdiff1d(of_arm, chosen)
    # how much of each chosen one moves the tip as the others do
    shares = solve_least_squares(columns[:, chosen], columns[:, others])
    root = body.full_root
    values = solve_least_squares(columns[:, chosen], moved)[:, 0]
    values *= structure.senses[chosen]
    halves = Z95 * row_lengths(root[chosen] + shares @ root[others])
    deviations = []
    for k, value, half in zip(
        chosen, values.tolist(), halves.tolist(), strict=True
    ):
        label = structure.labels[k]
        name = _in_words(label.name, str(label.joint))
        effect = float(sizes[k]) * abs(value)
        deviations.append(Deviation(name, value, half, label.unit, effect))
    deviations += _error_curves(structure, columns, steps)
    return sorted(deviations, key=lambda deviation: -deviation.effect)


def _error_curves(
    structure: Structure, columns: Array, steps: Array
) -> Iterator[Deviation]:
    """The error curves of joints that have one, of steps (d,) from the drawing's parameters."""
    for k, joint in enumerate(structure.joint_names):
        waves = structure.groups[f"curve.{k}"]
        effect = float(np.linalg.norm(columns[:, waves] @ steps[waves]))
        if effect:
            rms = float(np.linalg.norm(steps[waves])) / 2**0.5
            name = f"{joint}: error curve, rms"
            yield Deviation(name, rms, 0.0, "rad", effect)


def frame_parameters(body: Body) -> Index:
    """Indices of the parameters of a body that are not the arm's: those of sensor and tool."""
    labels = body.structure.labels
    frame = [
        k
        for k in body.active
        if labels[k].group.startswith(("view.", "tool", "marker"))
    ]
    return np.array(frame, np.intp)


def error_curve(body: Body, joint: int, q: Array) -> tuple[Array, Array]:
    """Learned error curve (n,) of a joint and half of its 95 % band [rad] at values (n,)."""
    indices = body.structure.groups[f"curve.{joint}"]
    if not np.isin(indices, body.active).all():
        indices = indices[:0]
    waves = waves_of(q).T[:, : len(indices)]
    root = body.root[np.searchsorted(body.active, indices)]
    half = Z95 * row_lengths(waves @ root)
    return np.asarray(waves @ body.beta[indices]), np.asarray(half)


def _motions_of_tip(
    model: Model, body: Body, before: Array
) -> tuple[Array, Array]:
    """How parameters move the tip, (postures m, d), without what sensor and tool take up.

    The length of a column is the rms motion of the tip for one unit of its parameter.  The second
    array (postures m, 1) is how far it is from where it is with the parameters `before` (d,): among
    steps that no row determines, large ones cancel, which their first derivatives do not.
    """
    structure = body.structure
    about = model.about
    shape = SETTINGS.postures, structure.dof
    q = np.random.default_rng(0).uniform(about.lower, about.upper, shape)
    frame = frame_parameters(body)
    drawn, drawn_slope = structure.linearise(q, before)
    learned, slope = structure.linearise(q, body.beta)
    moved = (learned - drawn)[:, structure.position].reshape(-1, 1)
    drawn_frame = drawn_slope[:, structure.position, frame]
    moved = _without(drawn_frame.reshape(len(moved), -1), moved)
    columns = slope[:, structure.position].reshape(len(moved), -1)
    moved = _without(columns[:, frame], moved)
    columns = _without(columns[:, frame], columns)
    factor = SETTINGS.postures**-0.5
    return factor * columns, factor * moved


def _without(columns: Array, x: Array) -> Array:
    """Columns of x (n, k) less what combinations of other columns (n, j) follow of them."""
    return np.asarray(x - columns @ solve_least_squares(columns, x))


def _moving(indices: Index, sizes: Array, units: NDArray[np.str_]) -> Index:
    """Of parameters those that move the tip as others of their unit do.

    One that hardly moves it would represent others with hundreds of times their values.
    """
    largest = {unit: sizes[indices[units == unit]].max() for unit in units}
    least = [SETTINGS.hardly * largest[unit] for unit in units]
    return np.asarray(indices[sizes[indices] > least])


def _independent(indices: Index, columns: Array) -> Index:
    """Of parameters, in their order, those that move the tip as none before them does."""
    chosen: list[int] = []
    basis = np.zeros((len(columns), 0))
    for k in indices.tolist():
        column = columns[:, k]
        rest = column - basis @ (basis.T @ column)
        length = np.linalg.norm(rest)
        if length > SETTINGS.same * np.linalg.norm(column):
            chosen.append(k)
            basis = np.column_stack([basis, rest / length])
    return np.array(chosen, np.intp)


def _in_words(name: str, joint: str) -> str:
    """A parameter in words: "elbow: zero", "elbow: origin along x"."""
    what, _, axis = name.removeprefix(f"{joint}.").partition(".")
    kind, _, rest = what.partition(" ")
    return " ".join(f"{joint}: {_WORDS.get(kind, kind)} {rest} {axis}".split())
