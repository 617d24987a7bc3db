
static inline void calib_wanted(const calib_real q[CALIB_DOF], calib_real x[CALIB_OUT]) {
  calib_body(calib_nominal, 0, q, x, 0, 0);
}

/* A start near q: positions alone are corrected. */
static inline void calib_posed(const calib_real q[CALIB_DOF], calib_real out[CALIB_DOF]) {
  (void)q;
  (void)out;
}
