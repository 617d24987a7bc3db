
/* Rows of numbers: each kind of question has a function that answers one row by another and returns a
 * flag.  A question has joints, or those that an answer should be near to, and from 16 on a position
 * (4), a quaternion x, y, z, w, an axis of the tip that is free or -1, from which distance on starts
 * lead to other ways, how many starts there are, and these. */
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

CALIB_API int calib_inverse_all_row(const calib_real *b, calib_real *out) {
  return calib_inverse_all(b + 16, @branches@, (calib_real(*)[CALIB_DOF])out);
}
#if @placed@

/* The task of the pose that a question asks for; 0 where its quaternion is none. */
static inline int calib_asked(const calib_real *b, calib_task *task) {
  const calib_real *p = b + 20;
  calib_real R[9];
  if (!(fabs(p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3] - 1) <= @rounding@)) return 0;
  calib_matrix(p, R);
  calib_pose_task(b + 16, R, (int)b[24], task);
  return 1;
}

/* The starts of a question. */
static inline calib_starts calib_starts_of(const calib_real *b) {
  const int count = (int)b[26];
  calib_starts starts = {b + 27, 0, count, count, CALIB_RUNS, b[25]};
  return starts;
}

CALIB_API int calib_poses_row(const calib_real *b, calib_real *q) {
  const calib_starts starts = calib_starts_of(b);
  calib_task task;
  calib_search search = calib_begin(&task, b, 1, 0, q);
  int sure = 0;
  if (calib_asked(b, &task)) sure = calib_try_near(&search, &task, b, CALIB_BUDGET, q);
  if (sure == 2 && starts.count) { /* all that starts lead to is looked at */
    search.budget = CALIB_BUDGET * starts.count;
    calib_try_starts(&search, &starts);
    sure = 1;
  }
  return calib_answered(&search, b, sure);
}

CALIB_API int calib_poses_all_row(const calib_real *b, calib_real *q) {
  const calib_starts starts = calib_starts_of(b);
  calib_task task;
  return calib_asked(b, &task) ? calib_every(&task, &starts, @most_ways@, q) : 0;
}

CALIB_API int calib_pose_row(const calib_real *q, calib_real *out) {
  calib_real R[9];
  const int valid = calib_pose(q, out, R);
  calib_quaternion(R, out + 3);
  return valid;
}
#endif

#endif /* @guard@ */
