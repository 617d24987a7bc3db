/* What the model says, wherever q is. */
static inline void calib_model(const calib_joints q, calib_real *x, calib_real *J) {
  calib_seen(&calib_body, CALIB_BENDS, q, x, J);
#if @local_terms@
  calib_local(q, x, J);
#endif
}

#if @play@
/* How far the tip may be with all joints at the worst side of their play. */
static inline calib_real calib_play_reach(const calib_joints q) {
  calib_real x[CALIB_OUT], J[CALIB_OUT * CALIB_DOF], reach = 0;
  int i, k;
  calib_model(q, x, J);
  for (k = 0; k < CALIB_DOF; ++k) {
    calib_real square = 0;
    for (i = 0; i < CALIB_OUT; ++i) square += J[i * CALIB_DOF + k] * J[i * CALIB_DOF + k];
    reach += calib_play[k] * sqrt(square);
  }
  return reach;
}
#endif

/* Joints within their ranges; 0 where there is no answer. */
static inline int calib_answers(const calib_joints q, calib_joints inside) {
  if (!calib_inside(q, inside)) return 0;
#if @position_bound@
  if (!(calib_blended(calib_position_bound, q) <= @most_bound@)) return 0;
#endif
  return 1;
}

/* Position; where J is not null also its derivative, J[coordinate * DOF + joint]. */
static inline int calib_position(const calib_joints q, calib_real *x, calib_real *J) {
  calib_real inside[CALIB_DOF];
  if (!calib_answers(q, inside)) {
    calib_unknown(J ? CALIB_OUT * CALIB_DOF : 0, J);
    return calib_unknown(CALIB_OUT, x);
  }
  calib_model(inside, x, J);
  return 1;
}

CALIB_API int calib_forward(const calib_real *q, calib_real *x) {
  return calib_position(q, x, 0);
}

CALIB_API int calib_jacobian(const calib_real *q, calib_real *J) {
  calib_real x[CALIB_OUT];
  return calib_position(q, x, J);
}

/* 95 % bound on the @bound_of@, or without `noise`, that of a single reading, on the true position. */
static inline int calib_bound_of(const calib_joints q, int noise, calib_real *bound) {
  calib_real inside[CALIB_DOF];
  calib_unknown(1, bound);
  if (!calib_answers(q, inside)) return 0;
#if @belief_scale@
  *bound = calib_posterior(inside, noise ? calib_more : calib_less);
#endif
#if @bound@
  *bound = calib_blended(noise ? calib_bound : calib_true_bound, inside);
#endif
  (void)noise;
#if @play@
  *bound += calib_play_reach(inside);
#endif
  return *bound == *bound;
}

CALIB_API int calib_expected_error(const calib_real *q, calib_real *bound) {
  return calib_bound_of(q, 1, bound);
}

CALIB_API int calib_model_error(const calib_real *q, calib_real *bound) {
  return calib_bound_of(q, 0, bound);
}
#if @placed@

/* Position, and the tip's orientation in the sensor's frame: a matrix, row by row. */
static inline int calib_pose(const calib_joints q, calib_real *x, calib_rotation R) {
  calib_real inside[CALIB_DOF], p[3], axes[9];
  int i;
  if (!calib_position(q, x, 0)) return calib_unknown(9, R);
  calib_inside(q, inside);
  calib_chain(&calib_placed, CALIB_BENDS, inside, p, axes, 0);
  for (i = 0; i < 9; ++i) R[i] = axes[3 * (i % 3) + i / 3];
  return 1;
}

/* Quaternion x, y, z, w of a rotation, with w >= 0: of the rows of four times its products with
 * itself the one with the largest square (Shepperd 1978). */
static inline void calib_quaternion(const calib_rotation R, calib_real q[4]) {
  const calib_real products[4][4] = {
      {1 + R[0] - R[4] - R[8], R[1] + R[3], R[2] + R[6], R[7] - R[5]},
      {R[1] + R[3], 1 - R[0] + R[4] - R[8], R[5] + R[7], R[2] - R[6]},
      {R[2] + R[6], R[5] + R[7], 1 - R[0] - R[4] + R[8], R[3] - R[1]},
      {R[7] - R[5], R[2] - R[6], R[3] - R[1], 1 + R[0] + R[4] + R[8]}};
  calib_real size;
  int best = 0, i;
  for (i = 1; i < 4; ++i)
    if (products[i][i] > products[best][best]) best = i;
  size = calib_length(4, products[best]);
  for (i = 0; i < 4; ++i) q[i] = products[best][i] / (products[best][3] < 0 ? -size : size);
}

/* The rotation of a quaternion x, y, z, w of any length. */
static inline void calib_matrix(const calib_real q[4], calib_rotation R) {
  const calib_real s = 2 / (calib_dot(3, q, q) + q[3] * q[3]);
  int i;
  for (i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    R[4 * i] = 1 - s * (q[j] * q[j] + q[k] * q[k]);
    R[3 * i + j] = s * (q[i] * q[j] - q[k] * q[3]);
    R[3 * j + i] = s * (q[i] * q[j] + q[k] * q[3]);
  }
}
#endif
