
/* A joint of a posture: its origin, its place when it has slid, its axis, and the orientation before
 * and after its link's own turn; the last one is the tip. */
typedef struct {
  calib_real origin[3], place[3], axis[3], before[9], after[9];
} calib_frame;

/* Frames of an arm's joints at their values, and of its tip. */
static inline void calib_frames(const calib_arm *arm, const calib_values value, calib_frame *at) {
  calib_real p[3] = {0, 0, 0}, cosine[CALIB_CHAIN], sine[CALIB_CHAIN];
  int i, k;
  calib_waves(CALIB_CHAIN, value, cosine, sine);
  for (k = 0; k < 9; ++k) at[0].before[k] = k % 4 == 0 ? 1 : 0;
  for (i = 0; i <= CALIB_CHAIN; ++i) {
    calib_add(at[i].before, arm->stride[i], p);
    calib_product(3, at[i].before, 3, arm->turned[i], at[i].after);
    for (k = 0; k < 3; ++k) at[i].origin[k] = at[i].place[k] = p[k];
    if (i == CALIB_CHAIN) break;
    for (k = 0; k < 3; ++k) at[i].axis[k] = calib_dot(at[i].after + 3 * k, arm->axis[i]);
    if (calib_bends[i]) {
      calib_turn(at[i].after, arm->axis[i], cosine[i], sine[i], at[i + 1].before);
    } else {
      for (k = 0; k < 3; ++k) p[k] += value[i] * at[i].axis[k];
      for (k = 0; k < 9; ++k) at[i + 1].before[k] = at[i].after[k];
    }
    for (k = 0; k < 3; ++k) at[i].place[k] = p[k];
  }
}

/* Values of an arm's joints without curves and bending, and where slope is not null their derivatives. */
static inline void calib_coupled(const calib_joints motor, const calib_joints rate,
                                 calib_values value, calib_slopes slope) {
  int i, k;
  for (i = 0; i < CALIB_CHAIN; ++i) {
    value[i] = calib_bias[i];
    for (k = 0; k < CALIB_DOF; ++k) value[i] += calib_coupling[i][k] * motor[k];
    for (k = 0; slope && k < CALIB_DOF; ++k) slope[i][k] = calib_coupling[i][k] * rate[k];
  }
}
#if @curve@

/* Adds the error curves of all joints, and where rate is not null their derivatives: of each the series
 * of cosines and that of sines, by the recurrence of Clenshaw (1955), all side by side. */
static inline void calib_curves(const calib_joints q, calib_joints value, calib_joints rate) {
  enum { LANES = 4 * CALIB_DOF };
  calib_real c[CALIB_DOF], s[CALIB_DOF], twice[LANES], sum[LANES] = {0}, last[LANES] = {0};
  const int lanes = rate ? LANES : LANES / 2;
  int i, n;
  calib_waves(CALIB_DOF, q, c, s);
  for (i = 0; i < LANES; ++i) twice[i] = 2 * c[i % CALIB_DOF];
  for (n = CALIB_HARMONICS - 1; n >= 0; --n)
    for (i = 0; i < lanes; ++i) {
      const calib_real next = calib_curve[n][i] + twice[i] * sum[i] - last[i];
      last[i] = sum[i];
      sum[i] = next;
    }
  for (i = 0; i < CALIB_DOF; ++i) {
    const int rates = 2 * CALIB_DOF + i;
    value[i] += c[i] * sum[i] - last[i] + s[i] * sum[CALIB_DOF + i];
    if (rate) rate[i] += c[i] * sum[rates] - last[rates] + s[i] * sum[CALIB_DOF + rates];
  }
}
#endif
#if @gravity@

/* How each joint from one on moves weights on the links beyond it, as much as each weighs; a weight
 * of a link is a mass and its moment in the link's frame. */
static inline void calib_levers(const calib_frame *at, int first,
                                const calib_real weight[CALIB_CHAIN][4],
                                calib_real moved[CALIB_CHAIN][3]) {
  calib_real arm[3] = {0, 0, 0}, mass = 0;
  int j, k;
  for (j = CALIB_CHAIN - 1; j >= first; --j) {
    for (k = 0; k < 3; ++k) arm[k] += mass * (at[j + 1].place[k] - at[j].place[k]);
    calib_add(at[j + 1].before, weight[j] + 1, arm);
    mass += weight[j][0];
    if (calib_bends[j]) calib_cross(at[j].axis, arm, moved[j]);
    for (k = 0; k < 3 && !calib_bends[j]; ++k) moved[j][k] = mass * at[j].axis[k];
  }
}

/* Frames of the arm as it is drawn, at which its weights bend it. */
static inline void calib_drawn_frames(const calib_joints q, calib_frame *at) {
  calib_real value[CALIB_CHAIN];
  calib_coupled(q, q, value, 0);
  calib_frames(&calib_drawn, value, at);
}

/* Adds how much each joint bends under the weights, and where slope is not null the derivatives. */
static inline void calib_sag(const calib_joints q, calib_values value, calib_slopes slope) {
  calib_frame at[CALIB_CHAIN + 1];
  calib_real across[CALIB_CHAIN][3], moved[CALIB_CHAIN][3];
  int i, j, k;
  calib_drawn_frames(q, at);
  for (i = 0; i < CALIB_CHAIN; ++i) {
    calib_cross(calib_gravity, at[i].axis, across[i]);
    for (k = 0; k < 3 && !calib_bends[i]; ++k) across[i][k] = 0;
  }
  for (i = 0; i < CALIB_CHAIN; ++i) {
    calib_levers(at, i, calib_bending[i], moved);
    value[i] += calib_dot(moved[i], calib_gravity);
    for (j = 0; slope && j < CALIB_CHAIN; ++j) {
      /* a joint before turns the whole lever, one beyond only the weights that follow it */
      const int first = j < i ? j : i, last = j < i ? i : j;
      const calib_real by_joint = calib_dot(across[first], moved[last]);
      for (k = 0; k < CALIB_DOF; ++k) slope[i][k] += by_joint * calib_coupling[j][k];
    }
  }
}
#endif
#if @way@

/* Adds what bends a planar arm whose gravity is unknown: waves of the sums of all angles up to each
 * joint. */
static inline void calib_flex(const calib_joints q, calib_values value, calib_slopes slope) {
  calib_real angle[CALIB_DOF], cosine[CALIB_DOF], sine[CALIB_DOF], sum = 0;
  int i, k, n;
  for (k = 0; k < CALIB_DOF; ++k) angle[k] = sum += calib_way[k] * q[k];
  calib_waves(CALIB_DOF, angle, cosine, sine);
  for (k = 0; k < CALIB_DOF; ++k)
    for (i = 0; i <= k; ++i) {
      const calib_real a = calib_flex_cos[i][k], b = calib_flex_sin[i][k];
      value[i] += a * cosine[k] + b * sine[k];
      for (n = 0; slope && n <= k; ++n) slope[i][n] += (b * cosine[k] - a * sine[k]) * calib_way[n];
    }
}
#endif

/* Frames of an arm, and where slope is not null the derivatives of its joints' values; `plain` without
 * curves and bending. */
static inline void calib_posture(const calib_arm *arm, int plain, const calib_joints q,
                                 calib_frame *at, calib_slopes slope) {
  const int bends = arm->own && !plain;
  calib_real motor[CALIB_DOF], rate[CALIB_DOF], value[CALIB_CHAIN];
  int k;
  for (k = 0; k < CALIB_DOF; ++k) {
    motor[k] = arm->gain[k] * q[k] + arm->offset[k];
    rate[k] = arm->gain[k];
  }
#if @curve@
  if (bends) calib_curves(q, motor, slope ? rate : 0);
#endif
#if @neighbour@
  for (k = 1; bends && k < CALIB_DOF; ++k) motor[k] += calib_neighbour[k] * q[k - 1];
#endif
  calib_coupled(motor, rate, value, slope);
#if @neighbour@
  for (k = 1; bends && slope && k < CALIB_DOF; ++k) { /* a joint moves with its neighbour's motor */
    int i;
    for (i = 0; i < CALIB_CHAIN; ++i)
      slope[i][k - 1] += calib_coupling[i][k] * calib_neighbour[k];
  }
#endif
#if @gravity@
  if (bends) calib_sag(q, value, slope);
#endif
#if @way@
  if (bends) calib_flex(q, value, slope);
#endif
  (void)bends;
  calib_frames(arm, value, at);
}

/* Position and orientation of the tip in the root's frame, and where G is not null the geometric
 * Jacobian, of which three rows are velocities and three angular velocities. */
static inline void calib_chain(const calib_arm *arm, int plain, const calib_joints q,
                               calib_vector p, calib_rotation R, calib_real G[6 * CALIB_DOF]) {
  calib_frame at[CALIB_CHAIN + 1];
  calib_real slope[CALIB_CHAIN][CALIB_DOF], arrow[3];
  int i, k, o;
  calib_posture(arm, plain, q, at, G ? slope : 0);
  for (k = 0; k < 3; ++k) p[k] = at[CALIB_CHAIN].origin[k];
  for (k = 0; k < 9; ++k) R[k] = at[CALIB_CHAIN].after[k];
  for (k = 0; G && k < 6 * CALIB_DOF; ++k) G[k] = 0;
  for (i = 0; G && i < CALIB_CHAIN; ++i) {
    calib_real twist[6] = {0, 0, 0, 0, 0, 0};
    for (k = 0; k < 3; ++k) arrow[k] = p[k] - at[i].origin[k];
    if (calib_bends[i]) calib_cross(at[i].axis, arrow, twist);
    for (k = 0; k < 3; ++k) twist[calib_bends[i] ? 3 + k : k] = at[i].axis[k];
    for (o = 0; o < 6; ++o)
      for (k = 0; k < CALIB_DOF; ++k) G[o * CALIB_DOF + k] += twist[o] * slope[i][k];
  }
}
#if @lens@

/* What is seen of a point before the sensor, its derivative by the point, and the point at
 * depth 1; the lens is focal length, centre and k1. */
static inline void calib_pinhole(const calib_vector at, calib_real x[2], calib_real L[6],
                                 calib_real u[2]) {
  const calib_real depth = at[2] > @least_depth@ ? at[2] : @least_depth@, f = calib_lens[0];
  const calib_real a = at[0] / depth, b = at[1] / depth, r2 = a * a + b * b;
  const calib_real k1 = calib_lens[3], bent = 1 + k1 * r2, twice = 2 * k1;
  int i;
  u[0] = a;
  u[1] = b;
  L[0] = f * (bent + twice * a * a) / depth;
  L[1] = L[3] = f * twice * a * b / depth;
  L[4] = f * (bent + twice * b * b) / depth;
  for (i = 0; i < 2; ++i) {
    x[i] = f * u[i] * bent + calib_lens[1 + i];
    L[3 * i + 2] = -(L[3 * i] * a + L[3 * i + 1] * b);
  }
}
#endif

/* What the sensor sees of an arm, and where J is not null its derivative (row by row). */
static inline void calib_seen(const calib_arm *arm, int plain, const calib_joints q, calib_place x,
                              calib_real *J) {
  calib_real p[3], R[9], G[6 * CALIB_DOF], at[3];
  int i;
  calib_chain(arm, plain, q, p, R, J ? G : 0);
  for (i = 0; i < 3; ++i) at[i] = calib_shift[i] + calib_dot(calib_view + 3 * i, p);
#if @lens@
  {
    calib_real L[6], u[2], moved[3 * CALIB_DOF];
    calib_pinhole(at, x, L, u);
    if (J) calib_product(3, calib_view, CALIB_DOF, G, moved);
    if (J) calib_product(2, L, CALIB_DOF, moved, J);
  }
#else
  for (i = 0; i < CALIB_OUT; ++i) x[i] = at[i];
  if (J) calib_product(CALIB_OUT, calib_view, CALIB_DOF, G, J);
#endif
}
