"""Tags and boards in rendered pictures; logs from pictures and films of a tag, and a photo."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from conftest import refused
from PIL import ExifTags, Image
from reference import table, write_columns
from rendering import Camera, Desk, board, board_shots, tag, write_video
from scenes import data_of, objects, page_of

import calib
from calib import CalibError, LogError, OptionError
from calib.recording.board import parse_board
from calib.recording.lens import calibrate_lens, load_lens
from calib.recording.motion_tables import read_joints
from calib.recording.tag_logs import TagScene, log_pictures, log_video
from calib.recording.tags import TagFinder
from calib.samples.lens import Lens

CAMERA = Camera(size=(640, 480), focal=600.0)
BOARD = parse_board("5x4:40mm:31mm:5x5_100")
AROUND = {20: (-0.02, -0.08), 21: (0.4, -0.08), 22: (0.4, 0.3), 23: (-0.02, 0.3)}
CORNERS = tuple(tag(n, 0.04, (*at, 0.0, 0.1 * n)) for n, at in AROUND.items())
LENS = Lens.of(CAMERA.size, np.array([600.0, 600.0, *CAMERA.centre, CAMERA.k1, 0, 0, 0, 0]))


TWO = {"lengths": (0.18, 0.16), "offsets": (0.0, 0.0)}  # links


def desk(**more):
    lying = board(5, 4, 0.04, 0.031, (0.29, -0.02, 0.0, 0.1))
    return Desk(**{"camera": CAMERA, "still": (lying, *CORNERS), "height": 0.025, **more})


def truth_on_board(scene, q):
    sticker = scene.still[0]
    turn, at = sticker.frame
    world = np.c_[scene.tip(q), np.full(len(q), scene.height)]
    return ((world - at) @ turn)[:, :2] + np.array(BOARD.size) / 2


def take(folder, scene, q, rng, first=0):
    """Take a picture at each of the postures."""
    for k, row in enumerate(q, first):
        cv2.imwrite(str(folder / "p" / f"img_{k}.png"), scene.picture(row, rng))


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    """Sixteen pictures, named so that their order is not that of the alphabet."""
    folder, scene = tmp_path_factory.mktemp("shot"), desk()
    rng = np.random.default_rng(0)
    (folder / "p").mkdir()
    q = scene.postures(16, rng, margin=30)
    take(folder, scene, q, rng)
    table(folder / "joints.csv", "abc", q)
    LENS.save(folder / "lens.json")
    return SimpleNamespace(folder=folder, scene=scene, q=q, pictures=folder / "p")


@pytest.fixture
def copy(shot, tmp_path):
    """The same, to be spoilt."""
    shutil.copytree(shot.folder, tmp_path / "s")
    return SimpleNamespace(folder=tmp_path / "s", scene=shot.scene, q=shot.q)


def make(folder, scene=None, joints="joints.csv", **more):
    return log_pictures(folder / "p", read_joints(folder / joints), scene or TagScene(7), **more)


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """Eight seconds at 20 frames a second, stops between moves; joints by a clock of their own."""
    folder = tmp_path_factory.mktemp("film")
    rng = np.random.default_rng(5)
    scene = Desk(Camera(size=(400, 300), focal=380.0), **TWO, shadow=0.0)
    goals = rng.uniform([0.1, 0.2], [1.2, 1.4], (16, 2))

    def joints(t):
        t = np.atleast_1d(t)
        k = np.clip((t / 0.9).astype(int), 0, 14)
        s = np.clip((t / 0.9 - k) / 0.5, 0, 1)[:, None]
        s = s**3 * (10 - 15 * s + 6 * s**2)
        return goals[k] * (1 - s) + goals[k + 1] * s

    frames = np.arange(0, 8, 0.05)
    pictures = [scene.picture(q, rng) for q in joints(frames + 1.0)]
    pictures[33] = scene.picture(goals[2], rng)  # at rest the tag is seen elsewhere, once
    write_video(str(folder / "run.mp4"), pictures, 20.0)
    time = np.arange(0, 12, 0.01)
    rows = table(folder / "joints.csv", ("time", "a", "b"), np.c_[time + 50.0, joints(time)])
    return SimpleNamespace(folder=folder, scene=scene, joints=read_joints(rows))


def test_pixels_in_the_order_of_numbers(shot):
    made = make(shot.folder)
    assert made.unit == "px"
    assert tuple(made.pictures[9:12]) == ("img_9.png", "img_10.png", "img_11.png")
    assert np.sqrt(((made.x - shot.scene.tip_pixels(shot.q)) ** 2).sum(1).mean()) < 0.1
    assert made.source["dropped"] == {}
    assert 0.01 < made.source["noise"] < 0.1


def test_rows_find_their_pictures_by_name(copy):
    order = np.random.default_rng(1).permutation(16)
    lines = [f"folder/img_{k}.png,{','.join(map(repr, copy.q[k].tolist()))}" for k in order]
    (copy.folder / "named.csv").write_text("\n".join(["picture,a,b,c", *lines[:-1]]))
    made = make(copy.folder, joints="named.csv")
    assert tuple(made.pictures) == tuple(f"img_{k}.png" for k in order[:-1])
    assert np.abs(made.x - copy.scene.tip_pixels(copy.q[order[:-1]])).max() < 0.3
    assert any("1 pictures, without joints, are left out" in note for note in made.notes)


def test_metres_by_the_board_and_the_height_and_the_pose_by_the_size_of_the_tag(shot):
    scene = TagScene(7, board=BOARD, lens=LENS, tag_height=0.025)
    made = make(shot.folder, scene)
    miss = np.linalg.norm(made.x - truth_on_board(shot.scene, shot.q), axis=1)
    assert made.unit == "m"
    assert np.sqrt((miss**2).mean()) < 1e-3  # a small picture, 1.5 mm a pixel
    assert 0.3 * np.sqrt((miss**2).mean()) < 2 * made.source["noise"] < 5e-3
    flat = make(shot.folder, TagScene(7, board=BOARD, lens=LENS))
    assert np.linalg.norm(flat.x - made.x, axis=1).max() > 5e-3
    # of a tag whose size is known, its pose
    made = make(shot.folder, TagScene(7, board=BOARD, lens=LENS, tag_size=0.04))
    assert made.x.shape == (16, 3)
    assert np.abs(made.x[:, 2] - 0.025).max() < 0.02
    angle = shot.q.sum(1) - shot.scene.still[0].place[3]
    turned = 2 * np.arctan2(made.orientation[:, 2], made.orientation[:, 3])
    assert np.abs(np.angle(np.exp(1j * (turned - angle)))).max() < 0.02


def test_a_bump_within_a_recording_is_told(shot, copy):
    bumped = desk(camera=Camera(CAMERA.size, CAMERA.focal, position=(0.205, -0.25, 0.9)))
    rng = np.random.default_rng(3)
    scene = TagScene(7, board=BOARD, lens=LENS, tag_height=0.025)
    take(copy.folder, bumped, copy.q[13:], rng, 13)
    made = make(copy.folder, scene)
    assert tuple(made.pictures) == tuple(f"img_{k}.png" for k in range(13))
    assert any("3 pictures left out: the reference is elsewhere" in note for note in made.notes)
    assert np.linalg.norm(made.x - truth_on_board(copy.scene, made.q), axis=1).max() < 2.5e-3
    take(copy.folder, bumped, copy.q[10:13], rng, 10)
    refused(CalibError, "in 6 of 16 pictures: was the camera bumped", make, copy.folder, scene)


def test_an_arm_or_a_tag_that_never_moves(copy):
    table(copy.folder / "same.csv", "abc", np.tile(copy.q[0], (16, 1)))
    refused(CalibError, "never moves", make, copy.folder, joints="same.csv")
    for k in range(1, 16):
        shutil.copy(copy.folder / "p" / "img_0.png", copy.folder / "p" / f"img_{k}.png")
    refused(CalibError, "stays at .* while the joints move", make, copy.folder)


def test_joints_that_are_a_row_late_are_refused(tmp_path):
    rng = np.random.default_rng(0)
    (tmp_path / "p").mkdir()
    scene = Desk(CAMERA, **TWO)
    q = rng.uniform([0.1, 0.2], [1.2, 1.4], (80, 2))
    pixels = scene.tip_pixels(q)
    q = q[((pixels > 40) & (pixels < np.array(CAMERA.size) - 40)).all(axis=1)][:22]
    take(tmp_path, scene, q, rng)
    table(tmp_path / "joints.csv", "ab", np.roll(q, 1, axis=0))
    refused(CalibError, "shifted against the pictures: those 1 rows further down", make, tmp_path)


def test_settings_that_cannot_be(shot, copy):
    words = r"tag 8 is in none of 16 pictures: .* show .*7 \(\d+ times\)"
    refused(CalibError, words, make, shot.folder, TagScene(8))
    refused(CalibError, "may be off by centimetres", TagScene, 7, board=BOARD)
    refused(CalibError, "`tag_height` is given without", TagScene, 7, tag_height=0.02)
    refused(CalibError, "needs `lens`", TagScene, 7, tag_size=0.04)
    refused(CalibError, "printed on the board too", TagScene, 7, "5x5_100", BOARD, lens=LENS)
    refused(CalibError, "expected `board` too", load_lens, shot.pictures, None)
    refused(CalibError, "is no lens", load_lens, shot.folder / "joints.csv", None)
    other = TagScene(7, lens=Lens((320, 240), LENS.focal, LENS.centre, LENS.distortion))
    refused(CalibError, "lens was calibrated with 320x240", make, shot.folder, other)
    path = table(copy.folder / "deg.csv", "abc", np.rad2deg(copy.q))
    refused(CalibError, "are these degrees", read_joints, path)
    assert np.allclose(read_joints(path, degrees=True).q, copy.q)


def test_counts_and_sizes_and_damage(copy):
    folder, upside_down = copy.folder, Image.Exif()
    upside_down[ExifTags.Base.Orientation] = 3
    for path in (folder / "p").iterdir():
        Image.open(path).save(path, exif=upside_down)
    picture = cv2.imread(str(folder / "p" / "img_5.png"), 0)
    (folder / "p" / "img_5.png").unlink()
    for name in ("img_4.png", "img_5.jpg"):
        packed = cv2.imencode(name[-4:], picture)[1].tobytes()
        (folder / "p" / name).write_bytes(packed[: len(packed) // 2])
    (folder / "p" / "img_6.png").write_text("no picture")
    made = make(folder)
    assert len(made) == 13
    assert made.source["dropped"] == {"cut off or damaged": 3}
    assert sum("cut off; left out" in note for note in made.notes) == 2
    assert any("img_6.png is no picture" in note for note in made.notes)
    assert "pictures are 640x480, turned by EXIF 3, as OpenCV" in made.notes[0]
    cv2.imwrite(str(folder / "p" / "img_7.png"), picture[:400])
    refused(CalibError, "img_7.png is 640x400, the pictures before it 640x480", make, folder)
    cv2.imwrite(str(folder / "p" / "img_7.png"), picture)
    refused(CalibError, "img_7.png is 640x480, the pictures .* by EXIF 3", make, folder)
    (folder / "p" / "img_7.png").unlink()
    refused(CalibError, "15 pictures and 16 rows", make, folder)
    for path in (folder / "p").iterdir():
        path.write_text("nothing")
    shutil.copy(folder / "p" / "img_1.png", folder / "p" / "img_7.png")
    refused(CalibError, "no picture in .* can be read", make, folder)


def test_a_video_becomes_rests(film):
    made = log_video(film.folder / "run.mp4", film.joints, TagScene(7))
    assert abs(made.source["time_offset"] - 51.0) < 3e-3
    assert 5 <= len(made) <= 9
    assert np.sqrt(((made.x - film.scene.tip_pixels(made.q)) ** 2).sum(1).mean()) < 0.15
    assert made.source["dropped"]["the arm moves"] > 40
    assert made.source["dropped"]["a jump of the track"] == 1


def test_videos_that_make_no_log(film, tmp_path):
    run, joints, plain = film.folder / "run.mp4", film.joints, TagScene(7)
    text, twice, rows = (tmp_path / name for name in ("text.mp4", "twins.mp4", "p.csv"))
    text.write_text("no video\n" * 200)
    twins = Desk(film.scene.camera, film.scene.lengths, still=(tag(7, 0.06, (0.05, -0.1, 0, 1)),))
    frames = [twins.picture(q, np.random.default_rng(0)) for q in joints.q[:600:50]]
    write_video(str(twice), frames, 20.0)
    rows.write_text("a,b\n0,1\n1,2\n")
    for words, values, options in (
        ("tag 9 is in none of 160 frames: .* show 7", (run, joints, TagScene(9)), {}),
        ("clocks are apart", (run, joints, plain), {"time_offset": 500.0}),
        ("never rests", (run, joints, plain), {"time_offset": 51.3}),
        ("cannot be read", (text, joints, plain), {}),
        ("cannot be read", (tmp_path / "none.mp4", joints, plain), {}),
        ("lens was calibrated with 640x480", (run, joints, TagScene(7, lens=LENS)), {}),
        (r"twice in \d+ of 12 frames \(twins.mp4 at", (twice, joints, plain), {}),
        ("a column 'time'", (run, read_joints(rows), plain), {}),
    ):
        refused(CalibError, words, log_video, *values, **options)
    refused(OptionError, "still", log_video, run, joints, plain, still=-1.0)


def test_the_commands(run, shot, film, tmp_path):
    assert "30 mm" in run.done("tag", 7, "-o", tmp_path / "tag.svg", "--size", "30mm").out
    printed = ("--board", "5x4:40mm:31mm:5x5_100")
    run.done("tag", *printed, "-o", tmp_path / "board.svg")
    joints = ("--joints-file", shot.folder / "joints.csv", "--tag", 7)
    names = [str(shot.pictures / f"img_{k}.png") for k in range(16)]  # or one by one
    seen = ("--picture", tmp_path / "s.png")
    assert "16 rows" in run.done("log", *names, *joints, *seen, "-o", tmp_path / "l.csv").out
    assert cv2.imread(str(tmp_path / "s.png")).shape == (480, 640, 3)
    assert calib.read_log(tmp_path / "l.csv", joints=["a", "b", "c"]).unit == "px"
    metric = (*printed, "--lens", shot.folder / "lens.json", "--tag-height", "25mm")
    run.done("log", shot.pictures, *joints, *metric, "-o", tmp_path / "m.csv")
    log = calib.read_log(tmp_path / "m.csv", joints=["a", "b", "c"])
    assert log.unit == "m"
    assert np.linalg.norm(log.x - truth_on_board(shot.scene, shot.q), axis=1).max() < 3e-3


@pytest.fixture(scope="module")
def photographed(tmp_path_factory, run):
    """Models of pixels with and without a photo, whose right half is bright."""
    folder = tmp_path_factory.mktemp("photo")
    rng = np.random.default_rng(0)
    q = rng.uniform([0.0, 0.2], [1.3, 1.6], (40, 2))
    x = Desk(Camera(), **TWO).tip_pixels(q) + rng.normal(0, 0.05, (40, 2))
    columns = {"a": q[:, 0], "b": q[:, 1], "x": x[:, 0], "y": x[:, 1]}
    source = {"unit": "px", "size": [1280, 720], "reference": {"kind": "pixels"}}
    write_columns(folder / "log.csv", columns, about=source | {"photo": "seen.png"})
    left, right = np.full((720, 640), 40, np.uint8), np.full((720, 640), 200, np.uint8)
    Image.fromarray(np.hstack([left, right])).save(folder / "seen.png")
    train = ("train", "--data", folder / "log.csv", "--joints", "a,b", "--size", 8)
    shown = ("--photo", folder / "seen.png", "-o", folder / "with.calib")
    wrong = run(*train, "--photo", folder / "log.csv", "-o", folder / "with.calib")
    assert "log.csv is no picture or video" in wrong.err
    run.done(*train, *shown)
    run.done(*train, "--no-photo", "-o", folder / "bare.calib")
    return calib.load(folder / "with.calib"), calib.load(folder / "bare.calib")


def test_the_map_is_drawn_over_the_photo(photographed):
    model, bare = photographed
    assert bare.photo is None
    grey = model.photo.pixels()[..., 0].astype(int)
    middle = grey.shape[1] // 2
    assert abs(grey[:, : middle - 9] - 40).max() < 9
    assert abs(grey[:, middle + 9 :] - 200).max() < 9
    assert "photo" not in calib.figures(bare)
    ax = calib.figures(model)["photo"].axes[0]
    limits = (*ax.get_xlim(), *ax.get_ylim())
    assert limits == (-0.5, 1279.5, 719.5, -0.5)  # y down, clipped to the picture
    (tips,) = ax.lines
    np.testing.assert_allclose(np.column_stack(tips.get_data()), model.rows.x)
    data, others = (data_of(page_of(each)) for each in (model, bare))
    names, without = ([layer["name"] for layer in page["layers"]] for page in (data, others))
    assert names[0] == "Photo" not in without
    # the picture's first row is up, seen from where the camera of the page is
    points = objects(data)["Photo/picture"]["points"]
    assert points[-1][1] > points[0][1]


CHARUCO = parse_board("7x5:24mm:18mm:5x5_100")


def test_the_tip_is_found_to_a_tenth_of_a_pixel_among_decoys():
    rng = np.random.default_rng(0)
    desk = Desk(CAMERA, still=(tag(3, 0.03, (0.0, 0.25, 0, 0.3)), tag(12, 0.05, (0.4, 0.2, 0, 1))))
    finder = TagFinder("36h11", [7])
    q = desk.postures(12, rng)
    errors = []
    for row in q:
        found = finder.find(desk.picture(row, rng))
        assert [t.number for t in found] == [7]
        errors.append(found[0].centre - desk.tip_pixels(row)[0])
    assert np.sqrt(np.square(errors).sum(1).mean()) < 0.1
    assert np.abs(np.mean(errors, axis=0)).max() < 0.05


def test_board_corners_are_where_the_renderer_puts_them():
    rng = np.random.default_rng(5)
    # the second one is cut by the picture's border
    for place, count in (((0.3, 0.0, 0.0, 0.4), 24), ((0.2, -0.2, 0.0, -0.4), 13)):
        sticker = board(7, 5, 0.024, 0.018, place)
        desk = Desk(still=(sticker,))
        found = CHARUCO.find(desk.picture([2.5, 0.3, 0.3], rng))
        turn, middle = sticker.frame
        corners = CHARUCO.corners() - [*np.array(CHARUCO.size) / 2, 0.0]  # from the lower left
        truth = desk.camera.project(corners @ turn.T + middle)
        assert len(found) == count
        miss = np.array([found[n] - truth[n] for n in found])
        assert np.sqrt((miss**2).sum(1).mean()) < 0.03
        assert np.abs(miss.mean(0)).max() < 0.01  # half a pixel is a convention, not noise


def test_lens_round_trip(tmp_path, monkeypatch):
    numbers = np.array([600.0, 602.0, 318.0, 243.0, -0.15, 0.04, 1e-3, -2e-3, 0.01])
    lens = Lens.of((640, 480), numbers)
    pixels = np.random.default_rng(0).uniform([0, 0], [640, 480], (200, 2))
    assert np.allclose(lens.distort(lens.undistort(pixels)), pixels, atol=1e-9)
    mine = lens.undistort(pixels)
    theirs = cv2.undistortPoints(pixels.reshape(-1, 1, 2), lens.matrix, lens.distortion)
    assert np.abs(mine - theirs.reshape(-1, 2)).max() < 1e-4  # OpenCV stops early
    lens.save(tmp_path / "lens.json")
    again = load_lens(tmp_path / "lens.json")[0]
    assert (again.distort(mine) == lens.distort(mine)).all()
    known = replace(lens, covariance=np.diag(np.arange(9.0)))
    known.save(tmp_path / "lens.json")
    assert (load_lens(tmp_path / "lens.json")[0].covariance == known.covariance).all()
    assert again.size == lens.size
    # another lens is not written over it
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((480, 640), np.uint8))
    monkeypatch.setattr("calib.recording.lens.calibrate_lens", lambda *_: lens.plus(np.ones(9)))
    refused(LogError, "600.0 px, not 601", load_lens, tmp_path, CHARUCO, tmp_path / "lens.json")


def test_a_lens_is_calibrated_from_pictures_of_a_board():
    rng = np.random.default_rng(6)
    desk = Desk(Camera(size=(640, 360), focal=550.0))
    pictures = board_shots(desk, board(7, 5, 0.024, 0.018, (0, 0, 0, 0)), 8, rng)
    lens = calibrate_lens([CHARUCO.find(p) for p in pictures], CHARUCO, desk.camera.size)
    assert lens.rms < 0.09
    assert abs(lens.focal[0] / desk.camera.focal - 1) < 0.005
    seen = (550.0, 550.0, *desk.camera.centre, desk.camera.k1)
    truth = Lens.of(desk.camera.size, np.array([*seen, 0.0, 0.0, 0.0, 0.0]))
    free = np.diag(lens.covariance) > 0
    assert free.tolist() == [True] * 5 + [False] * 4  # k1 alone is needed
    away = (lens.parameters - truth.parameters)[free] / np.sqrt(np.diag(lens.covariance)[free])
    assert np.abs(away).max() < 4.0  # it knows how well it is known
    assert 1e-4 < np.sqrt(lens.covariance[0, 0]) / lens.focal[0] < 5e-3
    grid = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.2, 0.2, 5)), -1)
    seen = truth.distort(grid.reshape(-1, 2))
    again = lens.undistort(seen)
    # what a pose cannot make good: the rays' angles between each other
    assert np.abs((again - again.mean(0)) - (grid.reshape(-1, 2) - grid.mean((0, 1)))).max() < 6e-3


def rasterised(svg, per_mm):
    """Draw the rectangles of an SVG: an independent reader of what is printed."""
    width, height = map(float, re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg).groups())
    canvas = np.full((round(height * per_mm), round(width * per_mm)), 255, np.uint8)
    for rect in re.findall(r"<rect[^>]*>", svg):
        value = dict(re.findall(r'(x|y|width|height|fill)="([^"]*)"', rect))
        x, y, w, h = (float(value.get(k, 0)) * per_mm for k in ("x", "y", "width", "height"))
        grey = 255 if value.get("fill") == "#fff" else 0
        canvas[round(y) : round(y + h), round(x) : round(x + w)] = grey
    return canvas


def test_a_printed_tag_has_its_true_size_and_is_found(run, tmp_path):
    run.done("tag", 7, "--size", "40mm", "-o", tmp_path / "tag.svg")
    svg = (tmp_path / "tag.svg").read_text()
    assert re.search(r'width="116mm" height="68mm"', svg)
    found = TagFinder("36h11").find(rasterised(svg, 5))
    assert [t.number for t in found] == [7]
    assert abs(found[0].side - 40 * 5) < 0.5


@pytest.mark.parametrize("is_upward", [False, True])
def test_tags_of_a_grid_are_found_in_rows_down_or_up_but_for_one_that_is_there_twice(is_upward):
    grid, known = parse_board("grid:3x2:60mm:20mm:t36h11"), cv2.aruco.DICT_APRILTAG_36h11
    page = np.full((300, 500), 255, np.uint8)
    places = grid.points()[::4, :2] * 1000 + 30
    for number, (x, y) in enumerate([*places.astype(int), (300, 200)]):
        row, column = divmod(number % 6, 3)
        number = 3 * (1 - row) + column if is_upward else number % 6
        cells = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(known), number, 60)
        page[y : y + 60, x : x + 60] = cells
    found = grid.find(page)
    assert sorted(found) == list(range(4, 24))  # of the first there are two
    miss = np.array([*found.values()]) - (grid.points()[4:, :2] * 1000 + 29.5)
    assert np.abs(miss).max() < 0.5


def test_opencv_is_asked_for_in_one_line_and_never_imported_early():
    code = (
        "import sys, calib, calib_cli, calib.recording.tag_scene\n"
        "from calib.recording.tags import TagFinder\n"
        "print('cv2' in sys.modules)\n"
        "sys.modules['cv2'] = None\n"
        "try:\n    TagFinder('36h11')\nexcept calib.CalibError as error:\n    print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("False\n")
    assert "or in a checkout pip install '.[camera]'" in done.stdout
