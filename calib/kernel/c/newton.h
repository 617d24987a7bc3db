
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
