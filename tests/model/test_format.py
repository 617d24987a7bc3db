"""Model files: exact round trips, the same bytes, whole or not at all, and all is on the page."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from conftest import refused
from hostile.test_model_file import described, split
from models import bytes_of, draw, log, measured, no_arm, tilted_camera, trained, turning
from safetensors.numpy import load as unpack

import calib

PAGE = (Path(__file__).parents[2] / "docs" / "format.md").read_text(encoding="utf-8")
MODELS = {
    "simulated": lambda: trained("two_link"),
    "a log": measured,
    "of three joints": lambda: trained("three_link"),
    "with a slide": lambda: trained("polar"),
    "with a joint that turns round": turning,
    "of few rows": lambda: measured(30, 6),
    "without a body": cache(lambda: calib.train(log(300, 1e-3), size=6, body="none")),
    "of no arm": cache(lambda: calib.train(no_arm(60), size=6)),
    "of a camera": tilted_camera,
    "of a growing neural gas": lambda: trained("two_link", 300, 5, map="gng", epochs=5),
    "with a radius": lambda: trained("two_link", 300, 5, sigma=(2.0, 0.5), epochs=3),
}


@pytest.mark.parametrize("kind", MODELS)
def test_a_round_trip_gives_the_same_answers_and_the_same_bytes(kind, tmp_path):
    model, path = MODELS[kind](), tmp_path / "m.calib"
    model.save(path)
    again = calib.load(path)
    assert bytes_of(again) == path.read_bytes() == bytes_of(model)
    q = draw(model, 200, seed=1)
    assert again.readouts == model.readouts
    for readout in model.readouts:
        assert again.forward(q, readout).tobytes() == model.forward(q, readout).tobytes()
    x = model.forward(q)
    x = x[np.isfinite(x[:, 0])]
    # the starts are refined in other company, which rounds differently
    np.testing.assert_allclose(again.inverse(x), model.inverse(x), rtol=0, atol=1e-12)
    for bound in ("expected_error", "model_error"):
        assert getattr(again, bound)(q).tobytes() == getattr(model, bound)(q).tobytes()
    assert (again.body is None) == (model.body is None)
    if model.body is not None:
        assert again.body.describe() == model.body.describe()
        assert again.body.parameters() == model.body.parameters()
        np.testing.assert_allclose(again.body.bound(q), model.body.bound(q), rtol=1e-12)
    data = path.read_bytes()
    assert len(data) < 1_000_000
    # every tensor and every key is on the page
    told = set(re.findall(r"`([a-z0-9_.*]+)`", PAGE))
    assert [n for n in unpack(data) if not told & {n, f"*.{n.split('.', 2)[-1]}"}] == []
    said = described(data)
    parts = (said, said["about"], said["association"], said["association"]["wiring"])
    for keys in (*parts, said["local"] or (), said["body"] or ()):
        assert set(keys) <= told


def body_of(said, tensors, q):
    """Positions (n, 2) of a planar body at joint values (n, dof)."""
    told, n = said["body"]["structure"], q.shape[1]
    sensor = told["sensors"][told["place"]]
    parts = iter(tensors["body.beta"])

    def take(count):
        return np.array([next(parts) for _ in range(count)])

    turns, d = np.array(told["revolute"]), np.array(told["signs"])
    alpha, s, a, b = take(4)
    t, h, (k,), c = take(2), take(2), take(1), take(2)
    length, offset, gain = take(n), take(n), take(n)
    psi = np.cumsum(np.where(turns, d * q, 0.0), axis=1)
    theta = gain * d * q + offset
    for i in range(n):
        for m in range(i, n):
            if turns[i] and turns[m]:
                e, f = take(2)
                theta[:, i] += e * np.cos(psi[:, m]) + f * np.sin(psi[:, m])
    order = np.arange(1, 49)
    for i in np.flatnonzero(turns):
        cosines, sines = take(48), take(48)
        angle = q[:, [i]] * order
        theta[:, i] += np.cos(angle) @ cosines + np.sin(angle) @ sines
    phi = np.cumsum(np.where(turns, theta, 0.0), axis=1)
    w = sensor["metre"] if sensor["view"] in ("base", "rigid") else 1.0
    slid = (length + w * gain * d * q) * np.exp(1j * (phi + offset))
    p = np.where(turns, length * np.exp(1j * phi), slid).sum(axis=1)
    p = np.stack([p.real, p.imag], axis=1)
    turned = np.array([[np.cos(alpha), -np.sin(alpha)], [np.sin(alpha), np.cos(alpha)]])
    matrix = np.exp(s) * turned @ [[1 + a, b], [b, 1 - a]] @ np.diag([1, sensor["mirror"]])
    y = t + p @ matrix.T / (1 + p @ h)[:, None]
    v = (y - sensor["centre"]) / (1.5 * sensor["extent"]) - c
    return y + 1.5 * sensor["extent"] * k * (v**2).sum(axis=1, keepdims=True) * v


@pytest.mark.parametrize("robot", ["two_link", "three_link", "polar", "log"])
def test_a_reader_that_knows_this_page_alone_answers_forward(robot):
    model = measured(150, 5) if robot == "log" else trained(robot, 300, 5)
    data = bytes_of(model)
    assert described(data)["local"]["degree"] == -1
    q = draw(model, 50)
    answer = body_of(described(data), unpack(data), q)
    np.testing.assert_allclose(answer, model.forward(q), rtol=0, atol=1e-12)


def test_no_time_no_date_and_no_path_is_inside(tmp_path):
    urdf, path = tmp_path / "copied_robot.urdf", tmp_path / "somewhere.calib"
    urdf.write_text(calib.load_arm("two_link").urdf)
    calib.train(calib.babble(calib.load_arm(str(urdf)), 300), size=5).save(path)
    content = path.read_bytes()
    for secret in (tmp_path, tmp_path.name, Path(calib.__file__).parent, Path.home(), "somewhere"):
        assert str(secret).encode() not in content
    assert "seconds" not in described(content)
    text = split(content)[0]["__metadata__"]["calib"]
    assert not re.search(r"\b20[2-9]\d-\d\d-\d\d|\b\d\d:\d\d:\d\d\b", text)
    # one canonical JSON string
    again = json.dumps(json.loads(text), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    assert text == again


def test_maps_are_read_as_they_were_saved_and_what_is_no_maps_or_no_model_is_told(tmp_path):
    path, maps = tmp_path / "model.calib", tmp_path / "maps.calib"
    model = trained("two_link", 300, 5)
    model.save(path)
    for each in (model.motor, model.association):
        each.save(maps)
        first, again = maps.read_bytes(), calib.load_maps(maps)
        assert type(again) is type(each)
        again.save(maps)
        assert maps.read_bytes() == first
    q = np.array([[0.5, 1.0], [1.0, 2.0]])
    np.testing.assert_array_equal(again.predict(q), model.association.predict(q))
    damaged = bytearray(maps.read_bytes())
    damaged[-3] ^= 1
    (tmp_path / "damaged.calib").write_bytes(bytes(damaged))
    for load, file, message in (
        (calib.load, tmp_path / "no.calib", "no such file, expected a model written by 'calib"),
        (calib.load, tmp_path, "cannot be read"),
        (calib.load, tmp_path / "no\0name", "cannot be read"),
        (calib.load, maps, "maps alone, no model"),
        (calib.load_maps, path, "no file of maps"),
        (calib.load_maps, tmp_path / "none.calib", "no such file"),
        (calib.load_maps, tmp_path / "damaged.calib", "checksum"),
    ):
        refused(calib.ModelError, message, load, file)


def test_an_older_file_is_replaced_only_by_one_that_was_read_back(tmp_path):
    model, path = trained("two_link"), tmp_path / "m.calib"
    model.save(path)
    before, upper = path.read_bytes(), model.about.upper.copy()
    upper[0] = np.nan
    damaged = replace(model, about=replace(model.about, upper=upper))
    refused(calib.ModelError, "nothing was written", damaged.save, path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["m.calib"]


RECIPES = {
    "two links": {"log": 0},
    "two links, online rule": {"rule": "online"},
    "two links, dsom": {"map": "dsom"},
    "two links, growing neural gas": {"map": "gng", "log": 40, "epochs": 2},
    "three links": {"robot": "three_link"},
    "a log": {},
    "maps and links alone": {"body": "none"},
    "few-shot adaptation": {"adapt": "few-shot"},
    "online adaptation": {"adapt": "online"},
}
"""Options of training, and what is done afterwards."""
WORK = """
import hashlib, importlib, json, pathlib, sys, tempfile
import calib

importlib.import_module("calib.change.adapt").HORIZON = 300

def made(robot="two_link", log=100, adapt="", **options):
    arm = calib.load_arm(robot)
    samples = calib.babble(arm, log or 300, seed=1, noise=1e-3)
    if log:
        s = samples
        samples = calib.Samples(s.q, s.x, s.joint_names, s.lower, s.upper, s.revolute, arm=arm)
    model = calib.train(samples, size=4, seed=2, **options)
    if adapt:
        new = calib.babble(arm, 60, seed=3, noise=1e-3, changes=["elbow.length=+5%"])
        model = calib.adapt(model, new, method=adapt).model
        assert model.history
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder, "m.calib")
        model.save(path)
        return hashlib.sha256(path.read_bytes()).hexdigest()

recipes = json.loads(sys.argv[1])
print(json.dumps([made(**recipe) for recipe in recipes]))
"""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@cache
def digests(threads: int, hash_seed: int, cores: int) -> dict[str, str]:
    """Return the digests of all recipes, each made by a process of its own surroundings."""
    environment = os.environ | dict.fromkeys(THREADS, str(threads))
    environment["PYTHONHASHSEED"] = str(hash_seed)

    def pin():
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])

    words = [sys.executable, "-c", WORK, json.dumps(list(RECIPES.values()))]
    pinned = pin if hasattr(os, "sched_setaffinity") else None
    quiet = {"capture_output": True, "text": True, "timeout": 600, "check": False}
    done = subprocess.run(words, env=environment, preexec_fn=pinned, **quiet)
    assert done.returncode == 0, done.stderr
    return dict(zip(RECIPES, json.loads(done.stdout), strict=True))


@pytest.mark.parametrize("recipe", RECIPES)
def test_another_process_with_more_threads_more_cores_and_another_hash_seed_agrees(recipe):
    alone = digests(threads=1, hash_seed=0, cores=1)
    assert digests(threads=4, hash_seed=7, cores=64)[recipe] == alone[recipe]
    assert len(set(alone.values())) == len(RECIPES)  # else the digest of nothing would pass
