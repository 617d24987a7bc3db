/* Answers a question, a row of numbers, by another and returns a flag.  A question has joints, or
 * those that an answer should be near to, from 16 on a position (4), and how many budgets more a
 * search has; or of a pose its quaternion x, y, z, w, an axis of the tip that is free or -1, from
 * which distance on starts lead to other ways, how many starts there are, and these.  All ways are
 * asked for by the position alone. */
typedef int (*calib_row)(const calib_real *question, calib_real *answer);

/* Answers rows from `first` up to `last`, questions and answers so many numbers apart. */
CALIB_API void calib_many(calib_row row, long first, long last, const calib_real *question,
                          int width, calib_real *answer, int size, signed char *flag) {
  for (; first < last; ++first)
    flag[first] = (signed char)row(question + first * width, answer + first * size);
}

CALIB_API int calib_inverse_row(const calib_real *b, calib_real *out) {
  return calib_inverse_within(b + 16, b, CALIB_BUDGET * (1 + (int)b[20]), out);
}

CALIB_API int calib_inverse_all_row(const calib_real *x, calib_real *out) {
  return calib_inverse_all(x, @branches@, (calib_real(*)[CALIB_DOF])out);
}

#endif /* @guard@ */
