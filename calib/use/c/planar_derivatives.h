
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
