"""Tags and boards in rendered pictures, against the renderer's own projection."""

import re
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import refused
from rendering import Camera, Desk, board, board_shots, tag

from calib import LogError
from calib.recording.board import parse_board
from calib.recording.lens import calibrate_lens, load_lens
from calib.recording.tags import TagFinder
from calib.samples.lens import Lens

SMALL = Camera(size=(640, 480), focal=600.0)
BOARD = parse_board("7x5:24mm:18mm:5x5_100")


def test_the_tip_is_found_to_a_tenth_of_a_pixel_among_decoys():
    rng = np.random.default_rng(0)
    desk = Desk(SMALL, still=(tag(3, 0.03, (0.0, 0.25, 0, 0.3)), tag(12, 0.05, (0.4, 0.2, 0, 1))))
    finder = TagFinder(wanted=[7])
    q = desk.postures(12, rng)
    errors = []
    for row in q:
        found = finder.find(desk.picture(row, rng))
        assert [t.number for t in found] == [7]
        errors.append(found[0].centre - desk.tip_pixels(row)[0])
    assert np.sqrt(np.square(errors).sum(1).mean()) < 0.1
    assert np.abs(np.mean(errors, axis=0)).max() < 0.05


def test_board_corners_are_where_the_renderer_puts_them():
    rng = np.random.default_rng(5)
    # the second one is cut by the picture's border
    for place, count in (((0.3, 0.0, 0.0, 0.4), 24), ((0.2, -0.2, 0.0, -0.4), 13)):
        sticker = board(7, 5, 0.024, 0.018, place)
        desk = Desk(still=(sticker,))
        found = BOARD.find(desk.picture([2.5, 0.3, 0.3], rng))
        turn, middle = sticker.frame
        corners = BOARD.corners() - [*np.array(BOARD.size) / 2, 0.0]  # from the lower left
        truth = desk.camera.project(corners @ turn.T + middle)
        assert len(found) == count
        miss = np.array([found[n] - truth[n] for n in found])
        assert np.sqrt((miss**2).sum(1).mean()) < 0.03
        assert np.abs(miss.mean(0)).max() < 0.01  # half a pixel is a convention, not noise


def test_lens_round_trip(tmp_path, monkeypatch):
    numbers = np.array([600.0, 602.0, 318.0, 243.0, -0.15, 0.04, 1e-3, -2e-3, 0.01])
    lens = Lens.of((640, 480), numbers)
    pixels = np.random.default_rng(0).uniform([0, 0], [640, 480], (200, 2))
    assert np.allclose(lens.distort(lens.undistort(pixels)), pixels, atol=1e-9)
    mine = lens.undistort(pixels)
    theirs = cv2.undistortPoints(pixels.reshape(-1, 1, 2), lens.matrix, lens.distortion)
    assert np.abs(mine - theirs.reshape(-1, 2)).max() < 1e-4  # OpenCV stops early
    lens.save(tmp_path / "lens.json")
    again = load_lens(tmp_path / "lens.json")[0]
    assert (again.distort(mine) == lens.distort(mine)).all()
    known = replace(lens, covariance=np.diag(np.arange(9.0)))
    known.save(tmp_path / "lens.json")
    assert (load_lens(tmp_path / "lens.json")[0].covariance == known.covariance).all()
    assert again.size == lens.size
    # another lens is not written over it
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((480, 640), np.uint8))
    monkeypatch.setattr("calib.recording.lens.calibrate_lens", lambda *_: lens.plus(np.ones(9)))
    refused(LogError, "600.0 px, not 601", load_lens, tmp_path, BOARD, tmp_path / "lens.json")


def test_a_lens_is_calibrated_from_pictures_of_a_board():
    rng = np.random.default_rng(6)
    desk = Desk(Camera(size=(640, 360), focal=550.0))
    pictures = board_shots(desk, board(7, 5, 0.024, 0.018, (0, 0, 0, 0)), 8, rng)
    lens = calibrate_lens([BOARD.find(p) for p in pictures], BOARD, desk.camera.size)
    assert lens.rms < 0.09
    assert abs(lens.focal[0] / desk.camera.focal - 1) < 0.005
    seen = (550.0, 550.0, *desk.camera.centre, desk.camera.k1)
    truth = Lens.of(desk.camera.size, np.array([*seen, 0.0, 0.0, 0.0, 0.0]))
    free = np.diag(lens.covariance) > 0
    assert free.tolist() == [True] * 5 + [False] * 4  # k1 alone is needed
    away = (lens.parameters - truth.parameters)[free] / np.sqrt(np.diag(lens.covariance)[free])
    assert np.abs(away).max() < 4.0  # it knows how well it is known
    assert 1e-4 < np.sqrt(lens.covariance[0, 0]) / lens.focal[0] < 5e-3
    grid = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.2, 0.2, 5)), -1)
    seen = truth.distort(grid.reshape(-1, 2))
    again = lens.undistort(seen)
    # what a pose cannot make good: the rays' angles between each other
    assert np.abs((again - again.mean(0)) - (grid.reshape(-1, 2) - grid.mean((0, 1)))).max() < 6e-3


def rasterised(svg, per_mm):
    """Draw the rectangles of an SVG: an independent reader of what is printed."""
    width, height = map(float, re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg).groups())
    canvas = np.full((round(height * per_mm), round(width * per_mm)), 255, np.uint8)
    for rect in re.findall(r"<rect[^>]*>", svg):
        value = dict(re.findall(r'(x|y|width|height|fill)="([^"]*)"', rect))
        x, y, w, h = (float(value.get(k, 0)) * per_mm for k in ("x", "y", "width", "height"))
        grey = 255 if value.get("fill") == "#fff" else 0
        canvas[round(y) : round(y + h), round(x) : round(x + w)] = grey
    return canvas


def test_a_printed_tag_has_its_true_size_and_is_found(run, tmp_path):
    run.done("tag", 7, "--size", "40mm", "-o", tmp_path / "tag.svg")
    svg = (tmp_path / "tag.svg").read_text()
    assert re.search(r'width="116mm" height="68mm"', svg)
    found = TagFinder().find(rasterised(svg, 5))
    assert [t.number for t in found] == [7]
    assert abs(found[0].side - 40 * 5) < 0.5


@pytest.mark.parametrize("is_upward", [False, True])
def test_tags_of_a_grid_are_found_in_rows_down_or_up_but_for_one_that_is_there_twice(is_upward):
    grid, known = parse_board("grid:3x2:60mm:20mm:t36h11"), cv2.aruco.DICT_APRILTAG_36h11
    page = np.full((300, 500), 255, np.uint8)
    places = grid.points()[::4, :2] * 1000 + 30
    for number, (x, y) in enumerate([*places.astype(int), (300, 200)]):
        row, column = divmod(number % 6, 3)
        number = 3 * (1 - row) + column if is_upward else number % 6
        cells = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(known), number, 60)
        page[y : y + 60, x : x + 60] = cells
    found = grid.find(page)
    assert sorted(found) == list(range(4, 24))  # of the first there are two
    miss = np.array([*found.values()]) - (grid.points()[4:, :2] * 1000 + 29.5)
    assert np.abs(miss).max() < 0.5


def test_opencv_is_asked_for_in_one_line_and_never_imported_early():
    code = (
        "import sys, calib, calib_cli, calib.recording.setting\n"
        "from calib.recording.tags import TagFinder\n"
        "print('cv2' in sys.modules)\n"
        "sys.modules['cv2'] = None\n"
        "try:\n    TagFinder()\nexcept calib.CalibError as error:\n    print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("False\n")
    assert "or in a checkout pip install '.[camera]'" in done.stdout
