  for (i = 0; i < CALIB_OUT; ++i) x[i] = at[i];
