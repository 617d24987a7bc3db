"""Fuzzing: hostile input of every kind is right, or refused in one line, within its limits.

At length, with so many times the examples: `CALIB_FUZZ=200 python -m pytest -k hostile -n 2`.
"""

from __future__ import annotations

import os
from random import Random

import pytest
from fuzzing.guard import Violation, guarded, one_line
from fuzzing.kinds import make_kind
from hypothesis import given, settings
from hypothesis import strategies as st

LENGTH = int(os.environ.get("CALIB_FUZZ", "1"))
EXAMPLES = {
    "arm": 60,
    "urdf": 120,
    "log": 120,
    "model": 60,
    "units": 60,
    "columns": 60,
    "names": 60,
}
AT_LENGTH = {"streams": 1}


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    made = {}
    for name in {**EXAMPLES, **AT_LENGTH} if LENGTH > 1 else EXAMPLES:
        made[name] = make_kind(name, tmp_path_factory.mktemp(name))
    yield made
    for kind in made.values():
        kind.close()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # numbers of a forged file may overflow
@pytest.mark.parametrize("name", [*EXAMPLES, *AT_LENGTH])
def test_hostile_input_is_right_or_refused(kinds, name):
    if name not in kinds:
        pytest.skip("takes a process for each input: CALIB_FUZZ=100")

    # Hypothesis draws the seed alone: st.randoms() draws zeros and infinities for directions
    # and lengths, and nearly all that it makes is refused at once
    @settings(
        max_examples=LENGTH * {**EXAMPLES, **AT_LENGTH}[name],
        deadline=None,
        derandomize=LENGTH == 1,  # a red run of CI means a change
    )
    @given(st.integers(0, 2**32 - 1))
    def judge(seed):
        kinds[name].judge(kinds[name].make(Random(seed)))

    judge()


def test_inputs_depend_on_their_seed_alone(kinds):
    for kind in kinds.values():
        for seed in range(5):
            assert repr(kind.make(Random(seed))) == repr(kind.make(Random(seed)))


def test_most_kinds_of_outcome_occur(kinds):
    """What is always refused tests nothing: a good share has to be accepted."""
    for name, accepted in (("arm", "right"), ("log", "read"), ("urdf", "loaded, right")):
        kind = kinds[name]
        outcomes = [kind.judge(kind.make(Random(seed))) for seed in range(40)]
        assert any(accepted in outcome for outcome in outcomes)
        assert any("refused" in outcome for outcome in outcomes)


class TestGuard:
    """The guard itself, which would otherwise find nothing in silence."""

    def test_other_files_and_the_network_are_noticed(self, tmp_path):
        outside = tmp_path / "outside.txt"
        outside.write_text("secret")
        inside = tmp_path / "work"
        inside.mkdir()
        (inside / "a").write_text("")
        with guarded(inside):
            (inside / "a").read_text()
        with pytest.raises(Violation, match=r"open .*outside"), guarded(inside):
            outside.read_text()
        with guarded(inside, [str(outside)]):
            outside.read_text()

    def test_processes_and_connections_are_noticed(self, tmp_path):
        import socket
        import subprocess

        with pytest.raises(Violation, match="subprocess"), guarded(tmp_path):
            subprocess.run(["/bin/true"], check=False)
        with (
            pytest.raises(Violation, match="socket"),
            guarded(tmp_path),
            socket.create_server(("127.0.0.1", 0)),
        ):
            pass

    def test_the_trap_sees_what_compiled_code_opens(self, kinds):
        trap = kinds["urdf"].trap
        trap.check()
        if trap._events is None:
            pytest.skip("this system has no inotify")
        import numpy as np

        np.fromfile(trap.secret, dtype="u1")
        with pytest.raises(Violation, match="secret"):
            trap.check()
        trap.check()

    def test_too_long_too_large_and_unprintable_are_noticed(self, tmp_path, monkeypatch):
        from fuzzing import guard

        monkeypatch.setattr(guard, "SECONDS", 0.05)
        with pytest.raises(Violation, match="processor time"), guarded(tmp_path):
            _endless()
        if guard.peak():
            monkeypatch.setattr(guard, "MEMORY", 1 << 20)
            with pytest.raises(Violation, match="occupied"), guarded(tmp_path):
                pass
        for text in ("a\nb", "a\x1b[2J", "", "x" * 3000, "Traceback (most recent call last)"):
            with pytest.raises(Violation):
                one_line(text)


def _endless():
    while True:
        pass
