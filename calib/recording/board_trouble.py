"""Pictures of a board that do not fit: what else explains them, and which are left out and why."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arm.rotations import exponential, logarithm, nearest_rotation
from ..body.belief import Body
from ..body.corners import fit_corners
from ..body.fitting import BodyFit
from ..body.spatial import SpatialStructure
from ..common.arrays import Array, Mask
from ..common.rows import thinned
from ..common.wording import listed
from ..errors import LogError, OptionError
from ..samples.diagnosis import Finding, readings
from ..samples.settings import MOST_ORDERED
from .board import Board
from .board_pictures import LEAST, BoardViews

_ASTRAY = 8.0  # a picture this many times further off than the median shows another board
_NEAR = 2.0  # px, below which a picture is never astray
_SHARP = 0.5  # px, from which one half of the pictures may fit better
_FINE, _WORSE = 0.05, 3.0  # px, and times that: an arm that bends explains pictures so badly only
_LEAST_SHARE = 0.4  # of the pictures that must agree
_CLEAR = 0.4  # of the misfit: another reading of the joints explains the pictures better
_FAR = 2e-2  # m, of poses, beyond which other readings are tried
_SIZED, _SURE = 0.01, 5.0  # of the board's size, and sd: beyond both it is wrong
_BUILT = 1e-3  # m, that an arm's origins are off at least where a size is doubted
_TRIED = 10  # pictures that other readings are tried on


@dataclass(frozen=True, eq=False)
class Explained:
    """The fit of the pictures that agree."""

    fit: BodyFit
    body: Body
    views: BoardViews  # those that agree
    kept: Mask  # (p,), which they are
    off: Array  # (n,) [px], how far their corners are from where the fit puts them
    usual: float  # [px], the median picture's
    notes: tuple[str, ...] = ()


def explain(structure: SpatialStructure, views: BoardViews, board: Board) -> Explained:
    """Fit pictures; raises in one line if another reading of them explains them, or none."""
    _refuse_readings(structure, views, board)
    count = len(views.q)
    found: list[Explained] = []
    # a board that was moved once leaves one half whole
    for first, last in ((0, count), (0, count // 2), (count // 2, count)):
        kept = (np.arange(count) >= first) & (np.arange(count) < last)
        if kept.sum() >= LEAST:
            found += _fitted(structure, views, kept)
        if found and found[-1].kept.mean() > 0.5 and found[-1].usual < _SHARP:
            break
    least = max(min((each.usual for each in found), default=0.0), _FINE)
    sharp = [each for each in found if each.usual < _WORSE * least]
    best = max(sharp, key=lambda each: int(each.kept.sum()), default=None)
    if best is None or best.usual > _NEAR or best.kept.mean() < _LEAST_SHARE:
        raise LogError(
            "no place of camera and board explains the pictures: check that each row of joints is "
            "of its picture, whether it is this robot, and that camera and board were not moved"
        )
    return replace(best, notes=_left_out(views, best.kept))


def _fitted(structure: SpatialStructure, views: BoardViews, kept: Mask) -> list[Explained]:
    """The fit of the pictures that agree with those that it begins with, none where it fails."""
    for _ in range(4):
        part = views.take(kept)
        try:
            fit, body = fit_corners(
                structure, part.q, part.poses, part.rows, part.corners, part.pixels, part.in_hand
            )
        except (LogError, np.linalg.LinAlgError):
            return []
        off = np.linalg.norm(views.pixels - fit.body.predict(views.each), axis=1)
        by_picture = np.array([np.median(off[views.rows == k]) for k in range(len(views.q))])
        usual = float(np.median(by_picture[kept]))
        now = by_picture < max(_ASTRAY * usual, _NEAR)
        if (now == kept).all() or now.sum() < LEAST:
            break
        kept = now
    return [Explained(fit, body, part, kept, off[kept[views.rows]], usual)]


def _left_out(views: BoardViews, kept: Mask) -> tuple[str, ...]:
    """Say which pictures contradict the others."""
    gone = np.flatnonzero(~kept)
    if not len(gone):
        return ()
    names = [views.names[k] for k in gone]
    where = "in them"
    if 1 < len(gone) == gone[-1] - gone[0] + 1 and gone[-1] == len(kept) - 1:
        where = f"from {names[0]} on"
    told = (
        f"{len(gone)} pictures contradict the others and are left out ({listed(names)}): {where} "
        "camera or board was moved, the camera refocused or zoomed, or the joints are not theirs"
    )
    return (told,)


def _refuse_readings(structure: SpatialStructure, views: BoardViews, board: Board) -> None:
    """Refuse joints, an eye or a board of which another reading explains the poses far better."""
    q, names = views.q, structure.joint_names
    own, inverse, sd = _closed_form(structure, q, views)
    if own > _FAR:
        other = "base" if views.in_hand else "hand"
        if _closed_form(structure, q, views.other_way())[0] < _CLEAR * own:
            where = "stands still" if views.in_hand else "is in the hand"
            raise OptionError(
                f"the pictures are explained where the camera {where}: give eye={other!r}",
                parameter="eye", value=other,
            )  # fmt: skip
        some = np.isin(np.arange(len(q)), thinned(len(q), _TRIED))
        few = views.take(some)
        late = (
            (np.roll(q, k, axis=0), Finding("late", words, "check which row is of which picture"))
            for k in (-2, -1, 1, 2)
            for words in [f"they are {abs(k)} row{'s' * (abs(k) > 1)} late or early"]
        )
        units, orders, *signs = readings(
            q, names, structure.revolute, any_order=len(names) <= MOST_ORDERED
        )
        for others in (units, late, *signs, orders):  # the simplest first
            tried = [(_closed_form(structure, each[some], few)[0], r) for each, r in others]
            left, best = min(tried, key=lambda each: each[0], default=(np.inf, None))
            if best is not None and left < _CLEAR * own:
                hint = "correct the header of the joints" if best.kind == "exchanged" else best.hint
                raise LogError(f"the pictures fit the joints only if {best.words}", hint=hint)
    if abs(inverse - 1.0) > _SIZED + _SURE * sd:
        raise LogError(
            f"the board's squares measure {1e3 * board.square / inverse:.4g} mm by the arm's "
            f"motions, {1e3 * board.square:.4g} mm as said: measure the print, and give its size "
            "in `board`"
        )


def _closed_form(
    structure: SpatialStructure, q: Array, views: BoardViews
) -> tuple[float, float, float]:
    """Median misfit [m] of poses that the drawing predicts, one over the board's size, its sd.

    Turns between two pictures are conjugate, Z_k Z_l' = Y A_k A_l' Y' (Park and Martin 1994); then
    places z = Y p / size + Y R tool + shift are linear in tool, shift and 1 / size.
    """
    place, turns = structure.with_view("base").pose(q, structure.neutral())
    seen, count = exponential(views.poses[:, 3:]), len(q)
    first, second = np.triu_indices(count, 1)
    a, b = (logarithm(each[first] @ np.swapaxes(each[second], 1, 2)) for each in (turns, seen))
    frame = nearest_rotation(b.T @ a)
    hand = nearest_rotation((np.swapaxes(frame @ turns, 1, 2) @ seen).sum(axis=0))
    # what neither tool nor shift follow of the tip's places, and of the poses'
    others = np.concatenate([frame @ turns, np.tile(np.eye(3), (count, 1, 1))], axis=2)
    others = others.reshape(3 * count, 6)
    both = np.column_stack([(place @ frame.T).ravel(), views.poses[:, :3].ravel()])
    tip, told = (both - others @ np.linalg.lstsq(others, both, rcond=1e-9)[0]).T
    miss = np.linalg.norm((told - tip).reshape(count, 3), axis=1)
    away = np.linalg.norm(views.poses[:, :3], axis=1)
    bent = away * np.linalg.norm(logarithm(seen @ np.swapaxes(frame @ turns @ hand, 1, 2)), axis=1)
    square = max(float(tip @ tip), 1e-9)  # of few joints nothing tells the size
    inverse = float(tip @ told) / square
    noise = max(float(((told - inverse * tip) ** 2).mean()), _BUILT**2)
    return float(np.median(miss + bent)), inverse, float(np.sqrt(noise / square))
