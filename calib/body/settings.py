"""Numbers of the body that were chosen: each with its unit, its reason, and what chose it.

How many rows, steps and probes a search takes stands beside it: more of them change no answer.
"""

from __future__ import annotations

import numpy as np

FREE = 1e3
"""Prior sd of what is not known [extents or reaches]: flat."""

SHIFT = 1e-3
TURN = float(np.radians(0.1))
"""Joint origins are where a drawing says to 1 mm and 0.1 deg [m, rad], or some times that."""

WIDER = (1.0, 20.0)
"""Times a drawing's prior sd, between which the evidence finds it."""

FINER = (0.2, 20.0)
"""The same where corners or touches tell them: of an arm whose origins were off by .3 mm, a board
told what is in the hand to .46 mm, with 1 mm at least to 2.3."""

SERVOS = (1.0, 100.0)
"""The same of offsets: 10 deg where servos were put on."""

GAIN = 1e-3
"""Prior sd of a joint's gain, of a drawing; twice that without one."""

ELASTIC = 1e-3
ELASTIC_FLAT = 1e-4
"""Joints bend by this much [rad] under the largest torque of gravity, or of a unit weight; in the
plane, where cosines and sines of the cumulative angles stand for torques, by a tenth (twice that
without a drawing)."""

TILT = float(np.radians(3.0))
"""Prior sd of each of two angles of gravity's direction: an arm's base may not stand level."""

OTHER_GRAVITY = 10.0
"""Nats by which gravity along another axis has to explain rows better before it is told."""

COUPLING = 1e-3
"""A joint's share in the motion of its neighbour's motor, where gears of a wrist hang together."""

CURVE_RMS = 4e-4
"""Rms of a joint's error curve [rad]: harmonic drives and industrial arms have 0.15 to 0.4 mrad;
the evidence finds those of others."""

CURVE_ROWS = 5.0
CURVE_ROWS_FLAT = 40.0
"""Pseudo-observations that hold it; in the plane 10 left 30 rows 1 % worse than 40."""

LONG = 3.0
"""Waves a turn up to which a planar arm's curve may be larger: eccentric wheels, loads."""

TAG = 2e-3
"""A camera's tag is held where the drawing says to so many metres."""

MARKER = 2e-3
MARKERS = (0.01, 100.0)
"""Sensors of one arm see markers that are apart by some of these metres: the evidence finds whether
it is one tag that two cameras see (.02 mm), or a tag and a reflector (.2 m)."""

SOCKET = 2e-2
"""The same of a ball that touches sockets [m]: flat, an arm without any stated distance shrank to a
point, which touches every socket at once."""

WIDTH = 20.0
CURVE_FLOOR = 3e-3
"""Waves a turn at which a curve's prior variance has fallen by exp(-1/2), and what stays beyond: a
real UR10 has 8 to 30 waves a turn of 0.15 to 0.37 mrad."""

STUDENT = 6.0
"""Degrees of freedom of a log's noise: a few rows may be grossly wrong."""

LOG_FLOOR = 1e-4
SIMULATED_FLOOR = 1e-7
"""Least noise [extents]: no sensor is better, and rounding of exact samples."""

NATS = 3.0
"""Gain of evidence that decides for a richer member where its held-out score agrees."""

SETTLED = 0.2
"""Share of a posterior sd that the last step of a log's member moves at most."""

SHARED = 1.25
"""Factor on the parameters' spread within a bound: an error of a length is shared by the whole
workspace.  With it 95 % of the places are covered in 19 of 20 logs, else on average over logs."""

OUTLIER = 0.1
"""A row of less Student weight than this, beyond eight noise sd, does not enter the inflation."""

LEAST_ROWS_OF_A_QUANTILE = 20
UNKNOWN_KAPPA = 1.5
"""Rows that a 95 % quantile needs at least, and the bound's inflation where there are fewer."""

NO_CURVES = 8.0
"""Nats against joint curves from which the bound needs no second fit with large ones."""

SHARED_ROWS = 1000
LEAST_SHARE = 0.5
"""Rows below which held-out errors of an arm in space scale the second fit's spread, and how much
of it stays: few rows tell how large curves are altogether, if not where."""

GUARDED_ROWS = 60
GUARD_LENS = 1e-3
"""Rows from which the second fit frees lens and elasticity that the member left out (fewer have
wide bounds), and the sd of a planar arm's lens: of a corner of the range 77 % covered, now 81."""

REPEATS = 10
"""Further readings of poses that tell of the sensor's noise."""

DOUBTED = 0.02
"""Share of the extent beyond which held-out rows doubt the geometry of a planar arm's drawing."""

RIVAL_START = 2.0
APART = 0.05
"""A rival start has at most so many times the best one's residuals, and is another arm where it
differs by this share of the extents: joint curves may prefer the wrong one of a path."""

OTHER_ARM = 0.2
NO_CAMERA = 0.03
OTHER_TURNS = 0.3
"""Median distance, as a share of what rows spread, of another arm; of pixels no camera explains;
and median turn [rad] of orientations that are of another arm."""

UNTOLD = 0.95
"""Share of the prior's sd from which the rows tell nothing of the last joint's offset: with a tool
that was turned by 12 deg it was said to be 0 within .2 deg where .757 deg was true."""

TARGET = float(np.radians(10.0))
"""Orientations in the robot's root frame are those of the drawing's tip where they differ by less
[rad]: only then do they tell the last joint's offset."""
