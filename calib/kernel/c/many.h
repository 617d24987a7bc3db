
/* Rows of numbers: each kind of question has a function that answers one row by another and returns a
 * flag.  A question has joints, or those that an answer should be near to, and from 16 on a position
 * (4), a quaternion x, y, z, w, an axis of the tip that is free or -1, from which distance on starts
 * lead to other ways, how many starts there are, and these.  All ways are asked for by the position alone. */
typedef int (*calib_row)(const calib_real *question, calib_real *answer);

/* Answers rows from `first` up to `last`, questions and answers so many numbers apart. */
CALIB_API void calib_many(calib_row row, long first, long last, const calib_real *question,
                          int width, calib_real *answer, int size, signed char *flag) {
  for (; first < last; ++first)
    flag[first] = (signed char)row(question + first * width, answer + first * size);
}

CALIB_API int calib_inverse_row(const calib_real *b, calib_real *out) {
  return calib_inverse(b + 16, b, out);
}

CALIB_API int calib_inverse_long_row(const calib_real *b, calib_real *out) {
  return calib_inverse_within(b + 16, b, 50 * CALIB_BUDGET, out);
}

CALIB_API int calib_inverse_all_row(const calib_real *x, calib_real *out) {
  return calib_inverse_all(x, @branches@, (calib_real(*)[CALIB_DOF])out);
}
#if @placed@

/* The task and the starts of a question for a pose; whether its quaternion is one. */
static inline int calib_asked(const calib_real *b, calib_task *task, calib_starts *starts) {
  const calib_starts all = {b + 27, (int)b[26], 1, (int)b[26], CALIB_RUNS, b[25]};
  const calib_real length = calib_length(4, b + 20);
  calib_real R[9];
  calib_matrix(b + 20, R);
  *task = calib_pose_task(b + 16, R, (int)b[24]);
  *starts = all;
  return fabs(length * length - 1) <= @rounding@;
}

CALIB_API int calib_poses_row(const calib_real *b, calib_real *q) {
  calib_starts starts;
  calib_task task;
  if (calib_asked(b, &task, &starts)) return calib_pose_from(&task, &starts, b, q);
  return calib_unknown(CALIB_DOF, q);
}

CALIB_API int calib_poses_all_row(const calib_real *b, calib_real *q) {
  calib_starts starts;
  calib_task task;
  const int valid = calib_asked(b, &task, &starts);
  calib_search search = calib_begin(&task, b, @most_ways@, CALIB_BUDGET * starts.count, q);
  if (valid) calib_try_starts(&search, &starts);
  return search.count;
}

CALIB_API int calib_pose_row(const calib_real *q, calib_real *out) {
  calib_real R[9];
  const int valid = calib_pose(q, out, R);
  calib_quaternion(R, out + 3);
  return valid;
}
#endif

#endif /* @guard@ */
