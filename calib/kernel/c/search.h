/* Starts of a search: joints one after another; no numbers are no start. */
typedef struct {
  const calib_real *q;
  int count;
  int likely;       /* those after the likely ones are for what these lead to nowhere */
  int runs;         /* so many runs without a new way end a search */
  calib_real apart; /* starts closer to a known way lead to it */
} calib_starts;

/* Whether a joint value is within the limits of all its turns. */
static inline int calib_allowed(int k, calib_real value) {
  const calib_real close = @close@ * calib_span[k];
  return value >= calib_least[k] - close && value <= calib_most[k] + close;
}

/* Joints by whole turns as near to others as their limits allow. */
static inline void calib_on_turn(const calib_joints near, calib_joints q) {
  for (int k = 0; k < CALIB_DOF; ++k) {
    const calib_real goal = calib_between(near[k], calib_least[k], calib_most[k]);
    const calib_real turns = floor((goal - q[k]) / calib_span[k] + (calib_real)0.5);
    if (!calib_periodic[k]) continue;
    q[k] += calib_span[k] * turns;
    if (!calib_allowed(k, q[k])) q[k] += q[k] > goal ? -calib_span[k] : calib_span[k];
    q[k] = calib_between(q[k], calib_least[k], calib_most[k]);
  }
}

/* Adds a new way, the nearest first, if need be for the furthest; returns whether it did. */
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
  calib_copy(CALIB_DOF, start, way);
  const int there = calib_reach(search, way, &gap), gain = there && calib_take(search, way);
  if (!search->count && gap.left < search->left) {
    search->left = gap.left;
    calib_copy(CALIB_DOF, way, search->way);
  }
  if (there ? !gain && !one : !(gap.left <= @edge@ * search->task->size)) return 0;
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
  *search = calib_begin(task, near, 1, budget, way);
  for (int k = 0; k < CALIB_DOF; ++k) {
    const calib_real u = calib_share_of(k, near[k]);
    if (!(u - u == 0) || (!calib_periodic[k] && !(u >= -1 && u <= 2))) return 0;
  }
  calib_moved(near, 0, search->from);
  calib_try(search, search->from);
  return search->count && search->away <= (spare ? @near_enough_spare@ : @near_enough@) ? 1 : 2;
}

/* The same of starts, but for those that can lead to no new or nearer way. */
static inline void calib_try_starts(calib_search *search, const calib_starts *starts) {
  int runs = 0;
  for (int n = 0; n < starts->count && runs < starts->runs; ++n) {
    const calib_real *start = starts->q + n * CALIB_DOF;
    if (search->count && n >= starts->likely) return;
    if (search->count == search->most && search->most > 1) return;
    if (!(start[0] - start[0] == 0)) continue;
    if (calib_beside(start, search->way, search->count, starts->apart)) continue;
    if (calib_beyond(search, start, @margin@)) continue;
    runs = calib_try(search, start) ? 0 : runs + 1;
  }
}

/* Puts the way that was found on the turn nearest to `near`; returns `sure`, or without a way 0 or 3. */
static inline int calib_answered(const calib_search *search, const calib_joints near, int sure) {
  if (search->count) calib_on_turn(near, search->way);
  else calib_unknown(CALIB_DOF, search->way);
  return search->count || sure == 3 ? sure : 0;
}
