enum {
  CALIB_KNOTS = @knots@, CALIB_LOADS = @loads@, CALIB_PARTS = @parts@, CALIB_VIEW = 12,
  CALIB_BELIEFS = @beliefs@, CALIB_WAYS = @ways@, CALIB_TOGETHER = CALIB_BELIEFS * CALIB_WAYS
};

/* Amounts of what beliefs vary together in: CALIB_WAYS directions of each. */
typedef calib_real calib_ways[CALIB_TOGETHER];

/* Radius of 95 % of a Gaussian, by the trace of its covariance and the sum of its squares. */
static inline calib_real calib_radius_95(calib_real trace, calib_real squares) {
  const calib_real g = 2 * squares / (9 * trace * trace), r = 1 - g + @normal@ * sqrt(g);
  return trace > 0 ? sqrt(trace * r * r * r) : 0;
}

/* Adds amounts, so far apart, of rows of what beliefs vary together in. */
static inline void calib_add_rows(int count, const calib_real *__restrict amount, int apart,
                                  const calib_real *__restrict row, calib_real *__restrict sum) {
  int n;
  for (n = 0; n + 1 < count; n += 2, row += 2 * CALIB_TOGETHER) { /* two at a time are quicker */
    const calib_real a = amount[n * apart], b = amount[(n + 1) * apart];
    for (int r = 0; r < CALIB_TOGETHER; ++r) sum[r] += a * row[r] + b * row[CALIB_TOGETHER + r];
  }
  for (int r = 0; n < count && r < CALIB_TOGETHER; ++r) sum[r] += amount[n * apart] * row[r];
}
