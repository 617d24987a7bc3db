
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
  calib_real own[6 * CALIB_DOF], lacking[6], y[6];
  int i, k, pass, held = 0, again;
  for (i = 0; i < n * CALIB_DOF; ++i) own[i] = J[i];
  for (pass = 0; pass < 3; ++pass) {
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
      if (!((u <= 0 && move[k] < 0) || (u >= 1 && move[k] > 0))) continue;
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

/* Joints from a start (in q) to a task by damped Newton steps; with more joints than residuals
 * those nearest to `near`.  Returns whether they are there; `left` is what is left.  A start that
 * leads to one of `count` known ways is given up where a step ends beside it. */
static inline int calib_reach(const calib_task *task, const calib_real near[CALIB_DOF],
                              const calib_real *known, int count, int steps,
                              calib_real q[CALIB_DOF], calib_real *left) {
  const int n = calib_rows(task);
  const calib_real size = calib_size(task), close = @close@ * size;
  calib_real r[2][6], J[2][6 * CALIB_DOF], wish[CALIB_DOF], move[CALIB_DOF], trial[CALIB_DOF];
  calib_real damping = @calm@, now, longest;
  int k, step, here = 0, pulled = CALIB_DOF > n, most = pulled ? 2 * steps : steps;
  calib_clipped(q);
  *left = calib_left(task, q, r[0], J[0]);
  for (step = 0; step < most && (pulled || *left > @enough@ * size); ++step) {
    if (step == steps) pulled = 0; /* anywhere on the target, then */
    if (pulled) calib_apart(near, q, wish);
    if (!calib_move(n, J[here], r[here], q, pulled ? wish : 0, damping, move)) return 0;
    for (longest = 0, k = 0; k < CALIB_DOF; ++k)
      if (fabs(move[k]) > longest) longest = fabs(move[k]);
    for (k = 0; k < CALIB_DOF; ++k)
      trial[k] = q[k] + calib_span[k] * move[k] * (longest > @longest@ ? @longest@ / longest : 1);
    calib_clipped(trial);
    if (!pulled && calib_beside(trial, known, count, @margin@ / 4)) return 0;
    now = calib_left(task, trial, r[1 - here], J[1 - here]);
    if (pulled && longest < @pulled@ && now <= *left) pulled = 0;
    if (now < *left || (pulled && now <= close)) {
      const int stalled = !(now < *left * (1 - (calib_real)1e-9)) && !pulled;
      for (k = 0; k < CALIB_DOF; ++k) q[k] = trial[k];
      *left = now;
      here = 1 - here;
      damping = damping > 30 * @calm@ ? damping / 30 : @calm@;
      if (stalled) break;
    } else {
      if (*left <= close && (!pulled || damping > 1)) break;
      damping = damping * 30 > (calib_real)1e-6 ? damping * 30 : (calib_real)1e-6;
      if (!(damping < 1000) && !pulled) break;
      if (!(damping < 1000)) pulled = 0, damping = @calm@;
    }
  }
  return *left <= close;
}

/* Where the joints may stand on the other side of a nearby fold: as far beyond it as q is before
 * it, along the motion that hardly moves the tip.  0 where no fold is near. */
static inline int calib_twin(const calib_task *task, const calib_real q[CALIB_DOF],
                             calib_real out[CALIB_DOF]) {
  const int n = calib_rows(task);
  const calib_real probe = (calib_real)1e-4;
  calib_real r[6], J[6 * CALIB_DOF], y[6], v[CALIB_DOF], size = 0, first = 0, second = 0;
  calib_real share = 0, power = 0;
  int i, k, step;
  calib_left(task, q, r, J);
  for (i = 0; i < n; ++i) y[i] = (calib_real)(1 + i) / n;
  for (i = 0; i < n * CALIB_DOF; ++i) power += J[i] * J[i];
  for (step = 0; step < 4; ++step) { /* inverse iteration */
    if (!calib_forces(n, J, y, @calm@, r)) return 0;
    for (size = 0, i = 0; i < n; ++i) size += r[i] * r[i];
    if (!(size > 0)) return 0;
    for (i = 0; i < n; ++i) y[i] = r[i] / sqrt(size);
  }
  for (k = 0; k < CALIB_DOF; ++k) {
    for (v[k] = 0, i = 0; i < n; ++i) v[k] += J[i * CALIB_DOF + k] * y[i];
    share += v[k] * v[k];
  }
  if (!(share > 0) || share > @folded@ * power) return 0;
  share = sqrt(share);
  for (k = 0; k < CALIB_DOF; ++k) v[k] /= share;
  for (step = -1; step <= 1; step += 2) {
    calib_real sum = 0;
    for (k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + step * probe * calib_span[k] * v[k];
    calib_left(task, out, r, J);
    for (i = 0; i < n; ++i)
      for (k = 0; k < CALIB_DOF; ++k) sum += y[i] * J[i * CALIB_DOF + k] * v[k];
    if (step < 0) first = sum;
    else second = sum;
  }
  size = (second - first) / (2 * probe);
  if (!(fabs(size) > 0)) return 0;
  size = -2 * share / size;
  if (!(fabs(size) < @beyond@)) return 0;
  for (k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + size * calib_span[k] * v[k];
  return 1;
}

/* Rows of the table of starts that may lead to a position: those of its cell and, after them, of
 * the cells beside; without cells those that are near to it and to joints.  Returns how many;
 * those from `likely` on, all over the table, are for what the first lead to nowhere. */
static inline int calib_starting(const calib_real x[CALIB_OUT], const calib_real near[CALIB_DOF],
                                 int row[CALIB_TRIES], int *likely) {
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
        row[found++] = i;
    }
  *likely = found;
  for (i = 0; i < CALIB_STARTS && found < CALIB_TRIES; i += 1 + CALIB_STARTS / CALIB_TRIES)
    row[found++] = i;
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
    row[k] = n;
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

/* Joints nearest to `near` that do a task; x is the position by which starts are chosen.  1 where
 * no other way is nearer, 2 where one might be, 0 where none was found: then `nearest` comes
 * closest of what was tried, and `left` is left (NaN where `near` is no joints). */
static inline int calib_search(const calib_task *task, const calib_real x[CALIB_OUT],
                               const calib_real near[CALIB_DOF], calib_real q[CALIB_DOF],
                               calib_real nearest[CALIB_DOF], calib_real *left) {
  const int spare = CALIB_DOF > calib_rows(task);
  const int sure = task->kind == CALIB_POSITION && !spare;
  calib_real from[CALIB_DOF], trial[CALIB_DOF], away, best = 0, now;
  int row[CALIB_TRIES], i, k, count = CALIB_TRIES, likely = CALIB_TRIES, found = 0;
  *left = calib_not_a_number();
  for (k = 0; k < CALIB_DOF; ++k) q[k] = calib_not_a_number();
  for (k = 0; k < CALIB_DOF; ++k) {
    const calib_real u = (near[k] - calib_lower[k]) / calib_span[k];
    if (!(u - u == 0) || (!calib_periodic[k] && !(u >= -1 && u <= 2))) return 0; /* no joints */
    from[k] = trial[k] = near[k];
  }
  calib_clipped(from);
  for (i = -1; i < count; ++i) { /* from `near`, then from the table */
    if (i == 0 && !(count = calib_starting(x, from, row, &likely))) break;
    if (i >= likely && (found || !sure)) break;
    if (i >= 0) {
      const calib_real *start = calib_start_q[row[i]];
      away = calib_apart(start, from, 0);
      if (found && (away > best + @margin@ || calib_apart(start, q, 0) < @margin@ / 2)) continue;
      for (k = 0; k < CALIB_DOF; ++k) trial[k] = start[k];
    }
    if (!calib_reach(task, from, q, found, CALIB_STEPS, trial, &now)) {
      if (found || *left <= now) continue;
      *left = now;
      for (k = 0; k < CALIB_DOF; ++k) nearest[k] = trial[k];
      continue;
    }
    away = calib_apart(trial, from, 0);
    if (found && !(away < best)) continue;
    found = 1;
    best = away;
    for (k = 0; k < CALIB_DOF; ++k) q[k] = trial[k];
    if (i >= 0) continue;
    if (!spare && best > @beside@ && calib_twin(task, q, trial) &&
        calib_reach(task, from, 0, 0, CALIB_STEPS, trial, &now) && (away = calib_apart(trial, from, 0)) < best) {
      best = away;
      for (k = 0; k < CALIB_DOF; ++k) q[k] = trial[k];
    }
    if (best <= (sure ? @beside@ : @surely@)) break;
  }
  if (!found) return 0;
  calib_on_turn(near, q);
  return sure || best <= @surely@ ? 1 : 2;
}

/* Adds what a start leads to, and what lies across a fold beside it, to `count` ways to do a task,
 * unless it is one of them; returns how many there are. */
static inline int calib_add_way(const calib_task *task, const calib_real start[CALIB_DOF],
                                int steps, int most, calib_real q[][CALIB_DOF], int count) {
  calib_real trial[CALIB_DOF], left;
  int k, first = count, fold;
  for (k = 0; k < CALIB_DOF; ++k) trial[k] = start[k];
  for (fold = 0; fold < 2 && count < most; ++fold) {
    if (fold && (count == first || CALIB_DOF > calib_rows(task) ||
                 !calib_twin(task, q[first], trial)))
      break;
    if (!calib_reach(task, start, q[0], fold ? 0 : count, steps, trial, &left)) break;
    if (calib_beside(trial, q[0], count, @same@)) break;
    for (k = 0; k < CALIB_DOF; ++k) q[count][k] = trial[k];
    ++count;
  }
  return count;
}

/* All ways to a position that the table of starts leads to, at most `most`; returns how many. */
static inline int calib_inverse_all(const calib_real x[CALIB_OUT], int most,
                                    calib_real q[][CALIB_DOF]) {
  calib_task task;
  int row[CALIB_TRIES], i, count, likely, found = 0;
  task.kind = CALIB_POSITION;
  for (i = 0; i < CALIB_OUT; ++i) task.x[i] = x[i];
  count = calib_starting(x, calib_start_q[0], row, &likely);
  for (i = 0; i < (found ? likely : count) && found < most; ++i)
    if (!calib_beside(calib_start_q[row[i]], q[0], found, @margin@))
      found = calib_add_way(&task, calib_start_q[row[i]], CALIB_STEPS, most, q, found);
  return found;
}

/* Joints that bring the tip to a position: of several ways the one nearest to `near`, in shares of
 * the joints' ranges.  1, or 2 where another way might be nearer; 0 where none was found. */
static inline int calib_inverse(const calib_real x[CALIB_OUT], const calib_real near[CALIB_DOF],
                                calib_real q[CALIB_DOF]) {
  calib_task task;
  calib_real nearest[CALIB_DOF], left;
  int i;
  task.kind = CALIB_POSITION;
  for (i = 0; i < CALIB_OUT; ++i) task.x[i] = x[i];
  return calib_search(&task, x, near, q, nearest, &left);
}
/* As calib_inverse, and 3 where nothing reaches the position. */
static inline int calib_answer(const calib_real x[CALIB_OUT], const calib_real near[CALIB_DOF],
                               calib_real q[CALIB_DOF]) {
  calib_task task;
  calib_real best[CALIB_DOF], left, bound, most = @sure@ * @extent@;
  int i, found;
  task.kind = CALIB_POSITION;
  for (i = 0; i < CALIB_OUT; ++i) task.x[i] = x[i];
  found = calib_search(&task, x, near, q, best, &left);
  if (found || !(left - left == 0)) return found;
  /* within the expected error it may still count as reached */
  if (calib_expected_error(best, &bound) && bound < most) most = bound;
  return left > 2 * most ? 3 : 0;
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
  calib_real nearest[CALIB_DOF], left;
  calib_pose_task(x, R, -1, &task);
  return calib_search(&task, x, near, q, nearest, &left);
}
#endif

/* One damped Newton step of the joints towards a position; returns the distance before it. */
static inline calib_real calib_newton_step(const calib_real target[CALIB_OUT], calib_real damping,
                                           calib_real q[CALIB_DOF]) {
  calib_task task;
  calib_real r[6], J[6 * CALIB_DOF], move[CALIB_DOF], left;
  int i;
  task.kind = CALIB_POSITION;
  for (i = 0; i < CALIB_OUT; ++i) task.x[i] = target[i];
  left = calib_left(&task, q, r, J);
  if (!calib_move(CALIB_OUT, J, r, q, 0, damping, move)) return calib_not_a_number();
  for (i = 0; i < CALIB_DOF; ++i) q[i] += calib_span[i] * move[i];
  return left;
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
