/* How much a joint's curve is off in each direction of beliefs, and its variance by itself. */
static inline void calib_curve_off(int joint, calib_real value, calib_multiples wave, calib_ways off,
                                   calib_real alone[CALIB_BELIEFS]) {
  const calib_real turn = value / (calib_real)6.283185307179586;
  const calib_real place = CALIB_KNOTS * (turn - floor(turn)), knot = floor(place);
  const int first = (int)knot % CALIB_KNOTS, next = (first + 1) % CALIB_KNOTS;
  for (int b = 0; b < CALIB_BELIEFS; ++b) {
    const calib_real *variance = calib_alone[b][joint];
    alone[b] = variance[first] + (place - knot) * (variance[next] - variance[first]);
  }
  for (int b = 0; b < 2; ++b) /* cosines, then sines */
    calib_add_rows(CALIB_HARMONICS, wave[0] + b * CALIB_DOF + joint, 2 * CALIB_DOF,
                   calib_by_wave[joint][b][0], off);
}
