"""From a camera's detections to an arm: errors in mm, and what a board found again is taken for.

Detections are the renderer's own projection with 0.03 px of noise, what rendered pictures give;
`benchmarks/camera.py` renders the pictures as well.
"""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("cv2")
from rendering import Camera, Desk

import calib
from calib.errors import CalibError
from calib.recording.board import Board
from calib.recording.lens import Lens
from calib.recording.reference import MarkLayout, watch

NAMES = ("shoulder", "elbow", "wrist")
LOWER, UPPER = np.array([-0.2, 0.0, -1.2]), np.array([1.3, 1.4, 1.2])
DESK = Desk(lengths=(0.186, 0.1335, 0.0945), offsets=(0.03, -0.045, 0.02))
BUMPED = Camera(position=(0.215, -0.24, 0.905), roll=0.035)
BOARD = Board.parse("7x5:24mm:18mm:5x5_100")
LAYOUT = MarkLayout.of_board(BOARD)
BENT = np.array([DESK.camera.k1, 0.0, 0.0, 0.0, 0.0])
SPREAD = np.diag([0.4, 0.4, 0.6, 0.6, 1e-3, 0, 0, 0, 0]) ** 2  # of a lens of ten pictures
LENS = Lens(DESK.camera.size, np.full(2, DESK.camera.focal), DESK.camera.centre, BENT, 0.02)


def postures(count, seed):
    rng = np.random.default_rng(seed)
    q = rng.uniform(LOWER, UPPER, (20 * count, 3))
    p = DESK.tip_pixels(q)
    inside = ((p > 40) & (p < np.array(DESK.camera.size) - 40)).all(1)
    return q[inside][:count]


def samples(q, x, unit="px", shared=0.0):
    source = {"noise_of_reference": shared}
    return calib.Samples(q, x, NAMES, LOWER, UPPER, (True,) * 3, unit=unit, source=source)


def seen(desk, q, rng):
    return desk.tip_pixels(q) + rng.normal(0, 0.03, (len(q), 2))


def by_board(desk, q, seed):
    """Positions on a board that is found anew, with a lens that is known to its covariance."""
    rng = np.random.default_rng(seed)
    points = BOARD.corners()
    corners = desk.camera.project(points) + rng.normal(0, 0.01, (len(points), 2))
    lens = replace(LENS, covariance=SPREAD).moved(rng.normal(0, np.sqrt(np.diag(SPREAD))))
    found, _ = watch(LAYOUT, {0: dict(enumerate(corners))}, lens)
    pixels = seen(desk, q, rng)
    x, common = found.positions(pixels), found.noise(pixels)[1]
    return samples(q, x, "m", float(np.sqrt(np.mean(common**2)))), found, lens


@pytest.fixture(scope="module")
def in_pixels():
    q = postures(58, 0)
    return calib.train(samples(q, seen(DESK, q, np.random.default_rng(1))), size=10)


@pytest.fixture(scope="module")
def in_metres():
    return calib.train(by_board(DESK, postures(58, 0), 1)[0], size=10)


def worst(model, desk):
    """Mean and largest error over the learned range [m]."""
    q = postures(300, 9)
    q = q[((q >= model.about.lower) & (q <= model.about.upper)).all(1)]
    x = model.forward(q)
    if model.about.unit == "m":
        away = np.linalg.norm(x - desk.tip(q), axis=1)
    else:
        away = np.linalg.norm(x - desk.tip_pixels(q), axis=1) * 0.95e-3  # the farthest pixel
    return away.mean(), away.max()


def test_pixels_alone_and_metres_of_a_board_make_an_arm(in_pixels, in_metres):
    for model, limit in ((in_pixels, 0.1e-3), (in_metres, 0.2e-3)):
        mean, most = worst(model, DESK)
        assert mean < limit
        assert most < 0.5e-3


def test_a_bumped_camera_is_named_and_adapted_to(in_pixels):
    desk = replace(DESK, camera=BUMPED)
    q = postures(40, 3)
    log = samples(q, seen(desk, q, np.random.default_rng(4)))
    drift = calib.check(in_pixels, log)
    assert drift.drifted
    assert drift.causes[0].cause == "sensor"
    mean, _ = worst(calib.adapt(in_pixels, log).model, desk)
    assert mean < 0.1e-3


def test_a_board_found_again_is_no_change_and_a_longer_link_is(in_metres):
    q = postures(40, 3)
    scores = []
    for seed in range(2, 5):
        log, _, _ = by_board(replace(DESK, camera=BUMPED), q, seed)
        scores.append(calib.check(in_metres, log).score)
    assert max(scores) < 1.0
    blind = calib.check(in_metres, replace(log, source={}))
    assert blind.score > max(scores)
    longer = replace(DESK, camera=BUMPED, lengths=(0.186, 0.1365, 0.0945))
    drift = calib.check(in_metres, by_board(longer, q, 2)[0])
    assert drift.drifted
    assert drift.causes[0].cause == "length:elbow"


def marks(count=10, place=lambda k: DESK.camera):
    """What pictures show of the board, each with a camera of its own."""
    rng, points = np.random.default_rng(3), BOARD.corners()
    return {
        k: dict(enumerate(place(k).project(points) + rng.normal(0, 0.03, (len(points), 2))))
        for k in range(count)
    }


@pytest.mark.parametrize("scale", [lambda k: 1.0 + 0.004 * (k % 3), lambda k: 1.0 + 0.01 * (k > 4)])
def test_a_camera_that_refocuses_or_is_bumped_is_refused(scale):
    refocused = marks(place=lambda k: replace(DESK.camera, focal=DESK.camera.focal * scale(k)))
    with pytest.raises(CalibError, match=r"of another size, .*autofocus"):
        watch(LAYOUT, refocused, LENS)
    bumped = marks(place=lambda k: BUMPED if k > 5 else DESK.camera)
    with pytest.raises(CalibError, match="in 4 of 10 pictures: was the camera bumped"):
        watch(LAYOUT, bumped, LENS)
