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
