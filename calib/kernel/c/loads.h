/* Adds how the tip moves as loads bend joints more, by how these move it, and as gravity tilts. */
static inline void calib_loads_off(const calib_bend *bend, calib_real by_joint[CALIB_CHAIN][3],
                                   calib_real motion[][3]) {
  const calib_frame *at = bend->drawn;
  for (int n = 0; n < CALIB_LOADS; ++n) { /* of a joint, from a link to another */
    calib_real weights[4] = {0, 0, 0, 0}, moved[3];
    const int i = calib_loaded[n][0];
    for (int j = calib_loaded[n][1]; j <= calib_loaded[n][2]; ++j)
      calib_weigh(at + j + 1, calib_load[n][j], weights);
    calib_swing(at, i, weights, moved);
    calib_add_times(calib_dot(3, moved, calib_gravity), by_joint[i], motion[n]);
  }
  for (int i = 0; i < CALIB_CHAIN; ++i)
    for (int n = 0; n < 2; ++n)
      calib_add_times(calib_dot(3, bend->swung[i], calib_tilt[n]), by_joint[i],
                      motion[CALIB_LOADS + n]);
}
