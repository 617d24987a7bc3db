"""The manual, docstrings, examples and benchmarks run as they stand; references are current."""

import doctest
import importlib
import inspect
import json
import pkgutil
import pydoc
import re
import runpy
import shlex
import shutil
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import versions
from models import sensed
from pages import PAGES, ROOT, anchors, blocks, links, run_page
from reference import ROBOTS, write_columns
from rendering import Camera

import calib

DOCS = ROOT / "docs"
TEXTS = {str(page.relative_to(ROOT)): page.read_text(encoding="utf-8") for page in PAGES}
README = TEXTS["README.md"]
#: pages whose blocks do not run: the README has a test of its own; the examples of api.md are
#: those of the docstrings
RUN = [name for name in TEXTS if name not in ("README.md", "docs/api.md")]
KNOCKED = (
    "train two_link",
    "babble two_link -n 100 --noise 0.001 --seed 6 --change elbow.length=+5% "
    "--change sensor.outliers=0.05 -o new.csv",
    "adapt two_link.calib --data new.csv",
)
#: what pages take over from another one
EARLIER = dict.fromkeys(("docs/apply.md", "docs/howto/ros.md"), KNOCKED)
INSTALLS = "Not run by the tests: it installs the package that they run."
REMARKS = {  # of what does not run as it stands
    ("docs/quickstart.md", INSTALLS),
    ("docs/howto/ros.md", INSTALLS),
    ("docs/howto/ros.md", "Not run by the tests: it needs a workspace of ROS 2. They run the node "
     "against stand-ins for ROS's modules."),
    ("docs/howto/ros.md", "Run by the tests against a stand-in for `robot`, never with LeRobot."),
}  # fmt: skip
REAL_URDF = next(ROBOTS.rglob("ur10_robot.urdf"), None)
"""The UR10 of the package example-robot-data, where it is installed."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the files that the pages say a reader has."""
    monkeypatch.chdir(tmp_path)
    arm = calib.load_arm("two_link")
    calib.write_log(calib.babble(arm, 300, seed=0, noise=1e-3), "log.csv")
    seen = calib.babble(arm, 300, seed=11, noise=5e-4)
    joints = dict(zip(arm.joint_names, seen.q.T, strict=True))
    camera = {"time": np.arange(300) / 2} | {name: np.degrees(q) for name, q in joints.items()}
    camera |= {"cam_u": 640 + 800 * seen.x[:, 0], "cam_v": 900 - 800 * seen.x[:, 1]}
    write_columns("camera.csv", camera)
    space = np.array([1.2, -0.4, 0.9]) + seen.x @ [[0.8, 0.6, 0.0], [-0.36, 0.48, 0.8]]
    space += np.random.default_rng(0).normal(0.0, 3e-4, space.shape)
    write_columns("tracker.csv", joints | dict(zip("xyz", space.T, strict=True)))
    write_columns("pictures.csv", pictures())
    return tmp_path


def pictures():
    """45 pictures of an arm in space: its joints, and the pixel at which each shows the tip."""
    arm, eye = calib.load_arm("spatial_three"), (0.35, -1.1, 0.55)
    ahead = {"position": eye, "target": np.add(eye, (-0.2, 0.93, -0.3)), "roll": 0.0}
    camera = Camera(focal=880.0, k1=0.0, shift=(0.5, 0.5), **ahead)
    log = sensed(arm, 45, 0, lambda q: camera.project(arm.forward(q)), 0.3, unit="px")
    return dict(zip((*arm.joint_names, "u", "v"), np.hstack([log.q, log.x]).T, strict=True))


def needed(text: str) -> None:
    """Put the files in place that not every computer can make."""
    if "ur10.urdf" in text:
        if REAL_URDF is None:
            pytest.skip("example-robot-data is not installed")
        shutil.copy(REAL_URDF, "ur10.urdf")
    if "run.mcap" in text:
        pytest.importorskip("rosbags")
        from test_rosbags import write

        write(Path("recording"), kind="mcap")
        shutil.copy(next(Path("recording").rglob("*.mcap")), "run.mcap")


def test_the_readmes_commands_run_and_its_code_does_what_it_says(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = [line for line in README.splitlines() if line.startswith("    ")]
    typed = [part.strip() for line in lines for part in line.split("#")[0].split("&&")]
    commands = [part for part in typed if part.startswith(("calib ", "printf "))]
    assert len(commands) > 12
    for command in commands:
        words = shlex.split(command)
        if words[0] == "printf":
            Path(words[-1]).write_text(words[1].replace("\\n", "\n"))
            continue
        if "ur10.urdf" in words:
            if REAL_URDF is None:
                continue
            shutil.copy(REAL_URDF, "ur10.urdf")
        shown = ["--html", "page.html"] if words[1] == "preview" else []  # no server, no browser
        done = run(*words[1:], *shown)
        expected = 3 if words[1] == "check" else 0  # the README says so: it has drifted
        assert done.code == expected, (command, done.err)
    made = {"two_link.calib", "arm.calib", "two_link.adapted.calib", "joints.csv", "q2.csv"}
    assert made <= {path.name for path in tmp_path.iterdir()}
    (block,) = [block for block in blocks(README) if block.language == "python"]
    names: dict[str, object] = {}
    exec(compile(block.text, "README.md", "exec"), names)
    assert np.shape(names["x"]) == np.shape(names["q"]) == (2,)


def test_the_readmes_two_commands_are_what_is_checked_on_every_change():
    script = (ROOT / ".ci/run").read_text()
    starts = re.findall(r"command_of '(.*?)'", script)
    assert len(starts) == 2
    for start in starts:
        found = re.findall(rf"^    {start}.*$", README, re.MULTILINE)
        assert len(found) == 1, (start, found)
    assert "export" not in script  # no variable is set for them


@pytest.mark.parametrize("name", RUN)
def test_commands_and_code_run_and_print_what_the_page_shows(run, name, folder):
    text = TEXTS[name]
    if not any(block.language in ("console", "python") for block in blocks(text)):
        return
    needed(text)
    for line in EARLIER.get(name, ()):
        run.done(line)
    names: dict[str, object] = {}
    if name == "docs/howto/ros.md":
        robot = Mock()  # for LeRobot's follower
        shutil.copy("two_link.adapted.calib", "so101.calib")
        action = {"shoulder_lift.pos": 30.0, "elbow_flex.pos": 60.0, "gripper.pos": 5.0}
        names = {"robot": robot, "action": action}
    run_page(ROOT / name, names)
    if name == "docs/howto/ros.md":
        adapted = calib.load("two_link.adapted.calib")
        (q,) = np.degrees(calib.correct(adapted, np.radians([[30.0, 60.0]])).q)
        expected = {"shoulder_lift.pos": q[0], "elbow_flex.pos": q[1], "gripper.pos": 5.0}
        assert robot.send_action.call_args.args == (pytest.approx(expected),)


@pytest.mark.parametrize("name", TEXTS)
def test_blocks_are_of_a_kind_that_is_run_or_are_known_to_be_no_code(name):
    found = list(blocks(TEXTS[name]))
    assert TEXTS[name].count("\n```") == 2 * len(found)  # no fence that the test would not find
    remarks = {(name, block.remark) for block in found if "un by the tests" in block.remark}
    assert remarks == {entry for entry in REMARKS if entry[0] == name}
    compiled = {"c"} if name == "docs/apply.md" else set()  # by test_export_c.py
    kinds = {block.language for block in found}
    assert name == "docs/api.md" or kinds <= {"console", "python", "text"} | compiled


@pytest.mark.parametrize("name", TEXTS)
def test_links_and_anchors_lead_somewhere(name):
    page, lost = ROOT / name, []
    for link in links(TEXTS[name]):
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or (anchor and anchor not in anchors(target.read_text("utf-8"))):
            lost.append(link)
    assert lost == []


def test_every_page_and_picture_is_reached_from_the_index():
    linked = {(DOCS / link.split("#")[0]).resolve() for link in links(TEXTS["docs/README.md"])}
    assert {page for page in PAGES if page.is_relative_to(DOCS)} - linked == {DOCS / "README.md"}
    targets = {(page.parent / link).resolve() for page in PAGES for link in links(page.read_text())}
    assert set(DOCS.glob("img/*.png")) == {path for path in targets if path.suffix == ".png"}


@pytest.mark.parametrize("name", ["cli", "api"])
def test_references_are_as_the_program_is(name):
    made = importlib.import_module(f"make_{name}")
    assert made.PAGE.read_text(encoding="utf-8") == made.page(), f"python docs/make_{name}.py"


def test_commands_that_can_say_no_tell_so_in_the_reference():
    parts = TEXTS["docs/cli.md"].split("\n## calib ")[1:]
    sections = {part.split("\n")[0].split()[-1]: part for part in parts}
    names = ("forward", "inverse", "path", "check", "adapt", "recognise", "correct", "urdf", "log")
    for name in names:
        assert "xit code 3" in sections[name], name


@pytest.mark.parametrize("name", sorted(path.stem for path in ROOT.glob("examples/*.py")))
def test_an_example_runs_by_itself_and_shows_figures(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    try:
        runpy.run_path(str(ROOT / f"examples/{name}.py"), run_name="__main__")
    except SystemExit as end:  # an extra is missing: the example says which
        if "pip install" not in str(end.code):
            raise
        pytest.skip(str(end.code))
    out = capsys.readouterr().out
    assert re.search(r"\d", out)
    if name == "urdf_then_real":
        before, after = map(float, re.search(r"poses: ([\d.]+) -> ([\d.]+) mm", out).groups())
        truth = float(re.search(r"truth: ([\d.]+) mm", out)[1])
        assert truth < after < before / 10  # readings have 0.5 mm of noise, the truth has none
        assert "still calibrated: True" in out
    if name == "closed_loop":
        at = {int(n): float(mm) for n, mm in re.findall(r"after +(\d+) steps +([\d.]+) mm", out)}
        noise = float(re.search(r"noise +([\d.]+) mm", out)[1])
        assert at[1] > 10 * noise
        assert max(at[16], at[40]) < noise


def test_every_script_that_a_page_names_is_there_and_every_script_is_named():
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    text = "\n".join([*TEXTS.values(), contributing])
    named = set(re.findall(r"benchmarks/(\w+)\.py", text))
    scripts = list(ROOT.glob("benchmarks/*.py"))
    names = {path.stem for path in scripts if not path.stem.startswith("peer_")}
    assert all((ROOT / f"benchmarks/{name}.py").exists() for name in named)
    importing = [*scripts, *Path(__file__).parent.glob("*.py")]
    text = "\n".join(path.read_text(encoding="utf-8") for path in importing)
    assert names <= named | set(re.findall(r"^ *(?:from|import) (\w+)", text, re.MULTILINE))


def test_errors_agree_with_those_of_other_versions(all_points):
    """Other versions of Python, NumPy and SciPy found the same."""
    kept = json.loads((ROOT / "tests/data/errors.json").read_text(encoding="utf-8"))
    lines = versions.differences(versions.errors(), kept)
    assert lines == [], "was training changed on purpose? python benchmarks/versions.py --write"


NAMES = [module.name for module in pkgutil.walk_packages(calib.__path__, "calib.")]
MODULES = ["calib", *(name for name in NAMES if not re.search(r"__main__$|\._robots", name))]
FINDER = doctest.DocTestFinder(exclude_empty=True)
SOURCE = "".join(p.read_text(encoding="utf-8") for p in Path(calib.__path__[0]).rglob("*.py"))
_ITEM = re.compile(r"^(\w+(?:, \w+)*) : (.*(?:\n(?:    .*|$))*)", re.MULTILINE)
_QUOTED = re.compile(r'"([a-z][\w:-]*)"')
_ROLE = re.compile(r":(?:func|class|meth|mod|data):`~?([\w.]+)`")


@pytest.mark.parametrize("name", MODULES)
def test_examples_are_true_and_references_lead_somewhere(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    for reference in set(_ROLE.findall(inspect.getsource(module))):
        if reference.startswith("calib"):
            assert pydoc.locate(reference) is not None, reference
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    said = []
    for test in FINDER.find(module, name):
        runner.run(test, out=said.append)
    assert not runner.failures, "".join(said)
    assert runner.tries or name not in ("calib", "calib.training.train", "calib.model.model")


def public():
    """Public functions and classes with the public methods of the classes, by name."""
    for name in calib.__all__:
        thing = getattr(calib, name)
        if callable(thing):
            yield name, thing
        if inspect.isclass(thing):
            for method, function in inspect.getmembers(thing, inspect.isfunction):
                if not method.startswith("_") and function.__module__.startswith("calib"):
                    yield f"{name}.{method}", function


PUBLIC = dict(public())


@pytest.mark.parametrize("name", PUBLIC)
def test_docstrings_name_parameters_and_choices_that_exist(name):
    doc = inspect.getdoc(PUBLIC[name])
    assert doc, f"{name} has no docstring"
    _, _, told = doc.partition("Parameters\n----------\n")
    told = re.split(r"\n\w+\n-+\n", told)[0]
    known = set(inspect.signature(PUBLIC[name]).parameters)
    for parameters, text in _ITEM.findall(told):
        assert set(parameters.split(", ")) <= known
        for choice in _QUOTED.findall(text):
            kinds = [f'"{part}"' in SOURCE for part in choice.split(":")]
            assert all(kinds), (parameters, choice)
