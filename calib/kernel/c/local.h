/* Factor on what nodes with a model say, by their share of the weight beside those without one. */
static inline calib_real calib_heard(calib_real share) {
  const calib_real t = calib_between((share - @silent@) / (@full@ - @silent@), 0, 1);
  return t * t * (3 - 2 * t) / (share > @silent@ ? share : @silent@);
}

/* Local models of what the body leaves over, added to position and derivative. */
static inline void calib_local(const calib_joints q, calib_real *x, calib_real *J) {
  calib_real weight[CALIB_NEAR], gap[CALIB_DOF], value[@terms@], loud = 0;
  int node[CALIB_NEAR + 1];
  calib_near(q, node, weight);
  for (int k = 0; k < CALIB_NEAR; ++k)
    if (calib_talks[node[k]]) loud += weight[k];
  for (int k = 0; k < CALIB_NEAR; ++k) {
    const calib_real r = calib_radius[node[k]], w = weight[k] * calib_heard(loud);
    const calib_real *c = calib_local_terms[node[k]];
    if (!calib_talks[node[k]]) continue;
    calib_way(q, calib_node[node[k]], gap);
    value[0] = 1;
    for (int t = 1; t < @terms@; ++t) value[t] = value[calib_parent[t]] * gap[calib_along[t]] / r;
    for (int t = 0; t < @terms@; ++t)
      for (int o = 0; o < CALIB_OUT; ++o) x[o] += w * c[t * CALIB_OUT + o] * value[t];
    for (int t = 1; J && t < @terms@; ++t)
      for (int i = 0; i < CALIB_DOF; ++i) {
        const calib_real slope = calib_power[t][i] * value[calib_below[t][i]];
        const calib_real rate = w * slope / (r * calib_span[i]);
        for (int o = 0; o < CALIB_OUT; ++o) J[o * CALIB_DOF + i] += rate * c[t * CALIB_OUT + o];
      }
  }
}
