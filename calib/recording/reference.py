"""What positions are told in: pixels, or metres by a board or four tags on the desk.

The reference is found anew in each recording. A camera that was bumped changes where the board
appears and leaves positions on it as they were, up to the uncertainty of finding it again,
which is told too.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError, OptionError
from ..samples.columns import open_source, read_columns
from .board import LEAST_CORNERS, Board
from .lens import Lens
from .plane import Pose, apply_homography, cut_noise, cut_plane, find_pose, homography

Array = NDArray[np.float64]
Marks = Mapping[int, Array]

_MOVED = 0.7  # [px]; marks further off than this show that the camera was bumped


class Reference(Protocol):
    """Turns pixels into positions."""

    @property
    def unit(self) -> str:
        """Unit of the positions."""

    def positions(self, pixels: Array) -> Array:
        """Return positions (n, 2) [unit] of pixels (n, 2)."""

    def noise(self, pixels: Array) -> tuple[Array, Array]:
        """Return standard deviations (n,): per pixel of noise, and shared by all rows [unit]."""

    def told(self) -> dict[str, Any]:
        """Return what a later recording compares itself with, as plain values."""


@dataclass(frozen=True)
class PixelReference:
    """Pixels of the picture as they are: x to the right, y down."""

    unit: str = "px"

    def positions(self, pixels: Array) -> Array:
        """Return the pixels."""
        return pixels

    def noise(self, pixels: Array) -> tuple[Array, Array]:
        """Return one pixel for a pixel, and nothing shared."""
        return np.ones(len(pixels)), np.zeros(len(pixels))

    def told(self) -> dict[str, Any]:
        """Return the kind."""
        return {"kind": "pixels"}


@dataclass(frozen=True, eq=False)
class PlaneReference:
    """A flat frame seen by a calibrated camera: rays are cut with the tag's plane."""

    lens: Lens
    pose: Pose
    height: float = 0.0
    unit: str = "m"

    def positions(self, pixels: Array) -> Array:
        """Return where the rays meet the plane."""
        return cut_plane(self.lens, self.pose, pixels, self.height)

    def noise(self, pixels: Array) -> tuple[Array, Array]:
        """Return the scale of a pixel, and what the pose leaves open."""
        return cut_noise(self.lens, self.pose, pixels, self.height)

    def told(self) -> dict[str, Any]:
        """Return the camera's pose over the frame."""
        return {
            "kind": "plane",
            "rotation": self.pose.rotation.tolist(),
            "camera": self.pose.camera.tolist(),
            "height": self.height,
        }


@dataclass(frozen=True, eq=False)
class FlatReference:
    """A flat frame seen by an unknown camera: a homography between tags around the arm."""

    matrix: Array
    residual: float
    unit: str = "m"

    def positions(self, pixels: Array) -> Array:
        """Map pixels to the plane."""
        return apply_homography(self.matrix, pixels)

    def noise(self, pixels: Array) -> tuple[Array, Array]:
        """Return the scale of a pixel, and the tags' own misfit."""
        base = self.positions(pixels)
        steps = [self.positions(pixels + d) - base for d in ([0.5, 0.0], [0.0, 0.5])]
        scale = 2.0 * np.sqrt(sum((s**2).sum(1) for s in steps) / 2.0)
        return scale, np.full(len(pixels), self.residual)

    def told(self) -> dict[str, Any]:
        """Return the homography."""
        return {"kind": "flat", "matrix": self.matrix.tolist()}


@dataclass(frozen=True, eq=False)
class Layout:
    """Marks at known places of a flat frame: a board's corners, or tags on a desk.

    Attributes
    ----------
    what : str
        What messages call it.
    points : mapping of int to (2,) array [m]
        Places by number.
    least : int
        Marks that must be seen.
    """

    what: str
    points: Marks
    least: int

    def reference(self, seen: Marks, lens: Lens | None, height: float) -> Reference:
        """Fit the reference to the marks of a recording."""
        numbers = [n for n in self.points if n in seen]
        if len(numbers) < self.least:
            raise LogError(
                f"{self.what} is too small, hidden or not there: {len(numbers)} found, "
                f"{self.least} expected"
            )
        flat = np.array([self.points[n] for n in numbers])
        pixels = np.array([seen[n] for n in numbers])
        if lens is None:
            matrix = homography(pixels, flat)
            miss = apply_homography(matrix, pixels) - flat
            free = max(miss.size - 8, 1)
            return FlatReference(matrix, float(np.sqrt((miss**2).sum() / free)))
        pose = find_pose(lens, np.c_[flat, np.zeros(len(flat))], pixels)
        return PlaneReference(lens, pose, height)


def board_layout(board: Board) -> Layout:
    """Return the corners of a board as a layout."""
    return Layout("the board", dict(enumerate(board.corners()[:, :2])), LEAST_CORNERS)


def read_layout(path: str | os.PathLike[str]) -> Layout:
    """Read tags at known places: a table with the columns `tag`, `x`, `y` [m].

    Raises
    ------
    LogError
        If there are fewer than four, or a tag has two places.
    """
    source = open_source(path)
    rows = read_columns(source, ["tag", "x", "y"])
    if not np.isfinite(rows).all() or (rows[:, 0] % 1 != 0).any() or (rows[:, 0] < 0).any():
        raise LogError(f"{source.label}: expected whole ids under 'tag' and metres under 'x', 'y'")
    points = {int(row[0]): row[1:] for row in rows}
    if len(points) < 4 or len(points) < len(rows):
        raise LogError(
            f"{source.label} has {len(rows)} rows of {len(points)} tags, expected four tags or "
            "more, each once, around the workspace"
        )
    if np.abs(rows[:, 1:]).max() > 20.0:
        raise LogError(f"{source.label}: a tag is {np.abs(rows[:, 1:]).max():g} m off; in mm?")
    return Layout("the frame of tags", points, 4)


@dataclass(frozen=True, eq=False)
class Watch:
    """The reference over a recording, which may have been bumped on the way.

    Attributes
    ----------
    starts : tuple of int
        First picture of each part.
    parts : tuple of Reference
        The reference of each.
    marks : dict of int to (2,) array [px]
        Where the last part's marks are.
    notes : tuple of str
        What moved.
    """

    starts: tuple[int, ...]
    parts: tuple[Reference, ...]
    marks: Marks
    notes: tuple[str, ...] = ()

    def positions(self, pixels: Array, numbers: Array) -> tuple[Array, Array, Array]:
        """Return positions (n, 2), noise of a pixel (n,) and shared noise (n,) [unit].

        Parameters
        ----------
        pixels : (n, 2) array [px]
            What was seen.
        numbers : (n,) array of int
            In which pictures.
        """
        x = np.empty_like(pixels)
        scale, common = np.empty(len(pixels)), np.empty(len(pixels))
        which = np.searchsorted(self.starts, numbers, side="right") - 1
        for k, part in enumerate(self.parts):
            rows = np.maximum(which, 0) == k
            if rows.any():
                x[rows] = part.positions(pixels[rows])
                scale[rows], common[rows] = part.noise(pixels[rows])
        return x, scale, common


def watch(
    layout: Layout, seen: Sequence[tuple[int, Marks]], lens: Lens | None, height: float = 0.0
) -> Watch:
    """Find the reference in a recording, and whether it moved within it.

    Parameters
    ----------
    layout : Layout
        Where the marks are.
    seen : sequence of (int, marks)
        Numbers of pictures, in order, and what they show of it.
    lens : Lens or None
        The camera; without one a homography is fitted.
    height : float [m]
        Of the tag's plane over the layout's.
    """
    if lens is None and height:
        raise OptionError(
            f"`tag_height={height:g}` needs `lens`: rays are cut with the tag's plane"
        )
    groups: list[list[tuple[int, Marks]]] = [[]]
    doubtful: list[tuple[int, Marks]] = []
    for number, marks in seen:
        if not groups[-1] or _shift(_middle(groups[-1]), marks) < _MOVED:
            groups[-1].append((number, marks))
            doubtful = []
            continue
        doubtful.append((number, marks))  # a hand in the picture is gone in the next
        if len(doubtful) >= 2 and _shift(doubtful[0][1], marks) < _MOVED:
            groups.append(doubtful)
            doubtful = []
    middles = [_middle(group) for group in groups]
    parts = tuple(layout.reference(middle, lens, height) for middle in middles)
    notes = []
    for before, after, group in zip(middles, middles[1:], groups[1:], strict=False):
        notes.append(
            f"the reference moved by {_shift(before, after):.1f} px about picture "
            f"{group[0][0] + 1}: the camera or what lies on the desk was bumped; it was found "
            "again from there on"
        )
    starts = tuple(group[0][0] if k else 0 for k, group in enumerate(groups))
    return Watch(starts, parts, middles[-1], tuple(notes))


def motion(earlier: Mapping[str, Any], now: Reference) -> str:
    """Say how far the camera moved over its reference since an earlier recording."""
    then = dict(earlier)
    told = now.told()
    if then.get("kind") != told["kind"] or told["kind"] != "plane":
        return "the earlier recording has no reference of the same kind to compare with"
    try:
        turn = np.array(then["rotation"], float).reshape(3, 3)
        place = np.array(then["camera"], float).reshape(3)
    except (KeyError, TypeError, ValueError):
        raise LogError("the earlier log does not say where its camera was") from None
    far = float(np.linalg.norm(np.array(told["camera"]) - place))
    between = np.array(told["rotation"]) @ turn.T
    angle = float(np.degrees(np.arccos(np.clip((np.trace(between) - 1.0) / 2.0, -1.0, 1.0))))
    return (
        f"since the earlier recording the camera moved by {1e3 * far:.1f} mm and turned by "
        f"{angle:.2f} deg over its reference"
    )


def _middle(group: Sequence[tuple[int, Marks]]) -> dict[int, Array]:
    """Return the median place of each mark."""
    numbers = sorted({n for _, marks in group for n in marks})
    return {n: np.median([m[n] for _, m in group if n in m], axis=0) for n in numbers}


def _shift(one: Marks, other: Marks) -> float:
    """Return how far the marks that both show moved, the median of them [px]."""
    both = [n for n in one if n in other]
    if len(both) < 3:
        return 0.0
    return float(np.median([np.linalg.norm(one[n] - other[n]) for n in both]))


def at_height(reference: Reference, height: float) -> Reference:
    """Return a plane's reference for another height of the tag [m]."""
    return replace(reference, height=height) if isinstance(reference, PlaneReference) else reference
