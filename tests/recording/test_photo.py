"""The map over a photo: what is kept in the model, and that positions are where they were seen."""

import numpy as np
import pytest

pytest.importorskip("cv2")
from PIL import Image
from rendering import Camera, Desk
from scenes import data_of, objects, page_of

import calib
from calib.samples.tables import write_table

CAMERA = Camera(size=(1280, 720))
DESK = Desk(CAMERA, lengths=(0.18, 0.16), offsets=(0.0, 0.0))
SOURCE = {"unit": "px", "size": [1280, 720], "reference": {"kind": "pixels"}, "photo": "seen.png"}


@pytest.fixture(scope="module")
def made(tmp_path_factory, run):
    """Models of pixels with and without a photo, whose right half is bright."""
    folder = tmp_path_factory.mktemp("photo")
    rng = np.random.default_rng(0)
    q = rng.uniform([0.0, 0.2], [1.3, 1.6], (40, 2))
    x = DESK.tip_pixels(q) + rng.normal(0, 0.05, (40, 2))
    columns = {"a": q[:, 0], "b": q[:, 1], "x": x[:, 0], "y": x[:, 1]}
    write_table(folder / "log.csv", columns, about=SOURCE)
    left, right = np.full((720, 640), 40, np.uint8), np.full((720, 640), 200, np.uint8)
    Image.fromarray(np.hstack([left, right])).save(folder / "seen.png")
    train = ("train", "--data", folder / "log.csv", "--joints", "a,b", "--size", 8)
    shown = ("--photo", folder / "seen.png", "-o", folder / "with.calib")
    wrong = run(*train, "--photo", folder / "log.csv", "-o", folder / "with.calib")
    assert "log.csv is no picture or video" in wrong.err
    for line in (shown, ("--no-photo", "-o", folder / "bare.calib")):
        run.done(*train, *line)
    return calib.load(folder / "with.calib"), calib.load(folder / "bare.calib"), x


def test_the_map_is_drawn_over_the_photo(made):
    model, bare, _ = made
    assert bare.photo is None
    grey = model.photo.pixels()[..., 0].astype(int)
    middle = grey.shape[1] // 2
    assert abs(grey[:, : middle - 9] - 40).max() < 9
    assert abs(grey[:, middle + 9 :] - 200).max() < 9
    assert "photo" not in calib.figures(bare)
    ax = calib.figures(model)["photo"].axes[0]
    assert ax.get_xlim() == (-0.5, 1279.5)
    assert ax.get_ylim() == (719.5, -0.5)  # y down, clipped to the picture
    (tips,) = ax.lines
    np.testing.assert_allclose(np.column_stack(tips.get_data()), model.rows.x)
    data = data_of(page_of(model))
    assert data["layers"][0]["name"] == "Photo"
    assert "Photo" not in [layer["name"] for layer in data_of(page_of(bare))["layers"]]
    # the picture's first row is up, seen from where the camera of the page is
    points = objects(data)["Photo/picture"]["points"]
    assert points[-1][1] > points[0][1]
