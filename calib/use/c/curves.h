
/* Error curves of all joints and their derivatives, by Horner's rule in exp(j q). */
static inline void calib_curves(const calib_real q[CALIB_DOF], calib_real value[CALIB_DOF],
                                calib_real slope[CALIB_DOF], int slopes) {
  calib_real c[CALIB_DOF], s[CALIB_DOF], im[CALIB_DOF], dim[CALIB_DOF], t;
  int i, n;
  for (i = 0; i < CALIB_DOF; ++i) {
    c[i] = cos(q[i]);
    s[i] = sin(q[i]);
    value[i] = im[i] = slope[i] = dim[i] = 0;
  }
  for (n = CALIB_HARMONICS - 1; n >= 0; --n)
    for (i = 0; i < CALIB_DOF; ++i) {
      t = value[i] + calib_curve_cos[n][i];
      im[i] -= calib_curve_sin[n][i];
      value[i] = t * c[i] - im[i] * s[i];
      im[i] = t * s[i] + im[i] * c[i];
    }
  for (n = CALIB_HARMONICS - 1; slopes && n >= 0; --n)
    for (i = 0; i < CALIB_DOF; ++i) {
      t = slope[i] + (calib_real)(n + 1) * calib_curve_sin[n][i];
      dim[i] += (calib_real)(n + 1) * calib_curve_cos[n][i];
      slope[i] = t * c[i] - dim[i] * s[i];
      dim[i] = t * s[i] + dim[i] * c[i];
    }
}
