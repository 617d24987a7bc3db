"""Numbers that were chosen for reading and judging logs, each with the case that chose it."""

from __future__ import annotations

import math

HELD_ROWS = 200_000
"""Rows of a log that are held in memory; of a longer one so many are drawn."""

ROUNDED = 1e-4
SLACK = 0.05
"""Shares of a range by which values may leave it: limits are rounded, and arms differ."""

LOCKED = {True: math.radians(5.0), False: 2e-2}
STILL = {True: math.radians(0.5), False: 1e-3}
"""Motion [rad where a joint turns, else m] of a locked joint that takes part, and that is told."""

LOCKED_SHARE = 0.02
"""Share of rows in which a locked joint may be away: wrong readings."""

DIAGNOSED_ROWS = 400
"""Rows that a diagnosis looks at: 720 orders of six joints take a second."""

FEWEST_ROWS = 8
TOOL_ROWS = 39
"""Rows below which a similarity in space, or a tool of unknown size, explains nearly anything."""

FAR_BETTER = 0.2
"""Another reading of a log is told where its misfit is below this share of the log's own.

Arms with links off by a tenth and offsets by 8 deg stay above it, exchanged columns below .1."""

GOOD = 0.1
SMALL = 0.005
"""Shares of the extent below which kinematics are right but for two exchanged columns, and nothing
is doubted: a reversed wrist leaves 2 %, a drawing is right to .2 %."""

MOST_ORDERED = 6
"""Joints whose 720 orders are tried."""

PATH = 0.1
"""Median step of the joints over their spread, above which rows are no motion."""

USUAL_SIZE = (0.5, 2.0)
SAME_UNIT = 0.05
PIXELS_RATIO = 5.0
"""An extent this many times the nominal one needs no word (lengths were typed wrong by less), is
that of another unit within this share (900 is no millimetre), and beyond that of pixels."""

TURNED = 0.3
"""Median turn [rad] beyond which orientations are not those of the joints."""

OUT_OF_PLANE = 0.02
"""Share of the extent by which positions of a planar arm may leave their plane (rms)."""

GROSS = 10.0
SPREAD = 4.0
GROSS_SHARE = 1e-4
"""A residual is gross beyond so many medians, so many times what seven rows in ten stay below, and
this share of the extent: no row of 80 clean logs of 20 to 600 rows is."""

AROUND = 15
NEAR = 2.5
APART = 10.0
"""Neighbours that a suspect row is compared with, how many times as far as usual they may be (in a
corner of the range they are twice as far), and by how many times their scatter it has to differ."""

MOST_WRONG = 0.25
"""Share of the rows that can be wrong; beyond it the fit is."""

UNSURE = 10.0
"""Times as wide as the median that a pose's stated sd may be: such a row would weigh like 100."""

LEAST_CORNER = 8
"""Rows from which on those that stand together, all off by the same, are told."""

FITTED_ROWS = 1500
ROWS_PER_TERM = 5
TERMS = 243
"""Rows that a robust fit of a rigid chain rests on, rows for each of its functions, and how many
functions: those of five joints that turn."""

LONGEST_PAUSE = 5.0
"""Median steps of time between two rows beyond which they are not one motion."""

CLEAR_DELAY = 5.0
DOUBTED_DELAY = 3.0
DELAY_SHARE = 0.1
"""A delay is corrected beyond so many standard deviations, told from fewer on, if it explains this
share of the squared residuals: real series of poses at rest stay below .02, a clock that is 1 ms
late at 1 rad/s of a UR5 measured to .1 mm explains .9."""

DELAY_BLOCKS = 20
DELAY_NU = 4.0
"""Blocks of neighbouring rows that vary on their own, and degrees of freedom of the noise."""

LARGEST_ARM = 20.0
"""An extent [m] beyond which a log without a robot is most likely in another unit: arms reach 3 m,
a log of one in mm extends over hundreds."""
