/* @title@
 *
 * Written by `calib export`; do not edit. C99, also valid C++.
 * Model checksum (SHA-256): @checksum@
 *
@facts@ *
 * All functions return 1 where there is an answer; else 0, and their results are NaN.
 * Joint values are in rad (or m where a joint slides), positions in @unit@.
 */
#ifndef @guard@
#define @guard@

#include <math.h>

typedef @real@ calib_real;

enum {
  CALIB_DOF = @dof@, CALIB_OUT = @out@, CALIB_NODES = @nodes@, CALIB_NEAR = @near@,
  CALIB_HARMONICS = @harmonics@
};
#if @spatial@

enum { CALIB_CHAIN = @chain@ };

/* An arm: joint values are gain q + offset + curve, and bend under gravity. */
typedef struct {
  calib_real gain[CALIB_DOF], offset[CALIB_DOF], bending[CALIB_CHAIN];
  calib_real stride[CALIB_CHAIN][3], turned[CALIB_CHAIN][9], tip[3], tip_turn[9];
  int curves, elastic;
} calib_arm;
#endif
