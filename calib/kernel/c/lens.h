/* What a lens (focal length, centre, k1) shows of a point, its derivative, the point at depth 1. */
static inline void calib_pinhole(const calib_vector at, calib_real x[2], calib_real L[6],
                                 calib_real u[2]) {
  const calib_real depth = at[2] > @least_depth@ ? at[2] : @least_depth@, f = calib_lens[0];
  const calib_real a = at[0] / depth, b = at[1] / depth, r2 = a * a + b * b;
  const calib_real k1 = calib_lens[3], bent = 1 + k1 * r2, twice = 2 * k1;
  u[0] = a;
  u[1] = b;
  L[0] = f * (bent + twice * a * a) / depth;
  L[1] = L[3] = f * twice * a * b / depth;
  L[4] = f * (bent + twice * b * b) / depth;
  for (int i = 0; i < 2; ++i) {
    x[i] = f * u[i] * bent + calib_lens[1 + i];
    L[3 * i + 2] = -(L[3 * i] * a + L[3 * i + 1] * b);
  }
}
