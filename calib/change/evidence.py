"""Evidence: the workings of a verdict, from which it is put in words and a belief is updated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..body.belief import Body
from ..body.structure import Structure
from ..common.arrays import Array, Mask
from ..samples.diagnosis import rows_behind
from .explain import Explanation
from .frame import Reference
from .orientation import TurnedTool, turned_tool
from .rows import LogRows
from .settings import FEW_WRONG, UNEXPLAINED
from .system import Log
from .tests import BoundTest, Tested


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a log says of a belief."""

    rows: LogRows
    cause: str | None  # {"sensor", "joints"} or None, what is known about the change
    prior: Body  # the belief that a changed arm starts from
    reference: Reference  # the same in the frame of the log
    sound: Mask  # (n,), rows that do not contradict all others
    data: Log  # these
    limit: Array  # (n,), 95 % bound on each row, as the model and the belief tell it [unit]
    tests: Tested
    bound: BoundTest
    findings: tuple[Explanation, ...]  # hypotheses with their evidence, the best first
    score: float  # above 1 the arm or its sensor changed
    attributed: bool = (
        False  # whether a hypothesis of a change is clearly better than none
    )

    @property
    def strays(self) -> int:
        """How many rows contradict all others."""
        return int(np.count_nonzero(~self.sound))

    @property
    def unit_seen(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        same = (
            self.reference.scale == 1.0 or self.rows.unit != self.rows.model.about.unit
        )
        return self.rows.unit if same else "sensor"

    @cached_property
    def distance(self) -> float:
        """Typical distance of the rows from the best explanation [unit]."""
        return float(np.median(np.linalg.norm(self.findings[0].residual, axis=1)))

    @cached_property
    def misfit(self) -> float:
        """The same as a share of the typical distance of the positions from their middle."""
        away = self.rows.x - np.median(self.rows.x, axis=0)
        spread = float(np.median(np.linalg.norm(away, axis=1)))
        return self.distance / max(spread, 1e-300)

    @cached_property
    def explained(self) -> bool:
        """Whether any hypothesis comes near the rows: to a part of their spread, or as told."""
        if self.misfit < UNEXPLAINED:
            return True
        # rows that lag or whose joints are exchanged come near too, but for those at each jump
        few = self.rows.wrong + self.strays <= FEW_WRONG * len(self.rows)
        usual = float(np.median(self.limit[self.sound]))
        return self.distance < usual < np.inf and few

    @cached_property
    def tool(self) -> TurnedTool:
        """How the tool is turned beside the best explanation of the positions."""
        if self.attributed:
            beta = self.findings[0].beta
            structure = self.reference.structure
        else:
            beta = self.rows.body.beta
            structure = self.rows.body.structure
        return self.tool_beside(structure, beta, framed=self.attributed)

    def tool_beside(
        self, structure: Structure, beta: Array, *, framed: bool = False
    ) -> TurnedTool:
        """How the tool is turned beside what parameters (d,) predict."""
        rows = self.rows
        return turned_tool(
            rows.body, structure, beta, rows.q, rows.x, rows.orientation, framed=framed
        )

    def why_not(self) -> str:
        """One line on a log that nothing explains."""
        reference = self.reference
        rows = self.rows
        z = rows.x.copy()
        z[self.sound] = self.data.z
        lag = rows_behind(
            lambda q: reference.structure.predict(q, reference.beta), rows.q, z
        )
        check = "check that joints and positions of a row belong together and are of this arm"
        if lag:
            check = (
                f"positions follow the joints by {lag} rows: align the clocks of both"
            )
        return (
            f"nothing explains the log: its positions are {100 * self.misfit:.0f} % of their "
            f"spread away from any change of the arm or the sensor; {check}"
        )
