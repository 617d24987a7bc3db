
static inline calib_real calib_not_a_number(void) { return (calib_real)NAN; }

/* Whether joint values are within the range that the model was learned for. */
static inline int calib_in_range(const calib_real q[CALIB_DOF]) {
  int i;
  for (i = 0; i < CALIB_DOF; ++i) {
    const calib_real u = (q[i] - calib_lower[i]) / calib_span[i];
    if (!calib_periodic[i] && !(u >= @slack@ && u <= 1 - @slack@)) return 0;
    if (!(u - u == 0)) return 0;
  }
  return 1;
}

/* Joint values with those of full turns moved into their range. */
static inline void calib_wrapped(const calib_real q[CALIB_DOF], calib_real out[CALIB_DOF]) {
  int i;
  for (i = 0; i < CALIB_DOF; ++i) {
    const calib_real u = (q[i] - calib_lower[i]) / calib_span[i];
    out[i] = calib_periodic[i] ? calib_lower[i] + (u - floor(u)) * calib_span[i] : q[i];
  }
}

