#if @local@

/* Whether a node still speaks at a multiple of its reach: 1, falling to 0 at twice the reach. */
static inline calib_real calib_share(calib_real ratio) {
  calib_real r = ratio < 1 ? 0 : ratio - 1;
  r = r > 1 ? 0 : 1 - r * r;
  return r * r;
}

/* Factor on what nodes with a model say, by their share of the weight beside those without one. */
static inline calib_real calib_heard(calib_real share) {
  const calib_real silent = @silent@;
  calib_real t = (share - silent) / (@full@ - silent);
  t = t < 0 ? 0 : t > 1 ? 1 : t;
  return t * t * (3 - 2 * t) / (share > silent ? share : silent);
}

/* Local models of what the body leaves over, added to position and derivative. */
static inline void calib_local(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_real weight[CALIB_NEAR], u[CALIB_DOF], gap[CALIB_NEAR][CALIB_DOF], total = 0, left = 0;
  calib_real loud = 0;
  int node[CALIB_NEAR], i, k, t, o;
  calib_near(q, node, weight, u);
  for (k = 0; k < CALIB_NEAR; ++k) {
    calib_real far = 0, share = 1;
    for (i = 0; i < CALIB_DOF; ++i) {
      calib_real g = u[i] - calib_node[node[k]][i];
      if (calib_periodic[i]) g -= floor(g + (calib_real)0.5);
      gap[k][i] = g;
      far += g * g;
    }
    share = calib_share(sqrt(far) / calib_says[node[k]]);
    weight[k] *= share;
    total += weight[k];
    if (calib_talks[node[k]]) loud += weight[k];
    if (share > left) left = share;
  }
  left *= calib_heard(total > 0 ? loud / total : 0);
  for (k = 0; k < CALIB_NEAR; ++k) {
    const calib_real r = calib_radius[node[k]];
    const calib_real *c = calib_local_terms[node[k]];
    calib_real w = total > 0 ? weight[k] * left / total : 0;
    calib_real value[@terms@];
    if (!(w > 0)) continue;
    value[0] = 1;
    for (t = 1; t < @terms@; ++t)
      value[t] = value[calib_parent[t]] * gap[k][calib_along[t]] / r;
    for (t = 0; t < @terms@; ++t)
      for (o = 0; o < CALIB_OUT; ++o) x[o] += w * c[t * CALIB_OUT + o] * value[t];
    if (!J) continue;
    for (t = 1; t < @terms@; ++t)
      for (i = 0; i < CALIB_DOF; ++i) {
        const int power = calib_power[t * CALIB_DOF + i];
        if (!power) continue;
        for (o = 0; o < CALIB_OUT; ++o)
          J[o * CALIB_DOF + i] += w * c[t * CALIB_OUT + o] * (calib_real)power *
                                  value[calib_below[t * CALIB_DOF + i]] / (r * calib_span[i]);
      }
  }
}
#endif

