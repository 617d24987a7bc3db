"""The fit of hand-eye calibration: corners and motions are measurements with noise.

A point p of a board is seen at ``lens(X^-1 M Y p)``.  A camera in the hand has M = G^-1, X the
camera in the flange and Y the board in the base; a camera that stands still has M = G, X the
camera in the base and Y the board in the flange, where G is the flange in the base.  The six errors
of each motion are eliminated row by row; all sizes of noise follow from the evidence (MacKay 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..arm.rotations import cross_matrix, exponential
from ..common.arrays import Array, Index
from .pictures import opencv

BENDS = [(i, k - i) for k in (2, 3, 4) for i in range(k + 1)]
"""Powers of a board's x and y in the terms of its height."""

SHAPE = len(BENDS) + 2
"""Numbers of a board's shape: heights, stretch and shear [half diagonals]."""

LENS = 9
"""Numbers of a lens: focal lengths, centre, k1, k2, p1, p2, k3."""

_STEPS = 40
_OWN_STEPS = 5  # of motions whose errors are found alone
_STIFF = 1e6  # damping from which no step is tried any more
_HUBER = 4.0  # noise sd, beyond which a corner counts less
_LEAST_CORNER = 0.01  # [px], noise that corners are credited with at least
_LEAST_POSE = np.array([1e-6, 1e-6])  # [rad, m], the same of motions
_FASTER = np.array(
    [1.0, 1.7, 2.0]
)  # exponents of the steps of corners, poses and priors


@dataclass(frozen=True, eq=False)
class Shots:
    """What the pictures of one camera show of a board."""

    points: tuple[
        Array, ...
    ]  # (m, 3) of each picture, in the board's frame, as said [m]
    corners: tuple[Array, ...]  # (m, 2) of each picture [px]
    rows: Index  # (p,), the motion that each picture was taken at
    in_hand: bool  # whether the camera is in the hand
    outline: Array  # (k, 3), all points of the board [m]

    def take(self, motions: Index) -> Shots:
        """The pictures that were taken at some of the motions, which are numbered anew."""
        number = {int(row): k for k, row in enumerate(motions)}
        kept = [k for k, row in enumerate(self.rows) if int(row) in number]
        rows = np.array([number[int(self.rows[k])] for k in kept], np.intp)
        points = tuple(self.points[k] for k in kept)
        return replace(
            self, points=points, corners=tuple(self.corners[k] for k in kept), rows=rows
        )


class Motions(Protocol):
    """Where the flange was, as poses or joints say."""

    @property
    def count(self) -> int:
        """Number n of motions."""

    @property
    def size(self) -> int:
        """Number k of the arm's own parameters."""

    def poses(self, arm: Array) -> Array:
        """The flange in the base (n, 4, 4) [m] at parameters (k,)."""

    def slopes(self, arm: Array) -> Array:
        """Turn in the flange's axes and shift in the base's, (n, 6, k), by the parameters."""

    def take(self, rows: Index) -> Motions:
        """Some of the motions."""


@dataclass(frozen=True, eq=False)
class GivenPoses:
    """Flange poses of a controller."""

    table: Array  # (n, 4, 4) [m]
    size: int = 0

    @property
    def count(self) -> int:
        """Number of motions."""
        return len(self.table)

    def poses(self, arm: Array) -> Array:  # noqa: ARG002
        """The flange in the base (n, 4, 4) [m]."""
        return self.table

    def slopes(self, arm: Array) -> Array:  # noqa: ARG002
        """No parameters."""
        return np.zeros((self.count, 6, 0))

    def take(self, rows: Index) -> GivenPoses:
        """Some of the poses."""
        return GivenPoses(self.table[rows])


@dataclass(frozen=True)
class Scale:
    """Values that share a prior sd, which the evidence finds between two limits."""

    name: str
    indices: Index  # of the values
    lowest: float
    highest: float


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the unknowns of all pictures stand: frames (six numbers each), then values."""

    cameras: int
    boards: tuple[bool, ...]  # whether each board is that of the cameras in the hand
    arm: int  # the arm's own parameters

    @property
    def frames(self) -> int:
        """Number of frames: the cameras', then the boards'."""
        return self.cameras + len(self.boards)

    @property
    def values(self) -> int:
        """Number of values: lenses, boards' shapes and sizes, the arm's parameters."""
        return LENS * self.cameras + (SHAPE + 1) * len(self.boards) + self.arm

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return 6 * self.frames + self.values

    def board_of(self, in_hand: bool) -> int:
        """The board that a camera sees."""
        return self.boards.index(in_hand)

    def lens(self, camera: int) -> Index:
        """Values of a camera's lens."""
        return LENS * camera + np.arange(LENS)

    def shape(self, board: int) -> Index:
        """Values of a board's shape."""
        return LENS * self.cameras + (SHAPE + 1) * board + np.arange(SHAPE)

    def square(self, board: int) -> int:
        """Value that is the log of a board's size over the said one."""
        return LENS * self.cameras + (SHAPE + 1) * board + SHAPE

    @property
    def arm_values(self) -> Index:
        """Values of the arm's own parameters."""
        return np.arange(self.values - self.arm, self.values)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What is fitted."""

    frames: Array  # (f, 4, 4) [m]
    values: Array  # (v,)
    errors: Array  # (n, 6), turn [rad] and shift [m] of each motion

    def moved(self, step: Array, errors: Array) -> Unknowns:
        """The unknowns after a step (s,) and one of the errors (n, 6)."""
        turns = step[: 6 * len(self.frames)].reshape(-1, 6)
        frames = self.frames.copy()
        frames[:, :3, :3] = frames[:, :3, :3] @ exponential(turns[:, :3])
        frames[:, :3, 3] += turns[:, 3:]
        values = self.values + step[6 * len(self.frames) :]
        return Unknowns(frames, values, self.errors + errors)


@dataclass(frozen=True, eq=False)
class Noise:
    """Sizes that the evidence finds."""

    corner: Array  # (c,), sd of a corner of each camera [px]
    pose: Array  # (2,), sd of the motions' turns [rad] and shifts [m]
    prior: Array  # (v,), prior sd of the values; 0 holds a value


@dataclass(frozen=True, eq=False)
class Fit:
    """A solution."""

    unknowns: Unknowns
    noise: Noise
    covariance: Array  # (s, s)
    freedom: float  # degrees of freedom that the noise of the motions is known with
    residuals: tuple[Array, ...]  # (N, 2) of each camera [px]


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums over the corners of each picture of a camera, [px^2] and [px]."""

    residuals: Array  # (N, 2) [px], corners weighed by Huber
    lengths: Array  # (N,), of the residuals without weights [px]
    products: Array  # (p, u + 6, u + 6), of slopes by the camera's unknowns and the motion's errors
    pulls: Array  # (p, u + 6), of slopes and residuals

    @property
    def together(self) -> float:
        """Sum of squares along each picture's pose [px^2]."""
        own = self.products[:, -6:, -6:]
        ridge = 1e-9 * np.einsum("pii->pi", own)[:, :, None] * np.eye(6)
        along = np.linalg.solve(own + ridge, self.pulls[:, -6:, None])[:, :, 0]
        return float((along * self.pulls[:, -6:]).sum())


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations: sums over all cameras, each over its noise."""

    shared: Array  # (s, s)
    across: Array  # (n, s, 6), of the unknowns and each motion's errors
    own: Array  # (n, 6, 6)
    pull: Array  # (s,)
    own_pull: Array  # (n, 6)


def inverse(pose: Array) -> Array:
    """Inverse of rigid motions (..., 4, 4)."""
    back = np.swapaxes(pose[..., :3, :3], -1, -2)
    out = np.zeros_like(pose)
    out[..., :3, :3] = back
    out[..., :3, 3] = -(back @ pose[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def poses_of(turns: Array, shifts: Array) -> Array:
    """Rigid motions (n, 4, 4) of rotations (n, 3, 3) and shifts (n, 3)."""
    out = np.tile(np.eye(4), (len(turns), 1, 1))
    out[:, :3, :3] = turns
    out[:, :3, 3] = shifts
    return out


def bending(points: Array, outline: Array) -> Array:
    """How points (N, 3) of a board of points (k, 3) [m] move by its shape, (N, 3, SHAPE)."""
    low = outline.min(axis=0)
    high = outline.max(axis=0)
    half = np.linalg.norm(high - low) / 2

    def terms(places: Array) -> tuple[Array, Array]:
        u, v, _ = ((places - (low + high) / 2) / half).T
        heights = np.column_stack([u**i * v**k for i, k in BENDS])
        return np.column_stack([np.ones_like(u), u, v]), heights

    plane, heights = terms(outline)
    flat = np.linalg.lstsq(plane, heights, rcond=None)[
        0
    ]  # a plane is the board's place
    plane, heights = terms(points)
    heights -= plane @ flat
    u, v = plane[:, 1:].T
    out = np.zeros((len(points), 3, SHAPE))
    out[:, 2, :-2] = half * heights
    out[:, 0, -2] = half * u
    out[:, 1, -2] = -half * v
    out[:, 0, -1] = half * v
    out[:, 1, -1] = half * u
    return out


def project(lens: Array, points: Array) -> tuple[Array, Array, Array]:
    """Pixels (N, 2) of points before a camera (N, 3) [m], their slopes by point and by lens."""
    still = np.zeros(3)
    matrix = np.array(
        [[lens[0], 0.0, lens[2]], [0.0, lens[1], lens[3]], [0.0, 0.0, 1.0]]
    )
    seen, slopes = opencv().projectPoints(
        points.reshape(-1, 1, 3), still, still, matrix, lens[4:]
    )
    slopes = slopes.reshape(len(points), 2, -1)
    return seen.reshape(-1, 2), slopes[:, :, 3:6], slopes[:, :, 6:15]


class _Camera:
    """Corners of one camera, all pictures in one array."""

    def __init__(self, number: int, shots: Shots, layout: Layout) -> None:
        self.number = number
        self.in_hand = shots.in_hand
        self.rows = shots.rows
        self.board = layout.board_of(shots.in_hand)
        self.counts = [len(points) for points in shots.points]
        ends = np.cumsum(self.counts)
        self.parts = [
            slice(end - count, end)
            for end, count in zip(ends, self.counts, strict=True)
        ]
        self.motion = np.repeat(
            shots.rows, self.counts
        )  # (N,), that each corner was seen at
        self.points = np.concatenate(shots.points)
        self.corners = np.concatenate(shots.corners)
        self.bending = bending(self.points, shots.outline)
        camera = 6 * number + np.arange(6)
        board = 6 * (layout.cameras + self.board) + np.arange(6)
        square = np.array([layout.square(self.board)])
        values = np.concatenate([layout.lens(number), layout.shape(self.board), square])
        places = 6 * layout.frames + values
        self.unknowns = np.concatenate([camera, board, places])

    def look(self, layout: Layout, unknowns: Unknowns, motions: Array) -> _Sight:
        """See the board at each motion (n, 4, 4), its errors included."""
        x = unknowns.frames[self.number]
        y = unknowns.frames[layout.cameras + self.board]
        shape = unknowns.values[layout.shape(self.board)]
        scale = np.exp(unknowns.values[layout.square(self.board)])
        true = motions[self.rows]
        errors = unknowns.errors[self.rows]
        true[:, :3, :3] = true[:, :3, :3] @ exponential(errors[:, :3])
        true[:, :3, 3] += errors[:, 3:]
        if self.in_hand:
            true = inverse(true)
        before = inverse(x) @ true  # what stands beyond the motion, in the camera
        seen = before @ y
        points = (self.points + self.bending @ shape) * scale
        places = np.empty_like(points)
        turned = np.empty((len(points), 3, 3))
        for pose, part in zip(seen, self.parts, strict=True):
            places[part] = points[part] @ pose[:3, :3].T + pose[:3, 3]
            turned[part] = pose[:3, :3]
        pixels, by_point, by_lens = project(
            unknowns.values[layout.lens(self.number)], places
        )
        by_turn = np.cross(
            places[:, None], by_point
        )  # of the whole scene about the camera
        inward = by_point @ turned
        by_shape = scale * inward @ self.bending
        by_size = inward @ points[:, :, None]
        slopes = np.concatenate([by_turn, by_point, by_lens, by_shape, by_size], axis=2)
        return _Sight(pixels, slopes, self._scene(x, before, seen))

    def _scene(self, x: Array, before: Array, seen: Array) -> Array:
        """How the scene turns and shifts (p, 6, 18) by camera, board and the motion's errors."""
        scene = np.zeros((len(seen), 6, 18))
        back = x[:3, :3].T
        turned = seen[:, :3, :3]
        onward = before[:, :3, :3]
        scene[:, :3, :3] = -np.eye(3)
        scene[:, 3:, 3:6] = -back
        scene[:, :3, 6:9] = turned
        scene[:, 3:, 6:9] = cross_matrix(seen[:, :3, 3]) @ turned
        scene[:, 3:, 9:12] = onward
        if self.in_hand:
            scene[:, :3, 12:15] = -back
            scene[:, 3:, 12:15] = cross_matrix(back @ x[:3, 3]) @ back
            scene[:, 3:, 15:] = -onward
        else:
            scene[:, :3, 12:15] = onward
            scene[:, 3:, 12:15] = cross_matrix(before[:, :3, 3]) @ onward
            scene[:, 3:, 15:] = back
        return scene

    def sums(self, sight: _Sight, sd: float) -> _Sums:
        """The sums over each picture; `sd` is that of a corner [px]."""
        residuals = self.corners - sight.pixels
        length = np.linalg.norm(residuals, axis=1)
        root = np.sqrt(_huber(length, sd))
        weighed = sight.slopes * root[:, None, None]
        residuals = residuals * root[:, None]
        few = weighed.shape[2]
        products = np.empty((len(self.parts), few, few))
        pulls = np.empty((len(self.parts), few))
        for k, part in enumerate(self.parts):
            flat = weighed[part].reshape(-1, few)
            products[k] = flat.T @ flat
            pulls[k] = flat.T @ residuals[part].ravel()
        chain = np.zeros((len(self.parts), few, few + 12))
        chain[:, :6, :12] = sight.scene[:, :, :12]
        chain[:, :6, -6:] = sight.scene[:, :, 12:]
        chain[:, 6:, 12:-6] = np.eye(few - 6)
        across = np.swapaxes(chain, 1, 2)
        return _Sums(
            residuals,
            length,
            across @ products @ chain,
            (across @ pulls[:, :, None])[:, :, 0],
        )


@dataclass(frozen=True, eq=False)
class _Sight:
    """What a camera sees of its board."""

    pixels: Array  # (N, 2)
    slopes: Array  # (N, 2, 6 + 24), by the scene's turn and shift, lens, shape and size
    scene: Array  # (p, 6, 18), how the scene moves by camera, board and the motion's errors


class Bundle:
    """Corners of some cameras and the motions that they were seen at."""

    def __init__(
        self, shots: Sequence[Shots], motions: Motions, scales: Sequence[Scale]
    ) -> None:
        boards = tuple(dict.fromkeys(each.in_hand for each in shots))
        self.layout = Layout(len(shots), boards, motions.size)
        self.motions = motions
        self.scales = scales
        self.cameras = [_Camera(k, each, self.layout) for k, each in enumerate(shots)]

    def predict(self, unknowns: Unknowns) -> list[Array]:
        """Pixels (N, 2) of each camera's corners."""
        motions = self.motions.poses(unknowns.values[self.layout.arm_values])
        return [
            camera.look(self.layout, unknowns, motions).pixels
            for camera in self.cameras
        ]

    def solve(
        self,
        start: Unknowns,
        noise: Noise,
        mean: Array,
        steps: int = _STEPS,
        learn: bool = True,
    ) -> Fit:
        """Levenberg-Marquardt, the sizes of noise by the evidence at each step.

        mean : (v,), prior mean of the values
        learn : whether the noise is found, or stays as given
        Raises LinAlgError where the pictures do not tell the unknowns.
        """
        layout = self.layout
        free = np.concatenate([np.arange(6 * layout.frames), self._free(noise)])
        fit = Fit(start, noise, np.zeros((layout.size, layout.size)), np.inf, ())
        sums = self._sums(start, noise)
        damping = 1e-4
        for count in range(steps):
            normal = self._normal(fit.unknowns, fit.noise, sums)
            step, errors, spread, certain = self._step(fit, normal, mean, free, damping)
            if not np.isfinite(step).all():
                raise np.linalg.LinAlgError("the fit of corners and motions diverged")
            there = fit.unknowns.moved(step, errors)
            ahead = self._sums(there, fit.noise)
            cost = self._cost(there, fit.noise, mean, ahead)
            if cost > (1 + 1e-9) * self._cost(fit.unknowns, fit.noise, mean, sums):
                if damping > _STIFF:
                    break
                damping = max(damping, 1e-6) * 10.0
                continue
            damping *= 0.1
            covariance = np.zeros_like(fit.covariance)
            covariance[np.ix_(free, free)] = spread
            before = fit.noise
            residuals = tuple(each.residuals for each in ahead)
            fit = Fit(there, before, covariance, fit.freedom, residuals)
            if learn:
                fit = self._learned(fit, ahead, mean, certain)
            sums = ahead
            if count > 4 and _settled(before, fit.noise):
                break
        return fit

    def motion_errors(self, fit: Fit) -> tuple[Array, Array]:
        """Errors (n, 6) of all motions as the corners tell them, and their covariance (n, 6, 6).

        The unknowns of all pictures stay as they are; their doubt is part of the covariance.
        """
        loose = np.diag(
            np.repeat([1.0, 1.0], 3)
        )  # 1 rad and 1 m: none, beside what corners tell
        unknowns = fit.unknowns
        for _ in range(_OWN_STEPS):
            normal = self._normal(unknowns, fit.noise, self._sums(unknowns, fit.noise))
            spread = np.linalg.inv(normal.own + loose)
            pull = normal.own_pull - unknowns.errors @ loose
            step = np.einsum("nij,nj->ni", spread, pull)
            unknowns = replace(unknowns, errors=unknowns.errors + step)
        follow = spread @ np.swapaxes(
            normal.across, 1, 2
        )  # (n, 6, s), how they follow unknowns
        spread = spread + follow @ fit.covariance @ np.swapaxes(follow, 1, 2)
        return unknowns.errors, np.asarray(spread, float)

    def _free(self, noise: Noise) -> Index:
        return 6 * self.layout.frames + np.flatnonzero(noise.prior > 0.0)

    def _sums(self, unknowns: Unknowns, noise: Noise) -> list[_Sums]:
        motions = self.motions.poses(unknowns.values[self.layout.arm_values])
        sums = []
        for camera, sd in zip(self.cameras, noise.corner, strict=True):
            sums.append(camera.sums(camera.look(self.layout, unknowns, motions), sd))
        return sums

    def _normal(
        self, unknowns: Unknowns, noise: Noise, sums: Sequence[_Sums]
    ) -> _Normal:
        layout = self.layout
        count = self.motions.count
        by_arm = self.motions.slopes(unknowns.values[layout.arm_values])
        places = 6 * layout.frames + layout.arm_values
        shared = np.zeros((layout.size, layout.size))
        across = np.zeros((count, layout.size, 6))
        own = np.zeros((count, 6, 6))
        pull = np.zeros(layout.size)
        own_pull = np.zeros((count, 6))
        for camera, each in zip(self.cameras, sums, strict=True):
            weight = noise.corner[camera.number] ** -2
            products = weight * each.products
            pulls = weight * each.pulls
            some = camera.unknowns
            shared[np.ix_(some, some)] += products[:, :-6, :-6].sum(axis=0)
            pull[some] += pulls[:, :-6].sum(axis=0)
            # a camera has one picture of each motion
            across[camera.rows[:, None], some] += products[:, :-6, -6:]
            own[camera.rows] += products[:, -6:, -6:]
            own_pull[camera.rows] += pulls[:, -6:]
        if layout.arm:  # the arm's parameters move the motions as their errors do
            flat = by_arm.reshape(-1, layout.arm)
            both = np.swapaxes(across, 0, 1).reshape(layout.size, -1) @ flat
            through = own @ by_arm
            shared[:, places] += both
            shared[places] += both.T
            shared[np.ix_(places, places)] += flat.T @ through.reshape(-1, layout.arm)
            across[:, places] += np.swapaxes(through, 1, 2)
            pull[places] += np.einsum("nik,ni->k", by_arm, own_pull)
        return _Normal(shared, across, own, pull, own_pull)

    def _step(
        self, fit: Fit, normal: _Normal, mean: Array, free: Index, damping: float
    ) -> tuple[Array, Array, Array, Array]:
        """Step (s,) and errors' step (n, 6); covariances of the free unknowns and the errors."""
        precision, slope = self._prior(fit.unknowns, fit.noise, mean)
        certain = np.repeat(fit.noise.pose**-2, 3)
        back = np.linalg.inv(normal.own + np.diag(certain))
        pull = normal.own_pull - certain * fit.unknowns.errors
        across = normal.across[:, free]
        gain = across @ back
        whole = normal.shared[np.ix_(free, free)] + np.diag(precision[free])
        before = np.diag(whole).copy()
        flat_gain = np.swapaxes(gain, 0, 1).reshape(len(free), -1)
        flat_across = np.swapaxes(across, 0, 1).reshape(len(free), -1)
        whole -= flat_gain @ flat_across.T
        wanted = normal.pull[free] - slope[free] - np.einsum("nij,nj->i", gain, pull)
        ruler = np.sqrt(np.maximum(np.diag(whole), 1e-12 * before))
        normed = whole / np.outer(ruler, ruler)
        spread = np.linalg.pinv(normed, rcond=1e-13, hermitian=True) / np.outer(
            ruler, ruler
        )
        some = (
            np.linalg.solve(normed + damping * np.eye(len(free)), wanted / ruler)
            / ruler
        )
        step = np.zeros(self.layout.size)
        step[free] = some
        errors = np.einsum("nij,nj->ni", back, pull) - np.einsum(
            "nji,j->ni", gain, some
        )
        known = np.einsum("nii->ni", back) + (gain * (spread @ gain)).sum(axis=1)
        return step, errors, spread, known

    def _prior(
        self, unknowns: Unknowns, noise: Noise, mean: Array
    ) -> tuple[Array, Array]:
        """Precision (s,) of the unknowns before any picture, and the slope (s,) of its energy."""
        precision = np.zeros(self.layout.size)
        slope = np.zeros(self.layout.size)
        some = np.flatnonzero(noise.prior > 0.0)
        places = 6 * self.layout.frames + some
        precision[places] = noise.prior[some] ** -2
        slope[places] = precision[places] * (unknowns.values - mean)[some]
        return precision, slope

    def _cost(
        self, unknowns: Unknowns, noise: Noise, mean: Array, sums: Sequence[_Sums]
    ) -> float:
        slope = self._prior(unknowns, noise, mean)[1][6 * self.layout.frames :]
        total = float(slope @ (unknowns.values - mean))
        total += float(((unknowns.errors / np.repeat(noise.pose, 3)) ** 2).sum())
        for each, sd in zip(sums, noise.corner, strict=True):
            weights = _huber(each.lengths, sd)
            total += float((weights * each.lengths**2).sum()) / sd**2
        return total

    def _learned(
        self, fit: Fit, sums: Sequence[_Sums], mean: Array, certain: Array
    ) -> Fit:
        """The fit with the noise that its residuals tell."""
        noise = fit.noise
        errors = fit.unknowns.errors
        # what corners tell of each motion beyond its prior counts as known numbers
        known = 1.0 - certain / np.repeat(noise.pose**2, 3)
        numbers = np.maximum([known[:, :3].sum(), known[:, 3:].sum()], 0.5)
        freedom = float(numbers.sum())
        squares = (errors**2).reshape(-1, 2, 3).sum(axis=(0, 2)) / numbers
        pose = noise.pose * np.exp(_FASTER[1] * _bounded(squares, noise.pose))
        fitted = (freedom + int((noise.prior > 0.0).sum())) / len(self.cameras)
        corner = []
        for camera, each in zip(self.cameras, sums, strict=True):
            residuals = each.residuals
            left = max(residuals.size - fitted, 0.2 * residuals.size)
            # errors of a picture's corners hang together: what is left of them in its pose counts
            directions = 6 * len(camera.parts)
            open_directions = max(directions - freedom - 12, 0.1 * directions)
            corner.append(
                max((residuals**2).sum() / left, each.together / open_directions)
            )
        sd = noise.corner * np.exp(
            _FASTER[0] * _bounded(np.array(corner), noise.corner)
        )
        prior = noise.prior.copy()
        variance = np.diag(fit.covariance)[6 * self.layout.frames :]
        for scale in self.scales:
            some = scale.indices[prior[scale.indices] > 0.0]
            if len(some):
                told = max(float((1.0 - variance[some] / prior[some] ** 2).sum()), 0.05)
                square = float(((fit.unknowns.values - mean)[some] ** 2).sum()) / told
                change = np.exp(
                    _FASTER[2] * _bounded(np.array([square]), prior[some[:1]])[0]
                )
                prior[some] = np.clip(
                    prior[some[0]] * change, scale.lowest, scale.highest
                )
        sizes = Noise(
            np.maximum(sd, _LEAST_CORNER), np.maximum(pose, _LEAST_POSE), prior
        )
        return replace(fit, noise=sizes, freedom=freedom)


def _settled(before: Noise, after: Noise) -> bool:
    """Whether sizes change by less than a hundredth, those of the prior by a twentieth."""
    corner = np.log(after.corner / before.corner)
    pose = np.log(after.pose / before.pose)[after.pose > _LEAST_POSE]
    free = before.prior > 0.0
    prior = np.log(after.prior[free] / before.prior[free])
    changes = np.abs(np.concatenate([corner, pose, 0.1 * prior]))
    return bool(changes.max() < 0.01)


def _huber(lengths: Array, sd: float) -> Array:
    """Weights (N,) of residuals of some lengths (N,) [px]."""
    return np.asarray(np.minimum(1.0, _HUBER * sd / np.maximum(lengths, 1e-12)))


def _bounded(squares: Array, sd: Array) -> Array:
    """Log of the step from sizes to those that squares tell, no larger than one."""
    return np.clip(0.5 * np.log(np.maximum(squares, 1e-300) / sd**2), -1.0, 1.0)
