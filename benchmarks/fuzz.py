"""Give calib hostile input by the thousand and count what becomes of it.

    python benchmarks/fuzz.py --kind units --n 20000 --seed 0

`arm` are random arms, which have to be right; `urdf`, `log` and `model` damaged and
hostile files; `cli` command lines within one process, `process` real ones; `units`, `columns` and
`names` logs and arrays that look sound and are not, `streams` closed and narrow standard
streams. No input may
give a traceback, take more than 5 s of processor time or 1 GB, touch other files or the
network, or get a wrong answer without a word. Input number i depends on the seed and i
alone. Inputs are judged in a second process, so that a crash is counted too; what fails is
written to a folder, and `--only i` repeats it.
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from pathlib import Path
from random import Random
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from fuzzing.guard import forget_peak, peak
from fuzzing.kinds import KINDS, Kind, make_kind

STUCK = 240.0
"""Time after which a process that says nothing is ended [s]; it shares its processors."""


def main() -> int:
    """Run the command and return its exit code: 1 if an input failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", required=True, choices=KINDS)
    parser.add_argument("--n", type=int, default=20_000, help="how many inputs")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, help="judge this input alone, in this process")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"), help="failed inputs")
    parser.add_argument("--json", type=Path, help="write the counts here")
    parser.add_argument("--first", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.only is not None:
        return _repeat(options)
    if options.first is not None:
        _work(options)
        return 0
    return _run(options)


def generator(kind: str, seed: int, i: int) -> Random:
    """Return the generator of input number `i`."""
    return Random(f"{kind} {seed} {i}")


def _repeat(options: argparse.Namespace) -> int:
    with tempfile.TemporaryDirectory() as folder:
        kind = make_kind(options.kind, Path(folder))
        case = kind.make(generator(options.kind, options.seed, options.only))
        print(repr(case)[:2000])
        print(kind.judge(case))
        kind.close()
    return 0


def _work(options: argparse.Namespace) -> None:
    """Judge inputs and print one line of JSON for each; standard error is of no interest."""
    out = os.fdopen(os.dup(1), "w", buffering=1)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    with tempfile.TemporaryDirectory() as folder:
        kind = make_kind(options.kind, Path(folder))
        for i in range(options.first, options.n):
            print(json.dumps({"i": i}), file=out)
            print(json.dumps(_judged(kind, options, i)), file=out)
        kind.close()


def _judged(kind: Kind, options: argparse.Namespace, i: int) -> dict[str, Any]:
    started = time.process_time()
    case = None
    try:
        case = kind.make(generator(options.kind, options.seed, i))
        forget_peak()
        started = time.process_time()
        outcome, failed = kind.judge(case), ""
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # PanicException of Polars is no Exception
        outcome, failed = "FAILED", f"{type(error).__name__}: {error}"
        _keep(options, i, case, traceback.format_exc())
    return {"outcome": outcome, "failed": failed, "seconds": time.process_time() - started,
            "peak": peak()}  # fmt: skip


def _keep(options: argparse.Namespace, i: int, case: object, why: str) -> Path:
    folder: Path = options.keep / f"{options.kind}-{options.seed}-{i}"
    folder.mkdir(parents=True, exist_ok=True)
    command = f"python benchmarks/fuzz.py --kind {options.kind} --seed {options.seed} --only {i}\n"
    (folder / "why.txt").write_text(f"{command}\n{why}\n{case!r:.3000}\n", errors="replace")
    data = case if isinstance(case, bytes) else repr(case).encode(errors="replace")
    (folder / "input").write_bytes(data)
    return folder


def _run(options: argparse.Namespace) -> int:
    counts: Counter[str] = Counter()
    failures: list[str] = []
    slowest, largest, done, i = (0.0, 0), 0, 0, 0
    started = time.monotonic()
    while i < options.n:
        at = i
        for line in _lines(options, i):
            if "outcome" not in line:
                at = line["i"]
                continue
            done += 1
            i = at + 1
            counts[line["outcome"]] += 1
            slowest = max(slowest, (line["seconds"], at))
            largest = max(largest, line["peak"])
            if line["failed"]:
                failures.append(f"{at}: {line['failed'][:300]}")
                print(failures[-1], flush=True)
            if done % 250 == 0:
                print(f"... {done} of {options.n}, {len(failures)} failed", flush=True)
        if i < options.n:  # the process ended or was stuck within input `at`
            _keep(options, at, None, "the process crashed or was stuck")
            failures.append(f"{at}: the process crashed or was stuck")
            print(failures[-1], flush=True)
            counts["FAILED"] += 1
            done += 1
            i = at + 1
    summary = {
        "kind": options.kind, "seed": options.seed, "inputs": done, "failed": len(failures),
        "outcomes": dict(counts.most_common()), "slowest_s": round(slowest[0], 2),
        "slowest": slowest[1], "peak_MB": round(largest / 1e6),
        "minutes": round((time.monotonic() - started) / 60, 1),
    }  # fmt: skip
    print(json.dumps(summary, indent=2))
    if options.json:
        options.json.write_text(json.dumps({**summary, "failures": failures}, indent=2) + "\n")
    return 1 if failures else 0


def _lines(options: argparse.Namespace, first: int) -> Any:
    """Run a process from input `first` on and yield what it says, until it ends or is stuck."""
    command = [sys.executable, __file__, "--kind", options.kind, "--seed", str(options.seed),
               "--n", str(options.n), "--first", str(first), "--keep", str(options.keep)]  # fmt: skip  # noqa: E501
    said: queue.Queue[str | None] = queue.Queue()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    stream = process.stdout
    assert stream is not None

    def read() -> None:
        for line in stream:
            said.put(line)
        said.put(None)

    threading.Thread(target=read, daemon=True).start()
    try:
        while (line := said.get(timeout=STUCK)) is not None:
            yield json.loads(line)
    except queue.Empty:
        pass
    finally:
        process.kill()
        process.wait()


if __name__ == "__main__":
    sys.exit(main())
