
/* Starts of a search: joints one after another, so far apart; no numbers are no start. */
typedef struct {
  const calib_real *q;
  int count, step;
  int likely;      /* those after the likely ones are for what these lead to nowhere */
  int runs;        /* so many runs without a new way end a search */
  calib_real apart; /* starts closer to a known way lead to it */
} calib_starts;

/* Whether a joint value is within the limits of all its turns. */
static inline int calib_allowed(int k, calib_real value) {
  const calib_real close = @close@ * calib_span[k];
  return value >= calib_least[k] - close && value <= calib_most[k] + close;
}

/* Joints by whole turns as near to others as their limits allow. */
static inline void calib_on_turn(const calib_joints near, calib_joints q) {
  int k;
  for (k = 0; k < CALIB_DOF; ++k) {
    const calib_real goal = calib_between(near[k], calib_least[k], calib_most[k]);
    const calib_real turns = floor((goal - q[k]) / calib_span[k] + (calib_real)0.5);
    if (!calib_periodic[k]) continue;
    q[k] += calib_span[k] * turns;
    if (!calib_allowed(k, q[k])) q[k] += q[k] > goal ? -calib_span[k] : calib_span[k];
    q[k] = calib_between(q[k], calib_least[k], calib_most[k]);
  }
}

/* Adds a new way, the nearest first, where there is no room in the place of one that is further;
 * returns whether it did. */
static inline int calib_take(calib_search *search, const calib_joints way) {
  const calib_real away = calib_apart(way, search->from);
  calib_real *place = search->way + CALIB_DOF * search->count;
  if (calib_beside(way, search->way, search->count, @same@)) return 0;
  if (search->count < search->most) ++search->count;
  else if (away < search->away) place -= CALIB_DOF;
  else return 0;
  for (; place > search->way; place -= CALIB_DOF) {
    if (calib_apart(place - CALIB_DOF, search->from) <= away) break;
    calib_copy(CALIB_DOF, place - CALIB_DOF, place);
  }
  calib_copy(CALIB_DOF, way, place);
  search->away = calib_apart(search->way + CALIB_DOF * (search->count - 1), search->from);
  return 1;
}

/* Takes the way that a start leads to, and what lies across a fold beside it, or beside what a limit lets
 * miss the task a little; returns whether one was new or nearer. */
static inline int calib_try(calib_search *search, const calib_joints start) {
  const int one = search->most == 1;
  calib_real way[CALIB_DOF], across[CALIB_DOF];
  calib_gap gap;
  int gain = 0;
  calib_copy(CALIB_DOF, start, way);
  if (calib_reach(search, way, &gap)) {
    gain = calib_take(search, way);
    if (!gain && !one) return 0;
  } else {
    if (!search->count && gap.left < search->left) {
      search->left = gap.left;
      calib_copy(CALIB_DOF, way, search->way);
    }
    if (!(gap.left <= @edge@ * search->task->size)) return 0;
  }
  if (CALIB_DOF > search->task->rows || (!one && search->count == search->most)) return gain;
  if (one && gain && search->away <= @near_enough@) return gain;
  if (!calib_twin(search->task, way, &gap, across)) return gain;
  if (calib_beyond(search, across, @margin@)) return gain;
  return (calib_descend(search, 0, across, &gap) && calib_take(search, across)) || gain;
}

/* A search for ways to a task from joints on, with room for `most`. */
static inline calib_search calib_begin(calib_task *task, const calib_joints from, int most,
                                       int budget, calib_real *way) {
  calib_search search = {task, {0}, way, (calib_real)INFINITY, 0, most, budget, 0};
  calib_copy(CALIB_DOF, from, search.from);
  return search;
}

/* Begins a search for the way to a task that is nearest to joints; 0 where they are none.  1 where no
 * other way can be nearer than what they lead to, or what lies across a fold beside it; else 2. */
static inline int calib_try_near(calib_search *search, calib_task *task,
                                 const calib_joints near, int budget, calib_joints way) {
  const int spare = CALIB_DOF > task->rows || task->arm;
  int k;
  *search = calib_begin(task, near, 1, budget, way);
  for (k = 0; k < CALIB_DOF; ++k) {
    const calib_real u = calib_share_of(k, near[k]);
    if (!(u - u == 0) || (!calib_periodic[k] && !(u >= -1 && u <= 2))) return 0;
  }
  calib_clipped(search->from);
  calib_try(search, search->from);
  return search->count && search->away <= (spare ? @near_enough_spare@ : @near_enough@) ? 1 : 2;
}

/* The same of starts, but for those that can lead to no new or nearer way. */
static inline void calib_try_starts(calib_search *search, const calib_starts *starts) {
  int n, runs = 0;
  for (n = 0; n < starts->count && runs < starts->runs; n += starts->step) {
    const calib_real *start = starts->q + n * CALIB_DOF;
    if (search->count && n >= starts->likely) return;
    if (search->count == search->most && search->most > 1) return;
    if (!(start[0] - start[0] == 0)) continue;
    if (calib_beside(start, search->way, search->count, starts->apart)) continue;
    if (calib_beyond(search, start, @margin@)) continue;
    runs = calib_try(search, start) ? 0 : runs + 1;
  }
}

#if @grid@

/* Tries the starts of a position's cell of the workspace; where they lead nowhere some all over. */
static inline void calib_try_position(calib_search *search) {
  calib_starts all = {calib_start_q[0], CALIB_STARTS, 1 + CALIB_STARTS / CALIB_TRIES, 0, CALIB_TRIES, 0};
  calib_starts starts = {0, 0, 1, CALIB_TRIES, CALIB_TRIES, @margin@ / 2};
  int cell = 0, i;
  for (i = 0; i < CALIB_OUT; ++i) {
    const calib_real u = (search->task->x[i] - calib_grid_lower[i]) / calib_grid_step[i];
    cell = cell * calib_grid[i] + (int)calib_between(u, 0, calib_grid[i] - (calib_real)0.5);
  }
  starts.q = calib_start_q[calib_cell[cell]];
  starts.count = calib_cell[cell + 1] - calib_cell[cell];
  calib_try_starts(search, &starts);
  if (!search->count) calib_try_starts(search, &all);
}
#else

/* Tries the starts that are near to a position and to joints, the nearest first. */
static inline void calib_try_position(calib_search *search) {
  const int most = CALIB_TRIES < CALIB_STARTS ? CALIB_TRIES : CALIB_STARTS;
  calib_real q[CALIB_TRIES][CALIB_DOF], far[CALIB_TRIES];
  const calib_starts starts = {q[0], most, 1, most / 6, CALIB_TRIES, @margin@ / 2};
  int row[CALIB_TRIES], count = 0, i, n;
  for (n = 0; n < CALIB_STARTS; ++n) {
    const calib_real joints = calib_apart(calib_start_q[n], search->from);
    calib_real away = joints * joints;
    for (i = 0; i < CALIB_OUT; ++i) {
      const calib_real gap = (search->task->x[i] - calib_start_x[n][i]) / @extent@;
      away += @pull@ * gap * gap;
    }
    count = calib_rank(n, away, count, most, far, row);
  }
  for (n = 0; n < most; ++n) calib_copy(CALIB_DOF, calib_start_q[row[n]], q[n]);
  calib_try_starts(search, &starts);
}
#endif

/* Puts the way that was found on the turn nearest to `near`; returns `sure`, or without a way 0 or 3. */
static inline int calib_answered(const calib_search *search, const calib_joints near, int sure) {
  if (search->count) calib_on_turn(near, search->way);
  else calib_unknown(CALIB_DOF, search->way);
  return search->count || sure == 3 ? sure : 0;
}

/* All ways to a position that the table of starts leads to, at most `most`, the nearest to the middle of
 * the joints' ranges first; returns how many. */
static inline int calib_inverse_all(const calib_place x, int most, calib_real q[][CALIB_DOF]) {
  calib_task task = calib_position_task(x);
  calib_search search = calib_begin(&task, calib_middle, most, CALIB_BUDGET * CALIB_TRIES, q[0]);
  calib_try_position(&search);
  return search.count;
}

/* As calib_inverse, with a budget of steps. */
static inline int calib_inverse_within(const calib_place x, const calib_joints near, int budget,
                                       calib_joints q) {
  calib_task task = calib_position_task(x);
  calib_search search;
  calib_real bound, most = @sure@ * @extent@;
  int sure = calib_try_near(&search, &task, near, budget, q);
  if (sure == 2) {
    if (CALIB_DOF <= CALIB_OUT) sure = 1;
    calib_try_position(&search);
  }
  if (!search.count && search.left < (calib_real)INFINITY) {
    /* within the expected error it may still count as reached */
    const calib_starts starts = {calib_start_q[0], CALIB_STARTS, 1, 0, CALIB_STARTS, 0};
    if (calib_expected_error(search.way, &bound) && bound < most) most = bound;
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
static inline calib_task calib_pose_task(const calib_vector x, const calib_rotation R, int axis) {
  calib_task task = {&calib_placed, axis < 0 ? 6 : 5, axis, @lever@, {0}, {0}, 0};
  int i;
  for (i = 0; i < 9; ++i) task.axes[i] = R[3 * (i % 3) + i / 3];
  for (i = 0; i < 3; ++i) task.x[i] = x[i] / @scale@;
  return task;
}

/* The way to a pose nearest to joints that these, and then starts lead to, as calib_inverse. */
static inline int calib_pose_from(calib_task *task, const calib_starts *starts,
                                  const calib_joints near, calib_joints q) {
  calib_search search;
  int sure = calib_try_near(&search, task, near, CALIB_BUDGET, q);
  if (sure == 2 && starts->count) { /* all that starts lead to is looked at */
    search.budget = CALIB_BUDGET * starts->count;
    calib_try_starts(&search, starts);
    sure = 1;
  }
  return calib_answered(&search, near, sure);
}

/* The same from `near` alone, of a pose as calib_pose_task has it. */
static inline int calib_inverse_pose(const calib_vector x, const calib_rotation R, int axis,
                                     const calib_joints near, calib_joints q) {
  const calib_starts none = {0, 0, 1, 0, 0, 0};
  calib_task task = calib_pose_task(x, R, axis);
  return calib_pose_from(&task, &none, near, q);
}
#endif
#if @limit@

/* Joints that bring the real tip to where the nominal arm would be with q, near q; with six joints
 * or more also its orientation.  0 where none do, or a joint would change by more than usual. */
CALIB_API int calib_correct(const calib_joints q, calib_joints out) {
  calib_task task = {&calib_body, @correcting@, -1, @lever@, {0}, {0}, 0}, seen;
  calib_real start[CALIB_DOF], x[CALIB_OUT];
  calib_search search;
  calib_gap gap;
  int k, good = calib_inside(q, start);
  calib_copy(CALIB_DOF, start, out);
  calib_chain(&calib_nominal, 0, start, task.x, task.axes, 0);
  calib_seen(&calib_nominal, 0, start, x, 0);
  seen = calib_position_task(x);
  search = calib_begin(&task, start, 0, CALIB_BUDGET, 0);
  if (task.rows) good = good && calib_descend(&search, 0, out, &gap);
  search.task = &seen; /* what local models move is met as a position */
  if (@correcting_seen@) good = good && calib_descend(&search, 0, out, &gap);
  for (k = 0; k < CALIB_DOF; ++k) {
    const calib_real change = calib_span[k] * calib_short(k, (out[k] - start[k]) / calib_span[k]);
    if (!(fabs(change) <= calib_limit[k])) good = 0;
    out[k] = q[k] + change; /* on q's own turn, not beyond a stop */
    if (calib_allowed(k, q[k]) && !calib_allowed(k, out[k])) good = 0;
  }
  return good ? good : calib_unknown(CALIB_DOF, out);
}
#endif
