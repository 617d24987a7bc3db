
/* Joints that bring the real tip to where the nominal arm would be with q, near q. */
static inline int calib_correct(const calib_real q[CALIB_DOF], calib_real out[CALIB_DOF]) {
  calib_real target[CALIB_OUT], start[CALIB_DOF], before[CALIB_DOF];
  calib_real held[CALIB_DOF], left, best = 0;
  int i, step;
  if (calib_in_range(q)) {
    calib_wrapped(q, start);
    for (i = 0; i < CALIB_DOF; ++i) out[i] = start[i];
    calib_wanted(start, target);
    calib_posed(start, out);
    for (i = 0; i < CALIB_DOF; ++i) held[i] = out[i];
    for (step = 0; step < 12; ++step) {
      for (i = 0; i < CALIB_DOF; ++i) before[i] = out[i];
      left = calib_newton_step(target, @calm@, out);
      if (!(step == 0 || left < best)) break;
      best = left;
      for (i = 0; i < CALIB_DOF; ++i) held[i] = before[i];
      if (left <= @enough@) break;
    }
    for (i = 0; i < CALIB_DOF; ++i) out[i] = held[i] + (q[i] - start[i]); /* on q's own turn */
    if (best <= @close@) return 1;
  }
  for (i = 0; i < CALIB_DOF; ++i) out[i] = calib_not_a_number();
  return 0;
}
