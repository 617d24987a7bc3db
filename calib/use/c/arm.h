
/* An arm: joint values are gain q + offset + curve, and bend under gravity. */
typedef struct {
  calib_real gain[CALIB_DOF], offset[CALIB_DOF], bending[CALIB_CHAIN];
  calib_real stride[CALIB_CHAIN][3], turned[CALIB_CHAIN][9], tip[3], tip_turn[9];
  int curves, elastic;
} calib_arm;
