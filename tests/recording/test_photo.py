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


def marked(pixels: np.ndarray, path) -> None:
    """Write a grey picture with a white spot at each pixel."""
    y, x = np.mgrid[: CAMERA.size[1], : CAMERA.size[0]]
    grey = np.full(x.shape, 60.0)
    for u, v in pixels:
        grey += 190.0 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / 60.0)
    Image.fromarray(np.clip(grey, 0, 255).astype(np.uint8)).save(path)


def spot(photo, near: np.ndarray) -> np.ndarray:
    """Return where the bright spot near a position is, by the photo's own borders."""
    pixels = photo.pixels().astype(float)[..., 0]
    left, right, low, high = photo.box
    rows, columns = pixels.shape
    x = left + (np.arange(columns) + 0.5) * (right - left) / columns
    y = high + (np.arange(rows) + 0.5) * (low - high) / rows
    reach = 12 * (right - left) / columns
    close = (np.abs(x - near[0]) < reach)[None] & (np.abs(y - near[1]) < reach)[:, None]
    weight = np.where(close, np.maximum(pixels - 90.0, 0.0), 0.0)
    return np.array([(weight.sum(0) * x).sum(), (weight.sum(1) * y).sum()]) / weight.sum()


@pytest.fixture(scope="module")
def made(tmp_path_factory, run):
    """Models of pixels with and without a photo, with spots where three tips were seen."""
    folder = tmp_path_factory.mktemp("photo")
    rng = np.random.default_rng(0)
    q = rng.uniform([0.0, 0.2], [1.3, 1.6], (40, 2))
    x = DESK.tip_pixels(q) + rng.normal(0, 0.05, (40, 2))
    columns = {"a": q[:, 0], "b": q[:, 1], "x": x[:, 0], "y": x[:, 1]}
    write_table(folder / "log.csv", columns, about=SOURCE)
    marked(x[:3], folder / "seen.png")
    train = ("train", "--data", folder / "log.csv", "--joints", "a,b", "--size", 8)
    shown = ("--photo", folder / "seen.png", "-o", folder / "with.calib")
    for line in (shown, ("--no-photo", "-o", folder / "bare.calib")):
        done = run(*train, *line)
        assert done.code == 0, done.err
    return calib.load(folder / "with.calib"), calib.load(folder / "bare.calib"), x


def test_a_kept_photo_shows_each_pixel_where_it_was(made):
    model, bare, x = made
    assert bare.photo is None
    for place in x[:3]:
        assert np.allclose(spot(model.photo, place), place, atol=0.3)


def test_the_map_is_drawn_over_the_photo(made):
    model, bare, _ = made
    assert "photo" not in calib.figures(bare)
    ax = calib.figures(model, names=["photo"])["photo"].axes[0]
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
