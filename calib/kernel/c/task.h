
/* What joints are asked for: a position of the sensor; a place, a pose, or a pose whose turn about
 * one axis of the tip is free, of the arm's root frame. */
enum { CALIB_POSITION, CALIB_PLACE, CALIB_POSE, CALIB_AXIS };

typedef struct {
  int kind;
  int axis; /* of CALIB_AXIS: 0, 1 or 2, an axis of the tip's frame */
  const calib_arm *arm;
  calib_real x[3], R[9];
} calib_task;

static inline int calib_rows(const calib_task *task) {
  const int rows[4] = {CALIB_OUT, 3, 6, 5};
  return rows[task->kind];
}

/* A length that a task's residuals are compared with. */
static inline calib_real calib_size(const calib_task *task) {
  return task->kind == CALIB_POSITION ? @extent@ : @lever@;
}

/* Turn that is left from R to another orientation S, or from one axis of R to that of S, a rotation
 * vector. */
static inline void calib_turn_left(const calib_rotation R, const calib_rotation S, int axis,
                                   calib_vector turn) {
  const int first = axis < 0 ? 0 : axis, last = axis < 0 ? 3 : axis + 1;
  calib_real a[3], b[3], across[3], sine, angle, cosine = 0;
  int i, k;
  for (k = 0; k < 3; ++k) turn[k] = 0;
  for (i = first; i < last; ++i) {
    for (k = 0; k < 3; ++k) {
      a[k] = R[3 * k + i];
      b[k] = S[3 * k + i];
    }
    calib_cross(a, b, across);
    for (k = 0; k < 3; ++k) turn[k] += across[k];
    cosine += calib_dot(a, b);
  }
  if (axis < 0) cosine -= 1; /* twice the cosine, and turn is twice the sine */
  sine = sqrt(calib_dot(turn, turn));
  angle = atan2(sine, cosine);
  if (!(sine > 0) && angle > 1) { /* half a turn, about any axis across */
    const calib_real other[3] = {a[1], a[2], -a[0]};
    calib_cross(a, other, turn);
    sine = sqrt(calib_dot(turn, turn));
  }
  for (k = 0; sine > 0 && k < 3; ++k) turn[k] *= angle / sine;
}

/* What joints miss of a task: residuals, their derivative by the joints in shares of their ranges,
 * and the residuals' length.  A radian of turn counts as the arm's length. */
typedef struct {
  calib_real r[6], J[6 * CALIB_DOF], left;
} calib_gap;

static inline void calib_left(const calib_task *task, int plain, const calib_joints q,
                              calib_gap *gap) {
  const int rows = calib_rows(task);
  calib_real *r = gap->r, *J = gap->J, squared = 0, p[3], R[9], turn[3];
  int i, k;
  if (task->kind == CALIB_POSITION) {
    calib_model(plain, q, r, J);
    for (i = 0; i < CALIB_OUT; ++i) r[i] = task->x[i] - r[i];
  } else {
    calib_chain(task->arm, plain, q, p, R, J);
    for (i = 0; i < 3; ++i) r[i] = task->x[i] - p[i];
  }
  if (rows > 3) {
    calib_turn_left(R, task->R, task->axis, turn);
    for (i = 0; i < 3; ++i) r[3 + i] = @lever@ * turn[i];
    for (i = 3 * CALIB_DOF; i < 6 * CALIB_DOF; ++i) J[i] *= @lever@;
  }
  if (task->kind == CALIB_AXIS) { /* along the tip's two other axes */
    calib_real sides[6], spin[3 * CALIB_DOF];
    for (i = 0; i < 6; ++i) sides[i] = R[3 * (i % 3) + (task->axis + 1 + i / 3) % 3];
    for (i = 0; i < 3; ++i) turn[i] = r[3 + i];
    for (i = 0; i < 3 * CALIB_DOF; ++i) spin[i] = J[3 * CALIB_DOF + i];
    calib_product(2, sides, 1, turn, r + 3);
    calib_product(2, sides, CALIB_DOF, spin, J + 3 * CALIB_DOF);
  }
  for (i = 0; i < rows; ++i) {
    squared += r[i] * r[i];
    for (k = 0; k < CALIB_DOF; ++k) J[i * CALIB_DOF + k] *= calib_span[k];
  }
  gap->left = sqrt(squared);
}
