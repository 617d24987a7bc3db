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
