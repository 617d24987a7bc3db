"""The fast path: single queries of a model by its own compiled C."""

from __future__ import annotations

import time
from typing import Any

from ..errors import CalibError
from ..kernel.compiled import Compiled, compile_source
from ..samples.roles import ROUNDING
from .answers import SURE
from .header import Header
from .parts import Parts


def compiled_of(model: Parts) -> tuple[Compiled | None, str]:
    """The compiled kernel of a model, and a sentence that says what single queries are answered by.

    None where the batch has to: without a compiler, without a body, or with `CALIB_NO_CC=1`.
    """
    started = time.perf_counter()
    if model.body is None:
        return None, "single queries are answered by the batch: the model stands on maps alone"
    try:
        header = Header.of(model)
        text, _ = header.text()
    except CalibError as error:
        return None, f"single queries are answered by the batch: {error}"
    words: dict[str, Any] = {
        "placed": header.arm.outputs == 3 and getattr(model.body.structure, "informed", False),
        "corrected": header.nominal is not None,
        "sure": SURE,
        "extent": float(model.solver.extent),
        "rounding": ROUNDING,
    }
    made = compile_source(text, words, len(header.limit), header.arm.outputs)
    if isinstance(made, str):
        return None, f"single queries are answered by the batch: {made}"
    taken = time.perf_counter() - started
    return made, f"single queries are answered by compiled C, made in {taken:.2g} s"
