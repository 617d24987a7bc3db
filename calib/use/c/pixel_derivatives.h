
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
