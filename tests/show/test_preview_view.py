"""Preview: placement, border, camera, motion and the scale of errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from models import measured, trained
from scenes import paths, project

import calib
from calib.arm.rotations import similarity
from calib.show.error_scale import STOPS, UNKNOWN, ErrorScale, colours, length_in_words, rgb
from calib.show.preview.arm import DrawnArm
from calib.show.preview.motion import drive
from calib.show.preview.placement import Viewpoint, place_model
from calib.show.preview.scene import draw
from calib.show.workspace import level_lines, outline


def test_a_similarity_is_found_mirrored_or_not():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(50, 2))
    for mirror in (1.0, -1.0):
        turn = 2.5 * np.array([[0.6, 0.8 * mirror], [-0.8, 0.6 * mirror]])
        found, shift, scale = similarity(x, x @ turn + [3.0, -1.0], mirrored=True)
        np.testing.assert_allclose(scale * found.T, turn, atol=1e-12)
        np.testing.assert_allclose(shift, [3.0, -1.0], atol=1e-12)


@pytest.mark.parametrize("robot", ["two_link", "tilted", "scara"])
def test_positions_are_drawn_at_their_true_place(robot: str):
    model, arm = trained(robot, n=400, size=8), calib.load_arm(robot)
    placement = place_model(model, DrawnArm.of(model.about))
    x = np.array([[0.1, 0.2], [0.3, -0.1]])
    np.testing.assert_allclose(placement.lift(x), arm.plane.lift(x), atol=1e-9)
    assert placement.note == ""


def test_a_camera_that_counts_pixels_is_brought_to_the_robot():
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, 500, seed=0)
    seen = replace(
        log, x=log.x @ np.array([[0.0, 900.0], [900.0, 0.0]]) + 400.0, unit="px", simulation=None
    )
    model = calib.train(seen, size=8)
    placement = place_model(model, DrawnArm.of(model.about))
    assert "least-squares" in placement.note
    drawn = placement.lift(seen.x)
    assert np.linalg.norm(drawn - arm.plane.lift(log.x), axis=1).max() < 5e-3


def test_without_a_urdf_the_map_is_drawn_at_a_size_that_can_be_seen():
    model = measured()
    scene = draw(replace(model, about=replace(model.about, urdf="", plane=None)))
    assert any("no URDF" in note for note in scene.notes)
    assert "Sensory map/lattice" in paths(scene)
    assert not any(path.startswith("Arm") for path in paths(scene))


def test_level_lines_of_a_circle():
    x = np.linspace(-2, 2, 81)
    r = np.hypot(*np.meshgrid(x, x, indexing="ij"))
    lines = level_lines(x, x, r, 1.0)
    np.testing.assert_allclose(np.linalg.norm(lines, axis=2), 1.0, atol=2e-3)
    length = np.linalg.norm(lines[:, 0] - lines[:, 1], axis=1).sum()
    assert abs(length - 2 * np.pi) < 0.01


def test_border_of_two_link_lies_on_its_limits():
    model = trained("two_link", n=3000, size=20)
    lines = outline(model)
    length = np.linalg.norm(lines[:, 0] - lines[:, 1], axis=1).sum()
    inner = np.sqrt(0.3**2 + 0.25**2 + 2 * 0.3 * 0.25 * np.cos(np.radians(150)))
    outer = np.sqrt(0.3**2 + 0.25**2 + 2 * 0.3 * 0.25 * np.cos(np.radians(15)))
    turn = np.radians(90) * (inner + outer) + 2 * np.radians(135) * 0.25
    assert abs(length / turn - 1) < 0.05
    radius = np.linalg.norm(lines, axis=2)
    assert inner - 0.01 < radius.min()
    assert radius.max() < outer + 1e-6


def test_the_camera_shows_everything_in_any_window():
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (200, 3)) * [0.5, 0.3, 0.1]
    for frame in (np.eye(3), np.eye(3)[[0, 2, 1]] * [[1], [1], [-1]], np.eye(3)[[1, 2, 0]]):
        camera = Viewpoint.onto(points, frame)
        for width, height, panel in ((900, 700, 280), (1440, 900, 280), (500, 900, 0)):
            pixels = project(camera, points, width, height, panel)
            assert (pixels[:, 0] > panel).all()
            assert (pixels[:, 0] < width).all()
            assert (pixels[:, 1] > 0).all()
            assert (pixels[:, 1] < height).all()


def test_x_leads_right_and_y_up():
    camera = Viewpoint.onto(np.eye(3), np.eye(3))
    pixels = project(camera, [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], 800, 600)
    assert pixels[1, 0] > pixels[0, 0] + 5
    assert abs(pixels[1, 1] - pixels[0, 1]) < 1
    assert pixels[2, 1] < pixels[0, 1] - 5


@pytest.mark.parametrize("robot", ["two_link_full", "three_link", "polar"])
def test_the_path_is_followed_without_jumps(robot: str):
    model = trained(robot, n=3000, size=20)
    motion = drive(model)
    assert motion.true
    step = np.abs(np.diff(motion.q, axis=0)) / model.motor.scale.span
    assert step.max() < 0.08
    np.testing.assert_allclose(motion.q[0], motion.q[-1], atol=1e-6)
    arm = calib.load_arm(robot)
    np.testing.assert_allclose(motion.reached, arm.forward(motion.q), atol=1e-12)
    assert motion.deviation.max() < 1e-3


def test_lengths_in_words():
    words = [length_in_words(v, "m") for v in (2.0, 0.5, 1e-3, 2.34e-5, 5e-9, 1e-12, 0.0)]
    assert words == ["2 m", "500 mm", "1 mm", "23.4 µm", "5 nm", "below 1 nm", "0"]
    assert length_in_words(0.99999e-3, "m") == "1 mm"
    assert length_in_words(float("nan"), "m") == "unknown"


def test_error_scales():
    rounding = ErrorScale.of(np.array([1e-13, 3e-12]), "m", 0.5)
    assert rounding.rounding
    assert rounding.words() == "below 1 nm everywhere"
    assert rounding.share(np.array([1e-13, np.nan])).tolist()[0] == 0.0
    narrow = ErrorScale.of(np.linspace(0.9, 1.0, 100) * 1e-3, "m", 0.5)
    assert not narrow.log
    assert narrow.low > 0.8e-3
    wide = ErrorScale.of(np.geomspace(1e-6, 1e-3, 100), "m", 0.5)
    assert wide.log
    for scale in (narrow, wide):
        shares = np.linspace(0, 1, 7)
        values = np.array([scale.value(s) for s in shares])
        np.testing.assert_allclose(scale.share(values), shares, atol=1e-9)
    pixels = ErrorScale.of(np.array([1e-8]), "px", 600.0)
    assert pixels.rounding
    assert "px" in pixels.words()


def test_colours_rise_evenly_in_lightness_and_have_no_ends_that_vanish():
    tint = colours(np.linspace(0, 1, 50)).astype(float) / 255
    linear = np.where(tint <= 0.04045, tint / 12.92, ((tint + 0.055) / 1.055) ** 2.4)
    light = linear @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(light) > 0).all()
    assert light[0] > 0.02
    assert light[-1] < 0.6
    assert colours(np.array([np.nan]))[0].tolist() == list(rgb(UNKNOWN))
    assert colours(np.array([0.0]))[0].tolist() == list(rgb(STOPS[0]))
