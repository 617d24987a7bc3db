
/* Rows of the table of starts that may lead to a position: those of its cell and, after them, of
 * the cells beside; without cells those that are near to it and to joints.  Returns how many;
 * those from `likely` on, all over the table, are for what the first lead to nowhere. */
static inline int calib_starting(const calib_real x[CALIB_OUT], const calib_real near[CALIB_DOF],
                                 short row[CALIB_TRIES], int *likely) {
#if @gridded@
  int cell[CALIB_OUT], found = 0, around = 1, i, n, ring;
  (void)near;
  for (i = 0; i < CALIB_OUT; ++i) {
    const calib_real u = floor((x[i] - calib_grid_lower[i]) / calib_grid_step[i]);
    cell[i] = u > 0 ? (u < calib_grid[i] ? (int)u : calib_grid[i] - 1) : 0;
    around *= 3;
  }
  for (ring = 0; ring < 2; ++ring)
    for (n = 0; n < around; ++n) {
      int place = 0, beside = 0, rest = n, outside = 0;
      for (i = 0; i < CALIB_OUT; ++i, rest /= 3) {
        const int at = cell[i] + rest % 3 - 1;
        outside |= at < 0 || at >= calib_grid[i];
        beside |= at != cell[i];
        place = place * calib_grid[i] + at;
      }
      if (outside || beside != ring) continue;
      for (i = calib_cell[place]; i < calib_cell[place + 1] && found < CALIB_TRIES; ++i)
        row[found++] = (short)i;
    }
  *likely = found;
  for (i = 0; i < CALIB_STARTS && found < CALIB_TRIES; i += 1 + CALIB_STARTS / CALIB_TRIES)
    row[found++] = (short)i;
  return found;
#else
  calib_real far[CALIB_TRIES];
  int found = 0, i, k, n;
  for (n = 0; n < CALIB_STARTS; ++n) {
    calib_real d = calib_apart(calib_start_q[n], near, 0);
    calib_real squared = 0;
    for (i = 0; i < CALIB_OUT; ++i) {
      const calib_real gap = (x[i] - calib_start_x[n][i]) / @extent@;
      squared += gap * gap;
    }
    d = d * d + squared * CALIB_PULL;
    if (found == CALIB_TRIES && !(d < far[CALIB_TRIES - 1])) continue;
    k = found < CALIB_TRIES ? found++ : CALIB_TRIES - 1;
    for (; k > 0 && far[k - 1] > d; --k) {
      far[k] = far[k - 1];
      row[k] = row[k - 1];
    }
    far[k] = d;
    row[k] = (short)n;
  }
  *likely = found < CALIB_TRIES / 3 ? found : CALIB_TRIES / 3;
  return found;
#endif
}

/* Joints by whole turns as near to others as their limits allow. */
static inline void calib_on_turn(const calib_real near[CALIB_DOF], calib_real q[CALIB_DOF]) {
  int k;
  for (k = 0; k < CALIB_DOF; ++k) {
    if (!calib_periodic[k]) continue;
    q[k] += calib_span[k] * floor((near[k] - q[k]) / calib_span[k] + (calib_real)0.5);
    while (q[k] > calib_most[k] + @close@ * calib_span[k]) q[k] -= calib_span[k];
    while (q[k] < calib_least[k] - @close@ * calib_span[k]) q[k] += calib_span[k];
    if (q[k] > calib_most[k]) q[k] = calib_most[k];
    if (q[k] < calib_least[k]) q[k] = calib_least[k];
  }
}

/* Starts of a search: rows of a table of joints, in an order. */
typedef struct {
  const calib_real *q; /* joints, one after another; no numbers are no start */
  const short *row;    /* the order; 0 where it is that of the table */
  int count, likely;   /* those after the likely ones are for what these lead to nowhere */
  int runs;            /* so many runs without a new way end a search */
  calib_real apart;    /* starts closer to a known way lead to it */
} calib_starts;

static inline const calib_real *calib_start(const calib_starts *starts, int n) {
  return starts->q + (starts->row ? starts->row[n] : n) * CALIB_DOF;
}

/* Starts of a position near joints, from the table; `row` is room for their order. */
static inline calib_starts calib_position_starts(const calib_real x[CALIB_OUT],
                                                 const calib_real near[CALIB_DOF],
                                                 short row[CALIB_TRIES]) {
  calib_starts starts = {calib_start_q[0], row, 0, 0, CALIB_TRIES, @margin@ / 2};
  starts.count = calib_starting(x, near, row, &starts.likely);
  return starts;
}

/* The best way to a task so far: joints that do it, or that come nearest to it. */
typedef struct {
  int met;
  calib_real q[CALIB_DOF], away;       /* nearest to the joints asked for, and how near */
  calib_real nearest[CALIB_DOF], left; /* of what misses the task the best, and what is left */
} calib_best;

/* Replaces a way by what a start leads to, if that is nearer. */
static inline void calib_try(const calib_task *task, const calib_real from[CALIB_DOF], int known,
                             const calib_real start[CALIB_DOF], calib_best *way) {
  calib_real trial[CALIB_DOF], left, away;
  calib_copy(start, trial);
  if (!calib_reach(task, from, way->q, known, CALIB_STEPS, trial, &left)) {
    if (way->met || way->left <= left) return;
    way->left = left;
    calib_copy(trial, way->nearest);
    return;
  }
  away = calib_apart(trial, from, 0);
  if (way->met && !(away < way->away)) return;
  way->met = 1;
  way->away = away;
  calib_copy(trial, way->q);
}

/* Whether no other way can be nearer. */
static inline int calib_sure(const calib_task *task, const calib_best *way) {
  const int single = task->kind == CALIB_POSITION && CALIB_DOF == CALIB_OUT;
  return way->met && way->away <= (single ? @beside@ : @surely@);
}

/* The way that `from` leads to, or what lies across a fold beside it. */
static inline void calib_try_near(const calib_task *task, const calib_real from[CALIB_DOF],
                                  calib_best *way) {
  calib_real twin[CALIB_DOF];
  way->met = 0;
  way->left = calib_not_a_number();
  calib_try(task, from, 0, from, way);
  if (way->met && CALIB_DOF <= calib_rows(task) && way->away > @beside@ &&
      calib_twin(task, way->q, twin))
    calib_try(task, from, 0, twin, way);
}

/* The same of starts, but for those that can lead to no nearer one. */
static inline void calib_try_starts(const calib_task *task, const calib_real from[CALIB_DOF],
                                    const calib_starts *starts, calib_best *way) {
  int n, runs = 0;
  for (n = 0; n < starts->count && runs < starts->runs; ++n) {
    const calib_real *start = calib_start(starts, n);
    if (n >= starts->likely && way->met) return;
    if (!(start[0] - start[0] == 0)) continue;
    if (way->met && (calib_apart(start, from, 0) > way->away + @margin@ ||
                     calib_apart(start, way->q, 0) < starts->apart))
      continue;
    ++runs;
    calib_try(task, from, way->met, start, way);
  }
}

/* `near` within its limits; 0 where it is no joints. */
static inline int calib_from(const calib_real near[CALIB_DOF], calib_real from[CALIB_DOF]) {
  int k;
  for (k = 0; k < CALIB_DOF; ++k) {
    const calib_real u = (near[k] - calib_lower[k]) / calib_span[k];
    if (!(u - u == 0) || (!calib_periodic[k] && !(u >= -1 && u <= 2))) return 0;
  }
  calib_copy(near, from);
  calib_clipped(from);
  return 1;
}

/* Joints nearest to `near` that do a task; x is the position by which starts are chosen.  1 where
 * no other way is nearer, 2 where one might be, 0 where none was found: `way` has what comes
 * closest then. */
static inline int calib_search(const calib_task *task, const calib_real x[CALIB_OUT],
                               const calib_real near[CALIB_DOF], calib_real q[CALIB_DOF],
                               calib_best *way) {
  const int single = task->kind == CALIB_POSITION && CALIB_DOF == CALIB_OUT;
  calib_real from[CALIB_DOF];
  short row[CALIB_TRIES];
  int k;
  for (k = 0; k < CALIB_DOF; ++k) q[k] = calib_not_a_number();
  way->met = 0;
  way->left = calib_not_a_number();
  if (!calib_from(near, from)) return 0;
  calib_try_near(task, from, way);
  if (!calib_sure(task, way)) {
    calib_starts starts = calib_position_starts(x, from, row);
    if (!single) starts.count = starts.likely;
    calib_try_starts(task, from, &starts, way);
  }
  if (!way->met) return 0;
  calib_copy(way->q, q);
  calib_on_turn(near, q);
  return single || calib_sure(task, way) ? 1 : 2;
}

/* Adds what a start leads to, and what lies across a fold beside it, to `count` ways to do a task,
 * unless it is one of them; returns how many there are. */
static inline int calib_add_way(const calib_task *task, const calib_real start[CALIB_DOF],
                                int steps, int most, calib_real q[][CALIB_DOF], int count) {
  calib_real trial[CALIB_DOF], left;
  int first = count, fold;
  calib_copy(start, trial);
  for (fold = 0; fold < 2 && count < most; ++fold) {
    if (fold && (count == first || CALIB_DOF > calib_rows(task) ||
                 !calib_twin(task, q[first], trial)))
      break;
    if (!calib_reach(task, start, q[0], fold ? 0 : count, steps, trial, &left)) break;
    if (calib_beside(trial, q[0], count, @same@)) break;
    calib_copy(trial, q[count++]);
  }
  return count;
}

/* All ways to a task that starts lead to, at most `most`; returns how many. */
static inline int calib_every(const calib_task *task, const calib_starts *starts, int steps,
                              int most, calib_real q[][CALIB_DOF]) {
  int n, runs = 0, count = 0;
  for (n = 0; n < starts->count && runs < starts->runs && count < most; ++n) {
    const calib_real *start = calib_start(starts, n);
    const int before = count;
    if (n >= starts->likely && count) break;
    if (!(start[0] - start[0] == 0) || calib_beside(start, q[0], count, starts->apart)) continue;
    count = calib_add_way(task, start, steps, most, q, count);
    runs = count > before ? 0 : runs + 1;
  }
  return count;
}

static inline void calib_position_task(const calib_real x[CALIB_OUT], calib_task *task) {
  int i;
  task->kind = CALIB_POSITION;
  for (i = 0; i < CALIB_OUT; ++i) task->x[i] = x[i];
}

/* All ways to a position that the table of starts leads to, at most `most`; returns how many. */
static inline int calib_inverse_all(const calib_real x[CALIB_OUT], int most,
                                    calib_real q[][CALIB_DOF]) {
  calib_task task;
  short row[CALIB_TRIES];
  calib_starts starts = calib_position_starts(x, calib_start_q[0], row);
  starts.apart = @margin@;
  calib_position_task(x, &task);
  return calib_every(&task, &starts, CALIB_STEPS, most, q);
}

/* Joints that bring the tip to a position: of several ways the one nearest to `near`, in shares of
 * the joints' ranges.  1, or 2 where another way might be nearer; 0 where none was found. */
static inline int calib_inverse(const calib_real x[CALIB_OUT], const calib_real near[CALIB_DOF],
                                calib_real q[CALIB_DOF]) {
  calib_task task;
  calib_best way;
  calib_position_task(x, &task);
  return calib_search(&task, x, near, q, &way);
}

/* As calib_inverse, and 3 where nothing reaches the position. */
static inline int calib_answer(const calib_real x[CALIB_OUT], const calib_real near[CALIB_DOF],
                               calib_real q[CALIB_DOF]) {
  calib_task task;
  calib_best way;
  calib_real bound, most = @sure@ * @extent@;
  int found;
  calib_position_task(x, &task);
  found = calib_search(&task, x, near, q, &way);
  if (found || !(way.left - way.left == 0)) return found;
  /* within the expected error it may still count as reached */
  if (calib_expected_error(way.nearest, &bound) && bound < most) most = bound;
  return way.left > 2 * most ? 3 : 0;
}
#if @placed@

/* The task of a pose of the sensor's frame (R row by row); `free` is -1, or an axis of the tip, 0
 * to 2, about which its turn is left open. */
static inline void calib_pose_task(const calib_real x[3], const calib_real R[9], int free,
                                   calib_task *task) {
  int i, j, k;
  task->kind = free < 0 ? CALIB_POSE : CALIB_AXIS;
  task->axis = free;
  task->arm = &@placing@;
  for (i = 0; i < 3; ++i) {
    task->x[i] = 0;
    for (j = 0; j < 3; ++j) {
      task->x[i] += calib_aim[3 * j + i] * (x[j] - calib_origin[j]) / @scale@;
      task->R[3 * i + j] = 0;
      for (k = 0; k < 3; ++k) task->R[3 * i + j] += calib_aim[3 * k + i] * R[3 * k + j];
    }
  }
}

/* Joints that bring the tip to a pose of the sensor's frame (R row by row), as calib_inverse. */
static inline int calib_inverse_pose(const calib_real x[3], const calib_real R[9],
                                     const calib_real near[CALIB_DOF], calib_real q[CALIB_DOF]) {
  calib_task task;
  calib_best way;
  calib_pose_task(x, R, -1, &task);
  return calib_search(&task, x, near, q, &way);
}
#endif

/* One damped Newton step of the joints towards a position; returns the distance before it. */
static inline calib_real calib_newton_step(const calib_real target[CALIB_OUT], calib_real damping,
                                           calib_real q[CALIB_DOF]) {
  calib_task task;
  calib_gap gap;
  calib_real move[CALIB_DOF];
  int i;
  calib_position_task(target, &task);
  calib_left(&task, q, &gap);
  if (!calib_move(CALIB_OUT, gap.J, gap.r, q, 0, damping, move)) return calib_not_a_number();
  for (i = 0; i < CALIB_DOF; ++i) q[i] += calib_span[i] * move[i];
  return gap.left;
}
#if @corrected@

/* Where the nominal arm would be with q, as the sensor sees it. */
static inline void calib_wanted(const calib_real q[CALIB_DOF], calib_real x[CALIB_OUT]) {
  calib_seen(&calib_nominal, q, x, 0);
}

/* Joints that bring the real tip to where the nominal arm would be with q, near q; with six joints
 * or more also its orientation.  0 where none do, or a joint would change by more than usual. */
static inline int calib_correct(const calib_real q[CALIB_DOF], calib_real out[CALIB_DOF]) {
  calib_real start[CALIB_DOF], left;
  calib_task task;
  int k, good = calib_in_range(q);
  if (good) {
    calib_wrapped(q, start);
    for (k = 0; k < CALIB_DOF; ++k) out[k] = start[k];
    task.kind = @correcting@;
    task.arm = &calib_body;
    if (task.kind == CALIB_POSITION) calib_wanted(start, task.x);
    else calib_chain(&calib_nominal, start, task.x, task.R, 0, 0);
    good = calib_reach(&task, start, 0, 0, CALIB_STEPS, out, &left);
#if @local@
    if (good && task.kind != CALIB_POSITION) { /* what local models move is met as a position */
      task.kind = CALIB_POSITION;
      calib_wanted(start, task.x);
      good = calib_reach(&task, out, 0, 0, CALIB_STEPS, out, &left);
    }
#endif
    for (k = 0; k < CALIB_DOF; ++k) {
      calib_real change = out[k] - start[k];
      if (calib_periodic[k])
        change -= calib_span[k] * floor(change / calib_span[k] + (calib_real)0.5);
      if (!(fabs(change) <= calib_limit[k])) good = 0;
      out[k] = q[k] + change; /* on q's own turn */
    }
  }
  for (k = 0; !good && k < CALIB_DOF; ++k) out[k] = calib_not_a_number();
  return good;
}
#endif
