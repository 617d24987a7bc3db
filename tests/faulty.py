"""The module `os`, but for a stroke before one of the steps of writing a file."""

from __future__ import annotations

import os

STEPS = ["open", "fdopen", "write", "write", "fsync", "replace"]
STEPS += ["open", "fsync", "close", "listdir"]
"""What `atomic_write` asks of the system, in this order."""


class Faulty:
    """The module `os`, but for a stroke before one of the steps."""

    def __init__(self, step, stroke):
        self.left, self.stroke, self.steps = step, stroke, []

    def __getattr__(self, name):
        real = getattr(os, name)
        return self.wrapped(name, real) if name in STEPS else real

    def wrapped(self, name, real):
        def call(*args, **options):
            self.count(name)
            result = real(*args, **options)
            return File(result, self) if name == "fdopen" else result

        return call

    def count(self, name):
        self.steps.append(name)
        if len(self.steps) == self.left + 1:
            self.stroke()


class File:
    """A binary file that is written in two halves."""

    def __init__(self, file, faulty):
        self.file, self.faulty = file, faulty

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        return self.file.__exit__(*exception)

    def __getattr__(self, name):
        return getattr(self.file, name)

    def write(self, data):
        half = len(data) // 2
        for part in (data[:half], data[half:]):
            self.faulty.count("write")
            self.file.write(part)
            self.file.flush()
