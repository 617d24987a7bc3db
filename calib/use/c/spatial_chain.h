
static inline void calib_cross(const calib_real a[3], const calib_real b[3], calib_real out[3]) {
  const calib_real x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
  out[0] = x;
  out[1] = y;
}

static inline calib_real calib_dot(const calib_real a[3], const calib_real b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* out += R v, with the rows of R. */
static inline void calib_add(const calib_real R[9], const calib_real v[3], calib_real out[3]) {
  int i;
  for (i = 0; i < 3; ++i) out[i] += calib_dot(R + 3 * i, v);
}

/* R becomes R S. */
static inline void calib_times(calib_real R[9], const calib_real S[9]) {
  int i, j;
  for (i = 0; i < 3; ++i) {
    const calib_real a = R[3 * i], b = R[3 * i + 1], c = R[3 * i + 2];
    for (j = 0; j < 3; ++j) R[3 * i + j] = a * S[j] + b * S[3 + j] + c * S[6 + j];
  }
}

/* R is turned about its own unit axis (Rodrigues). */
static inline void calib_turn(calib_real R[9], const calib_real axis[3], calib_real angle) {
  const calib_real c = cos(angle), s = sin(angle);
  calib_real swept[3], along;
  int i, j;
  for (i = 0; i < 3; ++i) {
    calib_cross(R + 3 * i, axis, swept);
    along = (1 - c) * calib_dot(R + 3 * i, axis);
    for (j = 0; j < 3; ++j) R[3 * i + j] = c * R[3 * i + j] + s * swept[j] + along * axis[j];
  }
}

static inline void calib_unit(calib_real R[9]) {
  int i;
  for (i = 0; i < 9; ++i) R[i] = i % 4 == 0 ? 1 : 0;
}

/* Torques of gravity in the nominal arm, as shares of the largest, and their derivatives. */
static inline void calib_loads(const calib_real q[CALIB_DOF], calib_real load[CALIB_CHAIN],
                               calib_real slope[CALIB_CHAIN][CALIB_DOF], int slopes) {
  calib_real R[9], p[3] = {0, 0, 0}, origin[CALIB_CHAIN][3], axis[CALIB_CHAIN][3];
  calib_real moment[CALIB_CHAIN][3], mass[CALIB_CHAIN], first[3] = {0, 0, 0}, weight = 0;
  calib_real pull[3], turn[3], swept[3], both[CALIB_CHAIN][CALIB_CHAIN];
  int i, j, k;
  calib_unit(R);
  for (i = 0; i < CALIB_CHAIN; ++i) {
    calib_real v = calib_bias[i];
    for (k = 0; k < CALIB_DOF; ++k) v += calib_coupling[i][k] * q[k];
    calib_add(R, calib_stride[i], p);
    for (k = 0; k < 3; ++k) axis[i][k] = calib_dot(R + 3 * k, calib_axis[i]);
    if (calib_bends[i]) calib_turn(R, calib_axis[i], v);
    for (k = 0; k < 3; ++k) {
      if (!calib_bends[i]) p[k] += v * axis[i][k];
      origin[i][k] = moment[i][k] = p[k];
    }
    calib_add(R, calib_centre[i], moment[i]); /* for now the centre of mass */
  }
  for (i = CALIB_CHAIN - 1; i >= 0; --i) {
    weight += calib_mass[i];
    mass[i] = weight;
    for (k = 0; k < 3; ++k) {
      first[k] += calib_mass[i] * moment[i][k];
      moment[i][k] = first[k] - weight * origin[i][k];
    }
    calib_cross(moment[i], calib_gravity, pull);
    load[i] = calib_bends[i] ? calib_dot(axis[i], pull)
                             : weight * calib_dot(axis[i], calib_gravity);
  }
  if (!slopes) return;
  for (i = 0; i < CALIB_CHAIN; ++i) {
    calib_cross(moment[i], calib_gravity, pull);
    for (j = 0; j <= i; ++j) {
      both[i][j] = 0;
      if (calib_bends[j]) {
        calib_cross(axis[j], axis[i], turn);
        if (calib_bends[i]) {
          calib_cross(axis[j], moment[i], swept);
          calib_cross(swept, calib_gravity, swept);
          both[i][j] = calib_dot(turn, pull) + calib_dot(axis[i], swept);
        } else {
          both[i][j] = calib_dot(turn, calib_gravity) * mass[i];
        }
      }
      both[j][i] = both[i][j];
    }
  }
  for (i = 0; i < CALIB_CHAIN; ++i)
    for (k = 0; k < CALIB_DOF; ++k) {
      slope[i][k] = 0;
      for (j = 0; j < CALIB_CHAIN; ++j) slope[i][k] += both[i][j] * calib_coupling[j][k];
    }
}

/* Position and orientation in the root's frame; where G is not null also the geometric
 * Jacobian, of which the rows 0 to 2 are velocities and the rows 3 to 5 angular velocities, and
 * where `at` is not null each joint's frame before and after its own turn, and its origin. */
static inline void calib_chain(const calib_arm *arm, const calib_real q[CALIB_DOF], calib_real p[3],
                               calib_real R[9], calib_real *G, calib_real at[][21]) {
  calib_real value[CALIB_DOF], rate[CALIB_DOF], load[CALIB_CHAIN], bent[CALIB_CHAIN][CALIB_DOF];
  calib_real origin[CALIB_CHAIN][3], axis[CALIB_CHAIN][3], arrow[3], swept[3], factor;
  int i, k, o;
  for (k = 0; k < CALIB_DOF; ++k) value[k] = rate[k] = 0;
  if (arm->curves) calib_curves(q, value, rate, G != 0);
  if (arm->elastic) calib_loads(q, load, bent, G != 0);
  for (k = 0; k < CALIB_DOF; ++k) {
    value[k] += arm->gain[k] * q[k] + arm->offset[k];
    rate[k] += arm->gain[k];
  }
  calib_unit(R);
  for (k = 0; k < 3; ++k) p[k] = 0;
  for (i = 0; i < CALIB_CHAIN; ++i) {
    calib_real v = calib_bias[i];
    for (k = 0; k < CALIB_DOF; ++k) v += calib_coupling[i][k] * value[k];
    if (arm->elastic) v += arm->bending[i] * load[i];
    calib_add(R, arm->stride[i], p);
    for (k = 0; at && k < 9; ++k) at[i][k] = R[k];
    calib_times(R, arm->turned[i]);
    for (k = 0; at && k < 12; ++k) at[i][9 + k] = k < 9 ? R[k] : p[k - 9];
    for (k = 0; k < 3; ++k) axis[i][k] = calib_dot(R + 3 * k, calib_axis[i]);
    if (calib_bends[i]) calib_turn(R, calib_axis[i], v);
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
    for (k = 0; k < CALIB_DOF; ++k) {
      factor = calib_coupling[i][k] * rate[k];
      if (arm->elastic) factor += arm->bending[i] * bent[i][k];
      for (o = 0; o < 3; ++o) {
        G[o * CALIB_DOF + k] += factor * (calib_bends[i] ? swept[o] : axis[i][o]);
        if (calib_bends[i]) G[(o + 3) * CALIB_DOF + k] += factor * axis[i][o];
      }
    }
  }
}
