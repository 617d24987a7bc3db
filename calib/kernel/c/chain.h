
#if @curve_cos@
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
#endif
#if @gravity@

/* How each joint of the nominal arm moves the points beyond it that weigh; the joints' axes. */
static inline void calib_swings(const calib_real q[CALIB_DOF], calib_real axis[CALIB_CHAIN][3],
                                calib_real swing[CALIB_CHAIN][CALIB_POINTS][3]) {
  calib_real R[9], p[3] = {0, 0, 0}, origin[CALIB_CHAIN][3], at[CALIB_POINTS][3], arm[3];
  int i, j, k;
  calib_unit(R);
  for (i = 0; i < CALIB_CHAIN; ++i) {
    calib_real v = calib_bias[i];
    for (k = 0; k < CALIB_DOF; ++k) v += calib_coupling[i][k] * q[k];
    calib_add(R, calib_drawn[i], p);
    for (k = 0; k < 3; ++k) axis[i][k] = calib_dot(R + 3 * k, calib_body.axis[i]);
    if (calib_bends[i]) calib_turn(R, calib_body.axis[i], v);
    for (k = 0; k < 3; ++k) {
      if (!calib_bends[i]) p[k] += v * axis[i][k];
      origin[i][k] = p[k];
    }
    for (j = 0; j < CALIB_POINTS; ++j)
      if (calib_carrier[j] == i) {
        for (k = 0; k < 3; ++k) at[j][k] = p[k];
        calib_add(R, calib_point[j], at[j]);
      }
  }
  for (i = 0; i < CALIB_CHAIN; ++i)
    for (j = 0; j < CALIB_POINTS; ++j) {
      for (k = 0; k < 3; ++k) arm[k] = at[j][k] - origin[i][k];
      if (calib_bends[i]) calib_cross(axis[i], arm, swing[i][j]);
      for (k = 0; k < 3; ++k) {
        if (!calib_bends[i]) swing[i][j][k] = axis[i][k];
        if (calib_carrier[j] < i) swing[i][j][k] = 0;
      }
    }
}

/* How much each joint bends under the weights, and its derivatives. */
static inline void calib_sag(const calib_real q[CALIB_DOF], calib_real bend[CALIB_CHAIN],
                             calib_real slope[CALIB_CHAIN][CALIB_DOF], int slopes) {
  calib_real axis[CALIB_CHAIN][3], swing[CALIB_CHAIN][CALIB_POINTS][3], across[CALIB_CHAIN][3];
  calib_real moved[CALIB_CHAIN][3], by_joint;
  int i, j, k, n;
  calib_swings(q, axis, swing);
  for (i = 0; i < CALIB_CHAIN; ++i) calib_cross(calib_gravity, axis[i], across[i]);
  for (i = 0; i < CALIB_CHAIN; ++i) {
    /* how each joint from this one on moves the points, each as much as it bends this one */
    for (j = i; j < (slopes ? CALIB_CHAIN : i + 1); ++j)
      for (k = 0; k < 3; ++k) {
        moved[j][k] = 0;
        for (n = 0; n < CALIB_POINTS; ++n) moved[j][k] += calib_bending[i][n] * swing[j][n][k];
      }
    bend[i] = calib_dot(moved[i], calib_gravity);
    for (n = 0; slopes && n < CALIB_DOF; ++n) slope[i][n] = 0;
    for (j = 0; slopes && j < CALIB_CHAIN; ++j) {
      /* a joint before turns the whole lever, one beyond only the points that follow it */
      const int first = j < i ? j : i, last = j < i ? i : j;
      by_joint = calib_bends[first] ? calib_dot(across[first], moved[last]) : 0;
      for (n = 0; n < CALIB_DOF; ++n) slope[i][n] += by_joint * calib_coupling[j][n];
    }
  }
}
#endif

/* Position and orientation in the root's frame; where G is not null also the geometric
 * Jacobian, of which the rows 0 to 2 are velocities and the rows 3 to 5 angular velocities, and
 * where `at` is not null each joint's frame before and after its own turn, and its origin; `plain`
 * without curves and bending. */
static inline void calib_chain(const calib_arm *arm, int plain, const calib_real q[CALIB_DOF],
                               calib_real p[3], calib_real R[9], calib_real *G,
                               calib_real at[][21]) {
  const int bends = arm->own && !plain;
  calib_real value[CALIB_DOF], rate[CALIB_DOF], slope[CALIB_CHAIN][CALIB_DOF];
  calib_real origin[CALIB_CHAIN][3], axis[CALIB_CHAIN][3], arrow[3], swept[3];
  int i, k, o;
#if @gravity@
  calib_real bend[CALIB_CHAIN], bent[CALIB_CHAIN][CALIB_DOF];
  if (bends) calib_sag(q, bend, bent, G != 0);
#endif
  for (k = 0; k < CALIB_DOF; ++k) value[k] = rate[k] = 0;
#if @curve_cos@
  if (bends) calib_curves(q, value, rate, G != 0);
#endif
  for (k = 0; k < CALIB_DOF; ++k) {
    value[k] += arm->gain[k] * q[k] + arm->offset[k];
    rate[k] += arm->gain[k];
  }
  for (i = 0; G && i < CALIB_CHAIN; ++i)
    for (k = 0; k < CALIB_DOF; ++k) slope[i][k] = calib_coupling[i][k] * rate[k];
#if @neighbour@
  for (k = 1; bends && k < CALIB_DOF; ++k) { /* a joint moves with its neighbour's motor */
    value[k] += calib_neighbour[k] * q[k - 1];
    for (i = 0; G && i < CALIB_CHAIN; ++i)
      slope[i][k - 1] += calib_coupling[i][k] * calib_neighbour[k];
  }
#endif
#if @way@
  if (bends) { /* bent by the sums of all angles up to each joint: planar, gravity unknown */
    calib_real psi = 0;
    for (k = 0; k < CALIB_DOF; ++k) {
      calib_real c, s;
      psi += calib_way[k] * q[k];
      c = cos(psi);
      s = sin(psi);
      for (i = 0; i <= k; ++i) {
        const calib_real bend = calib_flex_sin[i][k] * c - calib_flex_cos[i][k] * s;
        value[i] += calib_flex_cos[i][k] * c + calib_flex_sin[i][k] * s;
        for (o = 0; G && o <= k; ++o) slope[i][o] += bend * calib_way[o];
      }
    }
  }
#endif
  calib_unit(R);
  for (k = 0; k < 3; ++k) p[k] = 0;
  for (i = 0; i < CALIB_CHAIN; ++i) {
    calib_real v = calib_bias[i];
    for (k = 0; k < CALIB_DOF; ++k) v += calib_coupling[i][k] * value[k];
#if @gravity@
    if (bends) {
      v += bend[i];
      for (k = 0; G && k < CALIB_DOF; ++k) slope[i][k] += bent[i][k];
    }
#endif
    calib_add(R, arm->stride[i], p);
    for (k = 0; at && k < 9; ++k) at[i][k] = R[k];
    calib_times(R, arm->turned[i]);
    for (k = 0; at && k < 12; ++k) at[i][9 + k] = k < 9 ? R[k] : p[k - 9];
    for (k = 0; k < 3; ++k) axis[i][k] = calib_dot(R + 3 * k, arm->axis[i]);
    if (calib_bends[i]) calib_turn(R, arm->axis[i], v);
    for (k = 0; k < 3; ++k) {
      if (!calib_bends[i]) p[k] += v * axis[i][k];
      origin[i][k] = p[k];
    }
  }
  for (k = 0; at && k < 9; ++k) at[CALIB_CHAIN][k] = R[k];
  calib_add(R, arm->tip, p);
  calib_times(R, arm->tip_turn);
  for (i = 0; G && i < 6 * CALIB_DOF; ++i) G[i] = 0;
  for (i = 0; G && i < CALIB_CHAIN; ++i) {
    for (k = 0; k < 3; ++k) arrow[k] = p[k] - origin[i][k];
    calib_cross(axis[i], arrow, swept);
    for (k = 0; k < CALIB_DOF; ++k)
      for (o = 0; o < 3; ++o) {
        G[o * CALIB_DOF + k] += slope[i][k] * (calib_bends[i] ? swept[o] : axis[i][o]);
        if (calib_bends[i]) G[(o + 3) * CALIB_DOF + k] += slope[i][k] * axis[i][o];
      }
  }
}
#if @lens@

/* What is seen of a point before the sensor, its derivative by the point, and the point at
 * depth 1; the lens is focal length, centre and k1. */
static inline void calib_pinhole(const calib_real at[3], calib_real x[2], calib_real L[6],
                                 calib_real u[2]) {
  const calib_real depth = at[2] > @nearest@ ? at[2] : @nearest@, f = calib_lens[0];
  const calib_real a = at[0] / depth, b = at[1] / depth, r2 = a * a + b * b;
  const calib_real k1 = calib_lens[3], bent = 1 + k1 * r2, twice = 2 * k1;
  int i;
  u[0] = a;
  u[1] = b;
  L[0] = f * (bent + twice * a * a) / depth;
  L[1] = L[3] = f * twice * a * b / depth;
  L[4] = f * (bent + twice * b * b) / depth;
  for (i = 0; i < 2; ++i) {
    x[i] = f * u[i] * bent + calib_lens[1 + i];
    L[3 * i + 2] = -(L[3 * i] * a + L[3 * i + 1] * b);
  }
}
#endif

/* What the sensor sees of a chain, and where J is not null its derivative (row by row). */
static inline void calib_seen(const calib_arm *arm, int plain, const calib_real q[CALIB_DOF],
                              calib_real x[CALIB_OUT], calib_real *J) {
  calib_real p[3], R[9], G[6 * CALIB_DOF], at[3], V[9];
  int i, j, k;
  calib_chain(arm, plain, q, p, R, J ? G : 0, 0);
  for (i = 0; i < 3; ++i) at[i] = calib_shift[i] + calib_dot(calib_view + 3 * i, p);
  for (i = 0; i < 9; ++i) V[i] = calib_view[i];
  for (i = 0; i < CALIB_OUT; ++i) x[i] = at[i];
#if @lens@
  {
    calib_real L[6], u[2];
    calib_pinhole(at, x, L, u);
    for (i = 0; i < 2; ++i)
      for (j = 0; j < 3; ++j)
        V[3 * i + j] = L[3 * i] * calib_view[j] + L[3 * i + 1] * calib_view[3 + j] +
                       L[3 * i + 2] * calib_view[6 + j];
  }
#endif
  for (i = 0; J && i < CALIB_OUT; ++i)
    for (k = 0; k < CALIB_DOF; ++k) {
      J[i * CALIB_DOF + k] = 0;
      for (j = 0; j < 3; ++j) J[i * CALIB_DOF + k] += V[3 * i + j] * G[j * CALIB_DOF + k];
    }
}
