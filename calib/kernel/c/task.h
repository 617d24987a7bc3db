
/* What joints are asked for: a position of the sensor; a place, a pose, or a pose whose turn about
 * one axis of the tip is free, of the arm's root frame. */
enum { CALIB_POSITION, CALIB_PLACE, CALIB_POSE, CALIB_AXIS };

typedef struct {
  int kind;
  int axis;             /* of CALIB_AXIS: 0, 1 or 2, an axis of the tip's frame */
  const calib_arm *arm; /* of all kinds but CALIB_POSITION */
  calib_real x[3], R[9];
} calib_task;

static inline int calib_rows(const calib_task *task) {
  switch (task->kind) {
    case CALIB_POSITION: return CALIB_OUT;
    case CALIB_PLACE: return 3;
    case CALIB_AXIS: return 5;
    default: return 6;
  }
}

/* A length that a task's residuals are compared with. */
static inline calib_real calib_size(const calib_task *task) {
  return task->kind == CALIB_POSITION ? @extent@ : @lever@;
}

/* Turn that is left from R to another orientation S, a rotation vector. */
static inline void calib_turn_left(const calib_real R[9], const calib_real S[9],
                                   calib_real turn[3]) {
  calib_real sine, cosine = -1, angle, across[3];
  int i, k;
  for (k = 0; k < 3; ++k) turn[k] = 0;
  for (i = 0; i < 3; ++i) { /* half the sum of the cross products of columns */
    const calib_real a[3] = {R[i], R[3 + i], R[6 + i]};
    const calib_real b[3] = {S[i], S[3 + i], S[6 + i]};
    calib_cross(a, b, across);
    for (k = 0; k < 3; ++k) turn[k] += across[k] / 2;
    cosine += calib_dot(a, b);
  }
  sine = sqrt(calib_dot(turn, turn));
  angle = atan2(sine, cosine / 2);
  for (k = 0; k < 3; ++k) turn[k] = sine > 0 ? turn[k] * angle / sine : 0;
  if (!(sine > 0) && cosine < 0) turn[0] = angle; /* half a turn: any axis will do */
}

/* Turn that is left from one direction to another; perpendicular to both. */
static inline void calib_swing_left(const calib_real a[3], const calib_real b[3],
                                    calib_real turn[3]) {
  calib_real sine, angle;
  int k;
  calib_cross(a, b, turn);
  sine = sqrt(calib_dot(turn, turn));
  angle = atan2(sine, calib_dot(a, b));
  for (k = 0; k < 3; ++k) turn[k] = sine > 0 ? turn[k] * angle / sine : 0;
  if (!(sine > 0) && angle > 1) { /* half a turn, about any axis that is perpendicular to a */
    const calib_real other[3] = {a[1], a[2], -a[0]};
    calib_cross(a, other, turn);
    sine = sqrt(calib_dot(turn, turn));
    for (k = 0; k < 3; ++k) turn[k] *= angle / sine;
  }
}

/* Residuals of a pose beyond its position, and their derivative, in place of the rows 3 to 5 of a
 * geometric Jacobian. */
static inline void calib_turn_rows(const calib_task *task, const calib_real R[9], calib_real r[6],
                                   calib_real J[6 * CALIB_DOF]) {
  calib_real turn[3];
  int i, k;
  if (task->kind == CALIB_POSE) {
    calib_turn_left(R, task->R, turn);
    for (i = 0; i < 3; ++i) r[3 + i] = @lever@ * turn[i];
    for (i = 3 * CALIB_DOF; i < 6 * CALIB_DOF; ++i) J[i] *= @lever@;
  } else {
    const int free = task->axis, first = (free + 1) % 3, second = (free + 2) % 3;
    const calib_real a[3] = {R[free], R[3 + free], R[6 + free]};
    const calib_real b[3] = {R[first], R[3 + first], R[6 + first]};
    const calib_real c[3] = {R[second], R[3 + second], R[6 + second]};
    const calib_real wanted[3] = {task->R[free], task->R[3 + free], task->R[6 + free]};
    calib_swing_left(a, wanted, turn);
    r[3] = @lever@ * calib_dot(b, turn);
    r[4] = @lever@ * calib_dot(c, turn);
    for (k = 0; k < CALIB_DOF; ++k) {
      const calib_real spin[3] = {J[3 * CALIB_DOF + k], J[4 * CALIB_DOF + k],
                                  J[5 * CALIB_DOF + k]};
      J[3 * CALIB_DOF + k] = @lever@ * calib_dot(b, spin);
      J[4 * CALIB_DOF + k] = @lever@ * calib_dot(c, spin);
    }
  }
}

/* What joints miss of a task: residuals, their derivative by the joints in shares of their ranges,
 * and the residuals' length.  A radian of turn counts as the arm's length. */
typedef struct {
  calib_real r[6], J[6 * CALIB_DOF], left;
} calib_gap;

static inline void calib_left(const calib_task *task, const calib_real q[CALIB_DOF],
                              calib_gap *gap) {
  calib_real *r = gap->r, *J = gap->J, squared = 0, p[3], R[9];
  int i, k;
  if (task->kind == CALIB_POSITION) {
    calib_model(q, r, J);
    for (i = 0; i < CALIB_OUT; ++i) r[i] = task->x[i] - r[i];
  } else {
    calib_chain(task->arm, q, p, R, J, 0);
    for (i = 0; i < 3; ++i) r[i] = task->x[i] - p[i];
    if (task->kind != CALIB_PLACE) calib_turn_rows(task, R, r, J);
  }
  for (i = 0; i < calib_rows(task); ++i) {
    squared += r[i] * r[i];
    for (k = 0; k < CALIB_DOF; ++k) J[i * CALIB_DOF + k] *= calib_span[k];
  }
  gap->left = sqrt(squared);
}
