/* (J J' + damping trace) y = r for n residuals, by elimination in the upper half of the matrix. */
static inline int calib_forces(int n, const calib_real *J, const calib_real *r, calib_real damping,
                               calib_real y[6]) {
  calib_real a[6][6], inverse[6], trace = 0;
  for (int i = 0; i < n; ++i) {
    for (int j = i; j < n; ++j)
      a[i][j] = calib_dot(CALIB_DOF, J + i * CALIB_DOF, J + j * CALIB_DOF);
    trace += a[i][i];
    y[i] = r[i];
  }
  for (int i = 0; i < n; ++i) {
    a[i][i] += damping * trace;
    if (!(a[i][i] > 0)) return 0;
    inverse[i] = 1 / a[i][i];
    for (int j = i + 1; j < n; ++j) {
      const calib_real share = a[i][j] * inverse[i];
      for (int k = j; k < n; ++k) a[j][k] -= share * a[i][k];
      y[j] -= share * y[i];
    }
  }
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) y[i] -= a[i][k] * y[k];
    y[i] *= inverse[i];
  }
  return 1;
}

/* Of all moves, in shares of the joints' ranges, that close a gap of n residuals the one that ends
 * nearest to a wish; joints that are so close to a limit and would move towards it stay. */
static inline int calib_move(int n, const calib_gap *gap, const calib_joints q, calib_real slack,
                             const calib_real *wish, calib_real damping, calib_joints move) {
  calib_real own[6 * CALIB_DOF], ahead[CALIB_DOF] = {0}, lacking[6], y[6];
  int k, again = 1;
  calib_copy(n * CALIB_DOF, gap->J, own);
  if (wish) calib_copy(CALIB_DOF, wish, ahead);
  for (int pass = 0; again && pass < CALIB_DOF; ++pass) {
    for (int i = 0; i < n; ++i)
      lacking[i] = gap->r[i] - calib_dot(CALIB_DOF, own + i * CALIB_DOF, ahead);
    if (!calib_forces(n, own, lacking, damping, y)) return 0;
    for (again = 0, k = 0; k < CALIB_DOF; ++k) {
      /* joint values: a share of the range at its upper end may round to less than 1 */
      const calib_real below = q[k] - calib_lower[k], above = calib_lower[k] + calib_span[k] - q[k];
      move[k] = ahead[k];
      for (int i = 0; i < n; ++i) move[k] += own[i * CALIB_DOF + k] * y[i];
      if (calib_periodic[k] || move[k] == 0) continue;
      if ((move[k] < 0 ? below : above) > slack * calib_span[k]) continue;
      again = 1;
      ahead[k] = 0;
      for (int i = 0; i < n; ++i) own[i * CALIB_DOF + k] = 0;
    }
  }
  return 1;
}

/* Whether joints lie closer than that to one of some ways. */
static inline int calib_beside(const calib_joints q, const calib_real *ways, int count,
                               calib_real share) {
  for (int j = 0; j < count; ++j)
    if (calib_apart(q, ways + j * CALIB_DOF) < share) return 1;
  return 0;
}

/* Joints a move on (0: none), but none further than a step may, and within their limits; those of
 * full turns go round.  Returns whether no limit holds any. */
static inline int calib_moved(const calib_joints q, const calib_real *move, calib_joints out) {
  calib_real largest = @longest@;
  int inside = 1;
  for (int k = 0; move && k < CALIB_DOF; ++k)
    if (fabs(move[k]) > largest) largest = fabs(move[k]);
  for (int k = 0; k < CALIB_DOF; ++k) {
    const calib_real least = calib_lower[k], most = least + calib_span[k];
    const calib_real value = q[k] + (move ? calib_span[k] * move[k] * @longest@ / largest : 0);
    if (!calib_periodic[k] && !(value > least && value < most)) inside = 0;
    out[k] = calib_between(calib_wrapped(k, value), least, most);
  }
  return inside;
}

/* A search: from where, and the ways so far that do the task; with room for one the nearest stays. */
typedef struct {
  calib_task *task;
  calib_real from[CALIB_DOF]; /* joints that answers should be near to */
  calib_real *way;            /* joints of the ways, the nearest first; else what comes closest, */
  calib_real left;            /* and what that misses */
  int count, most;            /* ways, and how many have room */
  int budget;                 /* steps that are left */
  calib_real away;            /* from `from` to the furthest way */
} calib_search;

/* Whether one way alone is asked for, and joints are this much further than the one so far. */
static inline int calib_beyond(const calib_search *search, const calib_joints q, calib_real more) {
  return search->most == 1 && search->count && calib_apart(q, search->from) > search->away + more;
}

/* Joints by damped Newton steps until so little of their task is left, or no step leads on; the gap is
 * theirs.  0 where they are given up: what leads to one of `count` ways. */
static inline int calib_steps(calib_search *search, int count, calib_real enough, calib_joints q,
                              calib_gap *gap) {
  const calib_task *task = search->task;
  const calib_real close = @close@ * task->size;
  calib_real move[CALIB_DOF], trial[CALIB_DOF], damping = @calm@;
  calib_gap next;
  int last = 0;
  for (int step = 0; step < CALIB_STEPS && search->budget > 0 && gap->left > enough; ++step) {
    search->budget -= task->straight ? 1 : @step_cost@;
    if (!calib_move(task->rows, gap, q, 0, 0, damping, move)) return 0;
    const int inside = calib_moved(q, move, trial);
    if (last && inside) { /* what this step leaves is known to be less */
      calib_copy(CALIB_DOF, trial, q);
      gap->left = 0;
      return 1;
    }
    if (calib_beside(trial, search->way, count, @margin@ / 4)) return 0;
    calib_left(task, trial, &next);
    const int better = next.left < gap->left, slow = !(next.left < gap->left * (1 - @slow@));
    if (better ? slow : gap->left <= close || !(damping < @hardest@)) step = CALIB_STEPS;
    damping = better ? damping / @easier@ : damping * @easier@;
    damping = calib_between(damping, better ? @calm@ : @hard@, @hardest@ * @easier@);
    last = better && inside && damping <= @calm@ &&
           next.left <= @surplus@ * gap->left && /* at a fold a step leaves a quarter */
           next.left * next.left <= @surplus@ * close * gap->left;
    if (!better) continue;
    calib_copy(CALIB_DOF, trial, q);
    *gap = next;
  }
  return 1;
}

/* Redundant joints close to their task, along their self-motion towards those that are asked for.
 * How much the way bends away from these, or to them, is seen by what brings joints back onto it
 * after a slide, and sets the share of the next.  0 where they are given up, as of calib_steps. */
static inline int calib_slides(calib_search *search, int count, calib_joints q, calib_gap *gap) {
  const calib_task *task = search->task;
  const calib_real rough = @rough@ * task->size, close = @close@ * task->size;
  calib_real wish[CALIB_DOF], move[CALIB_DOF], trial[CALIB_DOF], share = 1, slid = 0;
  calib_gap next;
  for (int n = 0; n < CALIB_SLIDES && search->budget > 0 && share >= @stuck@; ++n) {
    const int there = gap->left <= close;
    const calib_real settled = task->straight ? 100 * @settled@ : there ? @settled@ : -1;
    const calib_real away = calib_way(search->from, q, wish);
    calib_real part = 1;
    search->budget -= task->straight ? 1 : @step_cost@;
    for (int k = 0; k < CALIB_DOF; ++k) wish[k] *= share;
    if (!calib_move(task->rows, gap, q, there ? @slack@ : 0, wish, @calm@, move)) return 1;
    const calib_real size = calib_dot(CALIB_DOF, move, move);
    const calib_real back = (calib_dot(CALIB_DOF, wish, move) - size) / share;
    if (sqrt(size) <= settled * share) return 1;
    for (int k = 0; k < CALIB_DOF; ++k) { /* no joint beyond its limit */
      const calib_real u = calib_share_of(k, q[k]), room = move[k] > 0 ? 1 - u : u;
      if (!calib_periodic[k] && room > @slack@ && fabs(part * move[k]) > room)
        part = room / fabs(move[k]);
    }
    for (int k = 0; k < CALIB_DOF; ++k) move[k] *= part;
    calib_moved(q, move, trial);
    if (calib_beside(trial, search->way, count, @margin@ / 4)) return 0;
    calib_left(task, trial, &next);
    if (!(next.left <= rough) || (there && calib_apart(trial, search->from) >= away)) {
      share /= 4;
      continue;
    }
    const calib_real bend = slid * slid - 2 * back;
    if (slid > 0) share = bend > 0 ? slid * slid / bend : 3;
    share = calib_between(share, (calib_real)0.1, 3);
    slid = calib_apart(trial, q);
    calib_copy(CALIB_DOF, trial, q);
    *gap = next;
  }
  return 1;
}

/* Joints from a start (in q) to a task; redundant ones slide once they are close.  Returns whether they
 * are there; the gap is theirs.  What leads to one of `count` ways is given up. */
static inline int calib_descend(calib_search *search, int count, calib_joints q, calib_gap *gap) {
  const calib_task *task = search->task;
  const calib_real rough = @rough@ * task->size, close = @close@ * task->size;
  const calib_real enough = task->straight ? rough : @enough@ * task->size;
  const int spare = CALIB_DOF > task->rows;
  calib_moved(q, 0, q);
  calib_left(task, q, gap);
  if (!calib_steps(search, count, spare ? rough : enough, q, gap)) return 0;
  if (spare && gap->left <= rough)
    if (!(calib_slides(search, count, q, gap) && calib_steps(search, count, enough, q, gap)))
      return 0;
  return gap->left <= (task->straight ? 10 * rough : close); /* what misses by far does so bent */
}

/* The same, first roughly by the arm without what bends it; a way further than the nearest is given up. */
static inline int calib_reach(calib_search *search, calib_joints q, calib_gap *gap) {
  if (@step_cost@ > 1) {
    search->task->straight = 1;
    const int there = calib_descend(search, search->count, q, gap);
    search->task->straight = 0;
    if (!there || calib_beyond(search, q, @margin@ / 4)) return 0;
  }
  return calib_descend(search, search->count, q, gap);
}

/* Joints as far beyond a nearby fold as q is before it, along the motion v that hardly moves the tip; 0
 * where no fold is near. */
static inline int calib_twin(const calib_task *task, const calib_joints q, const calib_gap *here,
                             calib_joints out) {
  const int n = task->rows;
  calib_real y[6], v[CALIB_DOF] = {0}, rate = 0;
  calib_gap gap;
  for (int i = 0; i < n; ++i) y[i] = (calib_real)(1 + i);
  for (int k = 0; k < 4; ++k) { /* residuals that joints hardly reach, by inverse iteration */
    if (!calib_forces(n, here->J, y, @calm@, y)) return 0;
    const calib_real size = calib_length(n, y);
    for (int i = 0; i < n; ++i) y[i] /= size;
  }
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < CALIB_DOF; ++k) v[k] += here->J[i * CALIB_DOF + k] * y[i];
  const calib_real least = calib_length(CALIB_DOF, v); /* singular value */
  const calib_real all = calib_length(n * CALIB_DOF, here->J);
  if (!(least * least <= @fold@ * all * all)) return 0;
  for (int k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + @probe@ * calib_span[k] * v[k] / least;
  calib_left(task, out, &gap);
  for (int i = 0; i < n; ++i) rate += y[i] * calib_dot(CALIB_DOF, gap.J + i * CALIB_DOF, v) / least;
  const calib_real reach = -2 * least * @probe@ / (rate - least);
  if (!(fabs(reach) < @twin_reach@)) return 0;
  for (int k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + reach * calib_span[k] * v[k] / least;
  return 1;
}
