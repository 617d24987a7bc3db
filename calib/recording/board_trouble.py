"""Pictures of a board that do not fit: what else explains them, and which are left out and why."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arm.rotations import exponential, logarithm, nearest_rotation
from ..body.belief import Body
from ..body.corners import fit_corners
from ..body.fitting import BodyFit
from ..body.parameters import Indices
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
_SIZED = 0.01  # of the board's size, beyond which it is wrong where that is clear
_SURE = 5.0  # standard deviations
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
    halves = ((0, count), (0, count // 2), (count // 2, count))
    found: list[Explained] = []
    for first, last in halves:  # a board that was moved once leaves one half whole
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
    return replace(best, notes=_left_out(structure, views, best))


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
        rows = np.column_stack([views.q[views.rows], views.corners])
        off = np.linalg.norm(views.pixels - fit.body.predict(rows), axis=1)
        by_picture = np.array([np.median(off[views.rows == k]) for k in range(len(views.q))])
        usual = float(np.median(by_picture[kept]))
        now = by_picture < max(_ASTRAY * usual, _NEAR)
        if (now == kept).all() or now.sum() < LEAST:
            break
        kept = now
    return [Explained(fit, body, views.take(kept), kept, off[kept[views.rows]], usual)]


def _left_out(structure: SpatialStructure, views: BoardViews, found: Explained) -> tuple[str, ...]:
    """Say which pictures contradict the others, and why: what moved, or the focus."""
    gone = np.flatnonzero(~found.kept)
    if not len(gone):
        return ()
    names = [views.names[k] for k in gone]
    still, hand = ("board", "camera") if views.in_hand else ("camera", "board")
    why = f"the {still} stood elsewhere, or the joints are not theirs"
    at_end = gone[-1] == len(views.q) - 1
    if len(gone) > 1 and gone[-1] - gone[0] + 1 == len(gone) and (at_end or gone[0] == 0):
        groups, rest = structure.groups, views.take(~found.kept)
        ways = {
            "the camera was refocused or zoomed": groups["lens"][:1],
            f"the {still} was moved": np.append(groups["view.rotation"], groups["view.shift"]),
            f"the {hand} was moved in the hand": np.append(groups["tool.rotation"], groups["tool"]),
        }
        left = {words: _left(found.fit.body, rest, index) for words, index in ways.items()}
        best = min(left, key=lambda words: left[words])
        if left[best] < _NEAR:
            why = f"{best} " + (f"from {names[0]} on" if at_end else f"after {names[-1]}")
    told = f"{len(gone)} pictures contradict the others and are left out ({listed(names)}): {why}"
    return (told,)


def _left(body: Body, views: BoardViews, index: Indices) -> float:
    """Median distance [px] of corners from a fit of which some parameters are fitted to them."""
    camera: Any = body.structure
    beta, rows = body.beta, np.column_stack([views.q[views.rows], views.corners])
    for _ in range(12):
        seen, x = camera.linearise(rows, beta, index)
        miss = views.pixels - seen
        weight = 1.0 / (1.0 + np.linalg.norm(miss, axis=1) / 50.0)
        pulled = (x.reshape(len(rows), 2, -1) * weight[:, None, None]).reshape(-1, len(index))
        step = np.zeros(len(beta))
        step[index] = np.linalg.lstsq(pulled, (miss * weight[:, None]).ravel(), rcond=1e-9)[0]
        beta = camera.retract(beta, step)
    left = np.linalg.norm(views.pixels - camera.predict(rows, beta), axis=1)
    return float(np.median(left))


def _refuse_readings(structure: SpatialStructure, views: BoardViews, board: Board) -> None:
    """Refuse joints, an eye or a board of which another reading explains the poses far better."""
    own, inverse, sd = _closed_form(structure, views.q, views)
    if own > _FAR:
        other, back = "base" if views.in_hand else "hand", views.other_way()
        where = "stands still" if views.in_hand else "is in the hand"
        if _closed_form(structure, views.q, back)[0] < _CLEAR * own:
            raise OptionError(
                f"the pictures are explained where the camera {where}: give eye={other!r}",
                parameter="eye", value=other,
            )  # fmt: skip
        some = np.zeros(len(views.q), bool)
        some[thinned(len(views.q), _TRIED)] = True
        few, q, names = views.take(some), views.q, structure.joint_names
        late = (
            (np.roll(q, k, axis=0), Finding("late", words, "check which row is of which picture"))
            for k in (-2, -1, 1, 2)
            for words in [f"they are {abs(k)} row{'s' * (abs(k) > 1)} late or early"]
        )
        units, orders, *signs = readings(
            q, names, structure.revolute, any_order=len(names) <= MOST_ORDERED
        )
        # the simplest first
        for others in (units, late, *signs, orders):
            tried = [(_closed_form(structure, q[some], few)[0], r) for q, r in others]
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
