"""The map over a photo: what is kept in the model, and that positions are where they were seen."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("cv2")
from PIL import Image
from rendering import Camera, Desk
from scenes import data_of, objects, page_of

import calib
from calib.errors import CalibError
from calib.model.about import Photo
from calib.model_file.loading import from_bytes
from calib.model_file.storage import to_bytes
from calib.recording.photo import WIDEST, take_photo
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


def spot(photo: Photo, near: np.ndarray) -> np.ndarray:
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
def made(tmp_path_factory):
    """A small model of pixels, its log, and a photo with spots where three tips were seen."""
    folder = tmp_path_factory.mktemp("photo")
    rng = np.random.default_rng(0)
    q = rng.uniform([0.0, 0.2], [1.3, 1.6], (40, 2))
    x = DESK.tip_pixels(q) + rng.normal(0, 0.05, (40, 2))
    columns = {"a": q[:, 0], "b": q[:, 1], "x": x[:, 0], "y": x[:, 1]}
    write_table(folder / "log.csv", columns, about=SOURCE)
    marked(x[:3], folder / "seen.png")
    model = calib.train(calib.read_log(folder / "log.csv", joints=["a", "b"]), size=8)
    return folder, model, x


def with_photo(made) -> calib.Model:
    folder, model, x = made
    return replace(model, photo=take_photo(folder / "seen.png", x, "px", SOURCE))


def test_a_kept_photo_shows_each_pixel_where_it_was(made):
    photo = with_photo(made).photo
    assert max(photo.pixels().shape) == WIDEST
    for place in made[2][:3]:
        assert np.allclose(spot(photo, place), place, atol=0.3)


def test_the_model_keeps_its_photo(made):
    model = with_photo(made)
    data = to_bytes(model)
    again = from_bytes(data)
    assert again.photo == model.photo
    assert to_bytes(model) == data
    assert 0 < len(data) - len(to_bytes(made[1])) - len(model.photo.jpeg) < 500
    with pytest.raises(CalibError, match="photo cannot be read"):
        Photo(b"\xff\xd8\xff and no more", (0, 1, 0, 1)).pixels()
    for jpeg, box in ((b"GIF89a", (0, 1, 0, 1)), (b"\xff\xd8\xff", (1, 0, 0, 1))):
        with pytest.raises(ValueError, match=r"JPEG|no box"):
            Photo(jpeg, box)


@pytest.mark.parametrize(
    ("change", "unit", "match"),
    [
        ({"size": [640, 480]}, "px", "by the same camera"),
        ({"reference": None}, "m", "does not say where its camera was"),
        ({"reference": {"kind": "flat", "matrix": [0] * 9}}, "m", "does not say where its camera"),
        ({"shift": 5000.0}, "px", "shows 0 % of the positions only"),
        ({"file": "none.png"}, "px", "none.png is no picture"),
        ({"file": "log.csv"}, "px", "no video that OpenCV can read"),
    ],
)
def test_photos_that_do_not_belong(made, change, unit, match):
    folder, _, x = made
    name = change.pop("file", "seen.png")
    shift = change.pop("shift", 0.0)
    with pytest.raises(CalibError, match=match) as caught:
        take_photo(folder / name, x + shift, unit, SOURCE | change)
    assert "\n" not in str(caught.value)


def test_the_map_is_drawn_over_the_photo(made):
    model = with_photo(made)
    assert "photo" not in calib.figures(made[1])
    ax = calib.figures(model, names=["photo"])["photo"].axes[0]
    assert ax.get_xlim() == (-0.5, 1279.5)
    assert ax.get_ylim() == (719.5, -0.5)  # y down, clipped to the picture
    (tips,) = ax.lines
    np.testing.assert_allclose(np.column_stack(tips.get_data()), model.rows.x)
    data = data_of(page_of(model))
    assert data["layers"][0]["name"] == "Photo"
    assert "Photo" not in [layer["name"] for layer in data_of(page_of(made[1]))["layers"]]
    # the picture's first row is up, seen from where the camera of the page is
    points = objects(data)["Photo/picture"]["points"]
    assert points[-1][1] > points[0][1]
