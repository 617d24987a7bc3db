/* @title@
 *
 * Written by `calib export`; do not edit. C99, also valid C++.
 * Model checksum (SHA-256): @checksum@
 *
@facts@ *
 * Functions return 1 where there is an answer; else 0, and their results are NaN, unless they say
 * otherwise.  Joint values are in rad (or m where a joint slides), positions in @unit@.
 * Nothing is allocated, nothing recurses, nothing is kept between calls.
 * A search takes at most CALIB_BUDGET steps, CALIB_STEPS of a start.
 */
#ifndef @guard@
#define @guard@

#include <math.h>

#ifndef CALIB_API
#define CALIB_API static inline
#endif

typedef @real@ calib_real;

enum {
  CALIB_DOF = @dof@, CALIB_OUT = @out@, CALIB_CHAIN = @chain@, CALIB_HARMONICS = @harmonics@,
  CALIB_STARTS = @starts@, CALIB_STEPS = @steps@, CALIB_SLIDES = @slides@, CALIB_RUNS = @runs@,
  CALIB_TRIES = @tries@, CALIB_BUDGET = @budget@, CALIB_BENDS = @bends@
};

/* Joint values, what a sensor sees, vectors, matrices row by row, the chain's joints, derivatives. */
typedef calib_real calib_joints[CALIB_DOF], calib_place[CALIB_OUT], calib_vector[3];
typedef calib_real calib_rotation[9], calib_values[CALIB_CHAIN];
typedef calib_real calib_slopes[CALIB_CHAIN][CALIB_DOF];
/* Cosines, then sines, of the multiples of joint values. */
typedef calib_real calib_multiples[CALIB_HARMONICS][2 * CALIB_DOF];

/* An arm: joint values are mix q + bias, and what curves and loads add where it bends.  Joints move
 * about the third axes of their frames, of which each has its place and axes in the one before. */
typedef struct {
  calib_real mix[CALIB_CHAIN][CALIB_DOF], bias[CALIB_CHAIN];
  calib_real stride[CALIB_CHAIN + 1][3], turned[CALIB_CHAIN + 1][9]; /* the last are the tip's */
} calib_arm;
@tables@
static inline void calib_copy(int count, const calib_real *from, calib_real *to) {
  while (count-- > 0) to[count] = from[count];
}

/* Numbers that are not known; returns 0. */
static inline int calib_unknown(int count, calib_real *out) {
  while (count > 0) out[--count] = (calib_real)NAN;
  return 0;
}

/* Where a joint is in its range, of which it is 1 from end to end. */
static inline calib_real calib_share_of(int k, calib_real value) {
  return (value - calib_lower[k]) / calib_span[k];
}

/* A joint value, moved into its range where it goes round. */
static inline calib_real calib_wrapped(int k, calib_real value) {
  return calib_periodic[k] ? value - calib_span[k] * floor(calib_share_of(k, value)) : value;
}

/* Joints with full turns moved into their range; 0 where they are outside of what was learned. */
static inline int calib_inside(const calib_joints q, calib_joints out) {
  int inside = 1;
  for (int i = 0; i < CALIB_DOF; ++i) {
    const calib_real beyond = calib_periodic[i] ? 1 + @rounded@ : @rounded@; /* at most a turn */
    if (!(fabs(calib_share_of(i, q[i]) - (calib_real)0.5) <= (calib_real)0.5 + beyond)) inside = 0;
    out[i] = calib_wrapped(i, q[i]);
  }
  return inside;
}

static inline void calib_cross(const calib_vector a, const calib_vector b, calib_vector out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline calib_real calib_dot(int count, const calib_real *a, const calib_real *b) {
  calib_real sum = 0;
  for (int i = 0; i < count; ++i) sum += a[i] * b[i];
  return sum;
}

static inline calib_real calib_length(int count, const calib_real *vector) {
  return sqrt(calib_dot(count, vector, vector));
}

static inline calib_real calib_between(calib_real value, calib_real least, calib_real most) {
  return value > least ? value < most ? value : most : least;
}

/* The short way from b to a in shares of the joints' ranges; returns its length. */
static inline calib_real calib_way(const calib_joints a, const calib_joints b, calib_joints way) {
  for (int k = 0; k < CALIB_DOF; ++k) {
    const calib_real share = (a[k] - b[k]) / calib_span[k];
    way[k] = calib_periodic[k] ? share - floor(share + (calib_real)0.5) : share;
  }
  return calib_length(CALIB_DOF, way);
}

static inline calib_real calib_apart(const calib_joints a, const calib_joints b) {
  calib_real way[CALIB_DOF];
  return calib_way(a, b, way);
}

/* Rows of three of a matrix times `width` columns of three. */
static inline void calib_product(int rows, const calib_real *matrix, int width,
                                 const calib_real *columns, calib_real *out) {
  for (int i = 0; i < rows; ++i) {
    const calib_real a = matrix[3 * i], b = matrix[3 * i + 1], c = matrix[3 * i + 2];
    for (int k = 0; k < width; ++k)
      out[i * width + k] = a * columns[k] + b * columns[width + k] + c * columns[2 * width + k];
  }
}

/* Cosines and sines of many angles: by their series, of what is left of half turns; vectorised. */
static inline void calib_waves(int count, const calib_real *angle, calib_real *cosine,
                               calib_real *sine) {
  const calib_real coarse = (calib_real)3.141592653468251; /* half a turn without its last digits */
  const calib_real fine = (calib_real)(3.141592653589793 - (double)coarse);
  for (int i = 0; i < count; ++i) {
    const calib_real halves = floor(angle[i] / coarse + (calib_real)0.5);
    const calib_real rest = angle[i] - halves * coarse - halves * fine;
    const calib_real sign = 1 - 2 * (halves - 2 * floor(halves / 2));
    cosine[i] = sine[i] = sign;
    for (int n = 22; n > 0; n -= 2) {
      cosine[i] = sign - rest * rest / (calib_real)(n * (n - 1)) * cosine[i];
      sine[i] = sign - rest * rest / (calib_real)(n * (n + 1)) * sine[i];
    }
    sine[i] *= rest;
  }
}

/* Puts a row among the nearest so far, in their order; returns how many there are, at most `most`. */
static inline int calib_rank(int row, calib_real away, int count, int most, calib_real *far,
                             int *rows) {
  int k = count < most ? count : most - 1;
  if (count == most && !(away < far[k])) return most;
  for (; k > 0 && far[k - 1] > away; --k) {
    far[k] = far[k - 1];
    rows[k] = rows[k - 1];
  }
  far[k] = away;
  rows[k] = row;
  return count < most ? count + 1 : most;
}
