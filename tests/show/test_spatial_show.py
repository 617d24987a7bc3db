"""Reports and previews of arms in space: what is drawn is what the model says."""

from __future__ import annotations

import numpy as np
import pytest
from models import in_pixels, in_space, trained
from scenes import objects

from calib.arm.loading import arm_from_urdf
from calib.body.curves import curve_value
from calib.body.sensor import SensorPose
from calib.show.preview.arm import DrawnArm
from calib.show.preview.placement import place_model
from calib.show.preview.scene import draw
from calib.show.preview.server import Live
from calib.show.report import space
from calib.show.report.evidence import gather
from calib.show.report.page import SECTIONS


@pytest.fixture(scope="module")
def scene():
    return draw(in_space())


@pytest.fixture(scope="module")
def evidence():
    return gather(in_space())


def test_positions_are_drawn_where_the_tool_is_in_the_robots_frame(scene):
    model = in_space()
    arm = arm_from_urdf(model.about.urdf)
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (20, 3))
    drawn = scene.placement.lift(model.forward(q))
    held = model.body.beta[model.body.structure.groups["tool"]]
    assert np.linalg.norm(drawn - arm.forward(q), axis=1) == pytest.approx(
        np.linalg.norm(held), abs=5e-3
    )


def test_layers_of_an_arm_in_space(scene):
    names = [layer["name"] for layer in scene.canvas.layers]
    assert "Workspace border" not in names
    assert [n for n in names if n in ("Error cloud", "Slices")] == ["Error cloud", "Slices"]
    found = objects(scene)
    assert {"Error cloud/points", "Slices/points", "Sensory map/nodes"} <= set(found)
    points = found["Slices/points"]["points"]
    level = np.abs(points[:, 2] - np.median(points[len(points) // 2 :, 2])) < 1e-6
    upright = (points - points[0]) @ scene.placement.frame[2]
    assert level.sum() > 200
    assert (np.abs(upright) < 1e-6).sum() > 200
    assert (level | (np.abs(upright) < 1e-6)).all()


def test_a_target_is_dragged_in_the_plane_that_the_viewer_faces(scene):
    model = in_space()
    point = scene.placement.lift(model.forward(model.about.lower * 0.3 + model.about.upper * 0.7))
    answer = Live(model).answer({"at": point.tolist()})
    assert answer["reachable"]
    assert answer["target"] == pytest.approx(point.tolist(), abs=1e-9)


def test_every_section_of_a_report_is_drawn(evidence):
    drawn = {s.name: s.draw(evidence) for s in SECTIONS}
    assert [name for name, figure in drawn.items() if figure is None] == ["photo"]
    assert "enlarged" in drawn["vectors"].axes[1].get_title()
    flat = gather(trained())
    assert not any(s.draw(flat) for s in SECTIONS if s.name in ("vectors", "joints", "curves"))


def test_a_joint_curve_is_the_bodys_within_its_interval(evidence):
    model = in_space()
    figure = space.joint_curves(evidence)
    for k, ax in enumerate(figure.axes[:3]):
        (line,) = ax.lines
        q = np.radians(line.get_xdata())
        own = 1e3 * curve_value(q, model.body.beta[model.body.structure.groups[f"curve.{k}"]])
        assert line.get_ydata() == pytest.approx(own, abs=1e-9)
        band = ax.collections[0].get_paths()[0].vertices
        assert np.ptp(band[:, 1]) > np.ptp(own)


def test_errors_by_joint_are_means_of_the_rows(evidence):
    figure = space.by_joint(evidence)
    mean = figure.axes[0].lines[0].get_ydata()
    errors = 1e3 * evidence.residuals.errors["local"]
    assert errors.min() < mean.min() <= errors.mean() <= mean.max() < errors.max()


def test_a_picture_stands_where_its_camera_sees_it():
    model = in_pixels()
    placement = place_model(model, DrawnArm.of(model.about))
    structure = model.body.structure
    sensor = SensorPose.of(model.body)
    camera, turn = sensor.position, sensor.rotation
    f, u, v, _ = structure.lens
    pixels = np.array([[u, v], [u + 100, v], [u, v + 50]])
    rays = (placement.lift(pixels) - camera) @ turn
    depth = rays[0, 2]
    np.testing.assert_allclose(
        rays, [[0, 0, depth], [100 * depth / f, 0, depth], [0, 50 * depth / f, depth]], atol=1e-9
    )
    assert 1.5 < depth < 2.5
    assert placement.frame[1] @ turn[:, 1] == pytest.approx(-1.0)
    seen = gather(model)
    drawn = {s.name: s.draw(seen) for s in SECTIONS if s.name in ("joints", "vectors")}
    assert drawn["joints"] is not None
    assert drawn["vectors"] is None
