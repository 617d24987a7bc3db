
/* What Python calls for single queries: joints are at b, what is asked from b + 16 on, four numbers
 * each, answers from b + 32 on.  1 is a sure answer, 0 and 2 are left to the batch, 3 is the sure
 * answer that nothing reaches a position. */
CALIB_API int called_forward(double *b) { return calib_forward(b, b + 32); }
CALIB_API int called_jacobian(double *b) { return calib_jacobian(b, b + 32); }
CALIB_API int called_bounds(double *b) { return calib_expected_error(b, b + 32); }
CALIB_API int called_model_bounds(double *b) { return calib_model_error(b, b + 32); }
CALIB_API int called_inverse(double *b) { return calib_answer(b + 16, b, b + 32); }
#if @placed@
CALIB_API calib_postures *called_table(void) {
  static calib_postures table;
  calib_prepare(&table);
  return &table;
}
CALIB_API int called_pose(double *b) {
  double R[9];
  const int valid = calib_pose(b, b + 32, R);
  calib_quaternion(R, b + 35);
  return valid;
}
CALIB_API int called_inverse_pose(double *b) {
  const double *p = b + 20, size = p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3];
  double R[9];
  calib_task task;
  calib_best way;
  if (!(fabs(size - 1) <= @rounding@)) return 0;
  calib_matrix(p, R);
  calib_pose_task(b + 16, R, (int)b[24], &task);
  return calib_search(&task, b + 16, b, b + 32, &way);
}
#endif
#if @corrected@
CALIB_API int called_correct(double *b) { return calib_correct(b, b + 32); }
#endif
