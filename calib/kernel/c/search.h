
/* (J J' + damping trace) y = r by Cholesky, for n residuals. */
static inline int calib_forces(int n, const calib_real *J, const calib_real *r,
                               calib_real damping, calib_real y[6]) {
  calib_real a[6][6], trace = 0;
  int i, j, k;
  for (i = 0; i < n; ++i) {
    for (j = 0; j <= i; ++j) {
      a[i][j] = 0;
      for (k = 0; k < CALIB_DOF; ++k) a[i][j] += J[i * CALIB_DOF + k] * J[j * CALIB_DOF + k];
    }
    trace += a[i][i];
    y[i] = r[i];
  }
  for (i = 0; i < n; ++i) a[i][i] += damping * trace;
  for (i = 0; i < n; ++i) {
    for (j = 0; j <= i; ++j) {
      for (k = 0; k < j; ++k) a[i][j] -= a[i][k] * a[j][k];
      if (i == j) {
        if (!(a[i][i] > 0)) return 0;
        a[i][i] = sqrt(a[i][i]);
      } else {
        a[i][j] /= a[j][j];
      }
    }
    for (k = 0; k < i; ++k) y[i] -= a[i][k] * y[k];
    y[i] /= a[i][i];
  }
  for (i = n - 1; i >= 0; --i) {
    for (k = i + 1; k < n; ++k) y[i] -= a[k][i] * y[k];
    y[i] /= a[i][i];
  }
  return 1;
}

/* From b to a in shares of the joints' ranges, the short way round where they go round; returns
 * the length. */
static inline calib_real calib_apart(const calib_real a[CALIB_DOF], const calib_real b[CALIB_DOF],
                                     calib_real *way) {
  calib_real squared = 0;
  int k;
  for (k = 0; k < CALIB_DOF; ++k) {
    calib_real u = (a[k] - b[k]) / calib_span[k];
    if (calib_periodic[k]) u -= floor(u + (calib_real)0.5);
    if (way) way[k] = u;
    squared += u * u;
  }
  return sqrt(squared);
}

/* Joints within their limits; those of full turns go round. */
static inline void calib_clipped(calib_real q[CALIB_DOF]) {
  int k;
  for (k = 0; k < CALIB_DOF; ++k) {
    const calib_real u = (q[k] - calib_lower[k]) / calib_span[k];
    if (calib_periodic[k]) q[k] = calib_lower[k] + (u - floor(u)) * calib_span[k];
    else if (u < 0) q[k] = calib_lower[k];
    else if (u > 1) q[k] = calib_lower[k] + calib_span[k];
  }
}

/* A move of the joints, in shares of their ranges: of all that bring the residuals to zero the one
 * that ends nearest to a wish; joints that a limit holds stay. */
static inline int calib_move(int n, const calib_real *J, const calib_real *r,
                             const calib_real q[CALIB_DOF], const calib_real *wish,
                             calib_real damping, calib_real move[CALIB_DOF]) {
  const calib_real slack = wish ? @slides_slack@ : 0;
  calib_real own[6 * CALIB_DOF], lacking[6], y[6];
  int i, k, pass, held = 0, again;
  for (i = 0; i < n * CALIB_DOF; ++i) own[i] = J[i];
  for (pass = 0; pass < CALIB_DOF; ++pass) {
    for (i = 0; i < n; ++i) {
      lacking[i] = r[i];
      for (k = 0; wish && k < CALIB_DOF; ++k) lacking[i] -= own[i * CALIB_DOF + k] * wish[k];
    }
    if (!calib_forces(n, own, lacking, damping, y)) return 0;
    for (again = 0, k = 0; k < CALIB_DOF; ++k) {
      const calib_real u = (q[k] - calib_lower[k]) / calib_span[k];
      move[k] = wish && !(held >> k & 1) ? wish[k] : 0;
      for (i = 0; i < n; ++i) move[k] += own[i * CALIB_DOF + k] * y[i];
      if (calib_periodic[k] || held >> k & 1) continue;
      if (!((u <= slack && move[k] < 0) || (u >= 1 - slack && move[k] > 0))) continue;
      again = 1;
      held |= 1 << k;
      for (i = 0; i < n; ++i) own[i * CALIB_DOF + k] = 0;
    }
    if (!again) break;
  }
  return 1;
}

/* Whether joints lie so close to one of some ways that they hardly lead to another. */
static inline int calib_beside(const calib_real q[CALIB_DOF], const calib_real *ways, int count,
                               calib_real share) {
  int j;
  for (j = 0; j < count; ++j)
    if (calib_apart(q, ways + j * CALIB_DOF, 0) < share) return 1;
  return 0;
}

static inline void calib_copy(const calib_real from[CALIB_DOF], calib_real to[CALIB_DOF]) {
  int k;
  for (k = 0; k < CALIB_DOF; ++k) to[k] = from[k];
}

/* Joints a move on, of which none goes further than `longest`, within their limits. */
static inline void calib_moved(const calib_real q[CALIB_DOF], const calib_real move[CALIB_DOF],
                               calib_real longest, calib_real out[CALIB_DOF]) {
  calib_real largest = longest;
  int k;
  for (k = 0; k < CALIB_DOF; ++k)
    if (fabs(move[k]) > largest) largest = fabs(move[k]);
  for (k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + calib_span[k] * move[k] * longest / largest;
  calib_clipped(out);
}

/* Joints from a start (in q) to a task by damped Newton steps; `gap` is what they miss at the end.
 * Given up where a step ends beside one of `count` known ways: returns 0, else 1. */
static inline int calib_newton(const calib_task *task, const calib_real *known, int count,
                               int steps, calib_real enough, calib_real q[CALIB_DOF],
                               calib_gap *gap) {
  const int n = calib_rows(task);
  const calib_real size = calib_size(task);
  calib_real move[CALIB_DOF], trial[CALIB_DOF], damping = @calm@;
  calib_gap next;
  int step;
  calib_clipped(q);
  calib_left(task, q, gap);
  for (step = 0; step < steps && gap->left > enough * size; ++step) {
    if (!calib_move(n, gap->J, gap->r, q, 0, damping, move)) return 0;
    calib_moved(q, move, @longest@, trial);
    if (calib_beside(trial, known, count, @margin@ / 4)) return 0;
    calib_left(task, trial, &next);
    if (next.left < gap->left) {
      const int stalled = !(next.left < gap->left * (1 - @slow@));
      calib_copy(trial, q);
      *gap = next;
      damping = damping > @easier@ * @calm@ ? damping / @easier@ : @calm@;
      if (stalled) break;
    } else {
      if (gap->left <= @close@ * size) break;
      damping = damping * @easier@ > @hard@ ? damping * @easier@ : @hard@;
      if (!(damping < @hardest@)) break;
    }
  }
  return 1;
}

/* What of the way to `near` leaves the task as it is; returns its length. */
static inline calib_real calib_pull(const calib_task *task, const calib_real near[CALIB_DOF],
                                    const calib_real q[CALIB_DOF], const calib_gap *gap,
                                    calib_real pull[CALIB_DOF]) {
  const calib_real none[6] = {0, 0, 0, 0, 0, 0};
  calib_real wish[CALIB_DOF], squared = 0;
  int k;
  calib_apart(near, q, wish);
  if (!calib_move(calib_rows(task), gap->J, none, q, wish, @calm@, pull)) return 0;
  for (k = 0; k < CALIB_DOF; ++k) squared += pull[k] * pull[k];
  return sqrt(squared);
}

/* Redundant joints slide along their self-motion towards `near`; a slide that comes no closer is
 * undone.  The length of a slide follows from the last one (Barzilai and Borwein 1988).  Given up
 * beside one of `count` known ways: returns 0, else 1. */
static inline int calib_slide(const calib_task *task, const calib_real near[CALIB_DOF],
                              const calib_real *known, int count, calib_real q[CALIB_DOF],
                              calib_gap *gap) {
  const calib_real close = @close@ * calib_size(task);
  calib_real pull[CALIB_DOF], after[CALIB_DOF], trial[CALIB_DOF], way[CALIB_DOF], share = 1;
  calib_real length = calib_pull(task, near, q, gap, pull);
  calib_gap next;
  int n, k;
  for (n = 0; n < CALIB_SLIDES && share * length > @settled@; ++n) {
    calib_real along = 0, squared = 0, factor = share;
    if (share * length > @longest@) factor = @longest@ / length;
    for (k = 0; k < CALIB_DOF; ++k) way[k] = factor * pull[k];
    calib_moved(q, way, 1, trial);
    if (!calib_newton(task, 0, 0, CALIB_STEPS, @close@, trial, &next) || next.left > close ||
        !(calib_apart(trial, near, 0) < calib_apart(q, near, 0))) {
      share /= 4;
      continue;
    }
    length = calib_pull(task, near, trial, &next, after);
    calib_apart(trial, q, way);
    for (k = 0; k < CALIB_DOF; ++k) {
      along += way[k] * (pull[k] - after[k]);
      squared += way[k] * way[k];
    }
    share = along > 0 ? squared / along : (calib_real)1.5;
    share = share < (calib_real)0.1 ? (calib_real)0.1 : share > 3 ? 3 : share;
    calib_copy(trial, q);
    calib_copy(after, pull);
    *gap = next;
    if (calib_beside(q, known, count, @margin@ / 4)) return 0;
  }
  return 1;
}

/* Joints from a start (in q) to a task; with more joints than residuals those nearest to `near`.
 * Returns whether they are there; `left` is what is left.  A start that leads to one of `count`
 * known ways is given up. */
static inline int calib_reach(const calib_task *task, const calib_real near[CALIB_DOF],
                              const calib_real *known, int count, int steps,
                              calib_real q[CALIB_DOF], calib_real *left) {
  const int spare = CALIB_DOF > calib_rows(task);
  const calib_real close = @close@ * calib_size(task);
  calib_gap gap;
  int good = calib_newton(task, known, count, steps, spare ? @close@ : @enough@, q, &gap);
  if (good && spare && gap.left <= close) {
    good = calib_slide(task, near, known, count, q, &gap) &&
           calib_newton(task, 0, 0, steps, @enough@, q, &gap);
  }
  *left = gap.left;
  return good && gap.left <= close;
}

/* The direction y of residuals that joints hardly reach, and the motion v that hardly moves the tip;
 * returns how little it does, as a share of the joints' ranges, or 0 far from a fold. */
static inline calib_real calib_flat(int n, const calib_real *J, calib_real y[6],
                                    calib_real v[CALIB_DOF]) {
  calib_real r[6], size, squared = 0, power = 0;
  int i, k, step;
  for (i = 0; i < n; ++i) y[i] = (calib_real)(1 + i) / n;
  for (step = 0; step < 4; ++step) { /* inverse iteration */
    if (!calib_forces(n, J, y, @calm@, r)) return 0;
    for (size = 0, i = 0; i < n; ++i) size += r[i] * r[i];
    if (!(size > 0)) return 0;
    for (i = 0; i < n; ++i) y[i] = r[i] / sqrt(size);
  }
  for (k = 0; k < CALIB_DOF; ++k) {
    for (v[k] = 0, i = 0; i < n; ++i) v[k] += J[i * CALIB_DOF + k] * y[i];
    squared += v[k] * v[k];
  }
  for (i = 0; i < n * CALIB_DOF; ++i) power += J[i] * J[i];
  if (!(squared > 0) || squared > @folded@ * power) return 0;
  for (k = 0; k < CALIB_DOF; ++k) v[k] /= sqrt(squared);
  return sqrt(squared);
}

/* Where the joints may stand on the other side of a nearby fold: as far beyond it as q is before
 * it, along the motion that hardly moves the tip.  0 where no fold is near. */
static inline int calib_twin(const calib_task *task, const calib_real q[CALIB_DOF],
                             calib_real out[CALIB_DOF]) {
  const int n = calib_rows(task);
  calib_real y[6], v[CALIB_DOF], size, reach, rate = 0;
  calib_gap gap;
  int i, k, side;
  calib_left(task, q, &gap);
  size = calib_flat(n, gap.J, y, v);
  if (!(size > 0)) return 0;
  for (side = -1; side <= 1; side += 2) { /* how fast that singular value changes */
    for (k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + side * @probe@ * calib_span[k] * v[k];
    calib_left(task, out, &gap);
    for (i = 0; i < n; ++i)
      for (k = 0; k < CALIB_DOF; ++k)
        rate += side * y[i] * gap.J[i * CALIB_DOF + k] * v[k] / (2 * @probe@);
  }
  if (!(fabs(rate) > 0)) return 0;
  reach = -2 * size / rate;
  if (!(fabs(reach) < @beyond@)) return 0;
  for (k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + reach * calib_span[k] * v[k];
  return 1;
}

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
