"""The drawing of a planar arm is read off its chain."""

import numpy as np
import pytest
from planar import chain_urdf

import calib
from calib.arm.loading import arm_from_urdf
from calib.body.drawing import PlanarDrawing
from calib.body.planar import planar_structure
from calib.errors import OptionError

NAMES = ("joint_1", "joint_2", "joint_3")


@pytest.mark.parametrize("slide", [None, 0, 1, 2])
@pytest.mark.parametrize("axis", ["0 0 1", "0 0 -1"])
def test_it_is_where_the_arm_is(slide, axis):
    text = chain_urdf(3, slide=slide).replace('<axis xyz="0 0 1"/>', f'<axis xyz="{axis}"/>', 1)
    arm = arm_from_urdf(text, NAMES, "tip", planar=True)
    drawing = PlanarDrawing.of(arm)
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (50, 3))
    x = arm.forward(q)
    structure = planar_structure(x, NAMES, arm.revolute, drawing, "base")
    structure = structure.with_sensor(mirror=drawing.mirror)
    np.testing.assert_allclose(structure.predict(q, structure.neutral()), x, atol=1e-12)


def test_an_arm_in_space_has_none():
    with pytest.raises(OptionError, match="no planar chain"):
        PlanarDrawing.of(calib.load_arm("spatial_three"))
