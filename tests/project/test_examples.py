"""Examples and benchmarks: they run as they stand, and pages name them all."""

import json
import re
import runpy
from pathlib import Path

import pytest
import versions

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples"
SCRIPTS = ROOT / "benchmarks"
EXAMPLES = sorted(path.stem for path in FOLDER.glob("*.py"))


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """What an example prints when it is run in an empty folder; each runs once."""
    done: dict[str, str] = {}

    def run(name: str, monkeypatch, capsys) -> str:
        if name not in done:
            monkeypatch.chdir(tmp_path_factory.mktemp(name))
            try:
                runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
            except SystemExit as end:  # an extra is missing: the example says which
                if "pip install" not in str(end.code):
                    raise
                pytest.skip(str(end.code))
            done[name] = capsys.readouterr().out
        return done[name]

    return run


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs_by_itself_and_shows_figures(name, printed, monkeypatch, capsys):
    assert re.search(r"\d", printed(name, monkeypatch, capsys))


def test_few_measured_poses_mend_the_model_of_a_urdf(printed, monkeypatch, capsys):
    out = printed("urdf_then_real", monkeypatch, capsys)
    before, after = map(float, re.search(r"poses: ([\d.]+) -> ([\d.]+) mm", out).groups())
    truth = float(re.search(r"truth: ([\d.]+) mm", out)[1])
    assert truth < after < before / 10  # readings have 0.5 mm of noise, the truth has none
    assert "still calibrated: True" in out


def test_a_loop_over_the_camera_ends_below_its_noise(printed, monkeypatch, capsys):
    out = printed("closed_loop", monkeypatch, capsys)
    at = {int(n): float(mm) for n, mm in re.findall(r"after +(\d+) steps +([\d.]+) mm", out)}
    noise = float(re.search(r"noise +([\d.]+) mm", out)[1])
    assert at[1] > 10 * noise
    assert max(at[16], at[40]) < noise


def test_every_script_that_a_page_names_is_there_and_every_script_is_named():
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    named = set(re.findall(r"benchmarks/(\w+)\.py", text))
    there = {path.stem for path in SCRIPTS.glob("*.py")}
    assert named <= there
    scripts = [*SCRIPTS.glob("*.py"), *Path(__file__).parent.glob("*.py")]
    text = "\n".join(path.read_text(encoding="utf-8") for path in scripts)
    used = set(re.findall(r"^ *(?:from|import) (\w+)", text, re.MULTILINE))
    assert {name for name in there - named - used if not name.startswith("peer_")} == set()


def test_errors_agree_with_those_of_other_versions():
    """Other versions of Python, NumPy and SciPy found the same."""
    kept = json.loads((ROOT / "tests/data/errors.json").read_text(encoding="utf-8"))
    lines = versions.differences(versions.errors(), kept)
    assert lines == [], "was training changed on purpose? python benchmarks/versions.py --write"
