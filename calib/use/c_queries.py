"""C source of the questions that a header answers, for a body of any kind.

It needs ``calib_smooth``, position and derivative of the body, and for `CORRECT` also
``calib_wanted``, where the nominal arm would be, and ``calib_posed``, a start near it.
"""

from __future__ import annotations

LOCAL = """\

/* Whether a node still speaks at a multiple of its reach: 1, falling to 0 at twice the reach. */
static inline calib_real calib_share(calib_real ratio) {
  calib_real r = ratio < 1 ? 0 : ratio - 1;
  r = r > 1 ? 0 : 1 - r * r;
  return r * r;
}

/* Factor on what nodes with a model say, by their share of the weight beside those without one. */
static inline calib_real calib_heard(calib_real share) {
  const calib_real silent = @silent@;
  calib_real t = (share - silent) / (@full@ - silent);
  t = t < 0 ? 0 : t > 1 ? 1 : t;
  return t * t * (3 - 2 * t) / (share > silent ? share : silent);
}

/* Local models of what the body leaves over, added to position and derivative. */
static inline void calib_local(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_real weight[CALIB_NEAR], u[CALIB_DOF], gap[CALIB_NEAR][CALIB_DOF], total = 0, left = 0;
  calib_real loud = 0;
  int node[CALIB_NEAR], i, k, t, o;
  calib_near(q, node, weight, u);
  for (k = 0; k < CALIB_NEAR; ++k) {
    calib_real far = 0, share = 1;
    for (i = 0; i < CALIB_DOF; ++i) {
      calib_real g = u[i] - calib_node[node[k]][i];
      if (calib_periodic[i]) g -= floor(g + (calib_real)0.5);
      gap[k][i] = g;
      far += g * g;
    }
    if (@fades@) share = calib_share(sqrt(far) / calib_says[node[k]]);
    weight[k] *= share;
    total += weight[k];
    if (calib_talks[node[k]]) loud += weight[k];
    if (share > left) left = share;
  }
  if (@votes@) left *= calib_heard(total > 0 ? loud / total : 0);
  for (k = 0; k < CALIB_NEAR; ++k) {
    const calib_real r = calib_radius[node[k]];
    const calib_real *c = calib_local_terms[node[k]];
    calib_real w = @fades@ ? (total > 0 ? weight[k] * left / total : 0) : weight[k];
    calib_real value[@terms@];
@gated@    if (!(w > 0)) continue;
    value[0] = 1;
    for (t = 1; t < @terms@; ++t)
      value[t] = value[calib_parent[t]] * gap[k][calib_along[t]] / r;
    for (t = 0; t < @terms@; ++t)
      for (o = 0; o < CALIB_OUT; ++o) x[o] += w * c[t * CALIB_OUT + o] * value[t];
    if (!J) continue;
    for (t = 1; t < @terms@; ++t)
      for (i = 0; i < CALIB_DOF; ++i) {
        const int power = calib_power[t * CALIB_DOF + i];
        if (!power) continue;
        for (o = 0; o < CALIB_OUT; ++o)
          J[o * CALIB_DOF + i] += w * c[t * CALIB_OUT + o] * (calib_real)power *
                                  value[calib_below[t * CALIB_DOF + i]] / (r * calib_span[i]);
      }
  }
}
"""

GATED = """\
    {
      calib_real t = calib_gate[node[k]][CALIB_DOF];
      for (i = 0; i < CALIB_DOF; ++i) t += calib_gate[node[k]][i] * gap[k][i];
      t = t < 0 ? 0 : t > 1 ? 1 : t;
      w *= t * t * (3 - 2 * t);
    }
"""

QUERIES = """\

/* What the model says, wherever q is. */
static inline void calib_model(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_smooth(q, x, J);
@local@}

/* Position; where J is not null also its derivative, J[coordinate * DOF + joint]. */
static inline int calib_position(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_real inside[CALIB_DOF];
  if (!calib_in_range(q)@trusted@) {
    int i;
    for (i = 0; i < CALIB_OUT; ++i) x[i] = calib_not_a_number();
    for (i = 0; J && i < CALIB_OUT * CALIB_DOF; ++i) J[i] = calib_not_a_number();
    return 0;
  }
  calib_wrapped(q, inside);
  calib_model(inside, x, J);
  return 1;
}

static inline int calib_forward(const calib_real q[CALIB_DOF], calib_real x[CALIB_OUT]) {
  return calib_position(q, x, 0);
}

static inline int calib_jacobian(const calib_real *q, calib_real J[CALIB_OUT * CALIB_DOF]) {
  calib_real x[CALIB_OUT];
  return calib_position(q, x, J);
}

/* 95 % bound on the @bound_of@@how@. */
static inline int calib_expected_error(const calib_real q[CALIB_DOF], calib_real *bound) {
  *bound = calib_not_a_number();
  if (!calib_in_range(q)@trusted@) return 0;
@bounded@  return 1;
}

/* The step of least squares for n residuals: q += J' (J J' + damping trace(J J'))^-1 r. */
static inline int calib_step(int n, const calib_real *J, const calib_real *r, calib_real damping,
                             calib_real q[CALIB_DOF]) {
  calib_real a[6][6], y[6], trace = 0;
  int i, j, k;
  for (i = 0; i < n; ++i) {
    for (j = 0; j <= i; ++j) {
      a[i][j] = 0;
      for (k = 0; k < CALIB_DOF; ++k) a[i][j] += J[i * CALIB_DOF + k] * J[j * CALIB_DOF + k];
    }
    trace += a[i][i];
    y[i] = r[i];
  }
  for (i = 0; i < n; ++i) a[i][i] += damping * trace;
  for (i = 0; i < n; ++i) { /* Cholesky */
    for (j = 0; j <= i; ++j) {
      for (k = 0; k < j; ++k) a[i][j] -= a[i][k] * a[j][k];
      if (i == j) {
        if (!(a[i][i] > 0)) return 0;
        a[i][i] = sqrt(a[i][i]);
      } else {
        a[i][j] /= a[j][j];
      }
    }
    for (k = 0; k < i; ++k) y[i] -= a[i][k] * y[k];
    y[i] /= a[i][i];
  }
  for (i = n - 1; i >= 0; --i) {
    for (k = i + 1; k < n; ++k) y[i] -= a[k][i] * y[k];
    y[i] /= a[i][i];
  }
  for (k = 0; k < CALIB_DOF; ++k)
    for (i = 0; i < n; ++i) q[k] += J[i * CALIB_DOF + k] * y[i];
  return 1;
}

/* One damped Newton step of the joints towards a position; returns the distance before it. */
static inline calib_real calib_newton_step(const calib_real target[CALIB_OUT], calib_real damping,
                                           calib_real q[CALIB_DOF]) {
  calib_real x[CALIB_OUT], J[CALIB_OUT * CALIB_DOF], squared = 0;
  int i;
  calib_model(q, x, J);
  for (i = 0; i < CALIB_OUT; ++i) {
    x[i] = target[i] - x[i];
    squared += x[i] * x[i];
  }
  if (!calib_step(CALIB_OUT, J, x, damping, q)) return calib_not_a_number();
  return sqrt(squared);
}
"""

CORRECT = """\

/* Joints that bring the real tip to where the nominal arm would be with q, near q. */
static inline int calib_correct(const calib_real q[CALIB_DOF], calib_real out[CALIB_DOF]) {
  calib_real target[CALIB_OUT], start[CALIB_DOF], before[CALIB_DOF];
  calib_real held[CALIB_DOF], left, best = 0;
  int i, step;
  if (calib_in_range(q)) {
    calib_wrapped(q, start);
    for (i = 0; i < CALIB_DOF; ++i) out[i] = start[i];
    calib_wanted(start, target);
    calib_posed(start, out);
    for (i = 0; i < CALIB_DOF; ++i) held[i] = out[i];
    for (step = 0; step < 12; ++step) {
      for (i = 0; i < CALIB_DOF; ++i) before[i] = out[i];
      left = calib_newton_step(target, @calm@, out);
      if (!(step == 0 || left < best)) break;
      best = left;
      for (i = 0; i < CALIB_DOF; ++i) held[i] = before[i];
      if (left <= @enough@) break;
    }
    for (i = 0; i < CALIB_DOF; ++i) out[i] = held[i] + (q[i] - start[i]); /* on q's own turn */
    if (best <= @close@) return 1;
  }
  for (i = 0; i < CALIB_DOF; ++i) out[i] = calib_not_a_number();
  return 0;
}
"""
