    {
      calib_real t = calib_gate[node[k]][CALIB_DOF];
      for (i = 0; i < CALIB_DOF; ++i) t += calib_gate[node[k]][i] * gap[k][i];
      t = t < 0 ? 0 : t > 1 ? 1 : t;
      w *= t * t * (3 - 2 * t);
    }
