
/* Many rows at once: each function answers rows from the first up to the last, with a flag each. */
#ifndef CALIB_API
#define CALIB_API static inline
#endif

CALIB_API void calib_forward_many(long first, long last, const calib_real *q, calib_real *x,
                                  signed char *valid) {
  for (; first < last; ++first)
    valid[first] = (signed char)calib_forward(q + first * CALIB_DOF, x + first * CALIB_OUT);
}

/* 95 % bounds on the @bound_of@. */
CALIB_API void calib_bounds_many(long first, long last, const calib_real *q, calib_real *bound,
                                 signed char *valid) {
  for (; first < last; ++first)
    valid[first] = (signed char)calib_expected_error(q + first * CALIB_DOF, bound + first);
}

/* 95 % bounds on the true position. */
CALIB_API void calib_model_bounds_many(long first, long last, const calib_real *q,
                                       calib_real *bound, signed char *valid) {
  for (; first < last; ++first)
    valid[first] = (signed char)calib_model_error(q + first * CALIB_DOF, bound + first);
}

/* As calib_inverse, and 3 where nothing reaches a position. */
CALIB_API void calib_inverse_many(long first, long last, const calib_real *x,
                                  const calib_real *near, calib_real *q, signed char *valid) {
  for (; first < last; ++first)
    valid[first] = (signed char)calib_answer(x + first * CALIB_OUT, near + first * CALIB_DOF,
                                             q + first * CALIB_DOF);
}

/* All ways to positions, at most `most` of each; how many. */
CALIB_API void calib_inverse_all_many(long first, long last, const calib_real *x, int most,
                                      calib_real *q, signed char *count) {
  for (; first < last; ++first)
    count[first] = (signed char)calib_inverse_all(
        x + first * CALIB_OUT, most, (calib_real(*)[CALIB_DOF])(q + first * most * CALIB_DOF));
}
#if @placed@

/* Postures all over the joints' ranges, and the poses of their tips in arm's lengths. */
typedef struct {
  calib_real q[CALIB_POSTURES][CALIB_DOF];
  float pose[CALIB_POSTURES][12];
} calib_postures;

static inline void calib_pose_of(const calib_real p[3], const calib_real R[9], float pose[12]) {
  int i;
  for (i = 0; i < 3; ++i) pose[i] = (float)(p[i] / @lever@);
  for (i = 0; i < 9; ++i) pose[3 + i] = (float)(R[i] / (calib_real)1.4142135623730951);
}

/* Fills a table of postures evenly: multiples of powers of the root of g^(dof + 1) = g + 1,
 * without their whole parts (Roberts 2018). */
CALIB_API void calib_prepare(calib_postures *table) {
  calib_real golden = 2, u[CALIB_DOF], p[3], R[9];
  calib_arm arm = @placing@;
  int n, k;
  arm.own = 0;
  for (n = 0; n < 40; ++n) golden = pow(1 + golden, 1 / (calib_real)(CALIB_DOF + 1));
  for (k = 0; k < CALIB_DOF; ++k) u[k] = (calib_real)0.5;
  for (n = 0; n < CALIB_POSTURES; ++n) {
    calib_real share = 1;
    for (k = 0; k < CALIB_DOF; ++k) {
      share /= golden;
      u[k] += share;
      u[k] -= floor(u[k]);
      table->q[n][k] = calib_lower[k] + u[k] * calib_span[k];
    }
    calib_chain(&arm, table->q[n], p, R, 0, 0);
    calib_pose_of(p, R, table->pose[n]);
  }
}

/* The postures nearest to a task's pose, in the order of their distance; `row` is room for it. */
static inline calib_starts calib_posture_starts(const calib_task *task,
                                                const calib_postures *table,
                                                short row[CALIB_POSTURES]) {
  enum { BINS = 256 };
  calib_starts starts = {table->q[0], row, CALIB_SCANNED, CALIB_SCANNED, CALIB_RUNS, @apart@};
  float wanted[12], weight[12];
  unsigned char bin[CALIB_POSTURES];
  int begin[BINS + 1], n, i;
  calib_pose_of(task->x, task->R, wanted);
  for (i = 0; i < 12; ++i)
    weight[i] = i < 3 || task->kind == CALIB_POSE || (i - 3) % 3 == task->axis ? 1.0f : 0.0f;
  for (i = 0; i <= BINS; ++i) begin[i] = 0;
  for (n = 0; n < CALIB_POSTURES; ++n) {
    float far = 0;
    for (i = 0; i < 12; ++i) {
      const float gap = table->pose[n][i] - wanted[i];
      far += weight[i] * gap * gap;
    }
    far *= BINS / 4;
    bin[n] = (unsigned char)(far < BINS - 1 ? far : BINS - 1);
    ++begin[bin[n] + 1];
  }
  for (i = 0; i < BINS; ++i) begin[i + 1] += begin[i];
  for (n = 0; n < CALIB_POSTURES; ++n) row[begin[bin[n]]++] = (short)n;
  return starts;
}

/* Starts of a pose: `count` that are given, or else postures of the table. */
static inline calib_starts calib_pose_starts(const calib_task *task, int count,
                                             const calib_real *given, const calib_postures *table,
                                             short row[CALIB_POSTURES]) {
  calib_starts starts = {given, 0, count, count, count, @same@};
  return count ? starts : calib_posture_starts(task, table, row);
}

/* Joints that bring the tip to poses x (3), R (9) of the sensor's frame, as calib_inverse_pose. */
CALIB_API void calib_poses_many(long first, long last, const calib_real *x, const calib_real *R,
                                int free, const calib_real *near, calib_real *q,
                                signed char *valid) {
  calib_task task;
  calib_best way;
  for (; first < last; ++first) {
    calib_pose_task(x + 3 * first, R + 9 * first, free, &task);
    valid[first] = (signed char)calib_search(&task, x + 3 * first, near + first * CALIB_DOF,
                                             q + first * CALIB_DOF, &way);
  }
}

/* The same from more starts, where that leaves in doubt whether no way is nearer. */
CALIB_API void calib_poses_far_many(long first, long last, const calib_real *x,
                                    const calib_real *R, int free, int count,
                                    const calib_real *given, const calib_postures *table,
                                    const calib_real *near, calib_real *q, signed char *valid) {
  calib_task task;
  calib_best way;
  calib_real from[CALIB_DOF];
  short row[CALIB_POSTURES];
  for (; first < last; ++first) {
    calib_real *out = q + first * CALIB_DOF;
    calib_starts starts;
    if (valid[first] == 1 || !calib_from(near + first * CALIB_DOF, from)) continue;
    calib_pose_task(x + 3 * first, R + 9 * first, free, &task);
    starts = calib_pose_starts(&task, count, given + first * count * CALIB_DOF, table, row);
    way.met = valid[first] == 2;
    way.left = calib_not_a_number();
    calib_copy(out, way.q);
    calib_clipped(way.q);
    way.away = calib_apart(out, from, 0);
    calib_try_starts(&task, from, &starts, &way);
    valid[first] = way.met ? 1 : 0;
    if (!way.met) continue;
    calib_copy(way.q, out);
    calib_on_turn(near + first * CALIB_DOF, out);
  }
}

/* All ways to poses, at most `most` of each, and how many.  Joint curves and bending are left out
 * while ways are looked for from postures. */
CALIB_API void calib_poses_all_many(long first, long last, const calib_real *x,
                                    const calib_real *R, int free, int count,
                                    const calib_real *given, const calib_postures *table, int most,
                                    calib_real *q, signed char *found) {
  calib_task task;
  calib_arm plain = @placing@;
  short row[CALIB_POSTURES];
  plain.own = 0;
  for (; first < last; ++first) {
    calib_real(*out)[CALIB_DOF] = (calib_real(*)[CALIB_DOF])(q + first * most * CALIB_DOF), left;
    calib_starts starts;
    int n, ways = 0, rough;
    calib_pose_task(x + 3 * first, R + 9 * first, free, &task);
    starts = calib_pose_starts(&task, count, given + first * count * CALIB_DOF, table, row);
    if (!count) task.arm = &plain;
    rough = calib_every(&task, &starts, count ? CALIB_STEPS : CALIB_STEPS / 2, most, out);
    task.arm = &@placing@;
    for (n = 0; n < rough; ++n) { /* with curves and bending, each once */
      if (!count && !calib_reach(&task, out[n], 0, 0, CALIB_STEPS, out[n], &left)) continue;
      if (calib_beside(out[n], out[0], ways, @same@)) continue;
      calib_copy(out[n], out[ways++]);
    }
    found[first] = (signed char)ways;
  }
}
#endif

#endif /* @guard@ */
