#if @node@

enum { CALIB_NODES = @nodes@, CALIB_NEAR = @near@ };

/* The nodes that speak for q and their weights, which sum to one. */
static inline void calib_near(const calib_real *q, int *node, calib_real *weight, calib_joints u) {
  calib_real far[CALIB_NEAR + 1], total = 0;
  int place[CALIB_NEAR + 1], found = 0, i, n, k;
  for (i = 0; i < CALIB_DOF; ++i) {
    u[i] = calib_share_of(i, q[i]);
    if (calib_periodic[i]) u[i] -= floor(u[i]);
  }
  for (n = 0; n < CALIB_NODES; ++n) {
    calib_real d = 0;
    for (i = 0; i < CALIB_DOF; ++i) {
      const calib_real g = calib_short(i, u[i] - calib_node[n][i]);
      d += g * g;
    }
    if (found == CALIB_NEAR + 1 && !(d < far[CALIB_NEAR])) continue;
    k = found < CALIB_NEAR + 1 ? found++ : CALIB_NEAR;
    while (k > 0 && far[k - 1] > d) {
      far[k] = far[k - 1];
      place[k] = place[k - 1];
      --k;
    }
    far[k] = d;
    place[k] = n;
  }
  for (k = 0; k < CALIB_NEAR; ++k) {
    const calib_real r = far[CALIB_NEAR] > 0 ? 1 - far[k] / far[CALIB_NEAR] : 1;
    weight[k] = r * r;
    node[k] = place[k];
    total += weight[k];
  }
  for (k = 0; k < CALIB_NEAR; ++k)
    weight[k] = total > 0 ? weight[k] / total : (calib_real)1 / CALIB_NEAR;
}

/* Values of the nodes, blended at q. */
static inline calib_real calib_blended(const calib_real *values, const calib_joints q) {
  int node[CALIB_NEAR], k;
  calib_real weight[CALIB_NEAR], u[CALIB_DOF], sum = 0;
  calib_near(q, node, weight, u);
  for (k = 0; k < CALIB_NEAR; ++k) sum += weight[k] * values[node[k]];
  return sum;
}
#endif

