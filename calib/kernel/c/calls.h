/* What Python calls: joints at b, what is asked from b + 16 on, four numbers each, answers from
 * b + 32 on.  1 is a sure answer, 0 is left to the batch, 3 is the sure answer that nothing
 * reaches a position. */
#define CALLED __attribute__((visibility("default")))
CALLED int called_forward(double *b) { return calib_forward(b, b + 32); }
CALLED int called_jacobian(double *b) { return calib_jacobian(b, b + 32); }
CALLED int called_bounds(double *b) { return calib_expected_error(b, b + 32); }
CALLED int called_model_bounds(double *b) { return calib_model_error(b, b + 32); }
CALLED int called_inverse(double *b) {
  calib_task task;
  double best[CALIB_DOF], left, bound, most = @sure@ * @extent@;
  int i, found;
  task.kind = 0;
  for (i = 0; i < CALIB_OUT; ++i) task.x[i] = b[16 + i];
  found = calib_search(&task, b + 16, b, b + 32, best, &left);
  if (found || !(left - left == 0)) return found == 1;
  /* within the expected error it may still count as reached */
  if (calib_expected_error(best, &bound) && bound < most) most = bound;
  return left > 2 * most ? 3 : 0;
}
#if @placed@
CALLED int called_inverse_pose(double *b) {
  const double *p = b + 20, size = p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3];
  const double s = 2 / size, x = p[0], y = p[1], z = p[2], w = p[3];
  const double R[9] = {1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w),
                       s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w),
                       s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)};
  if (!(fabs(size - 1) <= @rounding@)) return 0;
  return calib_inverse_pose(b + 16, R, b, b + 32) == 1;
}
#endif
#if @corrected@
CALLED int called_correct(double *b) { return calib_correct(b, b + 32); }
#endif
