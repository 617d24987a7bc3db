"""The benchmarks: their closed forms, and that the commands run without any peer."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import calib

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
sys.path.insert(0, str(FOLDER))

import map_race  # noqa: E402
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


def test_grids_begin_with_the_least_training_and_know_the_samples_at_hand():
    for peer in PEERS:
        for race in map_race.RACES:
            settings = map_race.grid(peer, race)
            shown = [map_race.presented(peer, s) for s in settings]
            assert shown == sorted(shown)
            assert all(0 < s.rows <= race.rows for s in settings)


def test_our_own_entry_trains_a_map_and_what_is_no_map_is_refused():
    u = np.random.default_rng(0).random((300, 2))
    weights = train(OURS, u, 5, Setting(200), 0)
    np.testing.assert_array_equal(weights, calib.SOM((5, 5), map="som").fit(u[:200]).weights)
    broken = type(OURS)("broken", "none", False, lambda *_: np.full((25, 2), np.nan), "")
    with pytest.raises(ValueError, match="broken"):
        train(broken, u, 5, Setting(200), 0)


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
