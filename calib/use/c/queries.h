
/* What the model says, wherever q is. */
static inline void calib_model(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_smooth(q, x, J);
@local@}

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
  *bound = calib_not_a_number();
  if (!calib_in_range(q)@trusted@) return 0;
@bounded@  return 1;
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
