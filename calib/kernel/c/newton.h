
/* (J J' + damping trace) y = r for n residuals, by factors L D L' without square roots. */
static inline int calib_forces(int n, const calib_real *J, const calib_real *r, calib_real damping,
                               calib_real y[6]) {
  calib_real a[6][6], inverse[6], trace = 0;
  int i, j, k;
  for (i = 0; i < n; ++i) {
    for (j = 0; j <= i; ++j) {
      a[i][j] = 0;
      for (k = 0; k < CALIB_DOF; ++k) a[i][j] += J[i * CALIB_DOF + k] * J[j * CALIB_DOF + k];
    }
    trace += a[i][i];
    y[i] = r[i];
  }
  for (i = 0; i < n; ++i) {
    a[i][i] += damping * trace;
    for (j = 0; j < i; ++j) { /* a[j][i] is what L has not yet been divided by */
      a[j][i] = a[i][j];
      for (k = 0; k < j; ++k) a[j][i] -= a[k][i] * a[j][k];
      a[i][j] = a[j][i] * inverse[j];
      a[i][i] -= a[i][j] * a[j][i];
      y[i] -= a[i][j] * y[j];
    }
    if (!(a[i][i] > 0)) return 0;
    inverse[i] = 1 / a[i][i];
  }
  for (i = n - 1; i >= 0; --i) {
    y[i] *= inverse[i];
    for (k = i + 1; k < n; ++k) y[i] -= a[k][i] * y[k];
  }
  return 1;
}

/* From b to a in shares of the joints' ranges, the short way round where they go round; returns
 * the length. */
static inline calib_real calib_apart(const calib_joints a, const calib_joints b, calib_real *way) {
  calib_real squared = 0;
  int k;
  for (k = 0; k < CALIB_DOF; ++k) {
    const calib_real u = calib_short(k, (a[k] - b[k]) / calib_span[k]);
    if (way) way[k] = u;
    squared += u * u;
  }
  return sqrt(squared);
}

/* Joints within their limits; those of full turns go round.  Returns whether no limit holds any. */
static inline int calib_clipped(calib_joints q) {
  int k, inside = 1;
  for (k = 0; k < CALIB_DOF; ++k) {
    const calib_real u = calib_share_of(k, q[k]);
    if (calib_periodic[k]) {
      q[k] = calib_lower[k] + (u - floor(u)) * calib_span[k];
    } else if (!(u > 0 && u < 1)) {
      q[k] = calib_lower[k] + (u > 0 ? calib_span[k] : 0);
      inside = 0;
    }
  }
  return inside;
}

/* A move of the joints, in shares of their ranges: of all that bring the residuals to zero the one
 * that ends nearest to a wish; joints that a limit holds stay. */
static inline int calib_move(int n, const calib_real *J, const calib_real *r, const calib_joints q,
                             const calib_real *wish, calib_real damping, calib_joints move) {
  const calib_real slack = wish ? @slack@ : 0;
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
      const calib_real u = calib_share_of(k, q[k]);
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
static inline int calib_beside(const calib_joints q, const calib_real *ways, int count,
                               calib_real share) {
  int j;
  for (j = 0; j < count; ++j)
    if (calib_apart(q, ways + j * CALIB_DOF, 0) < share) return 1;
  return 0;
}

/* Joints a move on, of which none goes further than a step may, within their limits.  Returns whether
 * no limit holds any. */
static inline int calib_moved(const calib_joints q, const calib_joints move, calib_joints out) {
  calib_real largest = @longest@;
  int k;
  for (k = 0; k < CALIB_DOF; ++k)
    if (fabs(move[k]) > largest) largest = fabs(move[k]);
  for (k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + calib_span[k] * move[k] * @longest@ / largest;
  return calib_clipped(out);
}

/* What of the way to `near` leaves the task as it is; returns its length. */
static inline calib_real calib_pull(const calib_task *task, const calib_joints near,
                                    const calib_joints q, const calib_gap *gap, calib_joints pull) {
  const calib_real none[6] = {0, 0, 0, 0, 0, 0};
  calib_real wish[CALIB_DOF], squared = 0;
  int k;
  calib_apart(near, q, wish);
  if (!calib_move(calib_rows(task), gap->J, none, q, wish, @calm@, pull)) return 0;
  for (k = 0; k < CALIB_DOF; ++k) squared += pull[k] * pull[k];
  return sqrt(squared);
}

/* Share of the pull that the next slide goes, by how the pull turned on the last one (Barzilai and
 * Borwein 1988). */
static inline calib_real calib_share(const calib_joints slid, const calib_joints before,
                                     const calib_joints after) {
  calib_real along = 0, squared = 0, share;
  int k;
  for (k = 0; k < CALIB_DOF; ++k) {
    along += slid[k] * (before[k] - after[k]);
    squared += slid[k] * slid[k];
  }
  share = along > 0 ? squared / along : (calib_real)1.5;
  return share < (calib_real)0.1 ? (calib_real)0.1 : share > 3 ? 3 : share;
}

/* A search: from where, and the ways so far that do the task; with room for one the nearest stays. */
typedef struct {
  const calib_task *task;
  calib_real from[CALIB_DOF]; /* joints that answers should be near to */
  calib_real *way;            /* joints of the ways, one after another */
  int count, most;            /* ways, and how many have room */
  int budget;                 /* steps that are left */
  calib_real away;            /* from `from` to the nearest way */
  calib_real nearest[CALIB_DOF], left; /* what comes closest where there is none */
} calib_search;

/* Slides of redundant joints along their self-motion towards the joints that are asked for. */
typedef struct {
  int count, moved;                           /* slides so far; whether the last one was taken */
  calib_real share, pull[CALIB_DOF];          /* of the pull that a slide goes */
  calib_real before[CALIB_DOF], slid[CALIB_DOF]; /* the pull of the last slide, and its way */
} calib_slides;

/* Adds the next slide to a move; 0 where joints have settled. */
static inline int calib_slide(const calib_search *search, const calib_joints q,
                              const calib_gap *gap, calib_real settled, calib_slides *slides,
                              calib_joints move) {
  const calib_real length = calib_pull(search->task, search->from, q, gap, slides->pull);
  calib_real part = 1;
  int k;
  if (slides->moved) slides->share = calib_share(slides->slid, slides->before, slides->pull);
  if (length <= settled || slides->share < @stuck@ || slides->count >= CALIB_SLIDES) return 0;
  ++slides->count;
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

/* Joints from a start (in q) to a task by damped Newton steps, `plain` roughly, without curves,
 * bending and local models.  More joints than residuals slide once they are close.  Returns whether
 * they are there; the gap is theirs.  What leads to one of `count` ways is given up. */
static inline int calib_descend(calib_search *search, int plain, int count, calib_joints q,
                                calib_gap *gap) {
  const calib_task *task = search->task;
  const calib_real size = calib_size(task), close = @close@ * size, rough = @rough@ * size;
  calib_slides slides = {0, 0, 1, {0}, {0}, {0}};
  calib_real move[CALIB_DOF], trial[CALIB_DOF], damping = @calm@;
  calib_gap next;
  int sliding = CALIB_DOF > calib_rows(task), step = 0, last = 0;
  calib_left(task, plain, q, gap);
  while (step < CALIB_STEPS && search->budget > 0) {
    const int near = sliding && gap->left <= rough;
    int better, inside;
    search->budget -= @bent@ && !plain ? 4 : 1; /* curves and bending take so much longer */
    if (!near && gap->left <= (plain ? rough : @enough@ * size)) break;
    if (!calib_move(calib_rows(task), gap->J, gap->r, q, 0, damping, move)) return 0;
    if (near) {
      const calib_real settled = plain ? 100 * @settled@ : gap->left <= close ? @settled@ : -1;
      sliding = calib_slide(search, q, gap, settled, &slides, move);
      if (!sliding && plain) break;
      if (!sliding) continue;
    }
    inside = calib_moved(q, move, trial);
    if (last && inside && !near) { /* what this step leaves is known to be less */
      calib_copy(CALIB_DOF, trial, q);
      return 1;
    }
    if (calib_beside(trial, search->way, count, @margin@ / 4)) return 0;
    calib_left(task, plain, trial, &next);
    if (near) {
      better = next.left <= rough && (gap->left > close || calib_apart(trial, search->from, 0) <
                                                               calib_apart(q, search->from, 0));
      if (!better) slides.share /= 4;
      calib_apart(trial, q, slides.slid);
      calib_copy(CALIB_DOF, slides.pull, slides.before);
      slides.moved = better;
    } else {
      const int slow = !(next.left < gap->left * (1 - @slow@));
      ++step;
      better = next.left < gap->left;
      if (better ? slow : gap->left <= close || !(damping < @hardest@)) step = CALIB_STEPS;
      damping = better ? damping / @easier@ : damping * @easier@;
      if (better && damping < @calm@) damping = @calm@;
      if (!better && damping < @hard@) damping = @hard@;
      last = better && inside && !plain && damping <= @calm@ &&
             next.left * next.left <= @surplus@ * close * gap->left;
    }
    if (!better) continue;
    calib_copy(CALIB_DOF, trial, q);
    *gap = next;
  }
  return gap->left <= (plain ? 10 * rough : close); /* what misses by far does so bent */
}

/* The same from a start on, first roughly where `rough`; a way that would be further than the nearest
 * is given up. */
static inline int calib_reach(calib_search *search, int rough, int count, calib_joints q,
                              calib_gap *gap) {
  calib_clipped(q);
  if (rough && @bent@) {
    if (!calib_descend(search, 1, count, q, gap)) return 0;
    if (search->most == 1 && count &&
        calib_apart(q, search->from, 0) > search->away + @margin@ / 4)
      return 0;
  }
  return calib_descend(search, 0, count, q, gap);
}

/* The direction y of residuals that joints hardly reach, and the motion v that hardly moves the tip;
 * returns how little it does, as a share of the joints' ranges, or 0 far from a fold. */
static inline calib_real calib_flat(int n, const calib_real *J, calib_real y[6], calib_joints v) {
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
  if (!(squared > 0) || squared > @fold@ * power) return 0;
  for (k = 0; k < CALIB_DOF; ++k) v[k] /= sqrt(squared);
  return sqrt(squared);
}

/* Where the joints may stand on the other side of a nearby fold: as far beyond it as q is before
 * it, along the motion that hardly moves the tip.  0 where no fold is near. */
static inline int calib_twin(const calib_task *task, const calib_joints q, const calib_gap *here,
                             calib_joints out) {
  const int n = calib_rows(task);
  calib_real y[6], v[CALIB_DOF], reach, rate = 0;
  const calib_real size = calib_flat(n, here->J, y, v);
  calib_gap gap;
  int i, k, side;
  if (!(size > 0)) return 0;
  for (side = -1; side <= 1; side += 2) { /* how fast that singular value changes */
    for (k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + side * @probe@ * calib_span[k] * v[k];
    calib_left(task, 0, out, &gap);
    for (i = 0; i < n; ++i)
      for (k = 0; k < CALIB_DOF; ++k)
        rate += side * y[i] * gap.J[i * CALIB_DOF + k] * v[k] / (2 * @probe@);
  }
  if (!(fabs(rate) > 0)) return 0;
  reach = -2 * size / rate;
  if (!(fabs(reach) < @twin_reach@)) return 0;
  for (k = 0; k < CALIB_DOF; ++k) out[k] = q[k] + reach * calib_span[k] * v[k];
  return 1;
}
