  {
    calib_real L[6], u[2];
    calib_pinhole(at, x, L, u);
    for (i = 0; i < 2; ++i)
      for (j = 0; j < 3; ++j)
        V[3 * i + j] = L[3 * i] * calib_view[j] + L[3 * i + 1] * calib_view[3 + j] +
                       L[3 * i + 2] * calib_view[6 + j];
  }
