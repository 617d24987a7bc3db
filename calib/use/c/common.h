
static inline calib_real calib_not_a_number(void) { return (calib_real)NAN; }

/* Whether joint values are within the range that the model was learned for. */
static inline int calib_in_range(const calib_real q[CALIB_DOF]) {
  int i;
  for (i = 0; i < CALIB_DOF; ++i) {
    const calib_real u = (q[i] - calib_lower[i]) / calib_span[i];
    if (!calib_periodic[i] && !(u >= @slack@ && u <= 1 - @slack@)) return 0;
    if (!(u - u == 0)) return 0;
  }
  return 1;
}

/* Joint values with those of full turns moved into their range. */
static inline void calib_wrapped(const calib_real q[CALIB_DOF], calib_real out[CALIB_DOF]) {
  int i;
  for (i = 0; i < CALIB_DOF; ++i) {
    const calib_real u = (q[i] - calib_lower[i]) / calib_span[i];
    out[i] = calib_periodic[i] ? calib_lower[i] + (u - floor(u)) * calib_span[i] : q[i];
  }
}
#if @nodes_asked@

/* The nodes that speak for q and their weights, which sum to one. */
static inline void calib_near(const calib_real *q, int *node, calib_real *weight,
                           calib_real u[CALIB_DOF]) {
  calib_real far[CALIB_NEAR + 1], total = 0;
  int place[CALIB_NEAR + 1], found = 0, i, n, k;
  for (i = 0; i < CALIB_DOF; ++i) {
    u[i] = (q[i] - calib_lower[i]) / calib_span[i];
    if (calib_periodic[i]) u[i] -= floor(u[i]);
  }
  for (n = 0; n < CALIB_NODES; ++n) {
    calib_real d = 0;
    for (i = 0; i < CALIB_DOF; ++i) {
      calib_real g = u[i] - calib_node[n][i];
      if (calib_periodic[i]) g -= floor(g + (calib_real)0.5);
      d += g * g;
    }
    if (found == CALIB_NEAR + 1 && !(d < far[CALIB_NEAR])) continue;
    k = found < CALIB_NEAR + 1 ? found++ : CALIB_NEAR;
    while (k > 0 && far[k - 1] > d) {
      far[k] = far[k - 1];
      place[k] = place[k - 1];
      --k;
    }
    far[k] = d;
    place[k] = n;
  }
  for (k = 0; k < CALIB_NEAR; ++k) {
    const calib_real r = far[CALIB_NEAR] > 0 ? 1 - far[k] / far[CALIB_NEAR] : 1;
    weight[k] = r * r;
    node[k] = place[k];
    total += weight[k];
  }
  for (k = 0; k < CALIB_NEAR; ++k)
    weight[k] = total > 0 ? weight[k] / total : (calib_real)1 / CALIB_NEAR;
}

/* Values of the nodes, blended at q. */
static inline calib_real calib_blended(const calib_real *values, const calib_real q[CALIB_DOF]) {
  int node[CALIB_NEAR], k;
  calib_real weight[CALIB_NEAR], u[CALIB_DOF], sum = 0;
  calib_near(q, node, weight, u);
  for (k = 0; k < CALIB_NEAR; ++k) sum += weight[k] * values[node[k]];
  return sum;
}
#endif

/* Error curves of all joints and their derivatives, by Horner's rule in exp(j q). */
static inline void calib_curves(const calib_real q[CALIB_DOF], calib_real value[CALIB_DOF],
                                calib_real slope[CALIB_DOF], int slopes) {
  calib_real c[CALIB_DOF], s[CALIB_DOF], im[CALIB_DOF], dim[CALIB_DOF], t;
  int i, n;
  for (i = 0; i < CALIB_DOF; ++i) {
    c[i] = cos(q[i]);
    s[i] = sin(q[i]);
    value[i] = im[i] = slope[i] = dim[i] = 0;
  }
  for (n = CALIB_HARMONICS - 1; n >= 0; --n)
    for (i = 0; i < CALIB_DOF; ++i) {
      t = value[i] + calib_curve_cos[n][i];
      im[i] -= calib_curve_sin[n][i];
      value[i] = t * c[i] - im[i] * s[i];
      im[i] = t * s[i] + im[i] * c[i];
    }
  for (n = CALIB_HARMONICS - 1; slopes && n >= 0; --n)
    for (i = 0; i < CALIB_DOF; ++i) {
      t = slope[i] + (calib_real)(n + 1) * calib_curve_sin[n][i];
      dim[i] += (calib_real)(n + 1) * calib_curve_cos[n][i];
      slope[i] = t * c[i] - dim[i] * s[i];
      dim[i] = t * s[i] + dim[i] * c[i];
    }
}

/* The step of least squares for n residuals: q += J' (J J' + damping trace(J J'))^-1 r. */
static inline int calib_step(int n, const calib_real *J, const calib_real *r, calib_real damping,
                             calib_real q[CALIB_DOF]) {
  calib_real a[6][6], y[6], trace = 0;
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
  for (i = 0; i < n; ++i) { /* Cholesky */
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
  for (k = 0; k < CALIB_DOF; ++k)
    for (i = 0; i < n; ++i) q[k] += J[i * CALIB_DOF + k] * y[i];
  return 1;
}
