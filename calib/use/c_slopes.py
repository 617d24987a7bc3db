"""C source of how positions move with a body's parameters, for the posterior's bound.

Each defines ``calib_derivatives``: columns by all parameters but the joints' curves, in the order
of the body's layout, and by each joint's own angle, which its curve multiplies.
"""

from __future__ import annotations

PLANAR = """\

/* out = M (x, y). */
static inline void calib_mapped(const calib_real M[4], calib_real x, calib_real y,
                                calib_real *out) {
  out[0] = M[0] * x + M[1] * y;
  out[1] = M[2] * x + M[3] * y;
}

/* Derivatives of the position: by the geometry, and by the joints' own angles. */
static inline void calib_derivatives(const calib_real q[CALIB_DOF],
                                     calib_real geometry[CALIB_GEOMETRY][3],
                                     calib_real own[CALIB_DOF][3]) {
  const calib_real *m = calib_view, k = calib_lens[0], size = calib_lens[5];
  calib_real at[CALIB_DOF + 1][5], x[CALIB_OUT], V[4], L[4], y[2], u[2], sx, sy, w, r2;
  calib_real after_x = 0, after_y = 0;
  int i, j, o, e = @elastic@;
  calib_body(calib_beta, @curves@, q, x, 0, at);
  sx = at[CALIB_DOF][0];
  sy = at[CALIB_DOF][1];
  w = 1 + m[6] * sx + m[7] * sy;
  for (o = 0; o < 2; ++o) {
    y[o] = (m[2 * o] * sx + m[2 * o + 1] * sy) / w;
    u[o] = (y[o] + m[4 + o] - calib_lens[3 + o]) / size - calib_lens[1 + o];
    for (i = 0; i < 2; ++i) V[2 * o + i] = (m[2 * o + i] - y[o] * m[6 + i]) / w;
  }
  r2 = u[0] * u[0] + u[1] * u[1];
  for (i = 0; i < 4; ++i) L[i] = 2 * u[i / 2] * u[i % 2] + (i % 3 ? 0 : r2);
  for (o = 0; o < 2; ++o) {
    geometry[8][o] = size * r2 * u[o];
    for (i = 0; i < 2; ++i) geometry[9 + i][o] = -size * k * L[2 * o + i];
  }
  for (i = 0; i < 4; ++i) L[i] = k * L[i] + (i % 3 ? 0 : 1);
  geometry[0][0] = -y[1];
  geometry[0][1] = y[0];
  for (o = 0; o < 2; ++o) {
    geometry[1][o] = y[o];
    for (i = 0; i < 2; ++i) {
      const calib_real *shear = calib_shears + 4 * i + 2 * o;
      geometry[2 + i][o] = (shear[0] * sx + shear[1] * sy) / w;
      geometry[4 + i][o] = i == o;
      geometry[6 + i][o] = -y[o] * (i ? sy : sx) / w;
    }
  }
  for (i = 0; i < 8; ++i) calib_mapped(L, geometry[i][0], geometry[i][1], geometry[i]);
  for (o = 0; o < 2; ++o) { /* the derivative by the tip is L V */
    const calib_real a = L[2 * o], b = L[2 * o + 1];
    L[2 * o] = a * V[0] + b * V[2];
    L[2 * o + 1] = a * V[1] + b * V[3];
  }
  for (i = CALIB_DOF - 1; i >= 0; --i) {
    const calib_real *c = at[i];
    const calib_real value = calib_sign[i] * q[i];
    after_x += c[3];
    after_y += c[4];
    calib_mapped(L, c[1], c[2], geometry[@length@ + i]);
    calib_mapped(L, -after_y, after_x, own[i]);
    for (o = 0; o < 2; ++o) {
      geometry[@offset@ + i][o] = own[i][o];
      geometry[@gain@ + i][o] = own[i][o] * value;
    }
    if (calib_turns[i]) continue;
    calib_mapped(L, -c[4], c[3], geometry[@offset@ + i]);
    calib_mapped(L, c[1] * value * @slide@, c[2] * value * @slide@, geometry[@gain@ + i]);
  }
  for (i = 0; i < CALIB_DOF; ++i)
    for (j = i; j < CALIB_DOF; ++j) {
      if (!calib_turns[i] || !calib_turns[j]) continue;
      for (o = 0; o < 2; ++o) {
        geometry[e][o] = own[i][o] * cos(at[j][0]);
        geometry[e + 1][o] = own[i][o] * sin(at[j][0]);
      }
      e += 2;
    }
  for (i = 0; i < CALIB_GEOMETRY; ++i) geometry[i][2] = 0;
  for (i = 0; i < CALIB_DOF; ++i) own[i][2] = 0;
}
"""

SPATIAL = """\

/* Derivatives of the position: by the geometry, and by the joints' own values. */
static inline void calib_derivatives(const calib_real q[CALIB_DOF],
                                     calib_real geometry[CALIB_GEOMETRY][3],
                                     calib_real own[CALIB_DOF][3]) {
  calib_real at[CALIB_CHAIN + 1][21], load[CALIB_CHAIN], bent[CALIB_CHAIN][CALIB_DOF];
  calib_real p[3], R[9], point[3], arrow[3], moved[3], about[3], flange[9];
  int i, a, k, n = 17 + 6 * CALIB_CHAIN;
  calib_chain(&calib_body, q, p, R, 0, at);
  for (i = 0; i < CALIB_GEOMETRY; ++i)
    for (k = 0; k < 3; ++k) geometry[i][k] = i - 3 == k ? 1 : 0;
  for (k = 0; k < 3; ++k) geometry[6][k] = point[k] = calib_dot(calib_view + 3 * k, p);
  for (k = 0; k < 9; ++k) flange[k] = at[CALIB_CHAIN][k];
  calib_times(flange, calib_flange);
  for (a = 0; a < 3; ++a) {
    calib_cross(geometry[3 + a], point, geometry[a]);
    for (k = 0; k < 3; ++k) about[k] = flange[3 * k + a];
    for (k = 0; k < 3; ++k) geometry[11 + a][k] = calib_dot(calib_view + 3 * k, about);
  }
  for (k = 0; k < CALIB_DOF; ++k)
    for (a = 0; a < 3; ++a) own[k][a] = 0;
  if (@bends@) calib_loads(q, load, bent, 0);
  for (i = 0; i < CALIB_CHAIN; ++i) {
    for (k = 0; k < 3; ++k) arrow[k] = p[k] - at[i][18 + k];
    for (a = 0; a < 3; ++a) {
      for (k = 0; k < 3; ++k) moved[k] = at[i][3 * k + a];
      for (k = 0; k < 3; ++k)
        geometry[17 + 6 * i + a][k] = calib_dot(calib_view + 3 * k, moved);
      for (k = 0; k < 3; ++k) about[k] = at[i][9 + 3 * k + a];
      calib_cross(about, arrow, moved);
      for (k = 0; k < 3; ++k)
        geometry[20 + 6 * i + a][k] = calib_dot(calib_view + 3 * k, moved);
    }
    for (k = 0; k < 3; ++k) about[k] = calib_dot(at[i] + 9 + 3 * k, calib_axis[i]);
    if (calib_bends[i]) calib_cross(about, arrow, about);
    for (a = 0; a < 3; ++a) {
      const calib_real slope = calib_dot(calib_view + 3 * a, about);
      for (k = 0; k < CALIB_DOF; ++k) own[k][a] += calib_coupling[i][k] * slope;
      if (@bends@) geometry[n + 2 * CALIB_DOF + i][a] = slope * load[i];
    }
  }
  for (k = 0; k < CALIB_DOF; ++k)
    for (a = 0; a < 3; ++a) {
      geometry[n + k][a] = own[k][a];
      geometry[n + CALIB_DOF + k][a] = own[k][a] * q[k];
    }
@seen@}
"""

PIXELS = """\

/* The same of pixels: through the camera, and by its lens. */
static inline void calib_in_pixels(const calib_real p[3], calib_real geometry[CALIB_GEOMETRY][3],
                                   calib_real own[CALIB_DOF][3]) {
  calib_real at[3], x[2], L[6], u[2];
  int i, k;
  for (k = 0; k < 3; ++k) at[k] = calib_shift[k] + calib_dot(calib_view + 3 * k, p);
  calib_pinhole(at, x, L, u);
  for (i = 0; i < CALIB_GEOMETRY + CALIB_DOF; ++i) {
    calib_real *moved = i < CALIB_GEOMETRY ? geometry[i] : own[i - CALIB_GEOMETRY];
    const calib_real across = calib_dot(L, moved);
    moved[1] = calib_dot(L + 3, moved);
    moved[0] = across;
    moved[2] = 0;
  }
  for (k = 0; k < 2; ++k) {
    geometry[7][k] = (x[k] - calib_lens[1 + k]) / calib_lens[0];
    geometry[8 + k][k] = 1;
    geometry[10][k] = calib_lens[0] * u[k] * (u[0] * u[0] + u[1] * u[1]);
  }
}
"""
"""Of a camera: goes before `SPATIAL`, which calls it."""
