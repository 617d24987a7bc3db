"""Evidence: the workings of a verdict, from which it is put in words and a belief is updated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array, Mask
from ..samples.diagnosis import rows_behind
from .explain import Explanation
from .frame import Reference
from .orientation import TurnedTool, turned_tool
from .rows import LogRows
from .settings import FEW_WRONG, UNEXPLAINED
from .significance import BoundTest, Tested
from .system import Log


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a log says of a belief."""

    rows: LogRows
    cause: (
        str | None
    )  # {"sensor", "joints", "offsets"} or None, what is known about the change
    prior: Body  # the belief that a changed arm starts from
    reference: Reference  # the same in the frame of the log
    sound: Mask  # (n,), rows that do not contradict all others
    data: Log  # these
    tests: Tested
    bound: BoundTest
    explanations: tuple[Explanation, ...]  # the best first
    score: float  # above 1 the arm or its sensor changed
    attributed: bool = False  # whether a change is clearly better than none

    @property
    def unit(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        same = (
            self.reference.scale == 1.0
            or self.rows.unit != self.rows.model.about.unit
        )
        return self.rows.unit if same else "sensor"

    @cached_property
    def distance(self) -> float:
        """Typical distance of the rows from the best explanation [unit]."""
        return float(
            np.median(np.linalg.norm(self.explanations[0].residual, axis=1))
        )

    @cached_property
    def misfit(self) -> float:
        """The same as a share of the typical distance of the positions from their middle."""
        away = self.rows.x - np.median(self.rows.x, axis=0)
        spread = float(np.median(np.linalg.norm(away, axis=1)))
        return self.distance / max(spread, 1e-300)

    @cached_property
    def explained(self) -> bool:
        """Whether any explanation comes near the rows: to a part of their spread, or as bounded."""
        if self.misfit < UNEXPLAINED:
            return True
        # rows that lag or whose joints are exchanged come near too, but for those at each jump
        wrong = self.rows.wrong + int(np.count_nonzero(~self.sound))
        return (
            self.distance < self.bound.usual < np.inf
            and wrong <= FEW_WRONG * len(self.rows)
        )

    @cached_property
    def tool(self) -> TurnedTool:
        """How the tool is turned beside the best explanation of the positions."""
        if self.attributed:
            return self.tool_under(self.explanations[0], framed=True)
        body = self.rows.body
        sure = np.zeros(body.structure.size)
        return turned_tool(
            self.rows, body.structure, body.beta, sure, framed=False
        )

    def tool_under(
        self, best: Explanation, *, framed: bool = False
    ) -> TurnedTool:
        """How the tool is turned beside an explanation, as far as that is sure."""
        return turned_tool(
            self.rows,
            self.reference.structure,
            best.beta,
            best.deviation,
            framed=framed,
        )

    def tool_beside(self, beta: Array) -> TurnedTool:
        """How the tool is turned beside what parameters (d,) predict."""
        sure = np.zeros(len(beta))
        structure = self.reference.structure
        return turned_tool(self.rows, structure, beta, sure, framed=False)

    def why_not(self) -> str:
        """One line on a log that nothing explains."""
        reference = self.reference
        z = self.rows.x.copy()
        z[self.sound] = self.data.z
        lag = rows_behind(
            lambda q: reference.structure.predict(q, reference.beta),
            self.rows.q,
            z,
        )
        check = "check that joints and positions of a row belong together and are of this arm"
        if lag:
            check = f"positions follow the joints by {lag} rows: align the clocks of both"
        return (
            f"nothing explains the log: its positions are {100 * self.misfit:.0f} % of their "
            f"spread away from any change of the arm or the sensor; {check}"
        )
