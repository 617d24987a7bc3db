/* All ways to a position that the table of starts leads to, at most `most`, the nearest to the middle of
 * the joints' ranges first; returns how many. */
static inline int calib_inverse_all(const calib_place x, int most, calib_real q[][CALIB_DOF]) {
  calib_task task = calib_position_task(x);
  calib_search search = calib_begin(&task, calib_middle, most, CALIB_BUDGET * CALIB_TRIES, q[0]);
  calib_try_position(&search);
  return search.count;
}

/* As calib_inverse, with a budget of steps. */
static inline int calib_inverse_within(const calib_place x, const calib_joints near, int budget,
                                       calib_joints q) {
  calib_task task = calib_position_task(x);
  calib_search search;
  const int sure = calib_try_near(&search, &task, near, budget, q);
  if (sure == 2) calib_try_position(&search);
  if (!search.count && search.left < (calib_real)INFINITY) {
    calib_real bound; /* what misses by less than twice that may still count as reached */
    if (!calib_expected_error(search.way, &bound)) bound = @extent@;
    const calib_real least = CALIB_DOF > CALIB_OUT ? @edge@ * @extent@ / 2 : 0;
    bound = calib_between(bound, least, @sure@ * @extent@);
    if (search.budget > 0 && search.left > 2 * bound) return calib_answered(&search, near, 3);
    for (int n = 0; budget > CALIB_BUDGET && !search.count && n < CALIB_STARTS; ++n)
      calib_try(&search, calib_start_q[n]);
  }
  return calib_answered(&search, near, CALIB_DOF > CALIB_OUT ? sure : sure > 0);
}

/* Joints that bring the tip to a position: of several ways the one nearest to `near`, in shares of
 * the joints' ranges.  1, or 2 where another way might be nearer; 0 where none was found, 3 where
 * nothing reaches the position. */
static inline int calib_inverse(const calib_place x, const calib_joints near, calib_joints q) {
  return calib_inverse_within(x, near, CALIB_BUDGET, q);
}
