
/* What the sensor sees of a chain, and where J is not null its derivative (row by row). */
static inline void calib_seen(const calib_arm *arm, const calib_real q[CALIB_DOF],
                              calib_real x[CALIB_OUT], calib_real *J, calib_real R[9]) {
  calib_real p[3], G[6 * CALIB_DOF], at[3], V[9];
  int i, j, k;
  calib_chain(arm, q, p, R, J ? G : 0, 0);
  for (i = 0; i < 3; ++i) at[i] = calib_shift[i] + calib_dot(calib_view + 3 * i, p);
  for (i = 0; i < 9; ++i) V[i] = calib_view[i];
@view@  for (i = 0; J && i < CALIB_OUT; ++i)
    for (k = 0; k < CALIB_DOF; ++k) {
      J[i * CALIB_DOF + k] = 0;
      for (j = 0; j < 3; ++j) J[i * CALIB_DOF + k] += V[3 * i + j] * G[j * CALIB_DOF + k];
    }
}

static inline void calib_smooth(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_real R[9];
  calib_seen(&calib_body, q, x, J, R);
}
