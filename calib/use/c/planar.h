/* out = M (x, y). */
static inline void calib_mapped(const calib_real M[4], calib_real x, calib_real y,
                                calib_real out[2]) {
  out[0] = M[0] * x + M[1] * y;
  out[1] = M[2] * x + M[3] * y;
}

/* What the sensor shows of a tip, x; y is that without shift and lens, u its place in the lens;
 * V is the derivative of y by the tip, k L that of what the lens adds. */
static inline void calib_shown(const calib_real tip[2], calib_real x[2], calib_real y[2],
                               calib_real u[2], calib_real V[4], calib_real L[4]) {
  const calib_real *m = calib_view, *lens = calib_lens;
  const calib_real w = 1 + m[6] * tip[0] + m[7] * tip[1];
  calib_real r2;
  int i, o;
  calib_mapped(m, tip[0], tip[1], y);
  for (o = 0; o < 2; ++o) {
    y[o] /= w;
    x[o] = y[o] + m[4 + o];
    u[o] = (x[o] - lens[3 + o]) / lens[5] - lens[1 + o];
    for (i = 0; i < 2; ++i) V[2 * o + i] = (m[2 * o + i] - y[o] * m[6 + i]) / w;
  }
  r2 = u[0] * u[0] + u[1] * u[1];
  for (o = 0; o < 2; ++o) x[o] += lens[5] * lens[0] * r2 * u[o];
  for (i = 0; i < 4; ++i) L[i] = 2 * u[i / 2] * u[i % 2] + (i % 3 ? 0 : r2);
}

/* L becomes (1 + k L) V, the derivative of x by the tip. */
static inline void calib_slope(calib_real L[4], const calib_real V[4]) {
  int i, o;
  for (i = 0; i < 4; ++i) L[i] = calib_lens[0] * L[i] + (i % 3 ? 0 : 1);
  for (o = 0; o < 4; o += 2) {
    const calib_real a = L[o], b = L[o + 1];
    for (i = 0; i < 2; ++i) L[o + i] = a * V[i] + b * V[2 + i];
  }
}

/* Body: position; where J is not null its derivative by the joints (row by row), and where `at`
 * is not null each joint's nominal angle, direction and part of the chain, and the tip. */
static inline void calib_body(const calib_real *beta, int curves, const calib_real q[CALIB_DOF],
                              calib_real x[CALIB_OUT], calib_real *J, calib_real at[][5]) {
  calib_real psi[CALIB_DOF], theta[CALIB_DOF], own[CALIB_DOF], bend[CALIB_DOF][CALIB_DOF];
  calib_real ux[CALIB_DOF], uy[CALIB_DOF], px[CALIB_DOF], py[CALIB_DOF], after[CALIB_DOF][2];
  calib_real value[CALIB_DOF], slope[CALIB_DOF], y[2], u[2], V[4], L[4], tx, ty;
  calib_real sum = 0, angle = 0, tip[2] = {0, 0};
  int i, j, k, e = 0;
  if (curves) calib_curves(q, value, slope, J != 0);
  for (i = 0; i < CALIB_DOF; ++i) {
    if (calib_turns[i]) sum += calib_sign[i] * q[i];
    psi[i] = sum;
  }
  for (i = 0; i < CALIB_DOF; ++i) {
    own[i] = beta[@gain@ + i] * calib_sign[i];
    theta[i] = calib_turns[i] ? own[i] * q[i] + beta[@offset@ + i] : 0;
    for (j = 0; j < CALIB_DOF; ++j) bend[i][j] = 0;
  }
  for (i = 0; i < CALIB_DOF; ++i) {
    if (!calib_turns[i]) continue;
    for (j = i; j < CALIB_DOF; ++j) {
      calib_real a, b, c, s;
      if (!calib_turns[j]) continue;
      a = beta[@elastic@ + e];
      b = beta[@elastic@ + e + 1];
      e += 2;
      if (a == 0 && b == 0) continue;
      c = cos(psi[j]);
      s = sin(psi[j]);
      theta[i] += a * c + b * s;
      bend[i][j] = b * c - a * s;
    }
    if (curves) {
      theta[i] += value[i];
      own[i] += slope[i];
    }
  }
  for (i = 0; i < CALIB_DOF; ++i) {
    calib_real reach = beta[@length@ + i], turn;
    angle += theta[i];
    turn = calib_turns[i] ? angle : angle + beta[@offset@ + i];
    ux[i] = cos(turn);
    uy[i] = sin(turn);
    if (!calib_turns[i]) reach += own[i] * q[i] * @slide@;
    px[i] = reach * ux[i];
    py[i] = reach * uy[i];
    tip[0] += px[i];
    tip[1] += py[i];
    if (at) {
      at[i][0] = psi[i]; at[i][1] = ux[i]; at[i][2] = uy[i]; at[i][3] = px[i]; at[i][4] = py[i];
      at[CALIB_DOF][0] = tip[0]; at[CALIB_DOF][1] = tip[1];
    }
  }
  calib_shown(tip, x, y, u, V, L);
  if (!J) return;
  calib_slope(L, V);
  tx = ty = 0;
  for (i = CALIB_DOF - 1; i >= 0; --i) { /* j times the part of the chain that joint i turns */
    tx -= py[i];
    ty += px[i];
    after[i][0] = tx;
    after[i][1] = ty;
  }
  for (i = 0; i < CALIB_DOF; ++i) {
    const calib_real rate = calib_turns[i] ? own[i] : own[i] * @slide@;
    tx = rate * (calib_turns[i] ? after[i][0] : ux[i]);
    ty = rate * (calib_turns[i] ? after[i][1] : uy[i]);
    for (k = 0; k < CALIB_DOF; ++k)
      for (j = i; calib_turns[i] && j < CALIB_DOF; ++j) {
        tx += after[k][0] * bend[k][j] * calib_sign[i];
        ty += after[k][1] * bend[k][j] * calib_sign[i];
      }
    calib_mapped(L, tx, ty, y);
    J[i] = y[0];
    J[CALIB_DOF + i] = y[1];
  }
}

static inline void calib_smooth(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_body(calib_beta, @curves@, q, x, J, 0);
}
