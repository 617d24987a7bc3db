
/* Where a frame of a posture is, and its axes, one after another. */
typedef struct {
  calib_real p[3], axes[9];
} calib_frame;

/* Adds a vector, so many times. */
static inline void calib_add_times(calib_real times, const calib_vector v, calib_vector sum) {
  int k;
  for (k = 0; k < 3; ++k) sum[k] += times * v[k];
}

/* Adds a vector in a frame, of these axes, to one. */
static inline void calib_add(const calib_rotation axes, const calib_vector v, calib_vector out) {
  int k;
  for (k = 0; k < 3; ++k) out[k] += v[0] * axes[k] + v[1] * axes[3 + k] + v[2] * axes[6 + k];
}

/* Frames of an arm's joints at their values, and of its tip. */
static inline void calib_frames(const calib_arm *arm, const calib_values value, calib_frame *at) {
  calib_real p[3] = {0, 0, 0}, axes[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  calib_real cosine[CALIB_CHAIN], sine[CALIB_CHAIN];
  int i, k;
  calib_waves(CALIB_CHAIN, value, cosine, sine);
  for (i = 0; i <= CALIB_CHAIN; ++i) {
    const calib_real *x = at[i].axes, *y = x + 3, *z = x + 6;
    calib_add(axes, arm->stride[i], p);
    calib_copy(3, p, at[i].p);
    calib_product(3, arm->turned[i], 3, axes, at[i].axes);
    if (i == CALIB_CHAIN) return;
    calib_copy(9, at[i].axes, axes);
    for (k = 0; k < 3; ++k) {
      if (calib_turns[i]) {
        axes[k] = cosine[i] * x[k] + sine[i] * y[k];
        axes[3 + k] = cosine[i] * y[k] - sine[i] * x[k];
      } else {
        p[k] += value[i] * z[k];
      }
    }
  }
}

/* How a joint turns or slides a mass, times it, at a lever: coordinates times the mass, the mass. */
static inline void calib_swing(const calib_frame *at, int joint, const calib_real lever[4],
                               calib_vector out) {
  const calib_real *axis = at[joint].axes + 6;
  int k;
  if (calib_turns[joint]) calib_cross(axis, lever, out);
  else for (k = 0; k < 3; ++k) out[k] = lever[3] * axis[k];
}

/* How a joint moves the tip, and the lever of that. */
static inline void calib_tip_moved(const calib_frame *at, int joint, calib_real lever[4],
                                   calib_vector out) {
  int k;
  for (k = 0; k < 3; ++k) lever[k] = at[CALIB_CHAIN].p[k] - at[joint].p[k];
  lever[3] = 1;
  calib_swing(at, joint, lever, out);
}
#if @curve@

/* Adds the error curves of all joints to values of the chain, and their derivatives. */
static inline void calib_curves(const calib_joints q, calib_multiples wave, calib_values value,
                                calib_slopes slope) {
  enum { LANES = 2 * CALIB_DOF };
  calib_real curve[LANES] = {0}, rate[LANES] = {0};
  int i, k, n;
  calib_waves(CALIB_DOF, q, wave[0], wave[0] + CALIB_DOF);
  for (n = 1; n < CALIB_HARMONICS; ++n)
    for (i = 0; i < CALIB_DOF; ++i) {
      const calib_real c = wave[0][i], s = wave[0][CALIB_DOF + i];
      wave[n][i] = c * wave[n - 1][i] - s * wave[n - 1][CALIB_DOF + i];
      wave[n][CALIB_DOF + i] = c * wave[n - 1][CALIB_DOF + i] + s * wave[n - 1][i];
    }
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
#endif

/* What bends an arm: curves by multiples of joint values, and weights at its drawn posture. */
typedef struct {
  calib_multiples wave;
  calib_frame drawn[CALIB_CHAIN + 1];
  calib_real swung[CALIB_CHAIN][3];
} calib_bend;

/* Frames of an arm, bent or not (0), and where slope is not null the derivatives of its values. */
static inline void calib_posture(const calib_arm *arm, const calib_joints q, calib_bend *bend,
                                 calib_frame *at, calib_slopes slope) {
  calib_real value[CALIB_CHAIN];
  calib_mixed(arm, q, value, slope);
#if @curve@
  if (bend) calib_curves(q, bend->wave, value, slope);
#endif
#if @gravity@
  if (bend) calib_sag(q, bend->drawn, bend->swung, value, slope);
#endif
  (void)bend;
  calib_frames(arm, value, at);
}

/* Position and axes of the tip in the root's frame, and where G is not null the geometric Jacobian, of
 * which three rows are velocities and three angular velocities. */
static inline void calib_chain(const calib_arm *arm, int bends, const calib_joints q, calib_vector p,
                               calib_rotation axes, calib_real G[6 * CALIB_DOF]) {
  calib_frame at[CALIB_CHAIN + 1];
  calib_real slope[CALIB_CHAIN][CALIB_DOF];
  calib_bend bend;
  int i, k, o;
  calib_posture(arm, q, bends ? &bend : 0, at, G ? slope : 0);
  calib_copy(3, at[CALIB_CHAIN].p, p);
  calib_copy(9, at[CALIB_CHAIN].axes, axes);
  for (k = 0; G && k < 6 * CALIB_DOF; ++k) G[k] = 0;
  for (i = 0; G && i < CALIB_CHAIN; ++i) {
    calib_real twist[6] = {0, 0, 0, 0, 0, 0}, lever[4];
    calib_tip_moved(at, i, lever, twist);
    if (calib_turns[i]) calib_copy(3, at[i].axes + 6, twist + 3);
    for (o = 0; o < 6; ++o)
      for (k = 0; k < CALIB_DOF; ++k) G[o * CALIB_DOF + k] += twist[o] * slope[i][k];
  }
}
#if @lens@

/* What a lens (focal length, centre, k1) shows of a point, its derivative, the point at depth 1. */
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

/* What the sensor sees of an arm, as it bends or not, and where J is not null its derivative. */
static inline void calib_seen(const calib_arm *arm, int bends, const calib_joints q, calib_place x,
                              calib_real *J) {
  calib_real p[3], axes[9], G[6 * CALIB_DOF], at[3], seen[9];
  calib_chain(arm, bends, q, p, axes, J ? G : 0);
  calib_product(3, calib_view, 1, p, at);
  calib_add_times(1, calib_shift, at);
  calib_copy(9, calib_view, seen);
#if @lens@
  {
    calib_real L[6], u[2];
    calib_pinhole(at, x, L, u);
    calib_product(2, L, 3, calib_view, seen);
  }
#else
  calib_copy(CALIB_OUT, at, x);
#endif
  if (J) calib_product(CALIB_OUT, seen, CALIB_DOF, G, J);
}
