
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
