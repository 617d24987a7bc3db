
/* What Python calls.  Of single queries joints are at b, what is asked from b + 16 on, four numbers
 * each, answers from b + 32 on.  1 is a sure answer, 0 and 2 are left to the batch, 3 is the sure
 * answer that nothing reaches a position. */
#define CALLED __attribute__((visibility("default")))
CALLED int called_forward(double *b) { return calib_forward(b, b + 32); }
CALLED int called_jacobian(double *b) { return calib_jacobian(b, b + 32); }
CALLED int called_bounds(double *b) { return calib_expected_error(b, b + 32); }
CALLED int called_model_bounds(double *b) { return calib_model_error(b, b + 32); }
#if @placed@
CALLED int called_pose(double *b) {
  double R[9];
  const int valid = calib_pose(b, b + 32, R);
  calib_quaternion(R, b + 35);
  return valid;
}
#endif
CALLED int called_inverse(double *b) { return calib_answer(b + 16, b, b + 32); }
#if @placed@
CALLED int called_inverse_pose(double *b) {
  const double *p = b + 20, size = p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3];
  const double s = 2 / size, x = p[0], y = p[1], z = p[2], w = p[3];
  const double R[9] = {1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w),
                       s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w),
                       s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)};
  if (!(fabs(size - 1) <= @rounding@)) return 0;
  return calib_inverse_pose(b + 16, R, b, b + 32);
}
#endif
#if @corrected@
CALLED int called_correct(double *b) { return calib_correct(b, b + 32); }
#endif

/* Rows `first` to `last`. */
CALLED void rows_forward(long first, long last, const double *q, double *x, signed char *valid) {
  calib_forward_many(first, last, q, x, valid);
}
CALLED void rows_bounds(long first, long last, const double *q, double *x, signed char *valid) {
  calib_bounds_many(first, last, 0, q, x, valid);
}
CALLED void rows_model_bounds(long first, long last, const double *q, double *x,
                              signed char *valid) {
  calib_bounds_many(first, last, 1, q, x, valid);
}
CALLED void rows_inverse(long first, long last, const double *x, const double *near, double *q,
                         signed char *valid) {
  calib_inverse_many(first, last, x, near, q, valid);
}
CALLED void rows_inverse_all(long first, long last, const double *x, int most, double *q,
                             signed char *count) {
  calib_inverse_all_many(first, last, x, most, q, count);
}
#if @placed@
static calib_posture postures[CALIB_POSTURES];
CALLED void prepare(void) { calib_postures(CALIB_POSTURES, postures); }
CALLED void rows_poses(long first, long last, const double *x, const double *R, int free,
                       const double *near, double *q, signed char *valid) {
  calib_poses_many(first, last, x, R, free, near, q, valid);
}
CALLED void rows_poses_far(long first, long last, const double *x, const double *R, int free,
                           const double *near, double *q, signed char *valid) {
  calib_poses_far_many(first, last, x, R, free, CALIB_POSTURES, postures, near, q, valid);
}
CALLED void rows_poses_all(long first, long last, const double *x, const double *R, int free,
                           int given, const double *starts, int most, double *q,
                           signed char *count) {
  calib_poses_all_many(first, last, x, R, free, given, starts, CALIB_POSTURES, postures, most, q,
                       count);
}
#endif
