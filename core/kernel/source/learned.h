/* The learned prior: core/solver/motion_prior.py. */

/* A Gaussian of rotation vectors (J, 3), with standard deviations (J, 3) and their correlation (3 J, 3 J), relative to
   other reference rotations. The vectors' quaternions are multiplied by change (J, 4, 4); back (J, 3, 3) turns their
   small rotations. moved (J, 3) and covariance (3 J, 3 J) are the results; slopes: work for 9 J values. */
static void STAGE(moved_gaussian)(int64_t joints, const double *vectors, const double *sigmas, const double *change,
                                  const double *back, const double *correlation, double *slopes, double *moved,
                                  double *covariance) {
  int64_t width = 3 * joints;
  for (int64_t n = 0; n < joints; n++) {
    const double *v = vectors + 3 * n, *c = change + 16 * n;
    double q[4], r[4];
    STAGE(quaternion)(v, q);
    for (int i = 0; i < 4; i++) r[i] = c[4 * i] * q[0] + c[4 * i + 1] * q[1] + c[4 * i + 2] * q[2] + c[4 * i + 3] * q[3];
    STAGE(rotation_vector)(r, moved + 3 * n);
    double turn[9], before[9], a[9], b[9];
    STAGE(exponential)(v, turn, before);
    STAGE(exponential)(moved + 3 * n, turn, a);
    STAGE(product)(back + 9 * n, before, b);
    /* slopes = a^-1 b, times the deviations; a is the Jacobian of a rotation of at most pi, so it can be inverted */
    double adjugate[9] = {a[4] * a[8] - a[5] * a[7], a[2] * a[7] - a[1] * a[8], a[1] * a[5] - a[2] * a[4],
                          a[5] * a[6] - a[3] * a[8], a[0] * a[8] - a[2] * a[6], a[2] * a[3] - a[0] * a[5],
                          a[3] * a[7] - a[4] * a[6], a[1] * a[6] - a[0] * a[7], a[0] * a[4] - a[1] * a[3]};
    double determinant = a[0] * adjugate[0] + a[1] * adjugate[3] + a[2] * adjugate[6];
    STAGE(product)(adjugate, b, slopes + 9 * n);
    for (int i = 0; i < 9; i++) slopes[9 * n + i] *= sigmas[3 * n + i % 3] / determinant;
  }
  for (int64_t n = 0; n < joints; n++)
    for (int64_t m = 0; m < joints; m++) {
      double block[9], half[9], other[9];
      for (int i = 0; i < 9; i++) {
        block[i] = correlation[(3 * n + i / 3) * width + 3 * m + i % 3];
        other[i] = slopes[9 * m + 3 * (i % 3) + i / 3];
      }
      STAGE(product)(slopes + 9 * n, block, half);
      STAGE(product)(half, other, block);
      for (int i = 0; i < 9; i++) covariance[(3 * n + i / 3) * width + 3 * m + i % 3] = block[i];
    }
}

/* The same of N vectors (N, J, 3). */
EXPORT int64_t STAGE(moved_gaussians)(int64_t count, int64_t joints, const double *vectors, const double *sigmas,
                                      const double *change, const double *back, const double *correlation,
                                      double *slopes, double *moved, double *covariances) {
  int64_t width = 3 * joints;
  for (int64_t n = 0; n < count; n++)
    STAGE(moved_gaussian)(joints, vectors + n * width, sigmas + n * width, change, back, correlation, slopes,
                          moved + n * width, covariances + n * width * width);
  return 0;
}
