/* Limit of rotation rates: core/body/pose_slew_limit.py. */

/* turn (3,) from a rotation to another, in its frame */
static void STAGE(turn)(const double *from, const double *to, double *turn) {
  const double back[4] = {from[0], -from[1], -from[2], -from[3]};
  double q[4];
  STAGE(multiply)(back, to, q);
  STAGE(rotation_vector)(q, turn);
}

/* limited (J, 4): rotations (J, 4), J > 0, that turn from those shown (J, 4) by no more than they may; the root is not
   limited. turned (J, 3): turns per frame from `raw` (J, 4), the last rotations. earlier (T, J, 3): such turns of the
   frames before, or none. gathered: increase of these per frame; usual (J,): what needs no explanation; ways (M,):
   movements per frame of markers, and shares (M, J) of them by which a joint may turn, divided by the lever. */
EXPORT int64_t STAGE(limited_turns)(int64_t joints, int64_t marker_count, int64_t count, double frames, double gathered,
                                    double lever, int64_t is_held, const double *rotations, const double *raw,
                                    const double *shown, const double *earlier, const double *usual,
                                    const double *shares, const double *ways, double *limited, double *turned) {
  memcpy(limited, rotations, (size_t)(4 * joints) * sizeof(double));
  for (int64_t j = 0; j < joints; j++) {
    double turn[3], *own = turned + 3 * j;
    STAGE(turn)(raw + 4 * j, rotations + 4 * j, own);
    for (int i = 0; i < 3; i++) own[i] /= frames;
    if (j == 0) continue;
    STAGE(turn)(shown + 4 * j, rotations + 4 * j, turn);
    double angle = sqrt((turn[0] * turn[0] + turn[1] * turn[1]) + turn[2] * turn[2]), limit = usual[j];
    if (angle < 1e-12) angle = 1e-12;
    if (count) {
      double most = INFINITY, explained = -INFINITY;
      for (int64_t t = 0; t <= count; t++) {
        const double *past = t < count ? earlier + 3 * (t * joints + j) : own;
        const double along = (past[0] * turn[0] + past[1] * turn[1]) + past[2] * turn[2];
        const double may = along / angle + frames * (gathered * (double)(count - t));
        if (may < most || isnan(may)) most = may; /* what is not a number stays */
      }
      for (int64_t m = 0; m < marker_count; m++) {
        const double by = shares[m * joints + j] * ways[m];
        if (by > explained || isnan(by)) explained = by;
      }
      explained /= lever;
      if (explained < most || isnan(explained)) most = explained;
      if (most > limit || isnan(most)) limit = most;
    }
    const double share = is_held ? 0.0 : limit * frames / angle;
    if (!(share < 1.0)) continue;
    double q[4];
    for (int i = 0; i < 3; i++) turn[i] *= share;
    STAGE(quaternion)(turn, q);
    STAGE(multiply)(shown + 4 * j, q, limited + 4 * j);
  }
  return 0;
}
