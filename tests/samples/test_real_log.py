"""The real arm: a UR10 measured with a laser tracker, learned from its log alone."""

from pathlib import Path

import numpy as np
import pytest

import calib
from calib.samples.wrong_rows import screen

FOLDER = Path(__file__).parents[3] / "shared/data/ur10_laser_tracker"
JOINTS = ["shoulder_lift_joint", "elbow_joint"]

pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(),
    reason="the UR10 laser tracker data are not in ../shared/data beside the repository",
)


@pytest.mark.parametrize(("series", "most"), [("a", 0.25e-3), ("c", 0.30e-3)])
def test_blocks_held_out_of_a_series_are_predicted(series, most):
    samples = calib.read_log(FOLDER / f"series_{series}.csv", joints=JOINTS)
    model = calib.train(samples)
    errors = model.about.errors["local"]
    assert errors["forward"]["distance"]["mean"] <= most
    assert errors["inverse"]["distance"]["mean"] <= most
    bound = model.expected_error(samples.q)
    known = np.isfinite(bound)
    assert known.mean() > 0.999  # but for a row or two far from all others
    assert most / 10 < bound[known].mean() < 4 * most
    assert model.about.bound_of == "sensor reading"


@pytest.mark.parametrize("series", ["a", "c"])
def test_no_row_of_the_real_arm_contradicts_its_neighbours(series):
    samples = calib.read_log(FOLDER / f"series_{series}.csv", joints=JOINTS)
    assert screen(samples)[0].all()
