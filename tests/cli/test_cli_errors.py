"""Bad input: one clear line on standard error, nothing on standard output, no file."""

import ast
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from calib_cli.errors import describe_error
from refusals import refused

import calib

ROOT = Path(__file__).parents[2]
# what is typed, the exit code, and words that the line must hold
CASES = json.loads((ROOT / "tests/data/documents.json").read_text())["refusals"]
INTERRUPTED = RuntimeError("Error calling __set_name__")
UNEXPECTED = [
    (MemoryError(), 1, "not enough memory; use a smaller --size or fewer --samples"),
    (PermissionError(13, "Permission denied", "a.csv"), 1, "a.csv: Permission denied"),
    (OSError(28, "No space left on device"), 1, "No space left on device"),
    (TypeError("a\nb"), 1, "internal error, TypeError: a b; CALIB_TRACEBACK=1 shows"),
    (INTERRUPTED, 130, "interrupted"),
]
EXCHANGED = [
    lambda model, log: calib.check(log, model),
    lambda model, log: calib.adapt(log, model),
    lambda model, log: calib.judge(log, model),
    lambda model, log: calib.evaluate(log, model),
    lambda model, log: calib.correct([0.5, 1.0], model),
    lambda model, log: calib.recognise(log, [model]),
    lambda model, log: calib.report("page.html", model),
    lambda model, log: calib.preview("page.html", model),
    lambda model, log: calib.write_log("log.csv", log),
    lambda model, log: calib.figures((model.motor, model.sensory)),
    lambda model, log: calib.train(log, size=5, sigma=(5,)),
    lambda model, log: calib.babble("two_link"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, model) -> Path:
    """A folder with one good model, one without a body, and many bad files."""
    path = tmp_path_factory.mktemp("bad")
    urdf = (ROOT / "robots" / "two_link.urdf").read_bytes()
    (path / "own.urdf").write_bytes(urdf)
    (path / "truncated.urdf").write_bytes(urdf[: len(urdf) // 2])
    replace(calib.load(model), body=None).save(path / "bare.calib")
    (path / "few.csv").write_text("shoulder,elbow,x,y\n.1,1,.1,.2\n.2,1.1,.2,.3\n.3,1.2,.3,.4\n")
    (path / "missing.csv").write_text("shoulder,x,y\n0,0.1,0.2\n1,0.2,0.3\n")
    (path / "good.calib").write_bytes(model.read_bytes())
    return path


@pytest.mark.parametrize(("line", "code", "words"), CASES, ids=[case[0] for case in CASES])
def test_one_line_and_a_document_and_nothing_written(run, folder, monkeypatch, line, code, words):
    monkeypatch.chdir(folder)
    before = {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}
    alone = line in ("query", "train two_link -o -")  # --json would be a fault of its own
    done = run(*line.replace(" --json", "").split(), *([] if alone else ["--json"]))
    assert done.code == code, done.err
    assert (done.err.count("\n"), done.err[-1]) == (1, "\n")
    assert [word for word in words.split(" ") if word not in done.err] == []
    if alone:
        return
    error = done.document["error"]
    assert set(error) == {"type", "message", "hint", "parameter", "value"}
    assert error["type"].endswith("Error")
    message = error["message"] if error["hint"] is None else f"{error['message']}; {error['hint']}"
    assert done.err == f"error: {message}\n"
    assert {path.name: path.stat().st_mtime_ns for path in folder.iterdir()} == before


INTERRUPTED.__cause__ = KeyboardInterrupt()


@pytest.mark.parametrize(("error", "code", "line"), UNEXPECTED)
def test_unexpected_errors_are_one_line_too(error, code, line):
    found, told = describe_error(error)
    assert found == code
    assert told["message"].startswith(line)
    assert "\n" not in told["message"]


def test_library_errors_name_parameters_and_the_command_line_options(run):
    told = refused(calib.RobotError, "elbw", calib.load_arm, "two_link", ["shoulder", "elbw"])
    assert "--" not in str(told)
    assert (told.parameter, told.value) == ("joints", "elbw")
    error = run("train two_link --joints shoulder,elbw --json").document["error"]
    assert (error["type"], error["parameter"], error["value"]) == ("RobotError", "--joints", "elbw")
    assert "elbow?" in error["hint"]
    assert "`" not in error["message"]


@pytest.mark.parametrize("call", EXCHANGED)
def test_arguments_of_python_that_are_exchanged_are_told_in_one_line(model, call):
    log = calib.babble(calib.load_arm("two_link"), 20)
    refused(calib.OptionError, "expected|give", call, calib.load(model), log)


def test_no_message_of_the_library_names_an_option():
    """Of text in the source only docstrings may speak of the command line."""
    foreign = ("var(", "pip install", "static inline", "use_degrees=true")
    foreign += ("calib check MODEL", "calib adapt MODEL")  # the report to its readers
    found = []
    for path in (ROOT / "calib").rglob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        docs = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        for node in nodes:
            text = node.value if isinstance(node, ast.Constant) and id(node) not in docs else None
            flag = isinstance(text, str) and re.search(r"(?<![\w-])--[a-z]+", text)
            # of rig.py: command lines of ROS
            if flag and path.name != "rig.py" and not any(word in text for word in foreign):
                found.append(f"{path.name}:{node.lineno} {flag[0]}")
    assert found == []
