#if @posterior@

/* How a position moves along a direction of the parameters. */
static inline void calib_along(const float *direction, calib_real geometry[][3],
                               calib_real own[][3], calib_real wave[][4 * @waves@],
                               calib_real out[3]) {
  int i, k, n;
  for (k = 0; k < 3; ++k) out[k] = 0;
  for (i = 0; i < CALIB_GEOMETRY; ++i)
    for (k = 0; k < 3; ++k) out[k] += direction[i] * geometry[i][k];
  if (!wave) return;
  for (i = 0; i < CALIB_DOF; ++i) {
    const float *curve = direction + CALIB_GEOMETRY + 2 * @waves@ * i;
    calib_real sum = 0;
    for (n = 0; n < @waves@; ++n)
      sum += curve[n] * wave[i][2 * n] + curve[@waves@ + n] * wave[i][2 * n + 1];
    for (k = 0; k < 3; ++k) out[k] += sum * own[i][k];
  }
}

/* Radius of 95 % of a Gaussian of covariance S (xx, xy, xz, yy, yz, zz) and more (3). */
static inline calib_real calib_radius_95(const calib_real S[6], calib_real share,
                                         const calib_real more[3]) {
  const calib_real a = share * S[0] + more[0], d = share * S[3] + more[1];
  const calib_real f = share * S[5] + more[2], trace = a + d + f;
  const calib_real off = share * share * (S[1] * S[1] + S[2] * S[2] + S[4] * S[4]);
  const calib_real square = a * a + d * d + f * f + 2 * off;
  calib_real g, r;
  if (!(trace > 0)) return 0;
  g = (calib_real)2 / 9 * square / (trace * trace);
  r = 1 - g + @normal@ * sqrt(g);
  return sqrt(trace * r * r * r);
}

static inline calib_real calib_posterior(const calib_real q[CALIB_DOF]) {
  static const int first[6] = {0, 0, 0, 1, 1, 2}, other[6] = {0, 1, 2, 1, 2, 2};
  calib_real geometry[CALIB_GEOMETRY][3], own[CALIB_DOF][3], wave[CALIB_DOF][4 * @waves@];
  calib_real S[6], y[3], bound = 0, apart;
  int b, i, k, n;
  calib_derivatives(q, geometry, own);
  for (i = 0; i < CALIB_DOF; ++i) {
    const calib_real c = cos(q[i]), s = sin(q[i]);
    wave[i][0] = c;
    wave[i][1] = s;
    for (n = 1; n < 2 * @waves@; ++n) {
      wave[i][2 * n] = wave[i][2 * n - 2] * c - wave[i][2 * n - 1] * s;
      wave[i][2 * n + 1] = wave[i][2 * n - 2] * s + wave[i][2 * n - 1] * c;
    }
  }
  for (b = 0; b < @beliefs@; ++b) {
    for (k = 0; k < 6; ++k) S[k] = 0;
    for (i = 0; i < CALIB_GEOMETRY; ++i) {
      calib_along(calib_root[b * CALIB_GEOMETRY + i], geometry, own, 0, y);
      for (k = 0; k < 6; ++k) S[k] += y[first[k]] * y[other[k]];
    }
    for (i = 0; i < CALIB_DOF; ++i) {
      const float *term = calib_own[b * CALIB_DOF + i];
      calib_real size = term[0];
      for (n = 0; n < 4 * @waves@; ++n) size += term[1 + n] * wave[i][n];
      for (k = 0; k < 6; ++k) S[k] += size * own[i][first[k]] * own[i][other[k]];
    }
    for (i = 0; i < @rank@; ++i) {
      calib_along(calib_coupled[b * (@rank@ + 1) + i], geometry, own, wave, y);
      for (k = 0; k < 6; ++k) S[k] += calib_gains[b * @rank@ + i] * y[first[k]] * y[other[k]];
    }
    calib_along(calib_coupled[b * (@rank@ + 1) + @rank@], geometry, own, wave, y);
    apart = sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]);
    apart += calib_scale[b][0] * calib_radius_95(S, calib_scale[b][1], calib_more);
    if (apart > bound) bound = apart;
  }
  return bound;
}
#endif
#if @local@

/* Whether a node still speaks at a multiple of its reach: 1, falling to 0 at twice the reach. */
static inline calib_real calib_share(calib_real ratio) {
  calib_real r = ratio < 1 ? 0 : ratio - 1;
  r = r > 1 ? 0 : 1 - r * r;
  return r * r;
}

/* Factor on what nodes with a model say, by their share of the weight beside those without one. */
static inline calib_real calib_heard(calib_real share) {
  const calib_real silent = @silent@;
  calib_real t = (share - silent) / (@full@ - silent);
  t = t < 0 ? 0 : t > 1 ? 1 : t;
  return t * t * (3 - 2 * t) / (share > silent ? share : silent);
}

/* Local models of what the body leaves over, added to position and derivative. */
static inline void calib_local(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_real weight[CALIB_NEAR], u[CALIB_DOF], gap[CALIB_NEAR][CALIB_DOF], total = 0, left = 0;
  calib_real loud = 0;
  int node[CALIB_NEAR], i, k, t, o;
  calib_near(q, node, weight, u);
  for (k = 0; k < CALIB_NEAR; ++k) {
    calib_real far = 0, share = 1;
    for (i = 0; i < CALIB_DOF; ++i) {
      calib_real g = u[i] - calib_node[node[k]][i];
      if (calib_periodic[i]) g -= floor(g + (calib_real)0.5);
      gap[k][i] = g;
      far += g * g;
    }
    share = calib_share(sqrt(far) / calib_says[node[k]]);
    weight[k] *= share;
    total += weight[k];
    if (calib_talks[node[k]]) loud += weight[k];
    if (share > left) left = share;
  }
  left *= calib_heard(total > 0 ? loud / total : 0);
  for (k = 0; k < CALIB_NEAR; ++k) {
    const calib_real r = calib_radius[node[k]];
    const calib_real *c = calib_local_terms[node[k]];
    calib_real w = total > 0 ? weight[k] * left / total : 0;
    calib_real value[@terms@];
    if (!(w > 0)) continue;
    value[0] = 1;
    for (t = 1; t < @terms@; ++t)
      value[t] = value[calib_parent[t]] * gap[k][calib_along[t]] / r;
    for (t = 0; t < @terms@; ++t)
      for (o = 0; o < CALIB_OUT; ++o) x[o] += w * c[t * CALIB_OUT + o] * value[t];
    if (!J) continue;
    for (t = 1; t < @terms@; ++t)
      for (i = 0; i < CALIB_DOF; ++i) {
        const int power = calib_power[t * CALIB_DOF + i];
        if (!power) continue;
        for (o = 0; o < CALIB_OUT; ++o)
          J[o * CALIB_DOF + i] += w * c[t * CALIB_OUT + o] * (calib_real)power *
                                  value[calib_below[t * CALIB_DOF + i]] / (r * calib_span[i]);
      }
  }
}
#endif

/* What the model says, wherever q is. */
static inline void calib_model(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_smooth(q, x, J);
#if @local@
  calib_local(q, x, J);
#endif
}

/* Position; where J is not null also its derivative, J[coordinate * DOF + joint]. */
static inline int calib_position(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_real inside[CALIB_DOF];
  if (!calib_in_range(q)@trusted@) {
    int i;
    for (i = 0; i < CALIB_OUT; ++i) x[i] = calib_not_a_number();
    for (i = 0; J && i < CALIB_OUT * CALIB_DOF; ++i) J[i] = calib_not_a_number();
    return 0;
  }
  calib_wrapped(q, inside);
  calib_model(inside, x, J);
  return 1;
}

static inline int calib_forward(const calib_real q[CALIB_DOF], calib_real x[CALIB_OUT]) {
  return calib_position(q, x, 0);
}

static inline int calib_jacobian(const calib_real *q, calib_real J[CALIB_OUT * CALIB_DOF]) {
  calib_real x[CALIB_OUT];
  return calib_position(q, x, J);
}

/* 95 % bound on the @bound_of@@how@. */
static inline int calib_expected_error(const calib_real q[CALIB_DOF], calib_real *bound) {
  calib_real inside[CALIB_DOF];
  *bound = calib_not_a_number();
  if (!calib_in_range(q)@trusted@) return 0;
  calib_wrapped(q, inside);
  *bound = @bound@;
  return 1;
}

/* One damped Newton step of the joints towards a position; returns the distance before it. */
static inline calib_real calib_newton_step(const calib_real target[CALIB_OUT], calib_real damping,
                                           calib_real q[CALIB_DOF]) {
  calib_real x[CALIB_OUT], J[CALIB_OUT * CALIB_DOF], squared = 0;
  int i;
  calib_model(q, x, J);
  for (i = 0; i < CALIB_OUT; ++i) {
    x[i] = target[i] - x[i];
    squared += x[i] * x[i];
  }
  if (!calib_step(CALIB_OUT, J, x, damping, q)) return calib_not_a_number();
  return sqrt(squared);
}
#if @spatial@

/* Position, and the tip's orientation in the sensor's frame: a matrix, row by row. */
static inline int calib_pose(const calib_real q[CALIB_DOF], calib_real *x, calib_real R[9]) {
  calib_real inside[CALIB_DOF], seen[CALIB_OUT], own[9];
  int i;
  if (!calib_position(q, x, 0)) {
    for (i = 0; i < 9; ++i) R[i] = calib_not_a_number();
    return 0;
  }
  calib_wrapped(q, inside);
  calib_seen(&calib_body, inside, seen, 0, own);
  for (i = 0; i < 9; ++i) R[i] = calib_aim[i];
  calib_times(R, own);
  return 1;
}
#endif
#if @corrected@

/* Joints that bring the real tip to where the nominal arm would be with q, near q. */
static inline int calib_correct(const calib_real q[CALIB_DOF], calib_real out[CALIB_DOF]) {
  calib_real target[CALIB_OUT], start[CALIB_DOF], before[CALIB_DOF];
  calib_real held[CALIB_DOF], left, best = 0;
  int i, step;
  if (calib_in_range(q)) {
    calib_wrapped(q, start);
    for (i = 0; i < CALIB_DOF; ++i) out[i] = start[i];
    calib_wanted(start, target);
    calib_posed(start, out);
    for (i = 0; i < CALIB_DOF; ++i) held[i] = out[i];
    for (step = 0; step < 12; ++step) {
      for (i = 0; i < CALIB_DOF; ++i) before[i] = out[i];
      left = calib_newton_step(target, @calm@, out);
      if (!(step == 0 || left < best)) break;
      best = left;
      for (i = 0; i < CALIB_DOF; ++i) held[i] = before[i];
      if (left <= @enough@) break;
    }
    for (i = 0; i < CALIB_DOF; ++i) out[i] = held[i] + (q[i] - start[i]); /* on q's own turn */
    if (best <= @close@) return 1;
  }
  for (i = 0; i < CALIB_DOF; ++i) out[i] = calib_not_a_number();
  return 0;
}
#endif

#endif /* @guard@ */
