"""Maps of a few nodes and points of the unit box, for the tests of maps."""

import numpy as np

from calib import Map
from calib.common.scale import TURN, Scale
from calib.maps.lattice import Lattice


def points(n, seed=0, d=2):
    return np.random.default_rng(seed).random((n, d))


def box(*periodic):
    """The unit box of some coordinates; a periodic one is a turn."""
    return Scale(np.zeros(len(periodic)), np.where(periodic, TURN, 1.0), np.array(periodic))


UNIT_BOX = box(False, False)


def network(units, shape, scale=UNIT_BOX):
    return Map(np.array(units, dtype=float), Lattice(shape), scale, np.zeros((0, 4)))


def grid(n, periodic=(False, False)):
    """Nodes in the middle of n cells along each coordinate."""
    shape = (n,) * len(periodic)
    return network((Lattice(shape).positions() + 0.5) / n, shape, box(*periodic))
