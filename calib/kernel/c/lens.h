/* What a lens (focal length, centre, k1) shows of a point, its derivative, the point at depth 1. */
static inline void calib_pinhole(const calib_vector at, calib_real x[2], calib_real L[6],
                                 calib_real u[2]) {
  const calib_real depth = at[2] > @least_depth@ ? at[2] : @least_depth@, f = calib_lens[0];
  for (int i = 0; i < 2; ++i) u[i] = at[i] / depth;
  const calib_real bent = 1 + calib_lens[3] * calib_dot(2, u, u), twice = 2 * calib_lens[3];
  L[0] = f * (bent + twice * u[0] * u[0]) / depth;
  L[1] = L[3] = f * twice * u[0] * u[1] / depth;
  L[4] = f * (bent + twice * u[1] * u[1]) / depth;
  for (int i = 0; i < 2; ++i) {
    x[i] = f * u[i] * bent + calib_lens[1 + i];
    L[3 * i + 2] = -calib_dot(2, L + 3 * i, u);
  }
}
