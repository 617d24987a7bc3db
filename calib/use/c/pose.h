
/* Position, and the tip's orientation in the sensor's frame: a matrix, row by row. */
static inline int calib_pose(const calib_real q[CALIB_DOF], calib_real *x, calib_real R[9]) {
  calib_real inside[CALIB_DOF], seen[CALIB_OUT], own[9];
  int i;
  if (!calib_position(q, x, 0)) {
    for (i = 0; i < 9; ++i) R[i] = calib_not_a_number();
    return 0;
  }
  calib_wrapped(q, inside);
  calib_seen(&calib_body, inside, seen, 0, own);
  for (i = 0; i < 9; ++i) R[i] = calib_aim[i];
  calib_times(R, own);
  return 1;
}
