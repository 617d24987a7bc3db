/* Tries the starts of a position's cell of the workspace; where they lead nowhere some all over. */
static inline void calib_try_position(calib_search *search) {
  int cell = 0;
  for (int i = 0; i < CALIB_OUT; ++i) {
    const calib_real u = (search->task->x[i] - calib_grid_lower[i]) / calib_grid_step[i];
    cell = cell * calib_grid[i] + (int)calib_between(u, 0, calib_grid[i] - (calib_real)0.5);
  }
  const int first = calib_cell[cell], count = calib_cell[cell + 1] - first;
  const calib_starts starts = {calib_start_q[first], count, count, count, @margin@ / 2};
  calib_try_starts(search, &starts);
  for (int i = 0; !search->count && i < CALIB_STARTS; i += 1 + CALIB_STARTS / CALIB_TRIES)
    calib_try(search, calib_start_q[i]);
}
