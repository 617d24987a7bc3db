"""The benchmarks: their closed forms, and that the commands run without any peer."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import calib

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
sys.path.insert(0, str(FOLDER))

import growth  # noqa: E402
import map_race  # noqa: E402
import measure  # noqa: E402
from map_peers import OURS, PEERS, Setting, train  # noqa: E402


def test_the_workspace_has_the_area_of_the_closed_form():
    arm = calib.load_arm("two_link")
    value, deviation = map_race.area_by_chance(arm, 200_000)
    assert abs(value - map_race.area(arm)) < 4 * deviation
    assert deviation < 0.01 * value


def test_the_quality_of_a_square_lattice_is_that_of_the_closed_form():
    # mean distance to the middle of a unit square: (sqrt 2 + ln(1 + sqrt 2)) / 6
    side = 20
    nodes = np.stack(np.divmod(np.arange(side**2), side), axis=1) / side + 0.5 / side
    fresh = np.random.default_rng(0).random((200_000, 2))
    found = map_race.quality(nodes, fresh, 1.0 / side, side)
    assert found["ratio"] == pytest.approx((np.sqrt(2) + np.log(1 + np.sqrt(2))) / 6, rel=5e-3)
    assert found["worst"] == pytest.approx(np.sqrt(0.5), rel=2e-2)
    assert found["topographic"] == 0.0
    shuffled = np.random.default_rng(1).permutation(nodes)
    assert map_race.quality(shuffled, fresh, 1.0 / side, side)["topographic"] > 0.9


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_the_exponent_of_a_power_law_is_its_power(power):
    x = np.array([10.0, 30.0, 100.0, 300.0])
    fit = growth.exponent(x, 7 * x**power)
    assert fit["exponent"] == pytest.approx(power)
    assert fit["interval"] == pytest.approx(0.0, abs=1e-6)


def test_grids_begin_with_the_least_training_and_know_the_samples_at_hand():
    for peer in PEERS:
        for race in map_race.RACES:
            settings = map_race.grid(peer, race)
            shown = [map_race.presented(peer, s) for s in settings]
            assert shown == sorted(shown)
            assert all(0 < s.rows <= race.rows for s in settings)


def test_a_larger_lattice_is_searched_from_what_a_smaller_one_took():
    peer, (small, large, _) = PEERS[2], map_race.RACES
    best = map_race.grid(peer, small)[8]
    row = {"side": small.side, "peer": peer.name, "best": {"1.10": vars(best), "1.06": None}}
    found = map_race._promising(peer, large, [row])
    assert found
    assert {s.end for s in found} == {best.end}
    least = map_race.presented(peer, best) / small.side**2
    assert min(map_race.presented(peer, s) / large.side**2 for s in found) >= 0.6 * least


def test_our_own_entry_trains_a_map_and_what_is_no_map_is_refused():
    u = np.random.default_rng(0).random((300, 2))
    weights = train(OURS, u, 5, Setting(200), 0)
    np.testing.assert_array_equal(weights, calib.SOM((5, 5), map="som").fit(u[:200]).weights)
    broken = type(OURS)("broken", "none", False, lambda *_: np.full((25, 2), np.nan), "")
    with pytest.raises(ValueError, match="broken"):
        train(broken, u, 5, Setting(200), 0)


def test_memory_of_a_process_is_its_own(tmp_path):
    command = [sys.executable, "-c", "b = b'1' * 300_000_000"]
    small = measure.process([sys.executable, "-c", ""], tmp_path)
    large = measure.process(command, tmp_path)
    assert 200 < large.peak_mb - small.peak_mb < 400
    assert large.wall > 0


def test_every_script_that_a_page_names_is_there_and_every_script_is_named():
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    named = set(re.findall(r"benchmarks/(\w+)\.py", text))
    there = {path.stem for path in FOLDER.glob("*.py")}
    assert named <= there
    scripts = [*FOLDER.glob("*.py"), *Path(__file__).parent.glob("*.py")]
    text = "\n".join(path.read_text(encoding="utf-8") for path in scripts)
    used = set(re.findall(r"^ *(?:from|import) (\w+)", text, re.MULTILINE))
    assert {name for name in there - named - used if not name.startswith("peer_")} == set()


def test_a_script_prints_its_tables():
    command = [sys.executable, "growth.py", "--quick", "--only", "links"]
    done = subprocess.run(command, cwd=FOLDER, check=True, capture_output=True, text=True)
    assert "links: exponents" in done.stdout
    assert "|---|---:" in done.stdout
