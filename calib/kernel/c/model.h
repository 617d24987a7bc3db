/* What the model says, wherever q is. */
static inline void calib_model(const calib_joints q, calib_real *x, calib_real *J) {
  calib_seen(&calib_body, CALIB_BENDS, q, x, J);
#if @local_terms@
  calib_local(q, x, J);
#endif
}
