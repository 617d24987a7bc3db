"""The verdict of a log on a model."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from ..model.baseline import Signal
from .causes import Cause
from .evidence import Evidence
from .noise import FALSE_ALARM
from .rows import OUTLIER, LogRows
from .significance import (
    MOST_BEYOND,
    BoundTest,
    GroupTest,
    GroupTests,
    bound_test,
)
from .update import Update

# most rows that distortions are measured on
MOST_DISTORTED = 1000
# Factor on the bound of maps: a corner's rows share the errors of a few nodes
SHARED_ERRORS = 2.0

UNKNOWN = "its cause is unknown"


@dataclass(frozen=True)
class Episode:
    """The verdict on one series of a log; `calib check --json` prints these fields."""

    episode: int
    samples: int
    drifted: bool | None  # None where it has too few rows
    score: float | None
    explanations: tuple[str, ...]

    @property
    def main_cause(self) -> str:
        """What moved the tip most, in words."""
        return [*self.explanations, UNKNOWN][0]


@dataclass(frozen=True, eq=False, repr=False)
class Verdict:
    """The verdict of a log on a model.

    Attributes
    ----------
    changed : bool or None
        Whether the arm or its sensor changed; None where the rows are too few to say.
    causes : tuple of Cause
        What explains the rows, the largest effect first, with intervals.
    score : float
        Largest score of a test; above 1 something changed.
    notes : tuple of str
        Further notes for the user.
    rows : LogRows
        The rows that count, with the model's predictions.
    tests : GroupTests
        Each group of parameters freed alone.
    bound : BoundTest
        The rows beyond the model's own 95 % bound.
    update : Update or None
        The belief updated by the rows, and held-out errors before and after; None for maps
        without a body, and where nothing changed and `learn` was false.
    evidence : Evidence or None
        The evidence behind the verdict; None for maps without a body.
    tolerance : float or None [unit]
        Size of a change that the user does not mind.
    episodes : tuple of Episode
        The verdict of `check` on each series of a log that has several.
    """

    changed: bool | None
    causes: tuple[Cause, ...]
    score: float
    notes: tuple[str, ...]
    rows: LogRows
    tests: GroupTests
    bound: BoundTest
    update: Update | None = None
    evidence: Evidence | None = None
    tolerance: float | None = None
    episodes: tuple[Episode, ...] = ()

    @property
    def drifted_episodes(self) -> tuple[Episode, ...]:
        """Series of the log in which something changed."""
        return tuple(episode for episode in self.episodes if episode.drifted)

    @property
    def drifted(self) -> bool | None:
        """Whether something changed; None where the rows are too few, or too coarse, to say."""
        if self.drifted_episodes:
            return True
        coarse = self.tolerance is not None and self.smallest > self.tolerance
        return None if coarse and not self.changed else self.changed

    @property
    def words(self) -> str:
        """The verdict in a few words."""
        if self.drifted:
            return "drifted"
        if self.changed is None:
            return "too few rows to say"
        if self.drifted is None:
            return "too coarse"
        if not self.bound_holds:
            return "the bound does not hold"
        return "still calibrated"

    @property
    def is_calm(self) -> bool:
        """Whether nothing changed, and the bound holds or fails by noisier readings alone."""
        noisier = any(cause.group == "noise" for cause in self.causes)
        return self.drifted is False and (self.bound_holds or noisier)

    @property
    def explanations(self) -> tuple[str, ...]:
        """The causes in words."""
        return tuple(cause.words for cause in self.causes)

    @property
    def main_cause(self) -> str:
        """The largest cause in words."""
        return [*self.explanations, UNKNOWN][0]

    @property
    def groups(self) -> tuple[GroupTest, ...]:
        """Every group that was tested."""
        return self.tests.groups

    @property
    def fired(self) -> list[GroupTest]:
        """Groups above their threshold, the most significant first."""
        above = [group for group in self.groups if group.score > 1.0]
        # where scores are as large as they can be, the statistic decides
        return sorted(above, key=lambda group: (-group.score, -group.statistic))

    @property
    def bound_holds(self) -> bool:
        """Whether about as many rows as usual lie within the model's own 95 % bound."""
        return self.bound.holds

    @property
    def covered(self) -> float:
        """Share of the rows within the model's own 95 % bound."""
        return 1.0 - self.bound.beyond

    @property
    def smallest(self) -> float:
        """Displacement [unit] from which the rows would show a change of any group.

        It is the root mean square over the learned range.
        """
        if self.evidence is None:
            bounds = self.rows.model.expected_error(self.rows.log.q)
            return float(np.median(bounds))
        return self.tests.smallest

    @property
    def samples(self) -> int:
        """Rows that count."""
        return len(self.rows)

    @property
    def outliers(self) -> int:
        """Rows that contradict all others and were left out."""
        return self.rows.strays

    @property
    def left_out(self) -> int:
        """Outliers, and rows outside of what the model has learned."""
        return self.rows.left_out

    @property
    def noise(self) -> float:
        """Standard deviation per axis of the rows' noise [unit]."""
        return self.tests.noise

    @property
    def unit(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        return self.rows.unit if self.evidence is None else self.evidence.unit

    @property
    def has_step(self) -> bool:
        """Whether something changed within the log."""
        return any(cause.cause == "step" for cause in self.causes)

    @property
    def hint(self) -> str:
        """What to do about a change before an adaptation; "" where that is enough."""
        if self.has_step:
            return "split the log there, then calib adapt with its later part"
        if self.evidence is None:
            return "maps without a body learn from a stream alone: calib adapt by method online"
        if not self.adapts:
            return "check the log and the arm: calib adapt finds nothing that mends it"
        # a change of unit has no interval
        if any(c.cause == "scale" and c.interval is None for c in self.causes):
            return "check the log's unit before calib adapt, which learns the new scale"
        return ""

    @property
    def adapts(self) -> bool:
        """Whether held-out rows show that `adapt` re-calibrates the model."""
        return self.update is not None and self.update.improved

    @property
    def held_out(self) -> tuple[float, float] | None:
        """Mean distance of held-out rows from the model, and from the updated belief [unit]."""
        if self.update is None:
            return None
        before = float(self.update.before.mean())
        return before, float(self.update.after.mean())

    @property
    def distortion(self) -> dict[str, Signal]:
        """The maps' distortions by the rows (eq. 9), which are shown but raise no alarm."""
        model = self.rows.model
        assert model.baseline is not None  # noqa: S101 - checked where the rows are read
        rows = self.rows.at_most(MOST_DISTORTED)
        return model.baseline.distortions(
            model.association, rows.u, rows.x, rows.predicted, rows.bound
        )

    def __repr__(self) -> str:
        """The verdict, its causes and its notes, a line each."""
        head = f"Verdict: {self.words}, score {self.score:.3g} (threshold 1), {len(self.rows)} rows"
        return "\n  ".join([head, *self.explanations, *self.notes])

    def to_json(self) -> dict[str, object]:
        """What `calib check --json` prints."""
        signals = self.distortion.items()
        return {
            "drifted": self.drifted,
            "samples": self.samples,
            "outliers": self.outliers,
            "left_out": self.left_out,
            "score": self.score,
            "smallest": self.smallest,
            "tolerance": self.tolerance,
            "adapts": self.adapts,
            "bound_holds": self.bound_holds,
            "covered": self.covered,
            "threshold": 1,
            "distortion": {name: signal._asdict() for name, signal in signals},
            "fired": [group.name for group in self.fired],
            "causes": [cause.to_json() for cause in self.causes],
            "smallest_by_group": {
                group.name: group.smallest for group in self.groups
            },
            "explanations": list(self.explanations),
            "episodes": [asdict(episode) for episode in self.episodes],
            "noise": {"now": self.noise, "usual": self.tests.usual},
            "false_alarm": FALSE_ALARM,
        }


def verdict_on_maps(rows: LogRows) -> Verdict:
    """The verdict on a model without a body, by the bound of its maps."""
    noise = rows.model.baseline.noise if rows.model.baseline else 0.0
    limit = SHARED_ERRORS * rows.bound
    distance = rows.distance
    most = max(OUTLIER * np.median(distance), limit.max())
    sound = np.asarray(distance <= most)
    rows = rows.without_strays(sound)
    tests = GroupTests((), noise, noise)
    limit = limit[sound]
    bound = bound_test(rows, limit, limit, rows.shared**2, tests)
    score = bound.beyond / MOST_BEYOND
    causes: tuple[Cause, ...] = ()
    if score > 1.0:
        words = (
            f"{100 * bound.beyond:.0f} % of the rows are beyond the maps' bound"
        )
        causes = (Cause("unknown", "maps", words),)
    note = "the model has no body: its rows are compared with its bound alone"
    return Verdict(
        changed=score > 1.0,
        causes=causes,
        score=score,
        notes=(*notes_of(rows, bound, score), note),
        rows=rows,
        tests=tests,
        bound=bound,
    )


def notes_of(rows: LogRows, bound: BoundTest, score: float) -> list[str]:
    """Return the notes on the rows, with one on a bound that does not hold."""
    notes = list(rows.notes)
    if not bound.holds:
        notes.append(bound.words(changed=score > 1.0))
    return notes
