/* How far the tip may be with all joints at the worst side of their play. */
static inline calib_real calib_play_reach(const calib_joints q) {
  calib_real x[CALIB_OUT], J[CALIB_OUT * CALIB_DOF], reach = 0;
  calib_model(q, x, J);
  for (int k = 0; k < CALIB_DOF; ++k) {
    calib_real square = 0;
    for (int i = 0; i < CALIB_OUT; ++i) square += J[i * CALIB_DOF + k] * J[i * CALIB_DOF + k];
    reach += calib_play[k] * sqrt(square);
  }
  return reach;
}
