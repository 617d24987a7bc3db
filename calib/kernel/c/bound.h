#if @ways@

/* Radius of 95 % of a Gaussian of covariance S (xx, xy, xz, yy, yz, zz) and more (3). */
static inline calib_real calib_radius_95(const calib_real S[6], calib_real share,
                                         const calib_real more[3]) {
  const calib_real a = share * S[0] + more[0], d = share * S[3] + more[1];
  const calib_real f = share * S[5] + more[2], trace = a + d + f;
  const calib_real off = share * share * (S[1] * S[1] + S[2] * S[2] + S[4] * S[4]);
  const calib_real square = a * a + d * d + f * f + 2 * off;
  calib_real g, r;
  if (!(trace > 0)) return 0;
  g = (calib_real)2 / 9 * square / (trace * trace);
  r = 1 - g + @normal@ * sqrt(g);
  return sqrt(trace * r * r * r);
}

/* How what is seen moves with whatever of an arm and its sensor may be off: the view's matrix,
 * shift and lens; each joint's origin, shifted and turned in its own frame; the tip; each joint's
 * offset, gain and coupling; how loads bend them, and where gravity points.  Parameters of a body
 * are sums of these. */
static inline void calib_derivatives(const calib_real q[CALIB_DOF],
                                     calib_real geometry[CALIB_GEOMETRY][3],
                                     calib_real own[CALIB_DOF][3]) {
  calib_real at[CALIB_CHAIN + 1][21], chained[CALIB_CHAIN][3], p[3], R[9], arrow[3], about[3];
  calib_real moved[3], (*out)[3] = geometry;
  int i, a, k;
#if @gravity@
  calib_real hinge[CALIB_CHAIN][3], swing[CALIB_CHAIN][CALIB_POINTS][3];
  calib_swings(q, hinge, swing);
#endif
  calib_chain(&calib_body, 0, q, p, R, 0, at);
  for (i = 0; i < CALIB_GEOMETRY; ++i)
    for (k = 0; k < 3; ++k) geometry[i][k] = 0;
  for (k = 0; k < 3; ++k) {
    for (a = 0; a < 3; ++a) out[3 * k + a][k] = p[a];
    out[9 + k][k] = 1;
  }
  out += 12;
  for (i = 0; i <= CALIB_CHAIN; ++i, out += 3) /* shifts of the origins and of the tip */
    for (a = 0; a < 3; ++a) {
      for (k = 0; k < 3; ++k) moved[k] = at[i][3 * k + a];
      for (k = 0; k < 3; ++k) out[a][k] = calib_dot(calib_view + 3 * k, moved);
    }
  for (i = 0; i < CALIB_CHAIN; ++i, out += 3) { /* turns of the origins, and the joints */
    for (k = 0; k < 3; ++k) arrow[k] = p[k] - at[i][18 + k];
    for (a = 0; a < 3; ++a) {
      for (k = 0; k < 3; ++k) about[k] = at[i][9 + 3 * k + a];
      calib_cross(about, arrow, moved);
      for (k = 0; k < 3; ++k) out[a][k] = calib_dot(calib_view + 3 * k, moved);
    }
    for (k = 0; k < 3; ++k) about[k] = calib_dot(at[i] + 9 + 3 * k, calib_body.axis[i]);
    if (calib_bends[i]) calib_cross(about, arrow, about);
    for (k = 0; k < 3; ++k) chained[i][k] = calib_dot(calib_view + 3 * k, about);
  }
  for (k = 0; k < CALIB_DOF; ++k)
    for (a = 0; a < 3; ++a) {
      own[k][a] = 0;
      for (i = 0; i < CALIB_CHAIN; ++i) own[k][a] += calib_coupling[i][k] * chained[i][a];
      out[k][a] = own[k][a];
      out[CALIB_DOF + k][a] = own[k][a] * q[k];
    }
  out += 2 * CALIB_DOF;
#if @neighbour@
  for (k = 1; k < CALIB_DOF; ++k)
    for (a = 0; a < 3; ++a) out[k - 1][a] = own[k][a] * q[k - 1];
  out += CALIB_DOF - 1;
#endif
#if @gravity@
  for (i = 0; i < CALIB_LOADS; ++i) {
    const int joint = calib_loaded[i];
    calib_real lever[3];
    int n;
    for (k = 0; k < 3; ++k) {
      lever[k] = 0;
      for (n = 0; n < CALIB_POINTS; ++n) lever[k] += calib_weight[i][n] * swing[joint][n][k];
    }
    for (a = 0; a < 3; ++a) {
      out[i][a] = chained[joint][a] * calib_dot(lever, calib_gravity);
      for (k = 0; k < 2; ++k) /* gravity is tilted */
        out[CALIB_LOADS + k][a] +=
            chained[joint][a] * calib_elastic[i] * calib_dot(lever, calib_tilt[k]);
    }
  }
  out += CALIB_LOADS + 2;
#endif
#if @way@
  {
    calib_real psi = 0;
    for (k = 0; k < CALIB_DOF; ++k) {
      psi += calib_way[k] * q[k];
      for (i = 0; i <= k; ++i, out += 2)
        for (a = 0; a < 3; ++a) {
          out[0][a] = own[i][a] * cos(psi);
          out[1][a] = own[i][a] * sin(psi);
        }
    }
  }
#endif
#if @lens@
  {
    calib_real seen[3], x[2], L[6], u[2];
    for (k = 0; k < 3; ++k) seen[k] = calib_shift[k] + calib_dot(calib_view + 3 * k, p);
    calib_pinhole(seen, x, L, u);
    for (i = 0; i < CALIB_GEOMETRY + CALIB_DOF; ++i) {
      calib_real *each = i < CALIB_GEOMETRY ? geometry[i] : own[i - CALIB_GEOMETRY];
      const calib_real across = calib_dot(L, each);
      each[1] = calib_dot(L + 3, each);
      each[0] = across;
      each[2] = 0;
    }
    for (k = 0; k < 2; ++k) {
      out[0][k] = (x[k] - calib_lens[1 + k]) / calib_lens[0];
      out[1 + k][k] = 1;
      out[3][k] = calib_lens[0] * u[k] * (u[0] * u[0] + u[1] * u[1]);
    }
  }
#else
  for (i = 0; i < CALIB_GEOMETRY + CALIB_DOF; ++i)
    for (k = CALIB_OUT; k < 3; ++k)
      (i < CALIB_GEOMETRY ? geometry[i] : own[i - CALIB_GEOMETRY])[k] = 0;
#endif
}

/* out += each of the numbers of a position times a row of what beliefs vary together in. */
static inline void calib_spanned(const calib_real by[3], const float *row,
                                 calib_real out[3][CALIB_TOGETHER]) {
  int k, r;
  for (k = 0; k < CALIB_OUT; ++k)
    for (r = 0; r < CALIB_TOGETHER; ++r) out[k][r] += by[k] * row[r];
}
#if @waved@

/* What joints' curves add: together with all else to z, and the variance of each by itself. */
static inline void calib_curve_spread(const calib_real q[CALIB_DOF],
                                      calib_real own[CALIB_DOF][3],
                                      calib_real z[3][CALIB_TOGETHER],
                                      calib_real alone[CALIB_BELIEFS][CALIB_DOF]) {
  calib_real wave[4 * CALIB_HARMONICS][CALIB_DOF], sum[CALIB_TOGETHER];
  int b, i, k, n, r;
  for (i = 0; i < CALIB_DOF; ++i) { /* cosines and sines of multiples, next to each other */
    wave[0][i] = cos(q[i]);
    wave[1][i] = sin(q[i]);
  }
  for (n = 2; n < 4 * CALIB_HARMONICS; n += 2)
    for (i = 0; i < CALIB_DOF; ++i) {
      wave[n][i] = wave[n - 2][i] * wave[0][i] - wave[n - 1][i] * wave[1][i];
      wave[n + 1][i] = wave[n - 2][i] * wave[1][i] + wave[n - 1][i] * wave[0][i];
    }
  for (b = 0; b < CALIB_BELIEFS; ++b) {
    for (i = 0; i < CALIB_DOF; ++i) alone[b][i] = calib_alone[b][0][i];
    for (n = 0; n < 4 * CALIB_HARMONICS; ++n)
      for (i = 0; i < CALIB_DOF; ++i) alone[b][i] += calib_alone[b][n + 1][i] * wave[n][i];
  }
  for (i = 0; i < CALIB_DOF; ++i) {
    for (r = 0; r < CALIB_TOGETHER; ++r) sum[r] = 0;
    for (n = 0; n < 2 * CALIB_HARMONICS; ++n)
      for (r = 0; r < CALIB_TOGETHER; ++r) sum[r] += wave[n][i] * calib_waved[i][n][r];
    for (k = 0; k < CALIB_OUT; ++k)
      for (r = 0; r < CALIB_TOGETHER; ++r) z[k][r] += own[i][k] * sum[r];
  }
}
#endif

static inline calib_real calib_posterior(const calib_real q[CALIB_DOF], const calib_real more[3]) {
  calib_real geometry[CALIB_GEOMETRY][3], own[CALIB_DOF][3], z[3][CALIB_TOGETHER];
  calib_real alone[CALIB_BELIEFS][CALIB_DOF], bound = 0;
  int b, i, j, k, n, r;
  calib_derivatives(q, geometry, own);
  for (k = 0; k < 3; ++k)
    for (r = 0; r < CALIB_TOGETHER; ++r) z[k][r] = 0;
  for (b = 0; b < CALIB_BELIEFS; ++b)
    for (i = 0; i < CALIB_DOF; ++i) alone[b][i] = 0;
  for (i = 0; i < CALIB_GEOMETRY; ++i) calib_spanned(geometry[i], calib_ways[i], z);
#if @waved@
  calib_curve_spread(q, own, z, alone);
#endif
  for (b = 0; b < CALIB_BELIEFS; ++b) {
    const int first = b * (CALIB_TOGETHER / CALIB_BELIEFS);
    calib_real S[6], apart = 0;
    for (n = 0, j = 0; j < 3; ++j)
      for (k = j; k < 3; ++k, ++n) {
        S[n] = 0;
        for (r = first; r < first + CALIB_TOGETHER / CALIB_BELIEFS; ++r)
          S[n] += calib_gains[r] * z[j][r] * z[k][r];
        for (i = 0; i < CALIB_DOF; ++i) S[n] += alone[b][i] * own[i][j] * own[i][k];
      }
    /* the last direction is by how much the beliefs are apart */
    r = first + CALIB_TOGETHER / CALIB_BELIEFS - 1;
    for (k = 0; k < 3; ++k) apart += z[k][r] * z[k][r];
    apart = sqrt(apart) + calib_belief_scale[b][0] * calib_radius_95(S, calib_belief_scale[b][1], more);
    if (apart > bound) bound = apart;
  }
  return bound;
}
#endif
