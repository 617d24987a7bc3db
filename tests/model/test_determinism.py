"""The same seed gives the same bytes: in two processes, with one thread or more."""

import json
import os
import subprocess
import sys
from functools import cache

import pytest

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

    done = subprocess.run(
        [sys.executable, "-c", WORK, json.dumps(list(RECIPES.values()))],
        env=environment,
        preexec_fn=pin if hasattr(os, "sched_setaffinity") else None,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return dict(zip(RECIPES, json.loads(done.stdout), strict=True))


@pytest.mark.parametrize("recipe", RECIPES)
def test_another_process_with_more_threads_more_cores_and_another_hash_seed_agrees(recipe):
    alone = digests(threads=1, hash_seed=0, cores=1)
    assert digests(threads=4, hash_seed=7, cores=64)[recipe] == alone[recipe]
    assert len(set(alone.values())) == len(RECIPES)  # else the digest of nothing would pass
