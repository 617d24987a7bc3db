/* Adds how much each joint bends under the weights, how these are swung by it at the posture that is drawn,
 * `at`, and where slope is not null the derivatives.  A weight of a link is a mass at the end of the link and its
 * moment in the frame there; the lever of a joint is that of the weights beyond it. */
static inline void calib_sag(const calib_joints q, calib_frame *at, calib_real swung[CALIB_CHAIN][3],
                             calib_values value, calib_slopes slope) {
  calib_real across[CALIB_CHAIN][3] = {{0}}, lever[CALIB_CHAIN][4], drawn[CALIB_CHAIN];
  int i, j, k;
  calib_mixed(&calib_drawn, q, drawn, 0);
  calib_frames(&calib_drawn, drawn, at);
  for (i = 0; i < CALIB_CHAIN; ++i)
    if (calib_turns[i]) calib_cross(calib_gravity, at[i].axes + 6, across[i]);
  for (i = 0; i < CALIB_CHAIN; ++i) {
    calib_real sum[4] = {0, 0, 0, 0}, moved[3];
    for (j = CALIB_CHAIN - 1; j >= i; --j) {
      sum[3] += calib_bending[i][j][0];
      calib_add(at[j + 1].axes, calib_bending[i][j] + 1, sum);
      for (k = 0; k < 3; ++k) sum[k] += sum[3] * (at[j + 1].p[k] - at[j].p[k]);
      calib_copy(4, sum, lever[j]);
    }
    calib_swing(at, i, lever[i], swung[i]);
    value[i] += calib_dot(3, swung[i], calib_gravity);
    for (j = 0; slope && j < CALIB_CHAIN; ++j) {
      /* a joint before turns the whole lever, one beyond only the weights that follow it */
      calib_real by_joint;
      calib_swing(at, j > i ? j : i, lever[j > i ? j : i], moved);
      by_joint = calib_dot(3, across[j < i ? j : i], moved);
      for (k = 0; k < CALIB_DOF; ++k) slope[i][k] += by_joint * calib_drawn.mix[j][k];
    }
  }
}
