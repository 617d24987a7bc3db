
/* (J J' + damping trace) y = r for n residuals, by elimination in the upper half of the matrix. */
static inline int calib_forces(int n, const calib_real *J, const calib_real *r, calib_real damping,
                               calib_real y[6]) {
  calib_real a[6][6], inverse[6], trace = 0;
  int i, j, k;
  for (i = 0; i < n; ++i) {
    for (j = i; j < n; ++j) a[i][j] = calib_dot(CALIB_DOF, J + i * CALIB_DOF, J + j * CALIB_DOF);
    trace += a[i][i];
    y[i] = r[i];
  }
  for (i = 0; i < n; ++i) {
    a[i][i] += damping * trace;
    if (!(a[i][i] > 0)) return 0;
    inverse[i] = 1 / a[i][i];
    for (j = i + 1; j < n; ++j) {
      const calib_real share = a[i][j] * inverse[i];
      for (k = j; k < n; ++k) a[j][k] -= share * a[i][k];
      y[j] -= share * y[i];
    }
  }
  for (i = n - 1; i >= 0; --i) {
    for (k = i + 1; k < n; ++k) y[i] -= a[i][k] * y[k];
    y[i] *= inverse[i];
  }
  return 1;
}

/* Joints within their limits; those of full turns go round.  Returns whether no limit holds any. */
static inline int calib_clipped(calib_joints q) {
  int k, inside = 1;
  for (k = 0; k < CALIB_DOF; ++k) {
    const calib_real least = calib_lower[k], most = least + calib_span[k];
    if (!calib_periodic[k] && !(q[k] > least && q[k] < most)) inside = 0;
    q[k] = calib_between(calib_wrapped(k, q[k]), least, most);
  }
  return inside;
}

/* Of all moves, in shares of the joints' ranges, that bring residuals to zero the one that ends nearest
 * to a wish; joints that a limit holds stay. */
static inline int calib_move(int n, const calib_real *J, const calib_real *r, const calib_joints q,
                             const calib_real *wish, calib_real damping, calib_joints move) {
  calib_real own[6 * CALIB_DOF], ahead[CALIB_DOF] = {0}, lacking[6], y[6];
  int i, k, pass, again = 1;
  calib_copy(n * CALIB_DOF, J, own);
  if (wish) calib_copy(CALIB_DOF, wish, ahead);
  for (pass = 0; again && pass < CALIB_DOF; ++pass) {
    for (i = 0; i < n; ++i) lacking[i] = r[i] - calib_dot(CALIB_DOF, own + i * CALIB_DOF, ahead);
    if (!calib_forces(n, own, lacking, damping, y)) return 0;
    for (again = 0, k = 0; k < CALIB_DOF; ++k) {
      /* joint values: a share of the range at its upper end may round to less than 1 */
      const calib_real below = q[k] - calib_lower[k], above = calib_lower[k] + calib_span[k] - q[k];
      move[k] = ahead[k];
      for (i = 0; i < n; ++i) move[k] += own[i * CALIB_DOF + k] * y[i];
      if (calib_periodic[k] || move[k] == 0) continue;
      if ((move[k] < 0 ? below : above) > (wish ? @slack@ * calib_span[k] : 0)) continue;
      again = 1;
      ahead[k] = 0;
      for (i = 0; i < n; ++i) own[i * CALIB_DOF + k] = 0;
    }
  }
  return 1;
}

/* Whether joints lie so close to one of some ways that they hardly lead to another. */
static inline int calib_beside(const calib_joints q, const calib_real *ways, int count,
                               calib_real share) {
  int j;
  for (j = 0; j < count; ++j)
    if (calib_apart(q, ways + j * CALIB_DOF) < share) return 1;
  return 0;
}

/* Joints a move on, none further than a step may, within their limits; whether no limit holds any. */
static inline int calib_moved(const calib_joints q, const calib_joints move, calib_joints out) {
  calib_real largest = @longest@;
  int k;
  for (k = 0; k < CALIB_DOF; ++k)
    if (fabs(move[k]) > largest) largest = fabs(move[k]);
  for (k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + calib_span[k] * move[k] * @longest@ / largest;
  return calib_clipped(out);
}

/* A search: from where, and the ways so far that do the task; with room for one the nearest stays. */
typedef struct {
  const calib_task *task;
  calib_real from[CALIB_DOF]; /* joints that answers should be near to */
  calib_real *way;            /* joints of the ways, the nearest first */
  int count, most;            /* ways, and how many have room */
  int budget;                 /* steps that are left */
  calib_real away;            /* from `from` to the furthest way */
  calib_real nearest[CALIB_DOF], left; /* what comes closest where there is none */
} calib_search;

/* Slides of redundant joints along their self-motion towards the joints that are asked for. */
typedef struct {
  int count, moved;                           /* slides so far; whether the last one was taken */
  calib_real share, pull[CALIB_DOF];          /* of the pull that a slide goes */
  calib_real before[CALIB_DOF], slid[CALIB_DOF]; /* the pull of the last slide, and its way */
} calib_slides;

/* Adds the next slide to a move; 0 where joints have settled.  Its share of the pull, which leaves the
 * task as it is, follows from how the last slide turned that (Barzilai and Borwein 1988). */
static inline int calib_slide(const calib_search *search, const calib_joints q,
                              const calib_gap *gap, calib_real settled, calib_slides *slides,
                              calib_joints move) {
  const calib_real none[6] = {0, 0, 0, 0, 0, 0}, slid = calib_length(CALIB_DOF, slides->slid);
  calib_real wish[CALIB_DOF], along = 0, part = 1;
  int k;
  calib_way(search->from, q, wish);
  if (!calib_move(search->task->rows, gap->J, none, q, wish, @calm@, slides->pull)) return 0;
  for (k = 0; k < CALIB_DOF; ++k)
    along += slides->slid[k] * (slides->before[k] - slides->pull[k]);
  if (slides->moved)
    slides->share = calib_between(along > 0 ? slid * slid / along : (calib_real)1.5, (calib_real)0.1, 3);
  if (calib_length(CALIB_DOF, slides->pull) <= settled) return 0;
  if (slides->share < @stuck@ || ++slides->count > CALIB_SLIDES) return 0;
  for (k = 0; k < CALIB_DOF; ++k) { /* no joint beyond its limit */
    const calib_real u = calib_share_of(k, q[k]);
    calib_real room;
    move[k] += slides->share * slides->pull[k];
    room = move[k] > 0 ? 1 - u : u;
    if (!calib_periodic[k] && room > @slack@ && fabs(part * move[k]) > room)
      part = room / fabs(move[k]);
  }
  for (k = 0; k < CALIB_DOF; ++k) move[k] *= part;
  return 1;
}

/* Joints from a start (in q) to a task by damped Newton steps.  More joints than residuals slide once
 * they are close.  Returns whether they are there; the gap is theirs.  What leads to one of `count`
 * ways is given up. */
static inline int calib_descend(calib_search *search, int count, calib_joints q, calib_gap *gap) {
  const calib_task *task = search->task;
  const calib_real close = @close@ * task->size, rough = @rough@ * task->size;
  calib_slides slides = {0, 0, 1, {0}, {0}, {0}};
  calib_real move[CALIB_DOF], trial[CALIB_DOF], damping = @calm@;
  calib_gap next;
  int sliding = CALIB_DOF > task->rows, step = 0, last = 0;
  calib_clipped(q);
  calib_left(task, q, gap);
  while (step < CALIB_STEPS && search->budget > 0) {
    const int near = sliding && gap->left <= rough;
    int better, inside;
    search->budget -= task->straight ? 1 : @step_cost@;
    if (!near && gap->left <= (task->straight ? rough : @enough@ * task->size)) break;
    if (!calib_move(task->rows, gap->J, gap->r, q, 0, damping, move)) return 0;
    if (near) {
      const calib_real settled = task->straight ? 100 * @settled@ : gap->left <= close ? @settled@ : -1;
      sliding = calib_slide(search, q, gap, settled, &slides, move);
      if (!sliding && task->straight) break;
      if (!sliding) continue;
    }
    inside = calib_moved(q, move, trial);
    if (last && inside && !near) { /* what this step leaves is known to be less */
      calib_copy(CALIB_DOF, trial, q);
      return 1;
    }
    if (calib_beside(trial, search->way, count, @margin@ / 4)) return 0;
    calib_left(task, trial, &next);
    if (near) {
      better = next.left <= rough && (gap->left > close || calib_apart(trial, search->from) <
                                                               calib_apart(q, search->from));
      if (!better) slides.share /= 4;
      calib_way(trial, q, slides.slid);
      calib_copy(CALIB_DOF, slides.pull, slides.before);
      slides.moved = better;
    } else {
      const int slow = !(next.left < gap->left * (1 - @slow@));
      ++step;
      better = next.left < gap->left;
      if (better ? slow : gap->left <= close || !(damping < @hardest@)) step = CALIB_STEPS;
      damping = better ? damping / @easier@ : damping * @easier@;
      damping = calib_between(damping, better ? @calm@ : @hard@, @hardest@ * @easier@);
      last = better && inside && !task->straight && damping <= @calm@ &&
             next.left <= @surplus@ * gap->left && /* at a fold a step leaves a quarter */
             next.left * next.left <= @surplus@ * close * gap->left;
    }
    if (!better) continue;
    calib_copy(CALIB_DOF, trial, q);
    *gap = next;
  }
  return gap->left <= (task->straight ? 10 * rough : close); /* what misses by far does so bent */
}

/* The same, first roughly by the arm without what bends it; a way further than the nearest is given up. */
static inline int calib_reach(calib_search *search, calib_joints q, calib_gap *gap) {
  if (@step_cost@ > 1) {
    const calib_task *task = search->task;
    calib_task rough = *task;
    int there;
    rough.straight = 1;
    search->task = &rough;
    there = calib_descend(search, search->count, q, gap);
    search->task = task;
    if (!there) return 0;
    if (search->most == 1 && search->count &&
        calib_apart(q, search->from) > search->away + @margin@ / 4)
      return 0;
  }
  return calib_descend(search, search->count, q, gap);
}

/* Joints as far beyond a nearby fold as q is before it, along the motion v that hardly moves the tip; 0
 * where no fold is near. */
static inline int calib_twin(const calib_task *task, const calib_joints q, const calib_gap *here,
                             calib_joints out) {
  const int n = task->rows;
  calib_real y[6], r[6], v[CALIB_DOF], size, reach, rate = 0;
  calib_gap gap;
  int i, k, side;
  for (i = 0; i < n; ++i) y[i] = (calib_real)(1 + i) / n;
  for (k = 0; k < 4; ++k) { /* residuals that joints hardly reach, by inverse iteration */
    if (!calib_forces(n, here->J, y, @calm@, r)) return 0;
    size = calib_length(n, r);
    if (!(size > 0)) return 0;
    for (i = 0; i < n; ++i) y[i] = r[i] / size;
  }
  for (k = 0; k < CALIB_DOF; ++k)
    for (v[k] = 0, i = 0; i < n; ++i) v[k] += here->J[i * CALIB_DOF + k] * y[i];
  size = calib_length(CALIB_DOF, v);
  reach = calib_length(n * CALIB_DOF, here->J);
  if (!(size > 0) || size * size > @fold@ * reach * reach) return 0;
  for (side = -1; side <= 1; side += 2) { /* how fast that singular value changes */
    for (k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + side * @probe@ * calib_span[k] * v[k] / size;
    calib_left(task, out, &gap);
    for (i = 0; i < n; ++i)
      for (k = 0; k < CALIB_DOF; ++k)
        rate += side * y[i] * gap.J[i * CALIB_DOF + k] * v[k] / (2 * @probe@ * size);
  }
  reach = -2 * size / rate;
  if (!(fabs(reach) < @twin_reach@)) return 0;
  for (k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + reach * calib_span[k] * v[k] / size;
  return 1;
}
