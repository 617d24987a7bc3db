
/* Where a joint of a posture is, its axis, and the orientation of its frame; the last is the tip. */
typedef struct {
  calib_real p[3], axis[3], R[9];
} calib_frame;

/* Frames of an arm's joints at their values, and of its tip. */
static inline void calib_frames(const calib_arm *arm, const calib_values value, calib_frame *at) {
  calib_real p[3] = {0, 0, 0}, R[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  calib_real cosine[CALIB_CHAIN], sine[CALIB_CHAIN];
  int i, k;
  calib_waves(CALIB_CHAIN, value, cosine, sine);
  for (i = 0; i <= CALIB_CHAIN; ++i) {
    calib_add(R, arm->stride[i], p);
    calib_copy(3, p, at[i].p);
    calib_product(3, R, 3, arm->turned[i], at[i].R);
    for (k = 0; k < 3; ++k) at[i].axis[k] = at[i].R[3 * k + 2];
    if (i == CALIB_CHAIN) return;
    calib_copy(9, at[i].R, R);
    for (k = 0; k < 3; ++k) {
      const calib_real *row = at[i].R + 3 * k;
      if (calib_turns[i]) {
        R[3 * k] = cosine[i] * row[0] + sine[i] * row[1];
        R[3 * k + 1] = cosine[i] * row[1] - sine[i] * row[0];
      } else {
        p[k] += value[i] * row[2];
      }
    }
  }
}

/* How a joint moves a mass at the end of a lever, times that mass: it turns it, or slides.  A lever is
 * three coordinates, times the mass, and the mass. */
static inline void calib_swing(const calib_frame *at, int joint, const calib_real lever[4],
                               calib_vector out) {
  int k;
  if (calib_turns[joint]) calib_cross(at[joint].axis, lever, out);
  for (k = 0; k < 3 && !calib_turns[joint]; ++k) out[k] = lever[3] * at[joint].axis[k];
}

/* How a joint moves the tip. */
static inline void calib_tip_moved(const calib_frame *at, int joint, calib_vector out) {
  calib_real lever[4] = {0, 0, 0, 1};
  int k;
  for (k = 0; k < 3; ++k) lever[k] = at[CALIB_CHAIN].p[k] - at[joint].p[k];
  calib_swing(at, joint, lever, out);
}
#if @curve@

static inline void calib_multiply(const calib_joints q, calib_multiples wave) {
  int i, n;
  calib_waves(CALIB_DOF, q, wave[0], wave[0] + CALIB_DOF);
  for (n = 1; n < CALIB_HARMONICS; ++n)
    for (i = 0; i < CALIB_DOF; ++i) {
      const calib_real c = wave[0][i], s = wave[0][CALIB_DOF + i];
      wave[n][i] = c * wave[n - 1][i] - s * wave[n - 1][CALIB_DOF + i];
      wave[n][CALIB_DOF + i] = c * wave[n - 1][CALIB_DOF + i] + s * wave[n - 1][i];
    }
}

/* Adds the error curves of all joints to values of the chain, and their derivatives. */
static inline void calib_curves(calib_multiples wave, calib_values value, calib_slopes slope) {
  enum { LANES = 2 * CALIB_DOF };
  calib_real curve[LANES] = {0}, rate[LANES] = {0};
  int i, k, n;
  for (n = 0; n < CALIB_HARMONICS; ++n)
    for (k = 0; k < LANES; ++k) curve[k] += calib_curve[n][k] * wave[n][k];
  for (n = 0; slope && n < CALIB_HARMONICS; ++n)
    for (k = 0; k < LANES; ++k) rate[k] += calib_curve_rate[n][k] * wave[n][k];
  for (i = 0; i < CALIB_CHAIN; ++i)
    for (k = 0; k < CALIB_DOF; ++k) {
      value[i] += calib_coupling[i][k] * (curve[k] + curve[CALIB_DOF + k]);
      if (slope) slope[i][k] += calib_coupling[i][k] * (rate[k] + rate[CALIB_DOF + k]);
    }
}
#endif

/* Values of an arm's joints without curves and loads, and where slope is not null their derivatives. */
static inline void calib_mixed(const calib_arm *arm, const calib_joints q, calib_values value,
                               calib_slopes slope) {
  int i, k;
  calib_copy(CALIB_CHAIN, arm->bias, value);
  for (i = 0; i < CALIB_CHAIN; ++i) {
    for (k = 0; k < CALIB_DOF; ++k) value[i] += arm->mix[i][k] * q[k];
    if (slope) calib_copy(CALIB_DOF, arm->mix[i], slope[i]);
  }
}
#if @gravity@

/* Levers of the weights on the links beyond each joint, from one on; a weight of a link is a mass at the
 * end of the link and its moment in the frame there. */
static inline void calib_levers(const calib_frame *at, int first,
                                const calib_real weight[CALIB_CHAIN][4],
                                calib_real lever[CALIB_CHAIN][4]) {
  calib_real sum[4] = {0, 0, 0, 0};
  int j, k;
  for (j = CALIB_CHAIN - 1; j >= first; --j) {
    sum[3] += weight[j][0];
    calib_add(at[j + 1].R, weight[j] + 1, sum);
    for (k = 0; k < 3; ++k) sum[k] += sum[3] * (at[j + 1].p[k] - at[j].p[k]);
    calib_copy(4, sum, lever[j]);
  }
}

/* Adds how much each joint bends under the weights, which it moves at the posture that is drawn, `at`,
 * and where slope is not null the derivatives. */
static inline void calib_sag(const calib_joints q, calib_frame *at, calib_motions moved,
                             calib_values value, calib_slopes slope) {
  calib_real across[CALIB_CHAIN][3] = {{0}}, lever[CALIB_CHAIN][4], drawn[CALIB_CHAIN];
  int i, j, k;
  calib_mixed(&calib_drawn, q, drawn, 0);
  calib_frames(&calib_drawn, drawn, at);
  for (i = 0; i < CALIB_CHAIN; ++i)
    if (calib_turns[i]) calib_cross(calib_gravity, at[i].axis, across[i]);
  for (i = 0; i < CALIB_CHAIN; ++i) {
    calib_levers(at, i, calib_bending[i], lever);
    calib_swing(at, i, lever[i], moved[i]);
    value[i] += calib_dot(moved[i], calib_gravity);
    for (j = 0; slope && j < CALIB_CHAIN; ++j) {
      /* a joint before turns the whole lever, one beyond only the weights that follow it */
      const int first = j < i ? j : i, last = j < i ? i : j;
      calib_real by_joint;
      if (j > i) calib_swing(at, j, lever[j], moved[j]);
      by_joint = calib_dot(across[first], moved[last]);
      for (k = 0; k < CALIB_DOF; ++k) slope[i][k] += by_joint * calib_drawn.mix[j][k];
    }
  }
}
#endif

/* Frames of an arm, and where slope is not null the derivatives of its joints' values. */
static inline void calib_posture(const calib_arm *arm, const calib_joints q, calib_frame *at,
                                 calib_slopes slope) {
  calib_real value[CALIB_CHAIN];
  calib_mixed(arm, q, value, slope);
  if (arm->bends) {
#if @curve@
    calib_multiples wave;
    calib_multiply(q, wave);
    calib_curves(wave, value, slope);
#endif
#if @gravity@
    calib_frame drawn[CALIB_CHAIN + 1];
    calib_motions moved;
    calib_sag(q, drawn, moved, value, slope);
#endif
  }
  calib_frames(arm, value, at);
}

/* Position and orientation of the tip in the root's frame, and where G is not null the geometric
 * Jacobian, of which three rows are velocities and three angular velocities. */
static inline void calib_chain(const calib_arm *arm, const calib_joints q, calib_vector p,
                               calib_rotation R, calib_real G[6 * CALIB_DOF]) {
  calib_frame at[CALIB_CHAIN + 1];
  calib_real slope[CALIB_CHAIN][CALIB_DOF];
  int i, k, o;
  calib_posture(arm, q, at, G ? slope : 0);
  calib_copy(3, at[CALIB_CHAIN].p, p);
  calib_copy(9, at[CALIB_CHAIN].R, R);
  for (k = 0; G && k < 6 * CALIB_DOF; ++k) G[k] = 0;
  for (i = 0; G && i < CALIB_CHAIN; ++i) {
    calib_real twist[6] = {0, 0, 0, 0, 0, 0};
    calib_tip_moved(at, i, twist);
    if (calib_turns[i]) calib_copy(3, at[i].axis, twist + 3);
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
static inline void calib_seen(const calib_arm *arm, const calib_joints q, calib_place x,
                              calib_real *J) {
  calib_real p[3], R[9], G[6 * CALIB_DOF], at[3];
  calib_chain(arm, q, p, R, J ? G : 0);
  calib_copy(3, calib_shift, at);
  calib_add(calib_view, p, at);
#if @lens@
  {
    calib_real L[6], u[2], seen[6];
    calib_pinhole(at, x, L, u);
    calib_product(2, L, 3, calib_view, seen);
    if (J) calib_product(2, seen, CALIB_DOF, G, J);
  }
#else
  calib_copy(CALIB_OUT, at, x);
  if (J) calib_product(CALIB_OUT, calib_view, CALIB_DOF, G, J);
#endif
}
