"""Socket fit: an arm and the sockets that it touched, fitted together.

Afterwards the sockets' places are positions like those of any other log.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arm.arm import SpatialArm
from ..body.body_fit import BodyFit
from ..body.covariance import Z95
from ..body.spatial import SpatialStructure, structure_of
from ..body.touch import DRAWN_SIZE, fit_touches, with_size
from ..common.arrays import Array, Mask
from ..common.rows import finite_rows, median_length, row_lengths
from ..errors import LogError
from ..samples.repeatability import at_poses
from ..samples.samples import Samples
from ..samples.sockets import Touches
from ..samples.tables import rows_in_words
from .fitted_log import FittedLog
from .options import TrainingOptions
from .settings import LEARNING, TOUCHING

_BASE = (
    "no touch tells where the base stands and how it is turned or tilted: both stay as drawn and "
    "are left out of intervals"
)
_SIZE = (
    "touches alone do not tell how large the arm is: its size stays as drawn; state the distance "
    "of two points, as in `distance='A,B=50mm'`"
)
_DRAWING = "drawing"
_SENSOR = "sensor"


@dataclass(frozen=True, eq=False)
class SocketFit:
    """An arm that was fitted to its touches."""

    fit: BodyFit
    places: Array  # (p, 3) [m], where the sockets are
    used: Mask  # (n,), rows whose tips are in their sockets
    scatter: float  # [m], median distance of tips from their sockets


@dataclass(frozen=True)
class SizeCheck:
    """The arm's size by stated distances, compared with that of its drawing, or of a sensor."""

    ratio: float  # size by the distances, over the other one
    sd: float  # of the ratio
    other: str  # whose that is

    @property
    def difference(self) -> float:
        """Relative difference of the two sizes."""
        return abs(self.ratio - 1.0)

    @property
    def differs(self) -> bool:
        """Whether one of the two is wrong."""
        return self.difference > TOUCHING.clearly * self.sd

    @property
    def is_plausible(self) -> bool:
        """Whether a drawing may be so far off."""
        return self.difference <= TOUCHING.most_doubt

    def words(self, touch: Touches) -> str:
        """The sentence on two sizes that differ, by the first of the stated distances."""
        first = touch.distances[0]
        stated = float(first.value or 0.0)
        size = 1e3 * stated / self.ratio
        widened = "bounds contain both"
        if self.other == _SENSOR:
            widened = "the distance is left out"
        elif not self.is_plausible:
            widened = "no drawing is so far off, so the distance is left out"
        points = " and ".join(map(touch.name, first.points))
        return (
            f"the size of the arm: {points} are said to be {1e3 * stated:.4g} mm apart, by the "
            f"{self.other}'s size they are {size:.4g} +- {Z95 * size * self.sd:.2g} mm: one of the "
            f"two is wrong by {100 * self.difference:.2g} %; the {self.other}'s is taken, and "
            f"{widened}"
        )


def fit_sockets(
    samples: Samples, touch: Touches, options: TrainingOptions
) -> FittedLog:
    """Fit arm and sockets, without the rows whose tips were in no socket of theirs.

    Returns the samples with their sockets' places as positions: in the arm's base frame, or in the
        sensor's where one measured some rows.
    Raises LogError if the touches do not determine the arm, or no arm explains them.
    """
    arm = samples.arm
    if not isinstance(arm, SpatialArm):
        raise LogError(
            "touches need the robot in space that made them: give its URDF"
        )
    count = len(samples)
    samples = at_poses(samples)
    touch = samples.touch or touch
    _refuse_alike(samples, touch)
    no_sensor = bool(touch.is_touch.all())
    structure = structure_of(arm, "base" if no_sensor else "rigid")
    structure = replace(structure, zeros_alone=options.free == "offsets")
    sockets = _fit_sound_touches(samples, touch, structure, options.seed)
    notes: list[str] = []
    repeated = count - len(samples)
    if repeated:
        notes.append(
            f"{repeated} touches in a posture that is there before count once"
        )
    if no_sensor:
        notes.append(_BASE)
    sockets, size_notes = _of_right_size(
        sockets, samples, touch, structure, options.seed
    )
    notes += size_notes
    _refuse_scatter(sockets.scatter, arm.chain.reach)
    strays = np.flatnonzero(~sockets.used)
    if len(strays):
        notes.append(
            f"{len(strays)} rows were in no socket of theirs and are left out: "
            f"{rows_in_words(samples.rows[strays])}"
        )
    positions = touch.positions(samples.x, sockets.places)
    return FittedLog(
        replace(samples, x=positions).take(sockets.used),
        rows_given=len(samples) + samples.left_out,
        half_play=np.zeros(samples.dof),
        notes=tuple(notes),
        fit=sockets.fit,
        options=options,
    )


def _refuse_scatter(scatter: float, reach: float) -> None:
    """Refuse touches whose tips scatter about their sockets as those of no arm do [m]."""
    if scatter > LEARNING.no_arm * reach:
        raise LogError(
            f"no arm explains the touches: the tips scatter by {1e3 * scatter:.3g} mm "
            "about their sockets (median); check the joints' order and unit, the tip, and the "
            "points' names"
        )


def _of_right_size(
    sockets: SocketFit,
    samples: Samples,
    touch: Touches,
    structure: SpatialStructure,
    seed: int,
) -> tuple[SocketFit, list[str]]:
    """The fit that has the arm's size right, and notes.

    The size is that of stated distances; that of a sensor, or else of the drawing, where none are
    stated of touched points, or where they and the other differ.
    """
    no_sensor = bool(touch.is_touch.all())
    if not touch.distances and no_sensor:
        return _with_size_sd(sockets, DRAWN_SIZE), [_SIZE]
    if not touch.distances:
        return sockets, []
    planes = tuple(fact for fact in touch.facts if fact.value is None)
    without = _fit_sound_touches(
        samples, replace(touch, facts=planes), structure, seed
    )
    size = _size_by_distances(samples, touch, without)
    if size is not None and not size.differs:
        return sockets, []
    notes = [] if size is None else [size.words(touch)]
    if not no_sensor:
        return without, notes
    if size is not None and size.is_plausible:
        return _with_size_sd(without, size.difference / Z95), notes
    return _with_size_sd(without, DRAWN_SIZE), [*notes, _SIZE]


def _with_size_sd(sockets: SocketFit, sd: float) -> SocketFit:
    """The fit with a size of the arm that is uncertain by a relative sd."""
    fit = replace(sockets.fit, body=with_size(sockets.fit.body, sd))
    return replace(sockets, fit=fit)


def _fit_sound_touches(
    samples: Samples, touch: Touches, structure: SpatialStructure, seed: int
) -> SocketFit:
    """Fit arm and sockets, without the rows whose tips are far from their sockets."""
    used = np.ones(len(samples), dtype=bool)
    places = np.full((len(touch.sockets), 3), np.nan)
    for attempt in range(1, TOUCHING.attempts + 1):
        number, facts, sockets = touch.take(used).numbers_and_facts()
        fit, places[sockets] = fit_touches(
            structure,
            samples.q[used],
            number,
            facts,
            lower=samples.lower,
            upper=samples.upper,
            x=samples.x[used],
            seed=seed,
        )
        tip = fit.body.predict(samples.q)
        # held-out rows show the usual distance, also of a fit that follows most rows closely
        held_out = fit.held_out[touch.is_touch[used]]
        held_out = held_out[finite_rows(held_out)]
        least = median_length(held_out) if len(held_out) else 0.0
        sound = ~touch.strays(tip, places, least=least)
        # the rows of the last fit are returned, also those that stray from it
        too_many = sound.mean() < 1 - TOUCHING.most
        if (sound == used).all() or too_many or attempt == TOUCHING.attempts:
            break
        used = sound
    in_place = used & touch.is_touch
    scatter = median_length((tip - places[touch.number])[in_place])
    return SocketFit(fit, places, used, scatter)


def _size_by_distances(
    samples: Samples, touch: Touches, sockets: SocketFit
) -> SizeCheck | None:
    """Return the size by stated distances of an arm that was fitted without them.

    Returns None where no distance is between sockets that were touched.
    """
    points = np.array([fact.points for fact in touch.distances])
    stated = np.array([fact.value for fact in touch.distances], dtype=float)
    tolerance = np.array([fact.tolerance for fact in touch.distances])
    first, second = sockets.places[points.T]
    fitted = row_lengths(first - second)
    sd = np.hypot(tolerance, sockets.scatter)
    weight = np.nan_to_num(fitted / sd) ** 2
    total = weight.sum()
    if not total:
        return None
    ratios = stated / fitted
    ratio = np.nansum(weight * ratios) / total
    other = _DRAWING
    sd_of_other = DRAWN_SIZE
    measured = samples.x[~touch.is_touch]
    if len(measured):
        other = _SENSOR
        spread = np.sqrt(((measured - measured.mean(axis=0)) ** 2).sum())
        sd_of_other = sockets.fit.body.noise[0] / spread
    sd_of_ratio = np.hypot(total**-0.5, sd_of_other)
    return SizeCheck(float(ratio), float(sd_of_ratio), other)


def _refuse_alike(samples: Samples, touch: Touches) -> None:
    """Refuse touches that are too few or too much alike to determine the arm."""
    sockets, counts = np.unique(
        touch.number[touch.is_touch], return_counts=True
    )
    spans = [np.ptp(samples.q[touch.number == k], axis=0) for k in sockets]
    alike = np.max(spans, initial=0.0) < TOUCHING.alike
    few = counts.sum() < TOUCHING.few or counts.max() < TOUCHING.few_of_one
    if alike or few:
        raise LogError(
            f"{counts.sum()} touches of {len(sockets)} sockets"
            f"{', all alike,' if alike else ''} tell nothing of the arm: expected 20 postures and "
            "more in each socket, from other sides, with the wrist turned each way"
        )
