"""Numbers of the body that were chosen: each with its unit, its reason, and what chose it."""

from __future__ import annotations

import numpy as np

FREE = 1e3
"""Prior sd of what is not known [extents or reaches]: flat."""

SHIFT, TURN = 1e-3, float(np.radians(0.1))
"""Joint origins are where a drawing says to 1 mm and 0.1 deg [m, rad], or some times that."""

SCALES = (1.0, 5.0, 20.0)
"""Factors on a prior sd that the evidence compares."""

OFFSET_SCALES = (1.0, 5.0, 20.0, 100.0)
"""The same of offsets: 0.1 deg where an arm was calibrated, 10 deg where servos were put on."""

GAIN = 1e-3
"""Prior sd of a joint's gain, of a drawing; twice that without one."""

ELASTIC, ELASTIC_FLAT = 1e-3, 1e-4
"""Joints bend by this much [rad] under the largest torque of gravity; in the plane, where cosines
and sines of the cumulative angles stand for torques, by a tenth (twice that without a drawing)."""

CURVE_RMS = 4e-4
"""Rms of a joint's error curve [rad]: harmonic drives and industrial arms have 0.15 to 0.4 mrad;
the evidence finds those of others."""

CURVE_ROWS, CURVE_ROWS_FLAT = 5.0, 40.0
"""Pseudo-observations that hold it; in the plane 10 left 30 rows 1 % worse than 40."""

LONG = 3.0
"""Waves a turn up to which a planar arm's curve may be larger: eccentric wheels, loads."""

TAG = 2e-3
"""A camera's tag is held where the drawing says to so many metres."""

SOCKET = 2e-2
"""A ball that touches sockets is held where the drawing says to so many metres; where it was flat,
an arm without any stated distance shrank to a point, which touches every socket at once."""

STATED = 2e-4
"""Noise of touches [m] that weighs stated distances in a first fit; the second takes its own."""
