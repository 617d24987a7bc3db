"""The exported C header answers as the model does, as C99 and as C++17, in double and float."""

import re
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from conftest import lengths, run_in_process
from models import arm, draw, in_space, needs_compiler, of_the_drawing, sensed, six, two_link
from scipy.spatial.transform import Rotation

import calib

DATA = Path(__file__).parents[1] / "data"
LANGUAGES = {"c99": ["-std=c99"], "c++17": ["-x", "c++", "-std=c++17"]}


def compiled(folder, language, header, program, *options, check=True):
    """Write a program before a header, compile it, and return whether that succeeded."""
    (folder / "arm.h").write_text(header)
    (folder / "program.c").write_text(program)
    flags = [*LANGUAGES[language], "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic", *options]
    words = ["cc", *flags, "-o", folder / "program", folder / "program.c", "-lm"]
    return not subprocess.run(words, check=check, capture_output=not check).returncode


@cache
def model(kind):
    """A model of an arm in space, as its file has it, or one with curves before a turned sensor."""
    if kind in ("space", "six"):
        with TemporaryDirectory() as folder:
            path = Path(folder) / "m.calib"
            (six() if kind == "six" else in_space()).save(path)
            return calib.load(path)
    local = 4e-3 if kind == "local" else 0.0

    def seen(q):
        x = two_link(q + 2e-3 * np.sin(9 * q) + [0.0, 0.02]) @ [[0.0, 1.0], [-1.0, 0.0]]
        return x + local * np.sin(5 * q[:, :1] * q[:, 1:])

    curved = calib.train(sensed(arm(), 500, 0, seen, 5e-5), size=8)
    if not local:
        return curved
    models = curved.predictor.models  # every third node without one
    coefficients = models.coefficients * (np.arange(64) % 3 > 0)[:, None, None]
    return replace(curved, local=replace(models, coefficients=coefficients))


@cache
def header(model, single):
    with TemporaryDirectory() as name:
        folder = Path(name)
        model.save(folder / "m.calib")
        words = "--float" if single else ""
        done = run_in_process.done(f"export {folder}/m.calib -o {folder}/arm.h {words}")
        assert ("float" in done.out) == single
        return (folder / "arm.h").read_text()


def answers(model, q, folder, language="c99", single=False):
    """What the compiled header says for joint values (n, dof)."""
    compiled(folder, language, header(model, single), (DATA / "answers.c").read_text())
    q.tofile(folder / "in")
    subprocess.run([folder / "program", folder / "in", folder / "out"], check=True)
    out = np.fromfile(folder / "out").reshape(len(q), -1)
    dof, m = q.shape[1], len(model.axes)
    return out[:, :m], out[:, m], out[:, m + 1 : -dof].reshape(-1, m, dof), out[:, -dof:]


def questions(model, n):
    """Joint values (n, dof) over the range and somewhat beyond it."""
    return draw(model, n, seed=1, margin=-0.1).astype(np.float32).astype(float)


@needs_compiler
@pytest.mark.parametrize(
    ("kind", "language"), [("real", "c99"), ("local", "c99"), ("space", "c99"), ("six", "c++17")]
)
def test_the_header_agrees_with_the_model(kind, language, tmp_path):
    m = model(kind)
    assert (m.predictor.models.degree >= 0) == (kind == "local")
    text = header(m, False)
    tables = re.findall(r"static const \w+ (\w+)", text)
    assert all(len(re.findall(rf"\b{name}\b", text)) > 1 for name in tables)  # each is read
    q = questions(m, 500)
    x, bound, slope, _ = answers(m, q, tmp_path, language)
    wanted = m.forward(q)
    assert (np.isnan(x) == np.isnan(wanted)).all()
    assert np.isnan(wanted).any()
    known = ~np.isnan(wanted[:, 0])
    np.testing.assert_allclose(x[known], wanted[known], rtol=0, atol=1e-12 * m.reach)
    told = m.expected_error(q)
    np.testing.assert_allclose(bound, told, rtol=1e-9, atol=1e-9 * m.reach)
    inside = m.predictor.value_and_slope(m.motor.scale.to_unit(q[known]))[1] / m.motor.scale.span
    np.testing.assert_allclose(slope[known], inside, rtol=0, atol=1e-11 * m.reach)
    assert np.isnan(slope[~known]).all()


@needs_compiler
@pytest.mark.parametrize("single", [False, True])
def test_a_corrected_command_brings_the_tip_to_the_nominal_place(single, tmp_path):
    m = model("real")
    q = questions(m, 2000)
    fixed = answers(m, q, tmp_path, single=single)[3]
    known = ~np.isnan(fixed[:, 0])
    assert known.sum() > 1000
    assert np.isnan(fixed[np.isnan(m.forward(q)[:, 0])]).all()
    wanted = calib.correct(m, q[known]).target
    gap = lengths(m.body.predict(fixed[known]) - wanted)
    assert gap.max() < (1e-3 if single else 1e-8) * m.reach
    # 0.02 rad of offset, 2 mrad of waves: the compensation is of that size
    assert 0.01 < np.median(np.abs(fixed[known] - q[known])[:, 1]) < 0.03


@needs_compiler
def test_a_change_beyond_the_limit_is_no_command(tmp_path, monkeypatch):
    m = model("real")
    q = questions(m, 500)
    change = np.abs(answers(m, q, tmp_path)[3] - q)
    limit = np.array([0.1, 0.02])  # in the middle of the elbow's changes
    monkeypatch.setattr("calib.use.exports.usual_limit", lambda _: limit)
    fixed = answers(replace(m), q, tmp_path)[3]
    known = ~np.isnan(change[:, 0])
    beyond = (change[known] > limit).any(axis=1)
    assert 0.1 < beyond.mean() < 0.9
    np.testing.assert_array_equal(np.isnan(fixed[known, 0]), beyond)


@needs_compiler
def test_six_joints_are_corrected_to_the_nominal_pose(tmp_path):
    m = model("six")
    rng, beta = np.random.default_rng(2), m.body.beta
    q = np.array([0.3, -1.2, 1.4, -0.8, 1.2, 0.4]) + rng.uniform(-0.3, 0.3, (500, 6))
    fixed = answers(m, q, tmp_path)[3]
    (real, turned), (_, before) = (m.body.structure.pose(rows, beta) for rows in (fixed, q))
    wanted, aim = m.body.structure.pose(q, of_the_drawing(m.body))
    assert lengths(real - wanted).max() < 1e-9
    back = np.swapaxes(aim, 1, 2)
    after, off = (Rotation.from_matrix(each @ back).magnitude() for each in (turned, before))
    assert np.median(off) > 1e-3
    assert after.max() < 1e-4


@needs_compiler
@pytest.mark.parametrize(("kind", "language"), [("real", "c++17"), ("space", "c99")])
def test_the_code_of_the_page_compiles_and_runs(kind, language, tmp_path):
    """A target of two numbers overflowed before the header of an arm in space."""
    page = (Path(__file__).parents[2] / "docs" / "apply.md").read_text()
    blocks = re.findall(r"```c\n(.*?)```", page, re.DOTALL)
    assert len(blocks) == 2
    program = "\n".join([*blocks, (DATA / "calls.c").read_text()])
    made = (tmp_path, language, header(model(kind), True), program)
    guards = ("-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    if not compiled(*made, *guards, check=False):
        compiled(*made)  # by a compiler without sanitisers
    subprocess.run([tmp_path / "program"], check=True)
