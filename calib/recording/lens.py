"""Lens: of a file of calib, ROS or OpenCV, of a model, or calibrated by pictures of a board."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..common.arrays import Array
from ..common.atomic import FilePath
from ..errors import LogError, OptionError
from ..samples.lens import Lens
from .board import LEAST_CORNERS, LEAST_PICTURES, Pattern
from .documents import Json, parse_document, values_of
from .pictures import list_pictures, one_thread, opencv, read_series

if TYPE_CHECKING:
    from ..model.model import Model

MATRIX = "camera_matrix|cameraMatrix|CameraMatrix|intrinsic_matrix|mtx|K|k"
DISTORTION = (
    "distortion_coefficients|distCoeffs|dist_coeffs|distortion|dist|D|d"
)
WIDTH = "image_width|imageWidth|width"
HEIGHT = "image_height|imageHeight|height"
"""Keys in YAML or JSON."""

_FISHEYE = ("equidistant", "fisheye", "kannala")
_TERMS = 5  # k1, k2, p1, p2, k3

UNSTATED = (0, 0)
"""Size of pictures where a file has none."""

_DOUBT = 0.03  # largest sd of the focal length, over it
_TANGENTIAL = 10  # pictures that can determine tangential distortion


def calibrate_lens(
    corners: Sequence[Mapping[int, Array]],
    board: Pattern,
    size: tuple[int, int],
) -> Lens:
    """Fit a lens to pictures of a board held at different angles.

    Schwarz's criterion selects one, two or four terms of distortion: terms that the pictures do not
    determine would be arbitrary near the border, where no board was.

    corners : places (2,) [px] by number that each picture shows, see `Pattern.find`
    size : width and height of the pictures [px]
    Raises LogError if too few pictures show the board, or it was never tilted.
    """
    cv2 = opencv()
    usable = [shown for shown in corners if len(shown) >= LEAST_CORNERS]
    if len(usable) < LEAST_PICTURES:
        raise LogError(
            f"the board is in {len(usable)} of {len(corners)} pictures of the lens (at most "
            f"{max(map(len, corners), default=0)} corners found, {LEAST_CORNERS} expected in "
            f"each): take {LEAST_PICTURES} or more, 10 are better, near and tilted, and check the "
            "board's numbers"
        )
    world = board.corners().astype(np.float32)
    objects = [world[list(shown)] for shown in usable]
    images = [np.array([*shown.values()], np.float32) for shown in usable]
    count = 2 * sum(map(len, images))
    least = np.inf
    doubt = np.inf
    for terms, flags in _flags_by_terms(len(images)).items():
        with suppress(cv2.error), one_thread():
            rms, matrix, bends, *poses = cv2.calibrateCamera(
                objects, images, size, None, None, flags=flags
            )
            # below 0.001 px the misfit is rounding, and its logarithm would decide
            score = count * np.log(max(rms, 1e-3) ** 2) + terms * np.log(count)
            if score < least:
                least = score
                lens = Lens.of(size, lens_parameters(matrix, bends), float(rms))
                covariance = _covariance(objects, lens, terms, *poses)
                doubt = float(np.sqrt(covariance[0, 0]) / lens.focal[0])
    if not doubt <= _DOUBT or not lens.focal.max() <= 50 * max(size):
        raise LogError(
            f"the pictures of the board determine the focal length to {min(100 * doubt, 100):.3g} "
            "% only, 3 % expected: tilt the board this way and that between them"
        )
    return replace(lens, covariance=covariance)


def _flags_by_terms(pictures: int) -> dict[int, int]:
    """OpenCV's flags of the lenses to try, by their number of terms."""
    cv2 = opencv()
    one = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2
    flags = {1: one, 2: one & ~cv2.CALIB_FIX_K2}
    if pictures >= _TANGENTIAL:
        flags[4] = cv2.CALIB_FIX_K3
    return flags


def lens_parameters(matrix: Array, bends: ArrayLike) -> Array:
    """Parameters (9,) of a camera matrix (3, 3) and up to five terms of distortion."""
    terms = np.append(bends, np.zeros(_TERMS))[:_TERMS]
    return np.concatenate([np.diag(matrix)[:2], matrix[:2, 2], terms])


def _covariance(
    objects: Sequence[NDArray[np.float32]],
    lens: Lens,
    terms: int,
    turns: Sequence[Array],
    shifts: Sequence[Array],
) -> Array:
    """Covariance (9, 9) of a lens, by its derivatives without what each picture's pose explains."""
    free = 4 + terms
    count = 2 * sum(map(len, objects))
    precision = np.zeros((free, free))
    for points, *pose in zip(objects, turns, shifts, strict=True):
        slopes = opencv().projectPoints(
            points, *pose, lens.matrix, lens.distortion
        )[1]
        by_pose, by_lens = np.split(slopes[:, : 6 + free], [6], axis=1)
        along = np.linalg.lstsq(by_pose, by_lens, rcond=None)[0]
        by_lens = by_lens - by_pose @ along
        precision += by_lens.T @ by_lens
    # rms is of distances: half of its square along each axis
    share = count / max(count - 6 * len(objects) - free, 1)
    covariance = np.zeros((9, 9))
    covariance[:free, :free] = np.linalg.pinv(precision)
    return 0.5 * lens.rms**2 * share * covariance


def _lens_of_file(path: Path) -> Lens:
    """The lens of a file of calib, ROS or OpenCV, or of a model.

    Raises LogError where it has none, where numbers are not finite, or where the lens is of
    another kind.
    """
    if path.suffix == ".calib":
        from ..model_file.loading import load

        return lens_of_model(load(path))
    try:
        text = path.read_text(encoding="utf-8")
        document = parse_document(text)
        if "calib lens" in values_of(document, "kind"):
            return Lens.from_json(document)
        matrix = _numbers(document, MATRIX).reshape(3, 3)
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = str(error).partition("\n")[0]
        raise LogError(
            f"{path} is no lens ({reason}): expected calib's lens.json, ROS's camera_info, or "
            "OpenCV's cameraMatrix and distCoeffs, in YAML or JSON, or pictures of the board"
        ) from None
    bent = _numbers(document, DISTORTION)
    focal = np.diag(matrix)[:2]
    is_finite = np.isfinite(np.append(matrix, bent)).all()
    if not is_finite or not focal.min() > 0.0:
        raise LogError(
            f"{path}: focal lengths {focal.tolist()}, distortion {bent.tolist()}: expected finite "
            "numbers and focal lengths above zero"
        )
    if any(word in text.lower() for word in _FISHEYE) or bent[_TERMS:].any():
        raise LogError(
            f"{path} is a fisheye or rational lens ({len(bent)} terms): expected up to five, k1, "
            "k2, p1, p2, k3; leave the lens out to have it fitted"
        )
    sides = np.append(_numbers(document, WIDTH), _numbers(document, HEIGHT))
    size = (int(sides[0]), int(sides[1])) if len(sides) == 2 else UNSTATED
    return Lens.of(size, lens_parameters(matrix, bent))


def lens_of_model(model: Model) -> Lens:
    """The lens behind a model of pictures of a board; LogError of other models."""
    board: Any = model.about.board
    try:
        return Lens.from_json(board["lens"])
    except (KeyError, TypeError, ValueError):
        raise LogError(
            "the model is not of pictures of a board: expected one that calib handeye -o wrote"
        ) from None


def refuse_size(lens: Lens | None, size: tuple[int, int], what: str) -> None:
    """Refuse pictures of another size (width, height) than the lens's."""
    if lens is None or tuple(lens.size) in (size, UNSTATED):
        return
    raise LogError(
        "{} is {}x{}, the lens was calibrated with {}x{}: expected the lens of this camera at this "
        "size; leave `lens` out to have it fitted".format(
            what, *size, *lens.size
        )
    )


def load_lens(
    path: FilePath,
    board: Pattern | None = None,
    output: FilePath | None = None,
) -> tuple[Lens, tuple[str, ...]]:
    """Read a lens of calib, ROS or OpenCV, or a model's; or calibrate by pictures of a board.

    path : a file, or a folder or pattern of pictures
    board : that the pictures show
    output : file to which a calibrated lens is written
    Returns the lens and notes. Raises LogError if the file is no lens.
    """
    if not Path(path).is_dir() and not any(mark in str(path) for mark in "*?["):
        return _lens_of_file(Path(path)), ()
    if board is None:
        raise OptionError(
            "`lens` is a folder of pictures: expected `board` too, which they show"
        )
    notes: list[str] = []
    corners = []
    size = (0, 0)
    for _, _, grey in read_series(list_pictures(path), notes):
        size = (grey.shape[1], grey.shape[0])
        corners.append(board.find(grey))
    lens = calibrate_lens(corners, board, size)
    notes.append(
        f"lens of {len(corners)} pictures: focal length {lens.focal[0]:.1f} px, corners miss their "
        f"places by {lens.rms:.2f} px rms"
    )
    if output is not None:
        other = _lens_of_file(Path(output)) if Path(output).exists() else lens
        if other.parameters.tolist() != lens.parameters.tolist():
            raise LogError(
                f"{output} is there already, of another focal length ({other.focal[0]:.1f} px, "
                f"not {lens.focal[0]:.1f})",
                hint="give it as `lens`, or move it away",
            )
        lens.save(output)
        notes.append(f"lens written to {os.fspath(output)}")
    return lens, tuple(notes)


def _numbers(document: Json, keys: str) -> Array:
    """The numbers under the first of some keys, in order; none where no key is there."""
    for key in keys.split("|"):
        for value in values_of(document, key):
            if isinstance(value, dict):
                value = value.get("data")
            with suppress(TypeError, ValueError):
                return np.array(value, float).ravel()
    return np.zeros(0)
