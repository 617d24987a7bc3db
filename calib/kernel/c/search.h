
/* Starts of a search: rows of a table of joints, in an order. */
typedef struct {
  const calib_real *q; /* joints, one after another; no numbers are no start */
  const short *row;    /* the order; 0 where it is that of the table */
  int count, likely;   /* those after the likely ones are for what these lead to nowhere */
  int runs;            /* so many runs without a new way end a search */
  calib_real apart;    /* starts closer to a known way lead to it */
} calib_starts;
#if @grid@

/* Starts of a position: those of its cell and, after them, of the cells beside. */
static inline calib_starts calib_position_starts(const calib_place x, const calib_joints near,
                                                 short row[CALIB_STARTS + 1]) {
  calib_starts starts = {calib_start_q[0], row, 0, 0, CALIB_TRIES, @margin@ / 2};
  int cell[CALIB_OUT], around = 1, i, n, ring;
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
      for (i = calib_cell[place]; i < calib_cell[place + 1] && starts.count < CALIB_TRIES; ++i)
        row[starts.count++] = (short)i;
    }
  starts.likely = starts.count;
  for (i = 0; i < CALIB_STARTS && starts.count < CALIB_TRIES; i += 1 + CALIB_STARTS / CALIB_TRIES)
    row[starts.count++] = (short)i;
  return starts;
}
#else

/* Starts of a position: those that are near to it and to joints, the nearest first. */
static inline calib_starts calib_position_starts(const calib_place x, const calib_joints near,
                                                 short row[CALIB_STARTS + 1]) {
  const int count = CALIB_TRIES < CALIB_STARTS ? CALIB_TRIES : CALIB_STARTS;
  calib_starts starts = {calib_start_q[0], row, count, count / 6, CALIB_TRIES, @margin@ / 2};
  calib_real far[CALIB_STARTS + 1];
  int i, n, k;
  for (n = 0; n < CALIB_STARTS; ++n) {
    const calib_real joints = calib_apart(calib_start_q[n], near, 0);
    calib_real away = joints * joints;
    for (i = 0; i < CALIB_OUT; ++i) {
      const calib_real gap = (x[i] - calib_start_x[n][i]) / @extent@;
      away += CALIB_PULL * gap * gap;
    }
    for (k = n < count ? n : count; k > 0 && far[k - 1] > away; --k) {
      far[k] = far[k - 1];
      row[k] = row[k - 1];
    }
    far[k] = away;
    row[k] = (short)n;
  }
  return starts;
}
#endif

/* Whether a joint value is within the limits of all its turns. */
static inline int calib_allowed(int k, calib_real value) {
  const calib_real close = @close@ * calib_span[k];
  return value >= calib_least[k] - close && value <= calib_most[k] + close;
}

/* Joints by whole turns as near to others as their limits allow. */
static inline void calib_on_turn(const calib_joints near, calib_joints q) {
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

/* Adds the way that a start leads to, and what lies across a fold beside it, or replaces a way that
 * is further; returns whether it did. */
static inline int calib_try(calib_search *search, const calib_joints start) {
  calib_real trial[CALIB_DOF], way[CALIB_DOF];
  calib_gap gap;
  int fold, gain = 0;
  calib_copy(CALIB_DOF, start, trial);
  for (fold = 0; fold < 2; ++fold) {
    const int one = search->most == 1;
    calib_real away;
    if (!calib_reach(search, !fold, fold ? 0 : search->count, trial, &gap)) {
      if (search->count || search->left <= gap.left || !(gap.left - gap.left == 0)) return gain;
      search->left = gap.left;
      calib_copy(CALIB_DOF, trial, search->nearest);
      return gain;
    }
    if (!one && calib_beside(trial, search->way, search->count, @same@)) return gain;
    away = calib_apart(trial, search->from, 0);
    if (!one || !search->count || away < search->away) {
      if (one) search->count = 0;
      calib_copy(CALIB_DOF, trial, search->way + CALIB_DOF * search->count++);
      search->away = away;
      gain = 1;
    }
    calib_copy(CALIB_DOF, trial, way);
    if (CALIB_DOF > calib_rows(search->task) || (one && away <= @near_enough@)) return gain;
    if (search->count == search->most && !one) return gain;
    if (!calib_twin(search->task, way, &gap, trial)) return gain;
    if (one && calib_apart(trial, search->from, 0) > search->away + @margin@) return gain;
  }
  return gain;
}

/* A search for ways to a task from joints on, with room for `most`. */
static inline calib_search calib_begin(const calib_task *task, const calib_joints from, int most,
                                       int budget, calib_real *way) {
  calib_search search = {task, {0}, way, 0, most, budget, 0, {0}, 0};
  calib_unknown(1, &search.left);
  calib_copy(CALIB_DOF, from, search.from);
  return search;
}

/* Begins a search for the way to a task that is nearest to joints; 0 where they are none.  1 where no
 * other way can be nearer than what they lead to, or what lies across a fold beside it; else 2. */
static inline int calib_try_near(calib_search *search, const calib_task *task,
                                 const calib_joints near, int budget, calib_joints way) {
  const int spare = CALIB_DOF > calib_rows(task);
  int k;
  *search = calib_begin(task, near, 1, budget, way);
  for (k = 0; k < CALIB_DOF; ++k) {
    const calib_real u = calib_share_of(k, near[k]);
    if (!(u - u == 0) || (!calib_periodic[k] && !(u >= -1 && u <= 2))) return 0;
  }
  calib_clipped(search->from);
  calib_try(search, search->from);
  return search->count && search->away <= (spare || task->kind ? @near_enough_spare@ : @near_enough@) ? 1 : 2;
}

/* The same of starts, but for those that can lead to no new or nearer way. */
static inline void calib_try_starts(calib_search *search, const calib_starts *starts) {
  int n, runs = 0;
  for (n = 0; n < starts->count && runs < starts->runs; ++n) {
    const calib_real *start = starts->q + (starts->row ? starts->row[n] : n) * CALIB_DOF;
    if (search->count && (n >= starts->likely || (search->count == search->most && search->most > 1)))
      return;
    if (!(start[0] - start[0] == 0)) continue;
    if (calib_beside(start, search->way, search->count, starts->apart)) continue;
    if (search->most == 1 && search->count &&
        calib_apart(start, search->from, 0) > search->away + @margin@)
      continue;
    runs = calib_try(search, start) ? 0 : runs + 1;
  }
}

/* All ways to a task that starts lead to, at most `most`; returns how many. */
static inline int calib_every(const calib_task *task, const calib_starts *starts, int most,
                              calib_real *q) {
  calib_search search = calib_begin(task, starts->q, most, CALIB_BUDGET * starts->count, q);
  calib_try_starts(&search, starts);
  return search.count;
}

/* Puts the way that was found on the turn nearest to `near`; returns `sure`, or without a way 0 or 3. */
static inline int calib_answered(const calib_search *search, const calib_joints near, int sure) {
  if (search->count) calib_on_turn(near, search->way);
  else calib_unknown(CALIB_DOF, search->way);
  return search->count || sure == 3 ? sure : 0;
}

static inline void calib_position_task(const calib_place x, calib_task *task) {
  int i;
  task->kind = CALIB_POSITION;
  task->axis = -1;
  task->arm = &calib_body;
  for (i = 0; i < CALIB_OUT; ++i) task->x[i] = x[i];
}

/* All ways to a position that the table of starts leads to, at most `most`; returns how many. */
static inline int calib_inverse_all(const calib_place x, int most, calib_real q[][CALIB_DOF]) {
  calib_task task;
  short row[CALIB_STARTS + 1];
  calib_starts starts = calib_position_starts(x, calib_start_q[0], row);
  starts.apart = @margin@;
  calib_position_task(x, &task);
  return calib_every(&task, &starts, most, q[0]);
}

/* As calib_inverse, with a budget of steps. */
static inline int calib_inverse_within(const calib_place x, const calib_joints near, int budget,
                                       calib_joints q) {
  calib_task task;
  calib_search search;
  calib_real bound, most = @sure@ * @extent@;
  int sure;
  calib_position_task(x, &task);
  sure = calib_try_near(&search, &task, near, budget, q);
  if (sure == 2) {
    short row[CALIB_STARTS + 1];
    calib_starts starts = calib_position_starts(x, search.from, row);
    if (CALIB_DOF <= CALIB_OUT) sure = 1;
    calib_try_starts(&search, &starts);
  }
  if (!search.count && search.left - search.left == 0) {
    /* within the expected error it may still count as reached */
    calib_starts starts = {calib_start_q[0], 0, CALIB_STARTS, 0, CALIB_STARTS, 0};
    if (calib_expected_error(search.nearest, &bound) && bound < most) most = bound;
    most *= 2;
    if (CALIB_DOF > CALIB_OUT && most < @edge@ * @extent@) most = @edge@ * @extent@;
    if (search.budget > 0 && search.left > most) return calib_answered(&search, near, 3);
    if (budget > CALIB_BUDGET) calib_try_starts(&search, &starts);
  }
  return calib_answered(&search, near, sure);
}

/* Joints that bring the tip to a position: of several ways the one nearest to `near`, in shares of
 * the joints' ranges.  1, or 2 where another way might be nearer; 0 where none was found, 3 where
 * nothing reaches the position. */
static inline int calib_inverse(const calib_place x, const calib_joints near, calib_joints q) {
  return calib_inverse_within(x, near, CALIB_BUDGET, q);
}
#if @placed@

/* The task of a pose of the sensor's frame (R row by row); `axis` is -1, or an axis of the tip, 0 to
 * 2, about which its turn is left open. */
static inline void calib_pose_task(const calib_vector x, const calib_rotation R, int axis,
                                   calib_task *task) {
  int i, j, k;
  task->kind = axis < 0 ? CALIB_POSE : CALIB_AXIS;
  task->axis = axis;
  task->arm = &calib_placed;
  for (i = 0; i < 3; ++i) {
    task->x[i] = 0;
    for (j = 0; j < 3; ++j) {
      task->x[i] += calib_aim[3 * j + i] * (x[j] - calib_origin[j]) / @scale@;
      task->R[3 * i + j] = 0;
      for (k = 0; k < 3; ++k) task->R[3 * i + j] += calib_aim[3 * k + i] * R[3 * k + j];
    }
  }
}

/* Joints that bring the tip to a pose of the sensor's frame (R row by row), as calib_inverse; `axis`
 * is -1, or an axis of the tip, 0 to 2, about which its turn is left open. */
static inline int calib_inverse_pose(const calib_vector x, const calib_rotation R, int axis,
                                     const calib_joints near, calib_joints q) {
  calib_task task;
  calib_search search;
  int sure;
  calib_pose_task(x, R, axis, &task);
  sure = calib_try_near(&search, &task, near, CALIB_BUDGET, q);
  return calib_answered(&search, near, sure);
}
#endif

/* One damped Newton step of the joints towards a position; returns the distance before it. */
static inline calib_real calib_newton_step(const calib_place target, calib_real damping,
                                           calib_joints q) {
  calib_task task;
  calib_gap gap;
  calib_real move[CALIB_DOF];
  int i;
  calib_position_task(target, &task);
  calib_left(&task, 0, q, &gap);
  if (!calib_move(CALIB_OUT, gap.J, gap.r, q, 0, damping, move)) return (calib_real)NAN;
  for (i = 0; i < CALIB_DOF; ++i) q[i] += calib_span[i] * move[i];
  return gap.left;
}
#if @limit@

/* Joints that bring the real tip to where the nominal arm would be with q, near q; with six joints
 * or more also its orientation.  0 where none do, or a joint would change by more than usual. */
CALIB_API int calib_correct(const calib_joints q, calib_joints out) {
  calib_real start[CALIB_DOF];
  calib_task task = {@correcting@, -1, &calib_body, {0}, {0}};
  calib_search search;
  calib_gap gap;
  int k, good = calib_inside(q, start);
  if (good) {
    calib_copy(CALIB_DOF, start, out);
    search = calib_begin(&task, start, 0, CALIB_BUDGET, 0);
    if (task.kind == CALIB_POSITION) calib_seen(&calib_nominal, 0, start, task.x, 0);
    else calib_chain(&calib_nominal, 0, start, task.x, task.R, 0);
    good = calib_reach(&search, 0, 0, out, &gap);
#if @local_terms@
    if (good && task.kind != CALIB_POSITION) { /* what local models move is met as a position */
      task.kind = CALIB_POSITION;
      calib_seen(&calib_nominal, 0, start, task.x, 0);
      good = calib_reach(&search, 0, 0, out, &gap);
    }
#endif
    for (k = 0; k < CALIB_DOF; ++k) {
      const calib_real change =
          calib_span[k] * calib_short(k, (out[k] - start[k]) / calib_span[k]);
      if (!(fabs(change) <= calib_limit[k])) good = 0;
      out[k] = q[k] + change; /* on q's own turn, not beyond a stop */
      if (calib_allowed(k, q[k]) && !calib_allowed(k, out[k])) good = 0;
    }
  }
  return good ? good : calib_unknown(CALIB_DOF, out);
}
#endif
