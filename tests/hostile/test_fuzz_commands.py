"""Command lines at random; at length with `CALIB_FUZZ=200`, see `test_fuzz_inputs.py`."""

from __future__ import annotations

import os
from random import Random

import pytest
from fuzzing.guard import Violation
from fuzzing.kinds import make_kind
from fuzzing.printed import judge_output
from hypothesis import given, settings
from hypothesis import strategies as st


@pytest.fixture(scope="module")
def commands(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("before"))
        kind = make_kind("cli", tmp_path_factory.mktemp("cli"))
        yield kind


LENGTH = int(os.environ.get("CALIB_FUZZ", "1"))


@settings(max_examples=80 * LENGTH, deadline=None, derandomize=LENGTH == 1)
@given(st.integers(0, 2**32 - 1))
def test_command_lines_end_in_order(commands, seed):
    commands.judge(commands.make(Random(seed)))


@pytest.mark.parametrize(
    ("args", "code", "out", "err"),
    [
        ((), 4, "", ""),
        ((), 1, "", "Traceback (most recent call last):\n"),
        ((), 1, "", "error: internal error, KeyError: 'x'\n"),
        ((), 1, "", ""),
        ((), 2, "", "error: a\nerror: b\n"),
        ((), 2, "results", "error: a\n"),
        ((), 0, "", "error: a\n"),
        ((), 3, "", ""),
        ((), 0, "a\x1b[31mb", ""),
        (("--json",), 0, "{", ""),
        (("--json",), 0, '{"a": NaN}', ""),
        (("--json",), 3, "", "no answer"),
    ],
)
def test_the_judge_notices(args, code, out, err):
    with pytest.raises(Violation):
        judge_output(args, code, out, err)
