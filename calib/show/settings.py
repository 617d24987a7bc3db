"""Settings: how much is drawn, and from when on something is said."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Amounts:
    """How much is computed and drawn: a figure of 50 kB and a tenth of a second each."""

    fresh: int = 1_000  # samples of a simulated arm: they show a mean to a few percent
    postures: int = 200  # that tell how parameters move the tip
    field: int = 2_500  # postures that a field of bounds is drawn with
    dots: int = 1_000  # rows in a figure
    arrows: int = 250  # in a figure
    causes: int = 7  # as many as the first screen has room for
    names: int = 12  # in a sentence
    window: int = 15  # rows of a running median
    points: int = 3_000  # rows in a preview
    played: int = 60  # rows that Play goes through
    step: int = 15  # frames from one of these to the next
    frames: int = 180  # of a loop
    links: int = 120_000  # in all
    fewest: int = 6  # links of one node
    most: int = 24  # links of one node
    branches: int = 12  # of an inverse answer
    inside: int = 30_000  # joint values that tell the workspace's border


@dataclass(frozen=True)
class Limits:
    """From when on something is said or drawn; each is a share of what stands in its line."""

    same: float = 0.03  # of a column's size: with less of its own, it is told by others
    small: float = 0.01  # of the largest effect: causes with less are not drawn
    lever: float = (
        0.3  # of a joint's longest lever: with less, a row says little of the joint
    )
    arrow: float = 0.08  # of the picture's width, the longest arrows
    long_edge: float = (
        5.0  # of the median edge: longer ones cross what the arm does not reach
    )
    few_rows: float = (
        1.5  # of the learned errors: with more when held out, rows help most
    )
    missed: float = (
        0.15  # of the rows beyond a 95 % bound, and by chance two: it does not hold
    )
    chance: int = 2  # rows
    logarithmic: float = (
        20.0  # of the smallest error: beyond it the scale is logarithmic
    )
    thin: float = 0.05  # of the median density: a field ends where it is less


AMOUNTS = Amounts()
LIMITS = Limits()
Z95 = 1.96
"""Half-width of a 95 % interval, in standard deviations."""
