/* Tries the starts that are near to a position and to joints, the nearest first. */
static inline void calib_try_position(calib_search *search) {
  const int most = CALIB_TRIES < CALIB_STARTS ? CALIB_TRIES : CALIB_STARTS;
  calib_real q[CALIB_TRIES][CALIB_DOF], far[CALIB_TRIES];
  const calib_starts starts = {q[0], most, most / 6, most, @margin@ / 2};
  int row[CALIB_TRIES], count = 0;
  for (int n = 0; n < CALIB_STARTS; ++n) {
    const calib_real joints = calib_apart(calib_start_q[n], search->from);
    calib_real away = joints * joints;
    for (int i = 0; i < CALIB_OUT; ++i) {
      const calib_real gap = (search->task->x[i] - calib_start_x[n][i]) / @extent@;
      away += @pull@ * gap * gap;
    }
    count = calib_rank(n, away, count, most, far, row);
  }
  for (int n = 0; n < most; ++n) calib_copy(CALIB_DOF, calib_start_q[row[n]], q[n]);
  calib_try_starts(search, &starts);
}
