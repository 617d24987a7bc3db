"""Settings: how much is drawn, and from where on something is reported."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """How much is computed and drawn: a figure of 50 kB and a tenth of a second each."""

    postures: int = 200  # that show how parameters move the tip
    field: int = 6_000  # postures that a field of bounds is drawn with
    dots: int = 1_000  # rows in a figure
    arrows: int = 250  # in a figure
    deviations: int = 7  # as many as the first screen has room for
    points: int = 3_000  # in a preview
    played: int = 60  # rows that Play goes through, 15 frames each
    links: int = 24  # of a node
    photo_cells: int = 16  # along each side of a photo that is bent

    # of the largest: deviations with less are not drawn
    small_effect: float = 0.01
    same: float = 0.03  # of a column: with less of its own, others tell it
    # of the largest column of a unit: an axis moved along itself was reported as 461 mm off
    hardly: float = 0.01
    # of a joint's longest: with less, a row shows little of it
    lever: float = 0.3
    arrow: float = 0.08  # of the picture's width: the longest arrows


SETTINGS = Settings()
