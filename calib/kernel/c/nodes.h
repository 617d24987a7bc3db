enum { CALIB_NODES = @nodes@, CALIB_NEAR = @near@ };

/* The nodes that speak for q and their weights, which sum to one; the last node's is none. */
static inline void calib_near(const calib_joints q, int node[CALIB_NEAR + 1],
                              calib_real weight[CALIB_NEAR]) {
  calib_real far[CALIB_NEAR + 1], total = 0;
  int count = 0;
  for (int n = 0; n < CALIB_NODES; ++n) {
    const calib_real away = calib_apart(q, calib_node[n]);
    count = calib_rank(n, away * away, count, CALIB_NEAR + 1, far, node);
  }
  for (int k = 0; k < CALIB_NEAR; ++k) {
    const calib_real r = far[CALIB_NEAR] > 0 ? 1 - far[k] / far[CALIB_NEAR] : 1;
    weight[k] = r * r;
    total += weight[k];
  }
  for (int k = 0; k < CALIB_NEAR; ++k)
    weight[k] = total > 0 ? weight[k] / total : (calib_real)1 / CALIB_NEAR;
}

/* Values of the nodes, blended at q. */
static inline calib_real calib_blended(const calib_real *values, const calib_joints q) {
  int node[CALIB_NEAR + 1];
  calib_real weight[CALIB_NEAR], sum = 0;
  calib_near(q, node, weight);
  for (int k = 0; k < CALIB_NEAR; ++k) sum += weight[k] * values[node[k]];
  return sum;
}
