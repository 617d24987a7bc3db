"""The drawing of a planar arm is read off its chain."""

import numpy as np
import pytest
from planar import chain_urdf

import calib
from calib.arm.loading import arm_from_urdf
from calib.body.drawing import LinearChain, PlanarDrawing
from calib.errors import OptionError

NAMES = ("joint_1", "joint_2", "joint_3")


@pytest.mark.parametrize("slide", [None, 0, 1, 2])
@pytest.mark.parametrize("axis", ["0 0 1", "0 0 -1"])
def test_it_is_the_chain_that_fits_the_arms_own_positions(slide, axis):
    text = chain_urdf(3, slide=slide).replace('<axis xyz="0 0 1"/>', f'<axis xyz="{axis}"/>', 1)
    arm = arm_from_urdf(text, NAMES, "tip", planar=True)
    drawing = PlanarDrawing.of(arm)
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (50, 3))
    tip = arm.forward(q) @ (1, 1j)
    chain = LinearChain.of(q, tip, drawing.signs, drawing.mirror, arm.revolute)
    assert chain.miss.max() < 1e-12
    np.testing.assert_allclose(drawing.lengths, chain.drawing.lengths, atol=1e-12)
    np.testing.assert_allclose(drawing.offsets, chain.drawing.offsets, atol=1e-12)
    np.testing.assert_allclose(drawing.shift, chain.drawing.shift, atol=1e-12)
    assert drawing.rotation == pytest.approx(chain.drawing.rotation, abs=1e-12)


def test_an_arm_in_space_has_none():
    with pytest.raises(OptionError, match="no planar chain"):
        PlanarDrawing.of(calib.load_arm("spatial_three"))
