/* Position, and the tip's orientation in the sensor's frame: a matrix, row by row. */
static inline int calib_pose(const calib_joints q, calib_real *x, calib_rotation R) {
  calib_real inside[CALIB_DOF], p[3], axes[9];
  if (!calib_position(q, x, 0)) return calib_unknown(9, R);
  calib_inside(q, inside);
  calib_chain(&calib_placed, CALIB_BENDS, inside, p, axes, 0);
  for (int i = 0; i < 9; ++i) R[i] = axes[3 * (i % 3) + i / 3];
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
  int best = 0;
  for (int i = 1; i < 4; ++i)
    if (products[i][i] > products[best][best]) best = i;
  const calib_real size = calib_length(4, products[best]);
  for (int i = 0; i < 4; ++i) q[i] = products[best][i] / (products[best][3] < 0 ? -size : size);
}

/* The rotation of a quaternion x, y, z, w; no numbers where its length is not 1. */
static inline void calib_matrix(const calib_real q[4], calib_rotation R) {
  const calib_real square = calib_dot(4, q, q);
  const calib_real s = fabs(square - 1) <= @rounding@ ? 2 / square : (calib_real)NAN;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    R[4 * i] = 1 - s * (q[j] * q[j] + q[k] * q[k]);
    R[3 * i + j] = s * (q[i] * q[j] - q[k] * q[3]);
    R[3 * j + i] = s * (q[i] * q[j] + q[k] * q[3]);
  }
}

/* The task of a pose of the sensor's frame, R row by row; a turn about an axis of the tip (0 to 2)
 * may be left open, else -1. */
static inline calib_task calib_pose_task(const calib_vector x, const calib_rotation R, int axis) {
  calib_task task = {&calib_placed, axis < 0 ? 6 : 5, axis, @lever@, {0}, {0}, 0};
  for (int i = 0; i < 9; ++i) task.axes[i] = R[3 * (i % 3) + i / 3];
  for (int i = 0; i < 3; ++i) task.x[i] = x[i] / @scale@;
  return task;
}

/* The way to a pose, as calib_pose_task has it, that joints lead to; as calib_inverse. */
static inline int calib_inverse_pose(const calib_vector x, const calib_rotation R, int axis,
                                     const calib_joints near, calib_joints q) {
  calib_task task = calib_pose_task(x, R, axis);
  calib_search search;
  const int sure = calib_try_near(&search, &task, near, CALIB_BUDGET, q);
  return calib_answered(&search, near, sure);
}

/* The task of a question for a pose. */
static inline calib_task calib_asked(const calib_real *b) {
  calib_real R[9];
  calib_matrix(b + 20, R);
  return calib_pose_task(b + 16, R, (int)b[24]);
}

CALIB_API int calib_poses_row(const calib_real *b, calib_real *q) {
  const calib_starts starts = {b + 27, (int)b[26], (int)b[26], CALIB_RUNS, b[25]};
  calib_task task = calib_asked(b);
  calib_search search;
  const int sure = calib_try_near(&search, &task, b, CALIB_BUDGET * (1 + starts.count), q);
  if (sure == 2) calib_try_starts(&search, &starts);
  return calib_answered(&search, b, starts.count ? 1 : sure); /* all that they lead to was seen */
}

CALIB_API int calib_poses_all_row(const calib_real *b, calib_real *q) {
  const calib_starts starts = {b + 27, (int)b[26], (int)b[26], CALIB_RUNS, b[25]};
  calib_task task = calib_asked(b);
  calib_search search = calib_begin(&task, b, @most_ways@, CALIB_BUDGET * starts.count, q);
  calib_try_starts(&search, &starts);
  return search.count;
}

CALIB_API int calib_pose_row(const calib_real *q, calib_real *out) {
  calib_real R[9];
  const int valid = calib_pose(q, out, R);
  calib_quaternion(R, out + 3);
  return valid;
}
