
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
