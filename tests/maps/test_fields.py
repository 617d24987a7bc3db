"""A gain of one's own in a map, and what no gain may be."""

import numpy as np
import pytest
from small_maps import points

import calib
from calib import OptionError

X = points(600)


def test_a_gain_draws_nodes():
    def right(visit: calib.Visit):
        assert visit.weights.shape == (64, 2)
        return 1.0 + 20.0 * visit.progress * (visit.weights[visit.winners, 0] > 0.7)

    drawn = calib.SOM((8, 8), map=right).fit(X)
    plain = calib.SOM((8, 8), map="som").fit(X)
    assert (drawn.units[:, 0] > 0.7).sum() > 1.3 * (plain.units[:, 0] > 0.7).sum()


WRONG = {
    "shape": lambda n: np.ones(n + 1),
    "a scalar": lambda n: 1.0,
    "negative": lambda n: np.where(np.arange(n) == 3, -1.0, 1.0),
    "nan": lambda n: np.full(n, np.nan),
    "infinite": lambda n: np.full(n, np.inf),
    "zeros": np.zeros,
    "text": lambda n: "gain",
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
@pytest.mark.parametrize("rule", ["batch", "online"])
def test_a_gain_that_makes_no_sense_is_an_error(wrong, rule):
    som = calib.SOM((4, 4), map=lambda visit: wrong(len(visit.winners)), rule=rule, epochs=2)
    with pytest.raises(OptionError, match="gain returned"):
        som.fit(X)
