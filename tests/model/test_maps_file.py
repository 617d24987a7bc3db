"""Maps in files of their own: what is read is what was saved, and nothing else is read."""

import numpy as np
import pytest
from models import trained

import calib


def test_maps_are_read_as_they_were_saved(tmp_path):
    association = trained("two_link", n=400, size=4).association
    for maps in (association, association.motor):
        path = tmp_path / "maps.calib"
        maps.save(path)
        again = calib.load_maps(path)
        assert type(again) is type(maps)
        first = path.read_bytes()
        again.save(path)
        assert path.read_bytes() == first
    association.save(path)
    q = np.array([[0.5, 1.0], [1.0, 2.0]])
    np.testing.assert_array_equal(calib.load_maps(path).predict(q), association.predict(q))


def test_files_that_are_no_maps_are_refused_in_a_line(tmp_path):
    model = trained("two_link", n=400, size=4)
    path = tmp_path / "model.calib"
    model.save(path)
    with pytest.raises(calib.ModelError, match="no file of maps"):
        calib.load_maps(path)
    with pytest.raises(calib.ModelError, match="no such file"):
        calib.load_maps(tmp_path / "none.calib")
    model.association.save(path)
    with pytest.raises(calib.ModelError):
        calib.load(path)
    content = bytearray(path.read_bytes())
    content[-3] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(calib.ModelError, match="checksum"):
        calib.load_maps(path)
