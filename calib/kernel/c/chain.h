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
  calib_posture(arm, q, bends ? &bend : 0, at, G ? slope : 0);
  calib_copy(3, at[CALIB_CHAIN].p, p);
  calib_copy(9, at[CALIB_CHAIN].axes, axes);
  if (!G) return;
  const calib_real tip[4] = {p[0], p[1], p[2], 1};
  for (int k = 0; k < 6 * CALIB_DOF; ++k) G[k] = 0;
  for (int i = 0; i < CALIB_CHAIN; ++i) {
    calib_real twist[6] = {0, 0, 0, 0, 0, 0};
    calib_swing(at, i, tip, twist);
    if (calib_turns[i]) calib_copy(3, at[i].axes + 6, twist + 3);
    for (int o = 0; o < 6; ++o)
      for (int k = 0; k < CALIB_DOF; ++k) G[o * CALIB_DOF + k] += twist[o] * slope[i][k];
  }
}

/* What the sensor sees of an arm, as it bends or not, and where J is not null its derivative. */
static inline void calib_seen(const calib_arm *arm, int bends, const calib_joints q, calib_place x,
                              calib_real *J) {
  calib_real p[3], axes[9], G[6 * CALIB_DOF], at[3], seen[9];
  calib_chain(arm, bends, q, p, axes, J ? G : 0);
  calib_product(3, calib_view, 1, p, at);
  calib_add_times(1, calib_shift, at);
  calib_copy(9, calib_view, seen);
#if @lens@
  calib_real L[6], u[2];
  calib_pinhole(at, x, L, u);
  calib_product(2, L, 3, calib_view, seen);
#else
  calib_copy(CALIB_OUT, at, x);
#endif
  if (J) calib_product(CALIB_OUT, seen, CALIB_DOF, G, J);
}
