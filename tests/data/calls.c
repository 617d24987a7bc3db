int main(void) {
  double command[CALIB_DOF];
  calib_real q[CALIB_DOF], target[CALIB_OUT];
  int i;
  for (i = 0; i < CALIB_DOF; ++i) {
    q[i] = calib_lower[i] + calib_span[i] / 2;
    command[i] = (double)q[i];
  }
  filter_command(command);
  calib_forward(q, target);
  target[0] += calib_span[0] / 1000;
  return step_towards(target, q) ? 0 : 1;
}
