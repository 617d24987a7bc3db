
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
#if @camera@

/* Pixels of a point in the camera's frame, their derivative by it, and the point at depth 1. */
static inline void calib_pinhole(const calib_real at[3], calib_real x[2], calib_real L[6],
                                 calib_real u[2]) {
  const calib_real depth = at[2] > @nearest@ ? at[2] : @nearest@, f = calib_lens[0];
  const calib_real a = at[0] / depth, b = at[1] / depth, r2 = a * a + b * b;
  const calib_real k1 = calib_lens[3], @law@, bent = 1 + rise * ratio, twice = 2 * rise;
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
static inline void calib_seen(const calib_arm *arm, const calib_real q[CALIB_DOF],
                              calib_real x[CALIB_OUT], calib_real *J, calib_real R[9]) {
  calib_real p[3], G[6 * CALIB_DOF], at[3], V[9];
  int i, j, k;
  calib_chain(arm, q, p, R, J ? G : 0, 0);
  for (i = 0; i < 3; ++i) at[i] = calib_shift[i] + calib_dot(calib_view + 3 * i, p);
  for (i = 0; i < 9; ++i) V[i] = calib_view[i];
  for (i = 0; i < CALIB_OUT; ++i) x[i] = at[i];
#if @camera@
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

static inline void calib_smooth(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_real R[9];
  calib_seen(&calib_body, q, x, J, R);
}
#if @posterior@
#if @camera@

/* The same of pixels: through the camera, and by its lens. */
static inline void calib_in_pixels(const calib_real p[3], calib_real geometry[CALIB_GEOMETRY][3],
                                   calib_real own[CALIB_DOF][3]) {
  calib_real at[3], x[2], L[6], u[2];
  int i, k;
  for (k = 0; k < 3; ++k) at[k] = calib_shift[k] + calib_dot(calib_view + 3 * k, p);
  calib_pinhole(at, x, L, u);
  for (i = 0; i < CALIB_GEOMETRY + CALIB_DOF; ++i) {
    calib_real *moved = i < CALIB_GEOMETRY ? geometry[i] : own[i - CALIB_GEOMETRY];
    const calib_real across = calib_dot(L, moved);
    moved[1] = calib_dot(L + 3, moved);
    moved[0] = across;
    moved[2] = 0;
  }
  for (k = 0; k < 2; ++k) {
    geometry[7][k] = (x[k] - calib_lens[1 + k]) / calib_lens[0];
    geometry[8 + k][k] = 1;
    geometry[10][k] = calib_lens[0] * u[k] * (u[0] * u[0] + u[1] * u[1]);
  }
}
#endif

/* Derivatives of the position: by the geometry, and by the joints' own values. */
static inline void calib_derivatives(const calib_real q[CALIB_DOF],
                                     calib_real geometry[CALIB_GEOMETRY][3],
                                     calib_real own[CALIB_DOF][3]) {
  calib_real at[CALIB_CHAIN + 1][21], load[CALIB_CHAIN], bent[CALIB_CHAIN][CALIB_DOF];
  calib_real p[3], R[9], point[3], arrow[3], moved[3], about[3], flange[9];
  int i, a, k, n = 17 + 6 * CALIB_CHAIN;
  calib_chain(&calib_body, q, p, R, 0, at);
  for (i = 0; i < CALIB_GEOMETRY; ++i)
    for (k = 0; k < 3; ++k) geometry[i][k] = i - 3 == k ? 1 : 0;
  for (k = 0; k < 3; ++k) geometry[6][k] = point[k] = calib_dot(calib_view + 3 * k, p);
  for (k = 0; k < 9; ++k) flange[k] = at[CALIB_CHAIN][k];
  calib_times(flange, calib_flange);
  for (a = 0; a < 3; ++a) {
    calib_cross(geometry[3 + a], point, geometry[a]);
    for (k = 0; k < 3; ++k) about[k] = flange[3 * k + a];
    for (k = 0; k < 3; ++k) geometry[11 + a][k] = calib_dot(calib_view + 3 * k, about);
  }
  for (k = 0; k < CALIB_DOF; ++k)
    for (a = 0; a < 3; ++a) own[k][a] = 0;
  if (@bends@) calib_loads(q, load, bent, 0);
  for (i = 0; i < CALIB_CHAIN; ++i) {
    for (k = 0; k < 3; ++k) arrow[k] = p[k] - at[i][18 + k];
    for (a = 0; a < 3; ++a) {
      for (k = 0; k < 3; ++k) moved[k] = at[i][3 * k + a];
      for (k = 0; k < 3; ++k)
        geometry[17 + 6 * i + a][k] = calib_dot(calib_view + 3 * k, moved);
      for (k = 0; k < 3; ++k) about[k] = at[i][9 + 3 * k + a];
      calib_cross(about, arrow, moved);
      for (k = 0; k < 3; ++k)
        geometry[20 + 6 * i + a][k] = calib_dot(calib_view + 3 * k, moved);
    }
    for (k = 0; k < 3; ++k) about[k] = calib_dot(at[i] + 9 + 3 * k, calib_axis[i]);
    if (calib_bends[i]) calib_cross(about, arrow, about);
    for (a = 0; a < 3; ++a) {
      const calib_real slope = calib_dot(calib_view + 3 * a, about);
      for (k = 0; k < CALIB_DOF; ++k) own[k][a] += calib_coupling[i][k] * slope;
      if (@bends@) geometry[n + 2 * CALIB_DOF + i][a] = slope * load[i];
    }
  }
  for (k = 0; k < CALIB_DOF; ++k)
    for (a = 0; a < 3; ++a) {
      geometry[n + k][a] = own[k][a];
      geometry[n + CALIB_DOF + k][a] = own[k][a] * q[k];
    }
#if @camera@
  calib_in_pixels(p, geometry, own);
#endif
}
#endif
#if @corrected@

static inline void calib_wanted(const calib_real q[CALIB_DOF], calib_real x[CALIB_OUT]) {
  calib_real R[9];
  calib_seen(&calib_nominal, q, x, 0, R);
}

/* Joints near q with the pose that the nominal arm would have, where there are six joints. */
static inline void calib_posed(const calib_real q[CALIB_DOF], calib_real out[CALIB_DOF]) {
  calib_real goal[3], p[3], want[9], R[9], G[6 * CALIB_DOF], r[6];
  int i, k, step;
  if (CALIB_DOF < 6) return;
  calib_chain(&calib_nominal, q, goal, want, 0, 0);
  for (step = 0; step < @poses@; ++step) {
    calib_chain(&calib_body, out, p, R, G, 0);
    for (k = 0; k < 3; ++k) {
      r[k] = goal[k] - p[k];
      r[3 + k] = 0;
    }
    for (i = 0; i < 3; ++i) { /* half the sum of the cross products of columns */
      const calib_real a[3] = {R[i], R[3 + i], R[6 + i]};
      const calib_real b[3] = {want[i], want[3 + i], want[6 + i]};
      calib_real turn[3];
      calib_cross(a, b, turn);
      for (k = 0; k < 3; ++k) r[3 + k] += turn[k] * @half_lever@;
    }
    for (i = 3 * CALIB_DOF; i < 6 * CALIB_DOF; ++i) G[i] *= @lever@;
    if (!calib_step(6, G, r, @pose_calm@, out)) break;
  }
  for (k = 0; k < CALIB_DOF; ++k)
    if (!(fabs(out[k] - q[k]) <= @limit@)) break;
  for (i = 0; k < CALIB_DOF && i < CALIB_DOF; ++i) out[i] = q[i]; /* beside a singularity */
}
#endif
