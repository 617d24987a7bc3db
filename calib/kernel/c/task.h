/* What joints are asked for: a position of the sensor, or of the arm's root frame a place, a pose, or a
 * pose whose turn about one axis of the tip is free. */
typedef struct {
  const calib_arm *arm; /* 0: the sensor's model */
  int rows;             /* residuals: of a pose six, five where a turn is free */
  int axis;             /* of the tip, 0 to 2, about which the turn is free, or -1 */
  calib_real size;      /* a length that residuals are compared with */
  calib_real x[3], axes[9]; /* of the tip */
  int straight; /* whether the arm is taken without what bends it: a rough search */
} calib_task;

static inline calib_task calib_position_task(const calib_place x) {
  calib_task task = {0, CALIB_OUT, -1, @extent@, {0}, {0}, 0};
  calib_copy(CALIB_OUT, x, task.x);
  return task;
}

/* Turn that is left from axes to others, or from one of them to its other, a rotation vector. */
static inline void calib_turn_left(const calib_rotation from, const calib_rotation to, int axis,
                                   calib_vector turn) {
  calib_real across[3], cosine = axis < 0 ? -1 : 0; /* twice the cosine, and the sine */
  for (int k = 0; k < 3; ++k) turn[k] = 0;
  for (int i = 0; i < 3; ++i) {
    if (axis >= 0 && axis != i) continue;
    calib_cross(from + 3 * i, to + 3 * i, across);
    calib_add_times(1, across, turn);
    cosine += calib_dot(3, from + 3 * i, to + 3 * i);
  }
  const calib_real sine = calib_length(3, turn), angle = atan2(sine, cosine);
  if (!(sine > 0) && angle > 1) calib_copy(3, from + 3 * ((axis + 4) % 3), turn); /* half a turn */
  for (int k = 0; k < 3; ++k) turn[k] *= angle / (sine > 0 ? sine : 1);
}

/* What joints miss of a task: residuals, their derivative by the joints in shares of their ranges,
 * and the residuals' length.  A radian of turn counts as the arm's length. */
typedef struct {
  calib_real r[6], J[6 * CALIB_DOF], left;
} calib_gap;

static inline void calib_left(const calib_task *task, const calib_joints q, calib_gap *gap) {
  const int bends = CALIB_BENDS && !task->straight;
  calib_real *r = gap->r, *J = gap->J, p[3] = {0}, axes[9], turn[3];
  if (task->arm) calib_chain(task->arm, bends, q, p, axes, J);
  else if (@step_cost@ > 1 && task->straight) calib_seen(&calib_body, 0, q, p, J);
  else calib_model(q, p, J);
  for (int i = 0; i < 3; ++i) r[i] = task->x[i] - p[i];
  if (task->rows > 3) {
    calib_turn_left(axes, task->axes, task->axis, turn);
    for (int i = 0; i < 3; ++i) r[3 + i] = @lever@ * turn[i];
    for (int i = 3 * CALIB_DOF; i < 6 * CALIB_DOF; ++i) J[i] *= @lever@;
  }
  if (task->axis >= 0) { /* along the tip's two other axes */
    calib_real sides[6], spin[3 * CALIB_DOF];
    for (int i = 0; i < 2; ++i) calib_copy(3, axes + 3 * ((task->axis + 1 + i) % 3), sides + 3 * i);
    calib_copy(3, r + 3, turn);
    calib_copy(3 * CALIB_DOF, J + 3 * CALIB_DOF, spin);
    calib_product(2, sides, 1, turn, r + 3);
    calib_product(2, sides, CALIB_DOF, spin, J + 3 * CALIB_DOF);
  }
  for (int i = 0; i < task->rows; ++i)
    for (int k = 0; k < CALIB_DOF; ++k) J[i * CALIB_DOF + k] *= calib_span[k];
  gap->left = calib_length(task->rows, r);
}
