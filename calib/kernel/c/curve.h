/* Adds the error curves of all joints to values of the chain, and their derivatives. */
static inline void calib_curves(const calib_joints q, calib_multiples wave, calib_values value,
                                calib_slopes slope) {
  enum { LANES = 2 * CALIB_DOF };
  calib_real curve[LANES] = {0}, rate[LANES] = {0};
  calib_waves(CALIB_DOF, q, wave[0], wave[0] + CALIB_DOF);
  for (int n = 1; n < CALIB_HARMONICS; ++n)
    for (int i = 0; i < CALIB_DOF; ++i) {
      const calib_real c = wave[0][i], s = wave[0][CALIB_DOF + i];
      wave[n][i] = c * wave[n - 1][i] - s * wave[n - 1][CALIB_DOF + i];
      wave[n][CALIB_DOF + i] = c * wave[n - 1][CALIB_DOF + i] + s * wave[n - 1][i];
    }
  for (int n = 0; n < CALIB_HARMONICS; ++n)
    for (int k = 0; k < LANES; ++k) curve[k] += calib_curve[n][k] * wave[n][k];
  for (int n = 0; slope && n < CALIB_HARMONICS; ++n)
    for (int k = 0; k < LANES; ++k) rate[k] += calib_curve_rate[n][k] * wave[n][k];
  for (int i = 0; i < CALIB_CHAIN; ++i)
    for (int k = 0; k < CALIB_DOF; ++k) {
      value[i] += calib_coupling[i][k] * (curve[k] + curve[CALIB_DOF + k]);
      if (slope) slope[i][k] += calib_coupling[i][k] * (rate[k] + rate[CALIB_DOF + k]);
    }
}
