"""C source that the headers of all arms share, and how numbers are written into it.

C99 that is also valid C++, without allocation and without any library but ``math.h``. The names
start with ``calib_`` here; `filled` puts another prefix, and numbers for words such as ``@unit@``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ..common.arrays import Array

_FUNCTIONS = re.compile(r"\b(cos|sin|sqrt|floor|fabs)\(")

HEAD = """\
/* @title@
 *
 * Written by `calib export`; do not edit. C99, also valid C++.
 * Model checksum (SHA-256): @checksum@
 *
@facts@ *
 * All functions return 1 where there is an answer; else 0, and their results are NaN.
 * Joint values are in rad (or m where a joint slides), positions in @unit@.
 */
#ifndef @guard@
#define @guard@

#include <math.h>

typedef @real@ calib_real;

enum {
  CALIB_DOF = @dof@, CALIB_OUT = @out@, CALIB_NODES = @nodes@, CALIB_NEAR = @near@,
  CALIB_HARMONICS = @harmonics@
};
"""

RANGE = """\

static inline calib_real calib_not_a_number(void) { return (calib_real)NAN; }

/* Whether joint values are within the range that the model was learned for. */
static inline int calib_in_range(const calib_real q[CALIB_DOF]) {
  int i;
  for (i = 0; i < CALIB_DOF; ++i) {
    const calib_real u = (q[i] - calib_lower[i]) / calib_span[i];
    if (!calib_periodic[i] && !(u >= @slack@ && u <= 1 - @slack@)) return 0;
    if (!(u - u == 0)) return 0;
  }
  return 1;
}

/* Joint values with those of full turns moved into their range. */
static inline void calib_wrapped(const calib_real q[CALIB_DOF], calib_real out[CALIB_DOF]) {
  int i;
  for (i = 0; i < CALIB_DOF; ++i) {
    const calib_real u = (q[i] - calib_lower[i]) / calib_span[i];
    out[i] = calib_periodic[i] ? calib_lower[i] + (u - floor(u)) * calib_span[i] : q[i];
  }
}

"""

NODES = """\

/* The nodes that speak for q and their weights, which sum to one. */
static inline void calib_near(const calib_real *q, int *node, calib_real *weight,
                           calib_real u[CALIB_DOF]) {
  calib_real far[CALIB_NEAR + 1], total = 0;
  int place[CALIB_NEAR + 1], found = 0, i, n, k;
  for (i = 0; i < CALIB_DOF; ++i) {
    u[i] = (q[i] - calib_lower[i]) / calib_span[i];
    if (calib_periodic[i]) u[i] -= floor(u[i]);
  }
  for (n = 0; n < CALIB_NODES; ++n) {
    calib_real d = 0;
    for (i = 0; i < CALIB_DOF; ++i) {
      calib_real g = u[i] - calib_node[n][i];
      if (calib_periodic[i]) g -= floor(g + (calib_real)0.5);
      d += g * g;
    }
    if (found == CALIB_NEAR + 1 && !(d < far[CALIB_NEAR])) continue;
    k = found < CALIB_NEAR + 1 ? found++ : CALIB_NEAR;
    while (k > 0 && far[k - 1] > d) {
      far[k] = far[k - 1];
      place[k] = place[k - 1];
      --k;
    }
    far[k] = d;
    place[k] = n;
  }
  for (k = 0; k < CALIB_NEAR; ++k) {
    const calib_real r = far[CALIB_NEAR] > 0 ? 1 - far[k] / far[CALIB_NEAR] : 1;
    weight[k] = r * r;
    node[k] = place[k];
    total += weight[k];
  }
  for (k = 0; k < CALIB_NEAR; ++k)
    weight[k] = total > 0 ? weight[k] / total : (calib_real)1 / CALIB_NEAR;
}

/* Values of the nodes, blended at q. */
static inline calib_real calib_blended(const calib_real *values, const calib_real q[CALIB_DOF]) {
  int node[CALIB_NEAR], k;
  calib_real weight[CALIB_NEAR], u[CALIB_DOF], sum = 0;
  calib_near(q, node, weight, u);
  for (k = 0; k < CALIB_NEAR; ++k) sum += weight[k] * values[node[k]];
  return sum;
}

"""


def filled(text: str, words: Mapping[str, object], prefix: str, single: bool) -> str:
    """C source with its words filled in, names that start with `prefix`, and its precision."""
    text = re.sub(r"@(\w+)@", lambda found: str(words[found.group(1)]), text)
    text = _FUNCTIONS.sub(r"\1f(", text) if single else text
    return text.replace("calib_", prefix).replace("CALIB_", prefix.upper())


def number(value: float, single: bool) -> str:
    """A C constant that reads back as the same number."""
    text = repr(float(np.float32(value)) if single else float(value))
    if single:
        text = f"{np.float32(value):.9g}"
        text = text if any(c in text for c in ".en") else text + ".0"
        return text + "f"
    return text if any(c in text for c in ".en") else text + ".0"


def array(kind: str, name: str, sizes: Sequence[str], values: Array, single: bool) -> str:
    """A constant array of C, filled row by row."""
    flat = [number(v, single) for v in np.asarray(values, dtype=float).ravel()]
    lines = _wrapped(flat)
    shape = "".join(f"[{s}]" for s in sizes)
    if len(sizes) == 2:  # braces for each row, or compilers warn
        width = np.asarray(values).shape[1]
        rows = [", ".join(flat[i : i + width]) for i in range(0, len(flat), width)]
        lines = [f"  {{{row}}}," for row in rows]
    return f"static const {kind} {name}{shape} = {{\n" + "\n".join(lines) + "\n};\n"


def integers(name: str, size: str, values: Iterable[int]) -> str:
    """A constant array of int."""
    return f"static const int {name}[{size}] = {{{', '.join(str(int(v)) for v in values)}}};\n"


def _wrapped(words: list[str]) -> list[str]:
    return ["  " + ", ".join(words[i : i + 4]) + "," for i in range(0, len(words), 4)]
