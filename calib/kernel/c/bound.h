/* Where the tip is (and 1), how it moves with joints, and with each part of the arm in the order
 * of calib_by_part without view and lens: as origins shift and turn along the axes of their frames,
 * by offsets of joints, by gains of their own and of the joints before, and by loads. */
static inline void calib_parts_off(const calib_joints q, calib_bend *bend, calib_real tip[4],
                                   calib_real motion[CALIB_PARTS][3], calib_real joint[CALIB_DOF][3]) {
  calib_frame at[CALIB_CHAIN + 1];
  calib_real by_joint[CALIB_CHAIN][3], lever[3];
  int row = 0;
  calib_posture(&calib_body, q, bend, at, 0);
  calib_copy(3, at[CALIB_CHAIN].p, tip);
  for (int i = 0; i <= CALIB_CHAIN; ++i, row += 3) calib_copy(9, at[i].axes, motion[row]);
  for (int i = 0; i < CALIB_CHAIN; ++i) {
    calib_swing(at, i, tip, by_joint[i]);
    for (int k = 0; k < 3; ++k) lever[k] = tip[k] - at[i].p[k];
    for (int k = 0; k < 9; k += 3) calib_cross(at[i].axes + k, lever, motion[row++]);
    for (int n = 0; n < CALIB_DOF; ++n)
      calib_add_times(calib_coupling[i][n], by_joint[i], joint[n]);
  }
  for (int i = 0; i < CALIB_DOF; ++i) calib_add_times(1, joint[i], motion[row++]);
  for (int i = 0; i < CALIB_DOF; ++i) calib_add_times(q[i], joint[i], motion[row++]);
  for (int i = 1; i < CALIB_DOF; ++i) calib_add_times(q[i - 1], joint[i], motion[row++]);
#if @gravity@
  calib_loads_off(bend, by_joint, motion + row);
#endif
}

/* How the sensor sees the tip move in each direction of beliefs; and with each joint, and the variances
 * of the joints' curves by themselves. */
static inline void calib_moves(const calib_joints q, calib_ways z[3], calib_real by_joint[CALIB_DOF][3],
                               calib_real alone[CALIB_DOF][CALIB_BELIEFS]) {
  calib_bend bend;
  calib_real motion[CALIB_PARTS][3] = {{0}}, joint[CALIB_DOF][3] = {{0}}, seen[9];
  calib_real point[4] = {0, 0, 0, 1};
  calib_ways there[3] = {{0}};
  (void)alone;
  calib_parts_off(q, &bend, point, motion, joint);
  for (int k = 0; k < 3; ++k)
    calib_add_rows(CALIB_PARTS, motion[0] + k, 3, calib_by_part[CALIB_VIEW], there[k]);
#if @alone@
  for (int n = 0; n < CALIB_DOF; ++n) {
    calib_ways off = {0};
    calib_curve_off(n, q[n], bend.wave, off, alone[n]);
    for (int k = 0; k < 3; ++k) calib_add_rows(1, joint[n] + k, 3, off, there[k]);
  }
#endif
  calib_copy(9, calib_view, seen);
  calib_product(3, seen, CALIB_TOGETHER, there[0], z[0]);
  for (int k = 0; k < 3; ++k) calib_add_rows(4, point, 1, calib_by_part[4 * k], z[k]);
#if @lens@
  calib_real before[3], x[2], u[2], L[9] = {0};
  calib_product(3, seen, 1, point, before);
  calib_add_times(1, calib_shift, before);
  calib_pinhole(before, x, L, u);
  calib_product(3, L, 3, calib_view, seen);
  calib_copy(3 * CALIB_TOGETHER, z[0], there[0]);
  calib_product(3, L, CALIB_TOGETHER, there[0], z[0]);
  for (int k = 0; k < 2; ++k) {
    const calib_real bent = (x[k] - calib_lens[1 + k]) / calib_lens[0];
    const calib_real cubic = calib_lens[0] * u[k] * calib_dot(2, u, u);
    const calib_real lens[4] = {bent, k == 0, k == 1, cubic};
    calib_add_rows(4, lens, 1, calib_by_part[CALIB_VIEW + CALIB_PARTS], z[k]);
  }
#endif
  for (int n = 0; n < CALIB_DOF; ++n) calib_product(3, seen, 1, joint[n], by_joint[n]);
}

/* 95 % bound of all beliefs, with variances that are added to those of the position. */
static inline calib_real calib_posterior(const calib_joints q, const calib_vector more) {
  calib_real alone[CALIB_DOF][CALIB_BELIEFS] = {{0}}, joint[CALIB_DOF][3], bound = 0;
  calib_ways z[3];
  calib_moves(q, z, joint, alone);
  for (int b = 0; b < CALIB_BELIEFS; ++b) {
    /* the last direction is by how much the beliefs are apart */
    const int first = b * CALIB_WAYS, last = CALIB_WAYS - 1;
    calib_real trace = 0, squares = 0, apart = 0;
    for (int j = 0; j < 3; ++j) {
      for (int k = j; k < 3; ++k) {
        calib_real sum = calib_dot(last, z[j] + first, z[k] + first);
        for (int i = 0; i < CALIB_DOF; ++i) sum += alone[i][b] * joint[i][j] * joint[i][k];
        sum = calib_belief_scale[b][1] * sum + (j == k ? more[j] : 0);
        trace += j == k ? sum : 0;
        squares += (j == k ? 1 : 2) * sum * sum;
      }
      apart += z[j][first + last] * z[j][first + last];
    }
    apart = sqrt(apart) + calib_belief_scale[b][0] * calib_radius_95(trace, squares);
    if (apart > bound) bound = apart;
  }
  return bound;
}
