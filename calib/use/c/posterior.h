
/* How a position moves along a direction of the parameters. */
static inline void calib_along(const float *direction, calib_real geometry[][3],
                               calib_real own[][3], calib_real wave[][4 * @waves@],
                               calib_real out[3]) {
  int i, k, n;
  for (k = 0; k < 3; ++k) out[k] = 0;
  for (i = 0; i < CALIB_GEOMETRY; ++i)
    for (k = 0; k < 3; ++k) out[k] += direction[i] * geometry[i][k];
  if (!wave) return;
  for (i = 0; i < CALIB_DOF; ++i) {
    const float *curve = direction + CALIB_GEOMETRY + 2 * @waves@ * i;
    calib_real sum = 0;
    for (n = 0; n < @waves@; ++n)
      sum += curve[n] * wave[i][2 * n] + curve[@waves@ + n] * wave[i][2 * n + 1];
    for (k = 0; k < 3; ++k) out[k] += sum * own[i][k];
  }
}

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

static inline calib_real calib_posterior(const calib_real q[CALIB_DOF]) {
  static const int first[6] = {0, 0, 0, 1, 1, 2}, other[6] = {0, 1, 2, 1, 2, 2};
  calib_real geometry[CALIB_GEOMETRY][3], own[CALIB_DOF][3], wave[CALIB_DOF][4 * @waves@];
  calib_real S[6], y[3], bound = 0, apart;
  int b, i, k, n;
  calib_derivatives(q, geometry, own);
  for (i = 0; i < CALIB_DOF; ++i) {
    const calib_real c = cos(q[i]), s = sin(q[i]);
    wave[i][0] = c;
    wave[i][1] = s;
    for (n = 1; n < 2 * @waves@; ++n) {
      wave[i][2 * n] = wave[i][2 * n - 2] * c - wave[i][2 * n - 1] * s;
      wave[i][2 * n + 1] = wave[i][2 * n - 2] * s + wave[i][2 * n - 1] * c;
    }
  }
  for (b = 0; b < @beliefs@; ++b) {
    for (k = 0; k < 6; ++k) S[k] = 0;
    for (i = 0; i < CALIB_GEOMETRY; ++i) {
      calib_along(calib_root[b * CALIB_GEOMETRY + i], geometry, own, 0, y);
      for (k = 0; k < 6; ++k) S[k] += y[first[k]] * y[other[k]];
    }
    for (i = 0; i < CALIB_DOF; ++i) {
      const float *term = calib_own[b * CALIB_DOF + i];
      calib_real size = term[0];
      for (n = 0; n < 4 * @waves@; ++n) size += term[1 + n] * wave[i][n];
      for (k = 0; k < 6; ++k) S[k] += size * own[i][first[k]] * own[i][other[k]];
    }
    for (i = 0; i < @rank@; ++i) {
      calib_along(calib_coupled[b * (@rank@ + 1) + i], geometry, own, wave, y);
      for (k = 0; k < 6; ++k) S[k] += calib_gains[b * @rank@ + i] * y[first[k]] * y[other[k]];
    }
    calib_along(calib_coupled[b * (@rank@ + 1) + @rank@], geometry, own, wave, y);
    apart = sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]);
    apart += calib_scale[b][0] * calib_radius_95(S, calib_scale[b][1], calib_more);
    if (apart > bound) bound = apart;
  }
  return bound;
}
