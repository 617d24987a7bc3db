enum {
  CALIB_KNOTS = @knots@, CALIB_LOADS = @loads@, CALIB_PARTS = @parts@, CALIB_VIEW = 12,
  CALIB_BELIEFS = @beliefs@, CALIB_WAYS = @ways@, CALIB_TOGETHER = CALIB_BELIEFS * CALIB_WAYS
};

/* Amounts of what beliefs vary together in: CALIB_WAYS directions of each. */
typedef calib_real calib_ways[CALIB_TOGETHER];

/* Radius of 95 % of a Gaussian, by the trace of its covariance and the sum of its squares. */
static inline calib_real calib_radius_95(calib_real trace, calib_real squares) {
  const calib_real g = (calib_real)2 / 9 * squares / (trace * trace), r = 1 - g + @normal@ * sqrt(g);
  return trace > 0 ? sqrt(trace * r * r * r) : 0;
}

/* Adds amounts, so far apart, of rows of what beliefs vary together in. */
static inline void calib_add_rows(int count, const calib_real *__restrict amount, int apart,
                                  const calib_real *__restrict row, calib_real *__restrict sum) {
  int n;
  for (n = 0; n + 1 < count; n += 2, row += 2 * CALIB_TOGETHER) { /* two at a time are quicker */
    const calib_real a = amount[n * apart], b = amount[(n + 1) * apart];
    for (int r = 0; r < CALIB_TOGETHER; ++r) sum[r] += a * row[r] + b * row[CALIB_TOGETHER + r];
  }
  for (int r = 0; n < count && r < CALIB_TOGETHER; ++r) sum[r] += amount[n * apart] * row[r];
}

#if @gravity@

/* Adds how the tip moves as loads bend joints more, by how these move the tip, and as gravity tilts. */
static inline void calib_loads_off(const calib_bend *bend, calib_real by_joint[CALIB_CHAIN][3],
                                   calib_real motion[][3]) {
  const calib_frame *at = bend->drawn;
  int i;
  for (int n = 0; n < CALIB_LOADS; ++n) { /* a joint, and the first and last link that weigh on it */
    calib_real weights[4] = {0, 0, 0, 0}, moved[3];
    i = calib_loaded[n][0];
    for (int j = calib_loaded[n][1]; j <= calib_loaded[n][2]; ++j)
      calib_weigh(at + j + 1, calib_load[n][j], weights);
    calib_swing(at, i, weights, moved);
    calib_add_times(calib_dot(3, moved, calib_gravity), by_joint[i], motion[n]);
  }
  for (i = 0; i < CALIB_CHAIN; ++i)
    for (int n = 0; n < 2; ++n)
      calib_add_times(calib_dot(3, bend->swung[i], calib_tilt[n]), by_joint[i], motion[CALIB_LOADS + n]);
}
#endif

/* Where the tip is (its fourth number is 1), and how it moves with joints and with each part of the arm, in the order of those of
 * calib_by_part between the numbers of view and lens: as origins shift and turn along the axes of their
 * frames, by offsets of joints, by gains of their own and of the joints before, and by loads. */
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
    for (int n = 0; n < CALIB_DOF; ++n) calib_add_times(calib_coupling[i][n], by_joint[i], joint[n]);
  }
  for (int i = 0; i < CALIB_DOF; ++i) calib_add_times(1, joint[i], motion[row++]);
  for (int i = 0; i < CALIB_DOF; ++i) calib_add_times(q[i], joint[i], motion[row++]);
  for (int i = 1; i < CALIB_DOF; ++i) calib_add_times(q[i - 1], joint[i], motion[row++]);
#if @gravity@
  calib_loads_off(bend, by_joint, motion + row);
#endif
}
#if @alone@

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
#endif

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
  for (int k = 0; k < 3; ++k) calib_add_rows(CALIB_PARTS, motion[0] + k, 3, calib_by_part[CALIB_VIEW], there[k]);
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
  {
    calib_real before[3], x[2], u[2], L[9] = {0};
    calib_product(3, seen, 1, point, before);
    calib_add_times(1, calib_shift, before);
    calib_pinhole(before, x, L, u);
    calib_product(3, L, 3, calib_view, seen);
    calib_copy(3 * CALIB_TOGETHER, z[0], there[0]);
    calib_product(3, L, CALIB_TOGETHER, there[0], z[0]);
    for (int k = 0; k < 2; ++k) {
      const calib_real bent = (x[k] - calib_lens[1 + k]) / calib_lens[0];
      const calib_real cubic = calib_lens[0] * u[k] * (u[0] * u[0] + u[1] * u[1]);
      const calib_real lens[4] = {bent, k == 0, k == 1, cubic};
      calib_add_rows(4, lens, 1, calib_by_part[CALIB_VIEW + CALIB_PARTS], z[k]);
    }
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
