
/* Many rows at once: each function answers rows from the first up to the last. */

static inline void calib_forward_many(long first, long last, const calib_real *q, calib_real *x,
                                      signed char *valid) {
  long n;
  for (n = first; n < last; ++n)
    valid[n] = (signed char)calib_forward(q + n * CALIB_DOF, x + n * CALIB_OUT);
}

/* 95 % bounds: of the true position where `model` is 1, else of the @bound_of@. */
static inline void calib_bounds_many(long first, long last, int model, const calib_real *q,
                                     calib_real *bound, signed char *valid) {
  long n;
  for (n = first; n < last; ++n)
    valid[n] = (signed char)(model ? calib_model_error(q + n * CALIB_DOF, bound + n)
                                   : calib_expected_error(q + n * CALIB_DOF, bound + n));
}

/* As calib_inverse, and 3 where nothing reaches a position. */
static inline void calib_inverse_many(long first, long last, const calib_real *x,
                                      const calib_real *near, calib_real *q, signed char *valid) {
  long n;
  for (n = first; n < last; ++n)
    valid[n] = (signed char)calib_answer(x + n * CALIB_OUT, near + n * CALIB_DOF,
                                         q + n * CALIB_DOF);
}

/* All ways to positions, at most `most` of each; how many. */
static inline void calib_inverse_all_many(long first, long last, const calib_real *x, int most,
                                          calib_real *q, signed char *count) {
  long n;
  for (n = first; n < last; ++n)
    count[n] = (signed char)calib_inverse_all(
        x + n * CALIB_OUT, most, (calib_real(*)[CALIB_DOF])(q + n * most * CALIB_DOF));
}
#if @placed@

/* A posture that leads to poses: its joints, and where the tip is in arm's lengths and how it is
 * turned. */
typedef struct {
  float pose[12], q[CALIB_DOF];
} calib_posture;

static inline void calib_pose_of(const calib_real p[3], const calib_real R[9], float pose[12]) {
  int i;
  for (i = 0; i < 3; ++i) pose[i] = (float)(p[i] / @lever@);
  for (i = 0; i < 9; ++i) pose[3 + i] = (float)(R[i] / (calib_real)1.4142135623730951);
}

/* Postures all over the joints' ranges, evenly: multiples of powers of the root of
 * g^(dof + 1) = g + 1, without their whole parts (Roberts 2018). */
static inline void calib_postures(int count, calib_posture *table) {
  calib_real golden = 2, u[CALIB_DOF], q[CALIB_DOF], p[3], R[9];
  calib_arm arm = @placing@;
  int n, k;
  arm.own = 0;
  for (n = 0; n < 40; ++n) golden = pow(1 + golden, 1 / (calib_real)(CALIB_DOF + 1));
  for (k = 0; k < CALIB_DOF; ++k) u[k] = (calib_real)0.5;
  for (n = 0; n < count; ++n) {
    calib_real share = 1;
    for (k = 0; k < CALIB_DOF; ++k) {
      share /= golden;
      u[k] += share;
      u[k] -= floor(u[k]);
      q[k] = calib_lower[k] + u[k] * calib_span[k];
      table[n].q[k] = (float)q[k];
    }
    calib_chain(&arm, q, p, R, 0, 0);
    calib_pose_of(p, R, table[n].pose);
  }
}

/* Rows of a table of postures (at most CALIB_POSTURES), those near to a task's pose first. */
static inline void calib_sorted(const calib_task *task, int count, const calib_posture *table,
                                short row[]) {
  enum { BINS = 256 };
  float wanted[12], weight[12];
  unsigned char bin[CALIB_POSTURES];
  int begin[BINS + 1], n, i;
  calib_pose_of(task->x, task->R, wanted);
  for (i = 0; i < 12; ++i)
    weight[i] = i < 3 || task->kind == CALIB_POSE || (i - 3) % 3 == task->axis ? 1.0f : 0.0f;
  for (i = 0; i <= BINS; ++i) begin[i] = 0;
  for (n = 0; n < count; ++n) {
    float far = 0;
    for (i = 0; i < 12; ++i) {
      const float gap = table[n].pose[i] - wanted[i];
      far += weight[i] * gap * gap;
    }
    far *= BINS / 4;
    bin[n] = (unsigned char)(far < BINS - 1 ? far : BINS - 1);
    ++begin[bin[n] + 1];
  }
  for (i = 0; i < BINS; ++i) begin[i + 1] += begin[i];
  for (n = 0; n < count; ++n) row[begin[bin[n]]++] = (short)n;
}

/* Joints nearest to `near` that do a task, from postures of a table; q is the nearest known way if
 * `known`.  Returns whether there is one. */
static inline int calib_search_postures(const calib_task *task, int count,
                                        const calib_posture *table,
                                        const calib_real near[CALIB_DOF], int known,
                                        calib_real q[CALIB_DOF]) {
  calib_real from[CALIB_DOF], trial[CALIB_DOF], left, best = 0;
  short row[CALIB_POSTURES];
  int n, k, runs = 0;
  for (k = 0; k < CALIB_DOF; ++k) from[k] = near[k];
  calib_clipped(from);
  if (known) best = calib_apart(q, from, 0);
  calib_sorted(task, count, table, row);
  for (n = 0; n < count && n < CALIB_SCANNED && runs < CALIB_RUNS; ++n) {
    for (k = 0; k < CALIB_DOF; ++k) trial[k] = (calib_real)table[row[n]].q[k];
    if (known && (calib_apart(trial, from, 0) > best + @margin@ ||
                  calib_beside(trial, q, 1, @apart@)))
      continue;
    ++runs;
    if (!calib_reach(task, from, q, known, CALIB_STEPS, trial, &left)) continue;
    left = calib_apart(trial, from, 0);
    if (known && !(left < best)) continue;
    known = 1;
    best = left;
    for (k = 0; k < CALIB_DOF; ++k) q[k] = trial[k];
  }
  if (known) calib_on_turn(near, q);
  return known;
}

/* All ways to a pose, at most `most`, from `given` starts or else from a table of postures; returns
 * how many.  Joint curves and bending are left out while ways are looked for in the table. */
static inline int calib_pose_all(const calib_task *task, int given, const calib_real *starts,
                                 int count, const calib_posture *table, int most,
                                 calib_real q[][CALIB_DOF]) {
  calib_arm arm = *task->arm;
  calib_task plain = *task;
  calib_real start[CALIB_DOF], left;
  short row[CALIB_POSTURES];
  int n, k, found = 0, runs = 0, ways = 0;
  for (n = 0; n < given && found < most; ++n)
    if (starts[n * CALIB_DOF] - starts[n * CALIB_DOF] == 0)
      found = calib_add_way(task, starts + n * CALIB_DOF, CALIB_STEPS, most, q, found);
  if (given) return found;
  arm.own = 0;
  plain.arm = &arm;
  calib_sorted(task, count, table, row);
  for (n = 0; n < count && n < CALIB_SCANNED && runs < CALIB_RUNS && found < most; ++n) {
    const int before = found;
    for (k = 0; k < CALIB_DOF; ++k) start[k] = (calib_real)table[row[n]].q[k];
    if (calib_beside(start, q[0], found, @apart@)) continue;
    found = calib_add_way(&plain, start, CALIB_STEPS / 2, most, q, found);
    runs = found > before ? 0 : runs + 1;
  }
  for (n = 0; n < found; ++n) { /* with curves and bending, each once */
    if (!calib_reach(task, q[n], 0, 0, CALIB_STEPS, q[n], &left)) continue;
    if (calib_beside(q[n], q[0], ways, @same@)) continue;
    for (k = 0; k < CALIB_DOF; ++k) q[ways][k] = q[n][k];
    ++ways;
  }
  return ways;
}

/* Joints that bring the tip to poses x (3), R (9) of the sensor's frame, as calib_inverse_pose. */
static inline void calib_poses_many(long first, long last, const calib_real *x, const calib_real *R,
                                    int free, const calib_real *near, calib_real *q,
                                    signed char *valid) {
  calib_task task;
  calib_real nearest[CALIB_DOF], left;
  long n;
  for (n = first; n < last; ++n) {
    calib_pose_task(x + 3 * n, R + 9 * n, free, &task);
    valid[n] = (signed char)calib_search(&task, x + 3 * n, near + n * CALIB_DOF,
                                         q + n * CALIB_DOF, nearest, &left);
  }
}

/* The same from postures of a table too, where that leaves in doubt whether no way is nearer. */
static inline void calib_poses_far_many(long first, long last, const calib_real *x,
                                        const calib_real *R, int free, int postures,
                                        const calib_posture *table, const calib_real *near,
                                        calib_real *q, signed char *valid) {
  calib_task task;
  long n;
  for (n = first; n < last; ++n) {
    calib_pose_task(x + 3 * n, R + 9 * n, free, &task);
    if (valid[n] != 1)
      valid[n] = (signed char)calib_search_postures(&task, postures, table, near + n * CALIB_DOF,
                                                    valid[n] == 2, q + n * CALIB_DOF);
  }
}

/* All ways to poses, at most `most` of each, from `given` starts of each or else from a table of
 * postures; how many. */
static inline void calib_poses_all_many(long first, long last, const calib_real *x,
                                        const calib_real *R, int free, int given,
                                        const calib_real *starts, int postures,
                                        const calib_posture *table, int most, calib_real *q,
                                        signed char *count) {
  calib_task task;
  long n;
  for (n = first; n < last; ++n) {
    calib_pose_task(x + 3 * n, R + 9 * n, free, &task);
    count[n] = (signed char)calib_pose_all(&task, given, starts + n * given * CALIB_DOF, postures,
                                           table, most,
                                           (calib_real(*)[CALIB_DOF])(q + n * most * CALIB_DOF));
  }
}
#endif

#endif /* @guard@ */
