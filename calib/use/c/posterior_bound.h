  {
    calib_real inside[CALIB_DOF];
    calib_wrapped(q, inside);
    *bound = calib_posterior(inside);
  }
