"""Settings of the body: every number that was chosen, with its unit, its reason, what chose it.

Numbers of rows, steps and probes that change no answer once they are large enough are kept next to
their search.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FLAT_SD = 1e3
"""Prior sd of what is not known [extents or reaches]: flat."""

DRAWN_SHIFT_SD = 1e-3
DRAWN_TURN_SD = float(np.radians(0.1))
"""Prior sds of a drawing's joint origins and zeros [m, rad]; the evidence finds their factor."""

FINER = (0.2, 20.0)
"""`PriorSettings.wider` where corners or touches determine it: with it, a board placed the thing in
the hand of an arm whose origins were off by .3 mm to .46 mm; with factors from 1 on to 2.3."""

STUDENT = 6.0
"""Degrees of freedom of a log's noise: a few rows may be grossly wrong."""

LOG_FLOOR = 1e-5
POSE_FLOOR = 1e-4
"""Least noise of a log of positions and of poses [extents, rad]: laser trackers read a reflector
to 10 um in a metre, cameras and probes that also measure orientations are ten times coarser.  With
1e-4, bounds were five times too wide for a tracker of 10 um."""

SIMULATED_FLOOR = 1e-7
"""Least noise of exact samples [extents, rad]: their rounding."""

NATS = 3.0
"""Gain of evidence that decides for a richer member where its held-out score agrees."""

SHARED = 1.25
"""Factor on the parameters' spread within a bound, since an error of a length concerns the whole
workspace: with it 95 % of the places are covered in 19 of 20 logs, without it in the mean log."""

PRIOR_SHARE = 0.95
"""Share of the prior's sd from which rows do not determine the last joint's offset: with a tool
that was turned by 12 deg it was reported as 0 within .2 deg where .757 deg was true."""


@dataclass(frozen=True)
class PriorSettings:
    """Priors of the parameters."""

    # range of the factor on a drawing's prior sd that the evidence finds
    wider: tuple[float, float] = (1.0, 20.0)
    # range of the factor on that of offsets: servos are mounted up to 10 deg off
    servos: tuple[float, float] = (1.0, 100.0)
    # range of the factor on that of joint origins, by touches: small where nothing determines the
    # arm's size, larger where a sensor or a distance does
    touches: tuple[float, float] = (FINER[0], 1.0)
    sized_touches: tuple[float, float] = (FINER[0], 5.0)
    # sd of a joint's gain, of a drawing; twice that without one
    gain: float = 1e-3
    # sd of a joint's bend [rad] under the largest torque of gravity, or of a unit weight; a tenth
    # in the plane, where cosines and sines of the cumulative angles replace torques (twice that
    # without a drawing)
    elastic: float = 1e-3
    elastic_in_plane: float = 1e-4
    # sd of each of two angles of gravity's direction [rad]: a base may not be level
    tilt: float = float(np.radians(3.0))
    # a joint's share in the motion of its neighbour's motor, where a wrist's gears are coupled
    coupling: float = 1e-3
    # rms of a joint's error curve [rad]: harmonic drives and industrial arms have 0.15 to 0.4
    # mrad; the evidence finds those of others
    curve_rms: float = 4e-4
    # pseudo-observations that hold it; in the plane 10 left 30 rows 1 % worse than 40
    curve_rows: float = 5.0
    curve_rows_in_plane: float = 40.0
    # waves a turn up to which a planar arm's curve is larger: by eccentric wheels, loads
    long: float = 3.0
    # waves a turn at which a curve's prior variance has fallen by exp(-1/2), and its share far
    # beyond: a real UR10 has 8 to 30 waves a turn of 0.15 to 0.37 mrad
    width: float = 20.0
    curve_floor: float = 3e-3
    # sd of a camera's tag about its place in the drawing [m]
    tag: float = 2e-3
    # sd of the distance between the markers of two sensors [m], and the range of its factor: from
    # one tag that two cameras see (.02 mm) to a tag and a reflector (.2 m)
    marker: float = 2e-3
    markers: tuple[float, float] = (0.01, 100.0)
    # sd of a ball that touches sockets about its place in the drawing [m]: with a flat prior, an
    # arm without a stated distance shrank to a point, which touches every socket at once
    socket: float = 2e-2
    # extents at which a planar arm's lens bends by its radial parameter
    lens_size: float = 1.5


@dataclass(frozen=True)
class StartSettings:
    """Where a fit begins."""

    # [nats] within which starts are equally good
    tied_nats: float = 1e-2
    rows: int = 400  # most rows of the runs
    # damped steps of all runs, and of the best
    run_steps: tuple[int, int] = (6, 40)
    runs: int = 8  # best runs, which get more steps
    turned_ways: int = 16  # best combinations of signs and mirrors, which run
    guessed_rows: int = 60  # most rows of a guess of the frame
    guess_steps: int = 10  # damped steps of a guess
    steps: int = 40  # damped steps of the best guess, and of a chain
    # length of tools to each side that guesses of the frame assume [reach]
    tool: float = 0.1
    # median residual over the spread of the rows: from here on they are of another arm, and pixels
    # of no camera; and median turn [rad] from which orientations are of another arm
    share_of_other_arm: float = 0.2
    share_of_no_camera: float = 0.03
    other_turns: float = 0.3
    # orientations in the robot's root frame that differ by less from the drawing's [rad] are of
    # the drawing's tip, and determine the last joint's offset
    target: float = float(np.radians(10.0))
    # fewest rows for a chain of which only the joints are known, and most rows of its search
    least_rows: int = 10
    chain_rows: int = 150
    chains: int = 24  # chains that a round begins at
    rounds: int = 3  # most rounds, until the best two agree
    # numbers of best ends that get more steps, and of these steps: after 40 steps a UR5's short
    # path was explained 25 to 900 nats worse than by the true chain, now to 2
    further_steps: tuple[tuple[int, int], ...] = ((8, 100), (4, 300))
    agreeing_ends: int = 4  # ends that agree, which are enough
    # [nats] within which ends agree, and the best two after more steps
    nats_of_agreeing_ends: float = 0.5
    nats_of_best_two: float = 2.0
    # residuals of a chain that is exact, and of one that explains the rows [extents]; a hobby
    # arm's first four ends were points that agreed at .29
    exact_share: float = 10 * SIMULATED_FLOOR
    explained_share: float = 0.05
    # share of the largest spread below which columns of a linear chain are one
    one_column: float = 3e-5


@dataclass(frozen=True)
class FitSettings:
    """The fit, its gate, and the second fit."""

    # contiguous blocks of rows with an information matrix of their own
    blocks: int = 10
    rows_at_once: int = 3000  # most rows whose derivatives are kept at once
    noise_steps: int = 12  # of the reweighting that finds a Student noise
    # first damping after a step that fails, and least gain of a damped step [nats]; both of a
    # search from anywhere
    first_damping: float = 1e-4
    least_gain: float = 0.05
    first_damping_of_search: float = 1e-3
    least_gain_of_search: float = 1e-3
    # largest last step, over a posterior sd, of a log's member and of one of exact samples; and
    # steps of the latter: from anywhere, then to the maximum
    settled: float = 0.2
    settled_of_exact: float = 1e-3
    search_steps_of_exact: int = 60
    steps_of_exact: int = 20
    # held-out error from which a planar arm is also fitted without its drawing [extents]
    doubted: float = 0.02
    # nats against joint curves from which the bound needs no second fit with large curves
    no_curves: float = 8.0
    # rows below which held-out errors of an arm in space scale the second fit's spread, and the
    # least factor: few rows show how large curves are, if not at which joints
    shared_rows: int = 1000
    least_share: float = 0.5
    # rows from which the second fit frees lens and elasticity that the member lacks (bounds of
    # fewer rows are wide), and the sd of a planar arm's lens: bounds in a corner of the range
    # covered 77 %, now 81
    guarded_rows: int = 60
    guard_lens: float = 1e-3
    # Student weight below which a row, beyond eight noise sd, does not count in the inflation
    outlier: float = 0.1
    # a body's own error (`Body.tau`): medians at which held-out errors are limited, share of the
    # noise's variance that they have anyway, and least value [noise sd]
    limit: float = 4.0
    noise_margin: float = 1.3
    least_tau: float = 0.05
    # fewest rows of a 95 % quantile, and the bound's inflation where there are fewer
    least_rows_of_a_quantile: int = 20
    unknown_kappa: float = 1.5
    # fewest rows for an autocorrelation time of residuals, and its largest value [rows]
    fewest_of_time: int = 40
    longest_time: int = 60
    # rows times parameters from which a spread is computed for some rows only
    spread_work: float = 5e5


@dataclass(frozen=True)
class PlaySettings:
    """Standard errors from which half the play of a joint is no chance."""

    sure: float = 4.0  # of at least one joint
    # of the other joints: with 4 of all, 21 of 60 unchanged arms were drifted
    likely: float = 2.5


PRIOR = PriorSettings()
START = StartSettings()
FIT = FitSettings()
PLAY = PlaySettings()
