  *bound = calib_blended(calib_bound, q);
