
#if @belief_scale@

enum {
  CALIB_KNOTS = @knots@, CALIB_LOADS = @loads@, CALIB_SHIFTS = 3 * CALIB_CHAIN + 3,
  CALIB_BELIEFS = @beliefs@, CALIB_WAYS = @ways@, CALIB_TOGETHER = CALIB_BELIEFS * CALIB_WAYS
};

/* Amounts of what beliefs vary together in: CALIB_WAYS directions of each. */
typedef calib_real calib_ways[CALIB_TOGETHER];

/* Radius of 95 % of a Gaussian of covariance S (xx, xy, xz, yy, yz, zz) and more (3). */
static inline calib_real calib_radius_95(const calib_real S[6], calib_real share,
                                         const calib_vector more) {
  const calib_real a = share * S[0] + more[0], d = share * S[3] + more[1];
  const calib_real f = share * S[5] + more[2], trace = a + d + f;
  const calib_real off = share * share * (S[1] * S[1] + S[2] * S[2] + S[4] * S[4]);
  const calib_real square = a * a + d * d + f * f + 2 * off;
  calib_real g, r;
  if (!(trace > 0)) return 0;
  g = (calib_real)2 / 9 * square / (trace * trace);
  r = 1 - g + @normal@ * sqrt(g);
  return sqrt(trace * r * r * r);
}

/* Adds amounts, so far apart, of rows of what beliefs vary together in. */
static inline void calib_add_rows(int count, const calib_real *__restrict amount, int apart,
                                  const calib_real *__restrict row, calib_real *__restrict sum) {
  int n, r;
  for (n = 0; n < count; ++n)
    for (r = 0; r < CALIB_TOGETHER; ++r) sum[r] += amount[n * apart] * row[n * CALIB_TOGETHER + r];
}

/* The same of motions, row by row, in each coordinate. */
static inline void calib_spread(int count, const calib_real *motion, const calib_real *row,
                                calib_ways sum[3]) {
  int k;
  for (k = 0; k < 3; ++k) calib_add_rows(count, motion + k, 3, row, sum[k]);
}

/* Adds how the tip moves as the origins of joints shift and turn along the axes of their frames. */
static inline void calib_origins_off(const calib_frame *at, calib_ways sum[3]) {
  calib_real shift[CALIB_SHIFTS][3], turn[CALIB_SHIFTS][3], lever[3];
  int i, k, n;
  for (n = 0; n < CALIB_SHIFTS; ++n) {
    i = n / 3;
    for (k = 0; k < 3; ++k) {
      shift[n][k] = at[i].R[3 * k + n % 3];
      lever[k] = at[CALIB_CHAIN].p[k] - at[i].p[k];
    }
    calib_cross(shift[n], lever, turn[n]);
  }
  calib_spread(CALIB_SHIFTS, shift[0], calib_by_shift[0], sum);
  calib_spread(CALIB_SHIFTS - 3, turn[0], calib_by_turn[0], sum);
}
#if @gravity@

/* The same as loads bend joints more, by how these move the tip, and as gravity tilts. */
static inline void calib_loads_off(const calib_frame *drawn, calib_motions moved,
                                   calib_motions bent, calib_ways sum[3]) {
  calib_ways bend[CALIB_CHAIN] = {{0}};
  calib_real pull, swung[3];
  int i, j, k, n;
  for (i = 0; i < CALIB_CHAIN; ++i)
    for (n = 0; n < 2; ++n) {
      pull = calib_dot(moved[i], calib_tilt[n]);
      calib_add_rows(1, &pull, 1, calib_by_tilt[n], bend[i]);
    }
  for (n = 0; n < CALIB_LOADS; ++n) { /* a joint, and the first and last link that weigh on it */
    calib_real lever[4] = {0, 0, 0, 0};
    i = calib_loaded[n][0];
    for (j = calib_loaded[n][1]; j <= calib_loaded[n][2]; ++j) {
      const calib_real *weight = calib_load[n][j];
      calib_add(drawn[j + 1].R, weight + 1, lever);
      for (k = 0; k < 3; ++k) lever[k] += weight[0] * (drawn[j + 1].p[k] - drawn[i].p[k]);
      lever[3] += weight[0];
    }
    calib_swing(drawn, i, lever, swung);
    pull = calib_dot(swung, calib_gravity);
    calib_add_rows(1, &pull, 1, calib_by_load[n], bend[i]);
  }
  calib_spread(CALIB_CHAIN, bent[0], bend[0], sum);
}
#endif

/* How much joints are off in each direction of beliefs, and the variance of their curves alone. */
static inline void calib_joints_off(const calib_joints q, calib_multiples wave, calib_ways *off,
                                    calib_real alone[CALIB_BELIEFS][CALIB_DOF]) {
  int b, i;
  (void)wave;
  for (i = 0; i < CALIB_DOF; ++i) {
    for (b = 0; b < CALIB_BELIEFS; ++b) alone[b][i] = 0;
    calib_copy(CALIB_TOGETHER, calib_by_offset[i], off[i]);
    calib_add_rows(1, q + i, 1, calib_by_gain[i], off[i]);
    if (i > 0) calib_add_rows(1, q + i - 1, 1, calib_by_neighbour[i - 1], off[i]);
#if @alone@
    {
      const calib_real turn = q[i] / (calib_real)6.283185307179586;
      const calib_real place = CALIB_KNOTS * (turn - floor(turn)), knot = floor(place);
      const int first = (int)knot % CALIB_KNOTS, next = (first + 1) % CALIB_KNOTS;
      for (b = 0; b < CALIB_BELIEFS; ++b)
        alone[b][i] = calib_alone[b][i][first] +
                      (place - knot) * (calib_alone[b][i][next] - calib_alone[b][i][first]);
      for (b = 0; b < 2; ++b) /* cosines, then sines */
        calib_add_rows(CALIB_HARMONICS, wave[0] + b * CALIB_DOF + i, 2 * CALIB_DOF,
                       calib_by_wave[i][b][0], off[i]);
    }
#endif
  }
}

/* How the sensor sees the tip move in each direction of beliefs, and with each joint. */
static inline void calib_moves(const calib_joints q, calib_multiples wave, calib_ways *off,
                               calib_ways z[3], calib_real joints[CALIB_DOF][3]) {
  calib_frame at[CALIB_CHAIN + 1];
  calib_real motion[CALIB_DOF][3] = {{0}}, seen[9], point[4] = {0, 0, 0, 1}, value[CALIB_CHAIN];
  calib_motions by;
  calib_ways there[3] = {{0}};
  int i, k, n;
#if @gravity@
  calib_frame drawn[CALIB_CHAIN + 1];
  calib_motions moved;
#endif
  (void)wave;
  calib_mixed(&calib_body, q, value, 0);
#if @curve@
  calib_curves(wave, value, 0);
#endif
#if @gravity@
  calib_drawn_frames(q, drawn);
  calib_sag(drawn, moved, value, 0);
#endif
  calib_frames(&calib_body, value, at);
  calib_origins_off(at, there);
  for (i = 0; i < CALIB_CHAIN; ++i) {
    calib_tip_moved(at, i, by[i]);
    for (n = 0; n < CALIB_DOF; ++n)
      for (k = 0; k < 3; ++k) motion[n][k] += calib_coupling[i][n] * by[i][k];
  }
#if @gravity@
  calib_loads_off(drawn, moved, by, there);
#endif
  calib_spread(CALIB_DOF, motion[0], off[0], there);
  calib_copy(3, at[CALIB_CHAIN].p, point);
  calib_copy(9, calib_view, seen);
  calib_product(3, seen, CALIB_TOGETHER, there[0], z[0]);
  for (k = 0; k < 3; ++k) calib_add_rows(4, point, 1, calib_by_view[4 * k], z[k]);
#if @lens@
  {
    calib_real before[3], x[2], u[2], L[9] = {0};
    calib_copy(3, calib_shift, before);
    calib_add(calib_view, point, before);
    calib_pinhole(before, x, L, u);
    calib_product(3, L, 3, calib_view, seen);
    calib_copy(3 * CALIB_TOGETHER, z[0], there[0]);
    calib_product(3, L, CALIB_TOGETHER, there[0], z[0]);
    for (k = 0; k < 2; ++k) {
      const calib_real bent = (x[k] - calib_lens[1 + k]) / calib_lens[0];
      const calib_real cubic = calib_lens[0] * u[k] * (u[0] * u[0] + u[1] * u[1]);
      const calib_real lens[4] = {bent, k == 0, k == 1, cubic};
      calib_add_rows(4, lens, 1, calib_by_lens[0], z[k]);
    }
  }
#endif
  for (n = 0; n < CALIB_DOF; ++n) calib_product(3, seen, 1, motion[n], joints[n]);
}

static inline calib_real calib_posterior(const calib_joints q, const calib_vector more) {
  calib_real alone[CALIB_BELIEFS][CALIB_DOF], joints[CALIB_DOF][3], bound = 0;
  calib_multiples wave;
  calib_ways off[CALIB_DOF], z[3];
  int b, i, j, k, n, r;
#if @alone@
  calib_multiply(q, wave);
#endif
  calib_joints_off(q, wave, off, alone);
  calib_moves(q, wave, off, z, joints);
  for (b = 0; b < CALIB_BELIEFS; ++b) {
    const int first = b * CALIB_WAYS, last = first + CALIB_WAYS - 1;
    calib_real S[6], apart = 0, radius;
    for (n = 0, j = 0; j < 3; ++j)
      for (k = j; k < 3; ++k, ++n) {
        S[n] = 0;
        for (r = first; r < last; ++r) S[n] += z[j][r] * z[k][r];
        for (i = 0; i < CALIB_DOF; ++i) S[n] += alone[b][i] * joints[i][j] * joints[i][k];
      }
    /* the last direction is by how much the beliefs are apart */
    for (k = 0; k < 3; ++k) apart += z[k][last] * z[k][last];
    radius = calib_radius_95(S, calib_belief_scale[b][1], more);
    apart = sqrt(apart) + calib_belief_scale[b][0] * radius;
    if (apart > bound) bound = apart;
  }
  return bound;
}
#endif
