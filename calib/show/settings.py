"""Settings: how much is drawn, and which sizes are reported."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """How much is computed and drawn, so that a figure takes 50 kB and a tenth of a second."""

    postures: int = 200  # that show how parameters move the tip
    field: int = 6_000  # postures that a field of bounds is drawn with
    dots: int = 1_000  # rows in a figure
    arrows: int = 250  # in a figure
    deviations: int = 7  # as many as the first screen has room for
    points: int = 3_000  # in a preview
    played: int = 60  # rows that Play goes through, 15 frames each
    links: int = 24  # of a node
    photo_cells: int = 16  # along each side of a photo that is bent

    # least effect of a deviation that is drawn, over the largest one
    small_effect: float = 0.01
    # part of a column that others do not explain, below which it is the same as they
    same: float = 0.03
    # least size of a column, over the largest one of its unit: an axis that moved along itself was
    # reported as 461 mm off
    hardly: float = 0.01
    # least lever of a row that shows a joint's error, over the longest lever
    lever: float = 0.3
    arrow: float = (
        0.08  # length of the longest arrows, over the picture's width
    )


SETTINGS = Settings()
