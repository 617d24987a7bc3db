
/* Derivatives of the position: by the geometry, and by the joints' own angles. */
static inline void calib_derivatives(const calib_real q[CALIB_DOF],
                                     calib_real geometry[CALIB_GEOMETRY][3],
                                     calib_real own[CALIB_DOF][3]) {
  const calib_real size = calib_lens[5], unit[4] = {1, 0, 0, 1};
  calib_real at[CALIB_DOF + 1][5], x[CALIB_OUT], V[4], L[4], lens[4], y[2], u[2], w;
  calib_real after_x = 0, after_y = 0, *tip = at[CALIB_DOF];
  int i, j, o, e = @elastic@;
  calib_body(calib_beta, @curves@, q, x, 0, at);
  calib_shown(tip, x, y, u, V, L);
  w = 1 + calib_view[6] * tip[0] + calib_view[7] * tip[1];
  for (i = 0; i < 4; ++i) lens[i] = L[i];
  calib_slope(lens, unit);
  calib_slope(L, V);
  for (o = 0; o < 2; ++o) {
    geometry[8][o] = size * (u[0] * u[0] + u[1] * u[1]) * u[o];
    for (i = 0; i < 2; ++i) geometry[9 + i][o] = size * (unit[2 * o + i] - lens[2 * o + i]);
  }
  geometry[0][0] = -y[1];
  geometry[0][1] = y[0];
  for (o = 0; o < 2; ++o) {
    geometry[1][o] = y[o];
    for (i = 0; i < 2; ++i) {
      const calib_real *shear = calib_shears + 4 * i + 2 * o;
      geometry[2 + i][o] = (shear[0] * tip[0] + shear[1] * tip[1]) / w;
      geometry[4 + i][o] = i == o;
      geometry[6 + i][o] = -y[o] * tip[i] / w;
    }
  }
  for (i = 0; i < 8; ++i) calib_mapped(lens, geometry[i][0], geometry[i][1], geometry[i]);
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
