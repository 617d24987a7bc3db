/* Where a frame of a posture is, and its axes, one after another. */
typedef struct {
  calib_real p[3], axes[9];
} calib_frame;

/* Adds a vector, so many times. */
static inline void calib_add_times(calib_real times, const calib_vector v, calib_vector sum) {
  for (int k = 0; k < 3; ++k) sum[k] += times * v[k];
}

/* Adds a vector in a frame, of these axes, to one. */
static inline void calib_add(const calib_rotation axes, const calib_vector v, calib_vector out) {
  for (int k = 0; k < 3; ++k) out[k] += v[0] * axes[k] + v[1] * axes[3 + k] + v[2] * axes[6 + k];
}

/* Frames of an arm's joints at their values, and of its tip. */
static inline void calib_frames(const calib_arm *arm, const calib_values value, calib_frame *at) {
  calib_real p[3] = {0, 0, 0}, axes[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  calib_real cosine[CALIB_CHAIN], sine[CALIB_CHAIN];
  calib_waves(CALIB_CHAIN, value, cosine, sine);
  for (int i = 0; i <= CALIB_CHAIN; ++i) {
    const calib_real *x = at[i].axes, *y = x + 3, *z = x + 6;
    calib_add(axes, arm->stride[i], p);
    calib_copy(3, p, at[i].p);
    calib_product(3, arm->turned[i], 3, axes, at[i].axes);
    if (i == CALIB_CHAIN) return;
    calib_copy(9, at[i].axes, axes);
    if (!calib_turns[i]) calib_add_times(value[i], z, p);
    for (int k = 0; calib_turns[i] && k < 3; ++k) {
      axes[k] = cosine[i] * x[k] + sine[i] * y[k];
      axes[3 + k] = cosine[i] * y[k] - sine[i] * x[k];
    }
  }
}

/* How a joint turns or slides masses, of which there is the sum of their places and theirs (4). */
static inline void calib_swing(const calib_frame *at, int joint, const calib_real masses[4],
                               calib_vector out) {
  const calib_real *axis = at[joint].axes + 6;
  calib_real lever[3];
  for (int k = 0; k < 3; ++k) {
    lever[k] = masses[k] - masses[3] * at[joint].p[k];
    out[k] = masses[3] * axis[k];
  }
  if (calib_turns[joint]) calib_cross(axis, lever, out);
}

/* Values of an arm's joints without curves and loads, and where slope is not null their derivatives. */
static inline void calib_mixed(const calib_arm *arm, const calib_joints q, calib_values value,
                               calib_slopes slope) {
  for (int i = 0; i < CALIB_CHAIN; ++i) {
    value[i] = arm->bias[i] + calib_dot(CALIB_DOF, arm->mix[i], q);
    if (slope) calib_copy(CALIB_DOF, arm->mix[i], slope[i]);
  }
}
