"""C source of a planar body: templates with the numbers of one model filled in.

C99 that is also valid C++, without allocation and without any library but ``math.h``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HEAD = """\
/* {title}
 *
 * Written by `calib export`; do not edit. C99, also valid C++.
 * Model checksum (SHA-256): {checksum}
 *
{facts} *
 * All functions return 1 where there is an answer; else 0, and their results are NaN.
 * Joint values are in rad (or m where a joint slides), positions in {unit}.
 */
#ifndef {guard}
#define {guard}

#include <math.h>

typedef {real} {p}real;

enum {{ {P}DOF = {dof}, {P}NODES = {nodes}, {P}HARMONICS = {harmonics} }};
"""

HELPERS = """\

static inline {p}real {p}not_a_number(void) {{ return ({p}real)NAN; }}

/* Whether joint values are within the range that the model was learned for. */
static inline int {p}in_range(const {p}real q[{P}DOF]) {{
  int i;
  for (i = 0; i < {P}DOF; ++i) {{
    const {p}real u = (q[i] - {p}lower[i]) / {p}span[i];
    if (!{p}periodic[i] && !(u >= {slack} && u <= {one} - {slack})) return 0;
    if (!(u - u == 0)) return 0;
  }}
  return 1;
}}

/* Joint values with those of full turns moved into their range. */
static inline void {p}wrapped(const {p}real q[{P}DOF], {p}real out[{P}DOF]) {{
  int i;
  for (i = 0; i < {P}DOF; ++i) {{
    const {p}real u = (q[i] - {p}lower[i]) / {p}span[i];
    out[i] = {p}periodic[i] ? {p}lower[i] + (u - {floor}(u)) * {p}span[i] : q[i];
  }}
}}

/* Error curve of a joint and its derivative, by Horner's rule in exp(j q). */
static inline void {p}curve(int joint, {p}real q, {p}real *value, {p}real *slope) {{
  const {p}real c = {cos}(q), s = {sin}(q);
  const {p}real *a = {p}curve_cos[joint], *b = {p}curve_sin[joint];
  {p}real re = 0, im = 0, dre = 0, dim = 0, t;
  int n;
  for (n = {P}HARMONICS; n >= 1; --n) {{
    re += a[n - 1];
    im -= b[n - 1];
    dre += ({p}real)n * b[n - 1];
    dim += ({p}real)n * a[n - 1];
    t = re * c - im * s;
    im = re * s + im * c;
    re = t;
    t = dre * c - dim * s;
    dim = dre * s + dim * c;
    dre = t;
  }}
  *value = re;
  *slope = dre;
}}

/* Body: position and, where J is not null, its derivative by the joints (row by row). */
static inline void {p}body(const {p}real *beta, int curves, const {p}real q[{P}DOF],
                           {p}real x[2], {p}real *J) {{
  {p}real psi[{P}DOF], theta[{P}DOF], own[{P}DOF], bend[{P}DOF][{P}DOF];
  {p}real ux[{P}DOF], uy[{P}DOF], px[{P}DOF], py[{P}DOF], tx[{P}DOF], ty[{P}DOF];
  {p}real sum = 0, angle = 0, sx = 0, sy = 0, w, yx, yy, r2, k, cx, cy, lx, ly, m00, m01, m10, m11;
  int i, j, e = 0;
  for (i = 0; i < {P}DOF; ++i) {{
    if ({p}turns[i]) sum += {p}sign[i] * q[i];
    psi[i] = sum;
  }}
  for (i = 0; i < {P}DOF; ++i) {{
    own[i] = beta[{gain} + i] * {p}sign[i];
    theta[i] = {p}turns[i] ? own[i] * q[i] + beta[{offset} + i] : 0;
    for (j = 0; j < {P}DOF; ++j) bend[i][j] = 0;
  }}
  for (i = 0; i < {P}DOF; ++i) {{
    if (!{p}turns[i]) continue;
    for (j = i; j < {P}DOF; ++j) {{
      {p}real a, b, c, s;
      if (!{p}turns[j]) continue;
      a = beta[{elastic} + e];
      b = beta[{elastic} + e + 1];
      e += 2;
      if (a == 0 && b == 0) continue;
      c = {cos}(psi[j]);
      s = {sin}(psi[j]);
      theta[i] += a * c + b * s;
      bend[i][j] = b * c - a * s;
    }}
    if (curves) {{
      {p}real value, slope;
      {p}curve(i, q[i], &value, &slope);
      theta[i] += value;
      own[i] += slope;
    }}
  }}
  for (i = 0; i < {P}DOF; ++i) {{
    {p}real reach = beta[{length} + i], turn;
    angle += theta[i];
    turn = {p}turns[i] ? angle : angle + beta[{offset} + i];
    ux[i] = {cos}(turn);
    uy[i] = {sin}(turn);
    if (!{p}turns[i]) reach += own[i] * q[i] * {slide};
    px[i] = reach * ux[i];
    py[i] = reach * uy[i];
    sx += px[i];
    sy += py[i];
  }}
  m00 = {p}view[0]; m01 = {p}view[1]; m10 = {p}view[2]; m11 = {p}view[3];
  w = 1 + {p}view[6] * sx + {p}view[7] * sy;
  yx = (m00 * sx + m01 * sy) / w;
  yy = (m10 * sx + m11 * sy) / w;
  x[0] = yx + {p}view[4];
  x[1] = yy + {p}view[5];
  k = {p}lens[0]; cx = {p}lens[1]; cy = {p}lens[2];
  lx = (x[0] - {p}lens[3]) / {p}lens[5] - cx;
  ly = (x[1] - {p}lens[4]) / {p}lens[5] - cy;
  r2 = lx * lx + ly * ly;
  if (k != 0) {{
    x[0] += {p}lens[5] * k * r2 * lx;
    x[1] += {p}lens[5] * k * r2 * ly;
  }}
  if (!J) return;
  {{
    const {p}real v00 = (m00 - yx * {p}view[6]) / w, v01 = (m01 - yx * {p}view[7]) / w;
    const {p}real v10 = (m10 - yy * {p}view[6]) / w, v11 = (m11 - yy * {p}view[7]) / w;
    const {p}real l00 = 1 + k * (r2 + 2 * lx * lx);
    const {p}real l01 = 2 * k * lx * ly;
    const {p}real l11 = 1 + k * (r2 + 2 * ly * ly);
    {p}real after_x = 0, after_y = 0, dx, dy, gx, gy;
    for (i = {P}DOF - 1; i >= 0; --i) {{
      after_x += px[i];
      after_y += py[i];
      tx[i] = -after_y; /* j times the part of the chain that joint i turns */
      ty[i] = after_x;
    }}
    for (i = 0; i < {P}DOF; ++i) {{
      if ({p}turns[i]) {{
        dx = tx[i] * own[i];
        dy = ty[i] * own[i];
      }} else {{
        dx = ux[i] * own[i] * {slide};
        dy = uy[i] * own[i] * {slide};
      }}
      if ({p}turns[i]) {{
        int a, b;
        for (a = 0; a < {P}DOF; ++a)
          for (b = i; b < {P}DOF; ++b) {{
            dx += tx[a] * bend[a][b] * {p}sign[i];
            dy += ty[a] * bend[a][b] * {p}sign[i];
          }}
      }}
      gx = v00 * dx + v01 * dy;
      gy = v10 * dx + v11 * dy;
      J[i] = l00 * gx + l01 * gy;
      J[{P}DOF + i] = l01 * gx + l11 * gy;
    }}
  }}
}}
"""

NODES = """\

/* The {near} nodes that speak for q and their weights, which sum to one. */
static inline void {p}near(const {p}real q[{P}DOF], int node[{near}], {p}real weight[{near}],
                           {p}real u[{P}DOF]) {{
  {p}real far[{near} + 1], total = 0;
  int place[{near} + 1], found = 0, i, n, k;
  for (i = 0; i < {P}DOF; ++i) {{
    u[i] = (q[i] - {p}lower[i]) / {p}span[i];
    if ({p}periodic[i]) u[i] -= {floor}(u[i]);
  }}
  for (n = 0; n < {P}NODES; ++n) {{
    {p}real d = 0;
    for (i = 0; i < {P}DOF; ++i) {{
      {p}real g = u[i] - {p}node[n][i];
      if ({p}periodic[i]) g -= {floor}(g + ({p}real)0.5);
      d += g * g;
    }}
    if (found == {near} + 1 && !(d < far[{near}])) continue;
    k = found < {near} + 1 ? found++ : {near};
    while (k > 0 && far[k - 1] > d) {{
      far[k] = far[k - 1];
      place[k] = place[k - 1];
      --k;
    }}
    far[k] = d;
    place[k] = n;
  }}
  for (k = 0; k < {near}; ++k) {{
    const {p}real r = far[{near}] > 0 ? 1 - far[k] / far[{near}] : 1;
    weight[k] = r * r;
    node[k] = place[k];
    total += weight[k];
  }}
  for (k = 0; k < {near}; ++k) weight[k] = total > 0 ? weight[k] / total : ({p}real)1 / {near};
}}
"""

QUERIES = """\

/* Values of the nodes, blended at q. */
static inline {p}real {p}blended(const {p}real *values, const {p}real q[{P}DOF]) {{
  int node[{near}], k;
  {p}real weight[{near}], u[{P}DOF], sum = 0;
  {p}near(q, node, weight, u);
  for (k = 0; k < {near}; ++k) sum += weight[k] * values[node[k]];
  return sum;
}}

/* Position of the tip; where J is not null also its derivative, J[coordinate * DOF + joint]. */
static inline int {p}position(const {p}real q[{P}DOF], {p}real x[2], {p}real *J) {{
  {p}real inside[{P}DOF];
  if (!{p}in_range(q){trusted}) {{
    int i;
    x[0] = x[1] = {p}not_a_number();
    for (i = 0; J && i < 2 * {P}DOF; ++i) J[i] = {p}not_a_number();
    return 0;
  }}
  {p}wrapped(q, inside);
  {p}body({p}beta, {curves}, inside, x, J);
  return 1;
}}

static inline int {p}forward(const {p}real q[{P}DOF], {p}real x[2]) {{
  return {p}position(q, x, 0);
}}

static inline int {p}jacobian(const {p}real q[{P}DOF], {p}real J[2 * {P}DOF]) {{
  {p}real x[2];
  return {p}position(q, x, J);
}}

/* 95 % bound on the {bound_of}. */
static inline int {p}expected_error(const {p}real q[{P}DOF], {p}real *bound) {{
  *bound = {p}not_a_number();
  if (!{p}in_range(q){trusted}) return 0;
  *bound = {p}blended({p}bound, q);
  return 1;
}}

/* One damped Newton step of the joints towards a position; returns the distance before it. */
static inline {p}real {p}newton_step(const {p}real target[2], {p}real damping, {p}real q[{P}DOF]) {{
  {p}real x[2], J[2 * {P}DOF], gx, gy, aa = 0, bb = 0, ab = 0, det, first, second, extra;
  int i;
  {p}body({p}beta, {curves}, q, x, J);
  gx = target[0] - x[0];
  gy = target[1] - x[1];
  for (i = 0; i < {P}DOF; ++i) {{
    aa += J[i] * J[i];
    bb += J[{P}DOF + i] * J[{P}DOF + i];
    ab += J[i] * J[{P}DOF + i];
  }}
  extra = damping * (aa + bb);
  aa += extra;
  bb += extra;
  det = aa * bb - ab * ab;
  if (!(det > 0)) return {p}not_a_number();
  first = (bb * gx - ab * gy) / det;
  second = (aa * gy - ab * gx) / det;
  for (i = 0; i < {P}DOF; ++i) q[i] += J[i] * first + J[{P}DOF + i] * second;
  return {sqrt}(gx * gx + gy * gy);
}}
"""

CORRECT = """\

/* Joints that bring the real tip to where the nominal arm would be with q, near q. */
static inline int {p}correct(const {p}real q[{P}DOF], {p}real out[{P}DOF]) {{
  {p}real target[2], start[{P}DOF], before[{P}DOF], held[{P}DOF], left, best = 0;
  int i, step;
  if ({p}in_range(q)) {{
    {p}wrapped(q, start);
    for (i = 0; i < {P}DOF; ++i) out[i] = held[i] = start[i];
    {p}body({p}nominal, 0, start, target, 0);
    for (step = 0; step < 12; ++step) {{
      for (i = 0; i < {P}DOF; ++i) before[i] = out[i];
      left = {p}newton_step(target, {calm}, out);
      if (!(step == 0 || left < best)) break;
      best = left;
      for (i = 0; i < {P}DOF; ++i) held[i] = before[i];
      if (left <= {enough}) break;
    }}
    for (i = 0; i < {P}DOF; ++i) out[i] = held[i] + (q[i] - start[i]); /* on q's own turn */
    if (best <= {close}) return 1;
  }}
  for (i = 0; i < {P}DOF; ++i) out[i] = {p}not_a_number();
  return 0;
}}
"""


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
