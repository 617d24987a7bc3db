/* Adds the weight of a link, a mass at its end and the moment in the frame there, to others. */
static inline void calib_weigh(const calib_frame *end, const calib_real *weight, calib_real *sum) {
  calib_add(end->axes, weight + 1, sum);
  calib_add_times(weight[0], end->p, sum);
  sum[3] += weight[0];
}

/* Adds how much each joint bends under the weights beyond it, and where slope is not null the
 * derivatives: by how it swings them at the posture that is drawn, `at`. */
static inline void calib_sag(const calib_joints q, calib_frame *at, calib_real swung[CALIB_CHAIN][3],
                             calib_values value, calib_slopes slope) {
  calib_real across[CALIB_CHAIN][3] = {{0}}, moved[CALIB_CHAIN][3], drawn[CALIB_CHAIN];
  calib_mixed(&calib_drawn, q, drawn, 0);
  calib_frames(&calib_drawn, drawn, at);
  for (int i = 0; i < CALIB_CHAIN; ++i) {
    calib_real weights[4] = {0, 0, 0, 0};
    if (calib_turns[i]) calib_cross(calib_gravity, at[i].axes + 6, across[i]);
    for (int j = CALIB_CHAIN - 1; j >= i; --j) {
      calib_weigh(at + j + 1, calib_bending[i][j], weights);
      if (slope || j == i) calib_swing(at, j, weights, moved[j]);
    }
    calib_copy(3, moved[i], swung[i]);
    value[i] += calib_dot(3, swung[i], calib_gravity);
    for (int j = 0; slope && j < CALIB_CHAIN; ++j) {
      /* a joint before swings all these weights, one beyond only those that follow it */
      const calib_real by_joint = calib_dot(3, across[j < i ? j : i], moved[j > i ? j : i]);
      for (int k = 0; k < CALIB_DOF; ++k) slope[i][k] += by_joint * calib_drawn.mix[j][k];
    }
  }
}
