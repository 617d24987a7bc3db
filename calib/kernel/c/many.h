
/* Rows of numbers: each kind of question has a function that answers one row by another and returns a
 * flag.  A question has joints, or those that an answer should be near to, and from 16 on a position
 * (4), a quaternion x, y, z, w, an axis of the tip that is free or -1, and how many starts follow: -1
 * to begin near the joints alone, 0 for the table's. */
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

/* Postures all over the joints' ranges, and the poses of their tips in arm's lengths. */
typedef struct {
  calib_real q[CALIB_POSTURES][CALIB_DOF];
  float pose[CALIB_POSTURES][12];
} calib_postures;

CALIB_API int calib_table_size(void) { return (int)sizeof(calib_postures); }

/* The table that searches begin at, see calib_prepare; without one they begin near joints alone. */
static const calib_postures *calib_table = 0;

static inline void calib_pose_of(const calib_real p[3], const calib_real R[9], float pose[12]) {
  int i;
  for (i = 0; i < 3; ++i) pose[i] = (float)(p[i] / @lever@);
  for (i = 0; i < 9; ++i) pose[3 + i] = (float)(R[i] / (calib_real)1.4142135623730951);
}

/* Fills a table of postures evenly, multiples of powers of the root of g^(dof + 1) = g + 1 without
 * their whole parts (Roberts 2018), many of them at limits, and makes it the one that searches begin at. */
CALIB_API void calib_prepare(calib_postures *table) {
  calib_real golden = 2, u[CALIB_DOF], p[3], R[9], G[6 * CALIB_DOF];
  int n, k;
  for (n = 0; n < 40; ++n) golden = pow(1 + golden, 1 / (calib_real)(CALIB_DOF + 1));
  for (k = 0; k < CALIB_DOF; ++k) u[k] = (calib_real)0.5;
  for (n = 0; n < CALIB_POSTURES; ++n) {
    calib_real share = 1;
    for (k = 0; k < CALIB_DOF; ++k) {
      share /= golden;
      u[k] += share;
      u[k] -= floor(u[k]);
      table->q[n][k] = calib_lower[k] + (u[k] + @aside@ * (2 * u[k] - 1)) * calib_span[k];
    }
    calib_clipped(table->q[n]);
    calib_chain(&calib_placed, 1, table->q[n], p, R, G);
    calib_pose_of(p, R, table->pose[n]);
  }
  calib_table = table;
}

/* Starts of a pose: the `count` that a question gives, or else the postures nearest to it, in the
 * order of their distance; `row` is room for it. */
static inline calib_starts calib_pose_starts(const calib_task *task, const calib_real *given,
                                             int count, short row[CALIB_POSTURES]) {
  calib_starts starts = {given, 0, count, count, count, @same@};
  float wanted[12], weight[12], far[CALIB_POSTURES] = {0};
  int n, i;
  if (count || !calib_table) return starts;
  starts.q = calib_table->q[0];
  starts.row = row;
  starts.count = starts.likely = CALIB_SCANNED;
  starts.runs = CALIB_RUNS;
  starts.apart = @apart@;
  calib_pose_of(task->x, task->R, wanted);
  for (i = 0; i < 12; ++i)
    weight[i] = i < 3 || task->kind == CALIB_POSE || (i - 3) % 3 == task->axis ? 1.0f : 0.0f;
  for (n = 0; n < CALIB_POSTURES; ++n)
    for (i = 0; i < 12; ++i) {
      const float gap = calib_table->pose[n][i] - wanted[i];
      far[n] += weight[i] * gap * gap;
    }
  calib_order(CALIB_POSTURES, far, row);
  return starts;
}

/* The task of the pose that a question asks for; 0 where its quaternion is none. */
static inline int calib_asked(const calib_real *b, calib_task *task) {
  const calib_real *p = b + 20;
  calib_real R[9];
  if (!(fabs(p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3] - 1) <= @rounding@)) return 0;
  calib_matrix(p, R);
  calib_pose_task(b + 16, R, (int)b[24], task);
  return 1;
}

CALIB_API int calib_poses_row(const calib_real *b, calib_real *q) {
  calib_task task;
  calib_search search = calib_begin(&task, b, 1, 0, q);
  int sure = 0;
  if (calib_asked(b, &task)) sure = calib_try_near(&search, &task, b, CALIB_BUDGET, q);
  if (sure == 2 && b[25] >= 0) { /* all that starts lead to is looked at */
    short row[CALIB_POSTURES];
    const calib_starts starts = calib_pose_starts(&task, b + 26, (int)b[25], row);
    search.budget = CALIB_BUDGET * CALIB_SCANNED;
    calib_try_starts(&search, &starts);
    sure = 1;
  }
  return calib_answered(&search, b, sure);
}

CALIB_API int calib_poses_all_row(const calib_real *b, calib_real *q) {
  calib_task task;
  calib_starts starts;
  short row[CALIB_POSTURES];
  if (!calib_asked(b, &task)) return 0;
  starts = calib_pose_starts(&task, b + 26, (int)b[25], row);
  return calib_every(&task, &starts, @most_ways@, q);
}

CALIB_API int calib_pose_row(const calib_real *q, calib_real *out) {
  calib_real R[9];
  const int valid = calib_pose(q, out, R);
  calib_quaternion(R, out + 3);
  return valid;
}
#endif

#endif /* @guard@ */
