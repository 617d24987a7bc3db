"""Settings: tuned numbers of this room, each with its unit, its reason and its measurement."""

from __future__ import annotations

from dataclasses import dataclass

# Share of undisturbed logs for which `check` may call anything changed, after Bonferroni
FALSE_ALARM = 1e-3
OUTLIER = 5.0  # noises from which a row contradicts all others
PSEUDO = 4.0  # observations that the old noise counts for
# Noise over the usual one from which it is told, where it is no chance, and one encoder's is looked
# for: that of a log's body is a Student scale, up to 30 % less than the deviation of series C
NOISIER = 1.5
# Least residual of one log, of the extents; 1e-4 hid a sensor that was moved by .1 mm
LEAST_OWN = 1e-6

CREPT = 0.25
"""Of the usual creep of an unchanged arm's parameters, what the tests allow for: the last rows of
series A, .4 mm off, are an alarm without it; all of it hid a sensor that was moved by .1 mm."""

CREEP = 0.01  # sd of a joint's curve that may creep between two logs, over that of its prior
# the same of a curve that is freed, and of an arm as it was built
BUILT_CURVE = 0.3

LEAST_MISFIT = 1e-4
"""Least residual sd of an arm that may have changed, beyond the noise [extents]: also of samples
without noise."""


# Sizes of a freed frame, a radian and an extent, beyond which it is not looked for
ANYWHERE = 20.0

CALM_WAVES = 0.7
WAVES = (CREEP, CALM_WAVES, 4.0)
"""Joints' waves, of unknown size, that a log may show beside every change: sd of their curves, over
that of its prior.  With the least alone, waves of 2 mrad along a line were taken for lengths and a
lens.  Each is as likely before: a prior uniform in the logarithm of a size (Jeffreys).  An arm
that has not changed may show calm ones: .25 mrad are what a model of 400 rows had not learned of a
real UR10, and did harm where they were taken for a change.  A larger smooth residual as well (4
times the usual) left an error of .64 mm on rows of another day, for .29."""

# Nats by which a change must be better than none, and within which explanations are averaged
MARGIN = 5.0


@dataclass(frozen=True)
class UpdateSettings:
    """How a belief is updated."""

    # that an update takes: linear in them
    rows: int = 600
    # that are fitted as training fits them: of 10,719 of series A all are as good within .2 %
    rows_of_training: int = 2000
    # contiguous ones that are held out in turn, each of which tells a gain
    blocks: int = 5
    # at most to the best fit, and nats that one must gain.  Along the ways in which an arm without
    # a drawing may be put together the fit betters by little for long, and predictions no more
    steps: int = 60
    enough: float = 0.5
    # sizes of what an unchanged arm's log has of its own, times the usual one: with the first alone
    # 40 rows of another mounting made errors elsewhere 1.25 times as large
    own_residuals: tuple[float, ...] = (1.0, 4.0)
    # score from which a change is beyond doubt: then the usual residual alone, with which windows
    # of 30 and more rows of series C left errors half as large as with 4 times as much
    clearly: float = 2.0
    # share of the held-out error that a change may leave at most
    changed: float = 0.95
    # The same where nothing changed, and of the error that a belief expects of itself: rows of half
    # of series A were added to a model of the other, which was then 1.15 times as far off
    refined: float = 0.85
    # standard errors by which the held-out blocks must gain
    sure: float = 2.0
    # Inflation of the bound of an arm that was only simulated: nothing has shown yet how it holds.
    # Of 30 rows with waves of 2 mrad it covered 94.4 % without.
    simulated_kappa: float = 1.2


UPDATING = UpdateSettings()
