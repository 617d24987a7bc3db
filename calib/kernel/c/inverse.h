
/* What joints are asked for: a position of the sensor (kind 0), a place of the arm's root frame
 * (kind 1), a pose of the arm's root frame (kind 2). */
typedef struct {
  int kind;
  calib_real x[3], R[9];
} calib_task;

static inline int calib_rows(const calib_task *task) {
  return task->kind == 0 ? CALIB_OUT : 3 * task->kind;
}

/* Residuals of a task and their derivative by the joints in shares of their ranges; returns the
 * residuals' length.  A radian of turn counts as the arm's length. */
static inline calib_real calib_left(const calib_task *task, const calib_real q[CALIB_DOF],
                                    calib_real r[6], calib_real J[6 * CALIB_DOF]) {
  const int rows = calib_rows(task);
  calib_real squared = 0;
  int i, k;
  if (task->kind == 0) {
    calib_model(q, r, J);
    for (i = 0; i < CALIB_OUT; ++i) r[i] = task->x[i] - r[i];
  } else {
    calib_real p[3], R[9];
    calib_chain(&calib_body, q, p, R, J, 0);
    for (i = 0; i < 3; ++i) r[i] = task->x[i] - p[i];
    if (task->kind == 2) {
      calib_real turn[3] = {0, 0, 0}, sine, cosine = -1, angle;
      for (i = 0; i < 3; ++i) { /* half the sum of the cross products of columns */
        const calib_real a[3] = {R[i], R[3 + i], R[6 + i]};
        const calib_real b[3] = {task->R[i], task->R[3 + i], task->R[6 + i]};
        calib_real across[3];
        calib_cross(a, b, across);
        for (k = 0; k < 3; ++k) turn[k] += across[k] / 2;
        cosine += calib_dot(a, b);
      }
      sine = sqrt(calib_dot(turn, turn));
      angle = atan2(sine, cosine / 2);
      for (k = 0; k < 3; ++k) r[3 + k] = @lever@ * (sine > 0 ? turn[k] * angle / sine : 0);
      if (!(sine > 0) && cosine < 0) r[3] = @lever@ * angle; /* half a turn: any axis will do */
      for (i = 3 * CALIB_DOF; i < 6 * CALIB_DOF; ++i) J[i] *= @lever@;
    }
  }
  for (i = 0; i < rows; ++i) {
    squared += r[i] * r[i];
    for (k = 0; k < CALIB_DOF; ++k) J[i * CALIB_DOF + k] *= calib_span[k];
  }
  return sqrt(squared);
}

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

/* Joints from a start (in q) to a task by damped Newton steps; with more joints than residuals
 * those nearest to `near`.  Returns whether they are there; `left` is what is left.  A start that
 * leads to what is `known` (or 0) is given up where a step ends beside it. */
static inline int calib_reach(const calib_task *task, const calib_real near[CALIB_DOF],
                              const calib_real *known, calib_real q[CALIB_DOF],
                              calib_real *left) {
  const int n = calib_rows(task);
  const calib_real size = task->kind == 0 ? @extent@ : @lever@, close = @close@ * size;
  calib_real r[2][6], J[2][6 * CALIB_DOF], wish[CALIB_DOF], move[CALIB_DOF], trial[CALIB_DOF];
  calib_real damping = @calm@, now, longest;
  int k, step, here = 0, pulled = CALIB_DOF > n, most = pulled ? CALIB_STEPS : CALIB_STEPS / 2;
  calib_clipped(q);
  *left = calib_left(task, q, r[0], J[0]);
  for (step = 0; step < most && (pulled || *left > @enough@ * size); ++step) {
    if (step == CALIB_STEPS / 2) pulled = 0; /* anywhere on the target, then */
    if (pulled) calib_apart(near, q, wish);
    if (!calib_move(n, J[here], r[here], q, pulled ? wish : 0, damping, move)) return 0;
    for (longest = 0, k = 0; k < CALIB_DOF; ++k)
      if (fabs(move[k]) > longest) longest = fabs(move[k]);
    for (k = 0; k < CALIB_DOF; ++k)
      trial[k] = q[k] + calib_span[k] * move[k] * (longest > @longest@ ? @longest@ / longest : 1);
    calib_clipped(trial);
    if (known && !pulled && calib_apart(trial, known, 0) < @margin@ / 4) return 0;
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

/* Rows of the table of starts whose positions are nearest to x; how many. */
static inline int calib_starting(const calib_real x[CALIB_OUT], int row[CALIB_TRIES]) {
  calib_real far[CALIB_TRIES];
  int found = 0, i, k, n;
  for (n = 0; n < CALIB_STARTS; ++n) {
    calib_real d = 0;
    for (i = 0; i < CALIB_OUT; ++i) {
      const calib_real gap = x[i] - calib_start_x[n][i];
      d += gap * gap;
    }
    if (found == CALIB_TRIES && !(d < far[CALIB_TRIES - 1])) continue;
    k = found < CALIB_TRIES ? found++ : CALIB_TRIES - 1;
    for (; k > 0 && far[k - 1] > d; --k) {
      far[k] = far[k - 1];
      row[k] = row[k - 1];
    }
    far[k] = d;
    row[k] = n;
  }
  return found;
}

/* Joints nearest to `near` that do a task; x is the position by which starts are chosen.  1 where
 * no other way is nearer, 2 where one might be, 0 where none was found: then `nearest` comes
 * closest of what was tried, and `left` is left (NaN where `near` is no joints). */
static inline int calib_search(const calib_task *task, const calib_real x[CALIB_OUT],
                               const calib_real near[CALIB_DOF], calib_real q[CALIB_DOF],
                               calib_real nearest[CALIB_DOF], calib_real *left) {
  const int spare = CALIB_DOF > calib_rows(task);
  calib_real from[CALIB_DOF], trial[CALIB_DOF], away, best = 0, now;
  int row[CALIB_TRIES], i, k, count = CALIB_TRIES, found = 0;
  *left = calib_not_a_number();
  for (k = 0; k < CALIB_DOF; ++k) q[k] = calib_not_a_number();
  for (k = 0; k < CALIB_DOF; ++k) {
    const calib_real u = (near[k] - calib_lower[k]) / calib_span[k];
    if (!(u - u == 0) || (!calib_periodic[k] && !(u >= -1 && u <= 2))) return 0; /* no joints */
    from[k] = trial[k] = near[k];
  }
  calib_clipped(from);
  for (i = -1; i < count; ++i) { /* from `near`, then from the table */
    if (i == 0 && !(count = calib_starting(x, row))) break;
    if (found && i > CALIB_TRIES / 3) break;
    if (i >= 0) {
      const calib_real *start = calib_start_q[row[i]];
      away = calib_apart(start, from, 0);
      if (found && (away > best + @margin@ || calib_apart(start, q, 0) < @margin@ / 2)) continue;
      for (k = 0; k < CALIB_DOF; ++k) trial[k] = start[k];
    }
    if (!calib_reach(task, from, found ? q : 0, trial, &now)) {
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
        calib_reach(task, from, 0, trial, &now) && (away = calib_apart(trial, from, 0)) < best) {
      best = away;
      for (k = 0; k < CALIB_DOF; ++k) q[k] = trial[k];
    }
    if (best <= (task->kind == 0 && !spare ? @beside@ : @surely@)) return 1;
  }
  return !found ? 0 : (task->kind == 0 && !spare) || best <= @surely@ ? 1 : 2;
}

/* Joints that bring the tip to a position: of several ways the one nearest to `near`, in shares of
 * the joints' ranges.  1, or 2 where another way might be nearer; 0 where none was found. */
static inline int calib_inverse(const calib_real x[CALIB_OUT], const calib_real near[CALIB_DOF],
                                calib_real q[CALIB_DOF]) {
  calib_task task;
  calib_real nearest[CALIB_DOF], left;
  int i;
  task.kind = 0;
  for (i = 0; i < CALIB_OUT; ++i) task.x[i] = x[i];
  return calib_search(&task, x, near, q, nearest, &left);
}

/* All ways to a position that the table of starts leads to, at most `most`; returns how many. */
static inline int calib_inverse_all(const calib_real x[CALIB_OUT], int most,
                                    calib_real q[][CALIB_DOF]) {
  calib_task task;
  calib_real trial[CALIB_DOF], left;
  int row[CALIB_TRIES], i, k, j, count, found = 0;
  task.kind = 0;
  for (i = 0; i < CALIB_OUT; ++i) task.x[i] = x[i];
  count = calib_starting(x, row);
  for (i = 0; i < 2 * count && found < most; ++i) {
    for (k = 0; k < CALIB_DOF; ++k) trial[k] = calib_start_q[row[i % count]][k];
    if (i >= count && (CALIB_DOF > CALIB_OUT || !calib_reach(&task, trial, 0, trial, &left) ||
                       !calib_twin(&task, trial, trial)))
      continue;
    if (!calib_reach(&task, calib_start_q[row[i % count]], 0, trial, &left)) continue;
    for (j = 0; j < found; ++j)
      if (calib_apart(trial, q[j], 0) < (calib_real)1e-5) break;
    if (j < found) continue;
    for (k = 0; k < CALIB_DOF; ++k) q[found][k] = trial[k];
    ++found;
  }
  return found;
}
#if @placed@

/* Joints that bring the tip to a pose of the sensor's frame (R row by row), as calib_inverse. */
static inline int calib_inverse_pose(const calib_real x[3], const calib_real R[9],
                                     const calib_real near[CALIB_DOF], calib_real q[CALIB_DOF]) {
  calib_task task;
  calib_real nearest[CALIB_DOF], left;
  int i, j, k;
  task.kind = 2;
  for (i = 0; i < 3; ++i) {
    task.x[i] = 0;
    for (j = 0; j < 3; ++j) {
      task.x[i] += calib_aim[3 * j + i] * (x[j] - calib_shift[j]) / @scale@;
      task.R[3 * i + j] = 0;
      for (k = 0; k < 3; ++k) task.R[3 * i + j] += calib_aim[3 * k + i] * R[3 * k + j];
    }
  }
  return calib_search(&task, x, near, q, nearest, &left);
}
#endif

/* One damped Newton step of the joints towards a position; returns the distance before it. */
static inline calib_real calib_newton_step(const calib_real target[CALIB_OUT], calib_real damping,
                                           calib_real q[CALIB_DOF]) {
  calib_task task;
  calib_real r[6], J[6 * CALIB_DOF], move[CALIB_DOF], left;
  int i;
  task.kind = 0;
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
    if (task.kind == 0) calib_wanted(start, task.x);
    else calib_chain(&calib_nominal, start, task.x, task.R, 0, 0);
    good = calib_reach(&task, start, 0, out, &left);
#if @local@
    if (good && task.kind > 0) { /* what local models move is met as a position */
      task.kind = 0;
      calib_wanted(start, task.x);
      good = calib_reach(&task, out, 0, out, &left);
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

#endif /* @guard@ */
