/* Body: position; where J is not null its derivative by the joints (row by row), and where `at`
 * is not null each joint's nominal angle, direction and part of the chain, and the tip. */
static inline void calib_body(const calib_real *beta, int curves, const calib_real q[CALIB_DOF],
                              calib_real x[CALIB_OUT], calib_real *J, calib_real at[][5]) {
  calib_real psi[CALIB_DOF], theta[CALIB_DOF], own[CALIB_DOF], bend[CALIB_DOF][CALIB_DOF];
  calib_real ux[CALIB_DOF], uy[CALIB_DOF], px[CALIB_DOF];
  calib_real py[CALIB_DOF], tx[CALIB_DOF], ty[CALIB_DOF];
  calib_real sum = 0, angle = 0, sx = 0, sy = 0, w, yx, yy, r2;
  calib_real k, cx, cy, lx, ly, m00, m01, m10, m11;
  calib_real value[CALIB_DOF], slope[CALIB_DOF];
  int i, j, e = 0;
  if (curves) calib_curves(q, value, slope, J != 0);
  for (i = 0; i < CALIB_DOF; ++i) {
    if (calib_turns[i]) sum += calib_sign[i] * q[i];
    psi[i] = sum;
  }
  for (i = 0; i < CALIB_DOF; ++i) {
    own[i] = beta[@gain@ + i] * calib_sign[i];
    theta[i] = calib_turns[i] ? own[i] * q[i] + beta[@offset@ + i] : 0;
    for (j = 0; j < CALIB_DOF; ++j) bend[i][j] = 0;
  }
  for (i = 0; i < CALIB_DOF; ++i) {
    if (!calib_turns[i]) continue;
    for (j = i; j < CALIB_DOF; ++j) {
      calib_real a, b, c, s;
      if (!calib_turns[j]) continue;
      a = beta[@elastic@ + e];
      b = beta[@elastic@ + e + 1];
      e += 2;
      if (a == 0 && b == 0) continue;
      c = cos(psi[j]);
      s = sin(psi[j]);
      theta[i] += a * c + b * s;
      bend[i][j] = b * c - a * s;
    }
    if (curves) {
      theta[i] += value[i];
      own[i] += slope[i];
    }
  }
  for (i = 0; i < CALIB_DOF; ++i) {
    calib_real reach = beta[@length@ + i], turn;
    angle += theta[i];
    turn = calib_turns[i] ? angle : angle + beta[@offset@ + i];
    ux[i] = cos(turn);
    uy[i] = sin(turn);
    if (!calib_turns[i]) reach += own[i] * q[i] * @slide@;
    px[i] = reach * ux[i];
    py[i] = reach * uy[i];
    sx += px[i];
    sy += py[i];
    if (at) {
      at[i][0] = psi[i]; at[i][1] = ux[i]; at[i][2] = uy[i]; at[i][3] = px[i]; at[i][4] = py[i];
      at[CALIB_DOF][0] = sx; at[CALIB_DOF][1] = sy;
    }
  }
  m00 = calib_view[0]; m01 = calib_view[1]; m10 = calib_view[2]; m11 = calib_view[3];
  w = 1 + calib_view[6] * sx + calib_view[7] * sy;
  yx = (m00 * sx + m01 * sy) / w;
  yy = (m10 * sx + m11 * sy) / w;
  x[0] = yx + calib_view[4];
  x[1] = yy + calib_view[5];
  k = calib_lens[0]; cx = calib_lens[1]; cy = calib_lens[2];
  lx = (x[0] - calib_lens[3]) / calib_lens[5] - cx;
  ly = (x[1] - calib_lens[4]) / calib_lens[5] - cy;
  r2 = lx * lx + ly * ly;
  if (k != 0) {
    x[0] += calib_lens[5] * k * r2 * lx;
    x[1] += calib_lens[5] * k * r2 * ly;
  }
  if (!J) return;
  {
    const calib_real v00 = (m00 - yx * calib_view[6]) / w, v01 = (m01 - yx * calib_view[7]) / w;
    const calib_real v10 = (m10 - yy * calib_view[6]) / w, v11 = (m11 - yy * calib_view[7]) / w;
    const calib_real l00 = 1 + k * (r2 + 2 * lx * lx);
    const calib_real l01 = 2 * k * lx * ly;
    const calib_real l11 = 1 + k * (r2 + 2 * ly * ly);
    calib_real after_x = 0, after_y = 0, dx, dy, gx, gy;
    for (i = CALIB_DOF - 1; i >= 0; --i) {
      after_x += px[i];
      after_y += py[i];
      tx[i] = -after_y; /* j times the part of the chain that joint i turns */
      ty[i] = after_x;
    }
    for (i = 0; i < CALIB_DOF; ++i) {
      if (calib_turns[i]) {
        dx = tx[i] * own[i];
        dy = ty[i] * own[i];
      } else {
        dx = ux[i] * own[i] * @slide@;
        dy = uy[i] * own[i] * @slide@;
      }
      if (calib_turns[i]) {
        int a, b;
        for (a = 0; a < CALIB_DOF; ++a)
          for (b = i; b < CALIB_DOF; ++b) {
            dx += tx[a] * bend[a][b] * calib_sign[i];
            dy += ty[a] * bend[a][b] * calib_sign[i];
          }
      }
      gx = v00 * dx + v01 * dy;
      gy = v10 * dx + v11 * dy;
      J[i] = l00 * gx + l01 * gy;
      J[CALIB_DOF + i] = l01 * gx + l11 * gy;
    }
  }
}


static inline void calib_smooth(const calib_real q[CALIB_DOF], calib_real *x, calib_real *J) {
  calib_body(calib_beta, @curves@, q, x, J, 0);
}
