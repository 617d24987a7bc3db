#include "arm.h"
#include <stdio.h>
int main(int count, char **names) {
  enum { SLOPES = CALIB_OUT * CALIB_DOF, ALL = CALIB_OUT + 1 + SLOPES + CALIB_DOF };
  double in[CALIB_DOF], out[ALL];
  calib_real q[CALIB_DOF], x[CALIB_OUT], J[SLOPES], e, fixed[CALIB_DOF];
  FILE *from, *to;
  int i;
  if (count != 3) return 1;
  from = fopen(names[1], "rb");
  to = fopen(names[2], "wb");
  if (!from || !to) return 1;
  while (fread(in, sizeof(double), CALIB_DOF, from) == CALIB_DOF) {
    for (i = 0; i < CALIB_DOF; ++i) q[i] = (calib_real)in[i];
    calib_forward(q, x);
    calib_jacobian(q, J);
    calib_expected_error(q, &e);
    calib_correct(q, fixed);
    for (i = 0; i < CALIB_OUT; ++i) out[i] = x[i];
    out[CALIB_OUT] = e;
    for (i = 0; i < SLOPES; ++i) out[CALIB_OUT + 1 + i] = J[i];
    for (i = 0; i < CALIB_DOF; ++i) out[CALIB_OUT + 1 + SLOPES + i] = fixed[i];
    fwrite(out, sizeof(double), ALL, to);
  }
  fclose(from);
  return fclose(to);
}
