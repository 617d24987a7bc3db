/* Joints that bring the real tip to where the nominal arm would be with q, near q; with six joints
 * or more also its orientation.  0 where none do, or a joint would change by more than usual. */
CALIB_API int calib_correct(const calib_joints q, calib_joints out) {
  calib_task task = {&calib_body, @correcting@, -1, @lever@, {0}, {0}, 0};
  calib_real start[CALIB_DOF], way[CALIB_DOF], x[CALIB_OUT];
  calib_gap gap;
  int good = calib_inside(q, start);
  calib_copy(CALIB_DOF, start, out);
  calib_chain(&calib_nominal, 0, start, task.x, task.axes, 0);
  calib_seen(&calib_nominal, 0, start, x, 0);
  calib_task seen = calib_position_task(x);
  calib_search search = calib_begin(&task, start, 0, CALIB_BUDGET, 0);
  if (task.rows) good = good && calib_descend(&search, 0, out, &gap);
  search.task = &seen; /* what local models move is met as a position */
  if (@correcting_seen@) good = good && calib_descend(&search, 0, out, &gap);
  calib_way(out, start, way);
  for (int k = 0; k < CALIB_DOF; ++k) {
    const calib_real change = calib_span[k] * way[k];
    if (!(fabs(change) <= calib_limit[k])) good = 0;
    out[k] = q[k] + change; /* on q's own turn, not beyond a stop */
    if (calib_allowed(k, q[k]) && !calib_allowed(k, out[k])) good = 0;
  }
  return good ? good : calib_unknown(CALIB_DOF, out);
}
