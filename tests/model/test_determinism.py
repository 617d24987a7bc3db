"""The same seed gives the same bytes: in one process, in two, with one thread or more."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache

import numpy as np
import pytest

RECIPES = {
    "two links": {"n": 1500, "size": 12},
    "two links, online rule": {"rule": "online"},
    "two links, dsom": {"map": "dsom"},
    "two links, growing neural gas": {"map": "gng", "n": 300, "size": 5},
    "three links": {"robot": "three_link", "size": 5, "n": 500},
    "a log": {"log": 60, "size": 4},
    "a short log, imagined": {"log": 30, "size": 6},
    "maps and links alone": {"log": 60, "size": 4, "body": "none"},
    "few-shot adaptation": {"adapt": "few-shot"},
    "online adaptation": {"adapt": "online"},
}
"""Options of training, and what is done afterwards."""

WORK = """
import hashlib, json, sys
import calib
from calib.model_file.storage import to_bytes

def made(robot="two_link", log=0, adapt="", size=6, n=400, **options):
    arm = calib.load_arm(robot)
    samples = calib.babble(arm, log or n, seed=1, noise=1e-3)
    if log:
        s = samples
        samples = calib.Samples(s.q, s.x, s.joint_names, s.lower, s.upper, s.revolute, arm=arm)
    model = calib.train(samples, size=size, seed=2, **options)
    if adapt:
        rows = {"few-shot": 60, "online": 200}[adapt]
        new = calib.babble(arm, rows, seed=3, noise=1e-3, changes=["elbow.length=+5%"])
        model = calib.adapt(model, new, method=adapt).model
        assert model.history
    return hashlib.sha256(to_bytes(model)).hexdigest()

recipes = json.loads(sys.argv[1])
print(json.dumps([made(**recipe) for recipe in recipes for _ in range(int(sys.argv[2]))]))
"""

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@cache
def digests(threads: int, hash_seed: int, cores: int, times: int) -> dict[str, set[str]]:
    """Return the digests of all recipes, made so many times by a process of its own."""
    environment = {
        **os.environ,
        **dict.fromkeys(THREADS, str(threads)),
        "PYTHONHASHSEED": str(hash_seed),
    }

    def pin():
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])

    done = subprocess.run(
        [sys.executable, "-c", WORK, json.dumps(list(RECIPES.values())), str(times)],
        env=environment,
        preexec_fn=pin if hasattr(os, "sched_setaffinity") else None,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = np.array(json.loads(done.stdout)).reshape(len(RECIPES), times)
    return {name: set(row) for name, row in zip(RECIPES, found.tolist(), strict=True)}


def alone() -> dict[str, set[str]]:
    """Everything twice in one process, with one thread on one core."""
    return digests(threads=1, hash_seed=0, cores=1, times=2)


@pytest.mark.parametrize("recipe", RECIPES)
def test_twice_in_one_process(recipe):
    assert len(alone()[recipe]) == 1


@pytest.mark.parametrize("recipe", RECIPES)
def test_in_another_process_with_more_threads_more_cores_and_another_hash_seed(recipe):
    assert digests(threads=4, hash_seed=7, cores=64, times=1)[recipe] == alone()[recipe]


def test_recipes_differ():
    """Else the digest of nothing would pass."""
    assert len({next(iter(found)) for found in alone().values()}) == len(RECIPES)
