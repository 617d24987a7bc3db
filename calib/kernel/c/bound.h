#if @belief_scale@

enum {
  CALIB_KNOTS = @knots@, CALIB_LOADS = @loads@,
  CALIB_BELIEFS = @beliefs@, CALIB_TOGETHER = @together@
};

/* Amounts of what beliefs vary together in. */
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

/* Adds an amount of a row of what beliefs vary together in. */
static inline void calib_add_row(calib_real amount, const calib_ways row, calib_ways sum) {
  int r;
  for (r = 0; r < CALIB_TOGETHER; ++r) sum[r] += amount * row[r];
}

/* The same of a motion's three coordinates. */
static inline void calib_spread(const calib_vector by, const calib_ways row, calib_real *z) {
  int k;
  for (k = 0; k < 3; ++k) calib_add_row(by[k], row, z + k * CALIB_TOGETHER);
}

/* The same of three motions, the columns of a matrix, and a row of each. */
static inline void calib_spread_three(const calib_rotation motions, const calib_ways *row,
                                      calib_real *z) {
  int k, r;
  for (k = 0; k < 3; ++k) {
    const calib_real a = motions[3 * k], b = motions[3 * k + 1], c = motions[3 * k + 2];
    for (r = 0; r < CALIB_TOGETHER; ++r)
      z[k * CALIB_TOGETHER + r] += a * row[0][r] + b * row[1][r] + c * row[2][r];
  }
}

/* Adds how the tip moves as the origins of joints shift and turn along their own axes. */
static inline void calib_origins_off(const calib_frame *at, calib_real *z) {
  calib_real arrow[3], along[3], swept[3], turned[9];
  int i, a, k;
  for (i = 0; i <= CALIB_CHAIN; ++i) {
    calib_spread_three(at[i].before, calib_by_shift + 3 * i, z);
    if (i == CALIB_CHAIN) return;
    for (k = 0; k < 3; ++k) arrow[k] = at[CALIB_CHAIN].origin[k] - at[i].origin[k];
    for (a = 0; a < 3; ++a) {
      for (k = 0; k < 3; ++k) along[k] = at[i].after[3 * k + a];
      calib_cross(along, arrow, swept);
      for (k = 0; k < 3; ++k) turned[3 * k + a] = swept[k];
    }
    calib_spread_three(turned, calib_by_turn + 3 * i, z);
  }
}
#if @gravity@

/* Adds how much joints of the chain are off as loads bend them more, and as gravity tilts. */
static inline void calib_loads_off(const calib_joints q, calib_ways *off) {
  calib_frame at[CALIB_CHAIN + 1];
  calib_real moved[CALIB_CHAIN][3];
  int i, j, n;
  calib_drawn_frames(q, at);
  for (n = 0; n < CALIB_LOADS; ++n) {
    j = calib_loaded[n];
    calib_levers(at, j, calib_load[n], moved);
    calib_add_row(calib_dot(moved[j], calib_gravity), calib_by_load[n], off[j]);
  }
  for (j = 0; j < CALIB_CHAIN; ++j) {
    calib_levers(at, j, calib_bending[j], moved);
    for (i = 0; i < 2; ++i)
      calib_add_row(calib_dot(moved[j], calib_tilt[i]), calib_by_tilt[i], off[j]);
  }
}
#endif
#if @by_cos@

/* Cosines and sines of the multiples of joint angles. */
static inline void calib_multiples(const calib_joints q,
                                   calib_real wave[CALIB_HARMONICS][2][CALIB_DOF]) {
  int i, n;
  calib_waves(CALIB_DOF, q, wave[0][0], wave[0][1]);
  for (n = 1; n < CALIB_HARMONICS; ++n)
    for (i = 0; i < CALIB_DOF; ++i) {
      const calib_real c = wave[n - 1][0][i], s = wave[n - 1][1][i];
      wave[n][0][i] = c * wave[0][0][i] - s * wave[0][1][i];
      wave[n][1][i] = c * wave[0][1][i] + s * wave[0][0][i];
    }
}
#endif

/* How much joints are off in each direction of beliefs, and the variance of their curves alone. */
static inline void calib_joints_off(const calib_joints q, calib_ways *off,
                                    calib_real alone[CALIB_BELIEFS][CALIB_DOF]) {
  int b, i, r;
#if @by_cos@
  calib_real wave[CALIB_HARMONICS][2][CALIB_DOF];
  int n;
#endif
#if @way@
  calib_real angle = 0;
  int k, row = 0;
#endif
  for (b = 0; b < CALIB_BELIEFS; ++b)
    for (i = 0; i < CALIB_DOF; ++i) alone[b][i] = 0;
  for (i = 0; i < CALIB_DOF; ++i) {
    for (r = 0; r < CALIB_TOGETHER; ++r) off[i][r] = calib_by_offset[i][r];
    calib_add_row(q[i], calib_by_gain[i], off[i]);
#if @neighbour@
    if (i > 0) calib_add_row(q[i - 1], calib_by_neighbour[i - 1], off[i]);
#endif
  }
#if @way@
  for (k = 0; k < CALIB_DOF; ++k) {
    angle += calib_way[k] * q[k];
    for (i = 0; i <= k; ++i, row += 2) {
      calib_add_row(cos(angle), calib_by_flex[row], off[i]);
      calib_add_row(sin(angle), calib_by_flex[row + 1], off[i]);
    }
  }
#endif
#if @by_cos@
  calib_multiples(q, wave);
  for (i = 0; i < CALIB_DOF; ++i) {
    const calib_real turn = q[i] / (calib_real)6.283185307179586;
    const calib_real place = CALIB_KNOTS * (turn - floor(turn)), knot = floor(place);
    const int first = (int)knot % CALIB_KNOTS, next = (first + 1) % CALIB_KNOTS;
    for (b = 0; b < CALIB_BELIEFS; ++b)
      alone[b][i] = calib_alone[b][i][first] +
                    (place - knot) * (calib_alone[b][i][next] - calib_alone[b][i][first]);
    for (n = 0; n < CALIB_HARMONICS; ++n) {
      const calib_real c = wave[n][0][i], s = wave[n][1][i];
      for (r = 0; r < CALIB_TOGETHER; ++r)
        off[i][r] += c * calib_by_cos[i][n][r] + s * calib_by_sin[i][n][r];
    }
  }
#endif
}

/* How the sensor sees the tip move in each direction of beliefs, and with each joint. */
static inline void calib_moves(const calib_joints q, calib_ways *off, calib_real *z,
                               calib_real *joints) {
  calib_frame at[CALIB_CHAIN + 1];
  calib_real moves[CALIB_CHAIN][3], by[3];
  calib_real there[3 * CALIB_TOGETHER] = {0}, motion[3 * CALIB_DOF], arrow[3];
  const calib_real *p = at[CALIB_CHAIN].origin;
  int i, k, n;
#if @gravity@
  calib_real bent[CALIB_CHAIN][CALIB_TOGETHER] = {{0}};
#endif
  calib_posture(&calib_body, 0, q, at, 0);
  calib_origins_off(at, there);
  for (i = 0; i < CALIB_CHAIN; ++i) {
    for (k = 0; k < 3; ++k) arrow[k] = p[k] - at[i].origin[k];
    calib_cross(at[i].axis, arrow, moves[i]);
    for (k = 0; k < 3 && !calib_bends[i]; ++k) moves[i][k] = at[i].axis[k];
  }
#if @gravity@
  calib_loads_off(q, bent);
  for (i = 0; i < CALIB_CHAIN; ++i) calib_spread(moves[i], bent[i], there);
#endif
  for (n = 0; n < CALIB_DOF; ++n) {
    for (k = 0; k < 3; ++k) {
      by[k] = 0;
      for (i = 0; i < CALIB_CHAIN; ++i) by[k] += calib_coupling[i][n] * moves[i][k];
      motion[k * CALIB_DOF + n] = by[k];
    }
    calib_spread(by, off[n], there);
  }
  calib_product(3, calib_view, CALIB_TOGETHER, there, z);
  calib_product(3, calib_view, CALIB_DOF, motion, joints);
  for (k = 0; k < 3; ++k) { /* the view's matrix and shift */
    for (i = 0; i < 3; ++i) calib_add_row(p[i], calib_by_view[3 * k + i], z + k * CALIB_TOGETHER);
    calib_add_row(1, calib_by_view[9 + k], z + k * CALIB_TOGETHER);
  }
#if @lens@
  {
    calib_real at_view[3], x[2], L[9] = {0}, u[2], in_view[3 * CALIB_TOGETHER];
    for (k = 0; k < 3; ++k) at_view[k] = calib_shift[k] + calib_dot(calib_view + 3 * k, p);
    calib_pinhole(at_view, x, L, u);
    for (n = 0; n < 3 * CALIB_TOGETHER; ++n) in_view[n] = z[n];
    for (n = 0; n < 3 * CALIB_DOF; ++n) motion[n] = joints[n];
    calib_product(3, L, CALIB_TOGETHER, in_view, z);
    calib_product(3, L, CALIB_DOF, motion, joints);
    for (k = 0; k < 2; ++k) {
      const calib_real cubic = calib_lens[0] * u[k] * (u[0] * u[0] + u[1] * u[1]);
      calib_real *seen = z + k * CALIB_TOGETHER;
      calib_add_row((x[k] - calib_lens[1 + k]) / calib_lens[0], calib_by_lens[0], seen);
      calib_add_row(1, calib_by_lens[1 + k], seen);
      calib_add_row(cubic, calib_by_lens[3], seen);
    }
  }
#endif
}

static inline calib_real calib_posterior(const calib_joints q, const calib_vector more) {
  enum { WAYS = CALIB_TOGETHER / CALIB_BELIEFS };
  calib_real off[CALIB_DOF][CALIB_TOGETHER], alone[CALIB_BELIEFS][CALIB_DOF];
  calib_real z[3 * CALIB_TOGETHER], joints[3 * CALIB_DOF], bound = 0;
  int b, i, j, k, n, r;
  calib_joints_off(q, off, alone);
  calib_moves(q, off, z, joints);
  for (b = 0; b < CALIB_BELIEFS; ++b) {
    const calib_real *way = z + b * WAYS;
    calib_real S[6], apart = 0, radius;
    for (n = 0, j = 0; j < 3; ++j)
      for (k = j; k < 3; ++k, ++n) {
        S[n] = 0;
        for (r = 0; r < WAYS - 1; ++r)
          S[n] += way[j * CALIB_TOGETHER + r] * way[k * CALIB_TOGETHER + r];
        for (i = 0; i < CALIB_DOF; ++i)
          S[n] += alone[b][i] * joints[j * CALIB_DOF + i] * joints[k * CALIB_DOF + i];
      }
    /* the last direction is by how much the beliefs are apart */
    for (k = 0; k < 3; ++k)
      apart += way[k * CALIB_TOGETHER + WAYS - 1] * way[k * CALIB_TOGETHER + WAYS - 1];
    radius = calib_radius_95(S, calib_belief_scale[b][1], more);
    apart = sqrt(apart) + calib_belief_scale[b][0] * radius;
    if (apart > bound) bound = apart;
  }
  return bound;
}
#endif
