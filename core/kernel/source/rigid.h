/* Rigid fit of points: core/geometry/rigid_transform.py. */

/* The eigenvector (4,) of the largest eigenvalue of a symmetric matrix (4, 4), which is overwritten (Jacobi 1846).
   Returns 0, or 2 if it is not finite. */
static int STAGE(largest_vector)(double a[4][4], double *vector) {
  double v[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
  for (int sweep = 0; sweep < 30; sweep++) {
    double apart = 0.0, size = 0.0;
    for (int i = 0; i < 4; i++) {
      size += a[i][i] * a[i][i];
      for (int j = 0; j < i; j++) apart += a[i][j] * a[i][j];
    }
    if (!isfinite(apart + size)) return 2;
    if (apart <= 1e-36 * size || apart == 0.0) break;
    for (int p = 0; p < 3; p++)
      for (int q = p + 1; q < 4; q++) {
        if (a[p][q] == 0.0) continue;
        double theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
        double t = 1.0 / (fabs(theta) + sqrt(theta * theta + 1.0));
        if (theta < 0.0) t = -t;
        double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
        for (int k = 0; k < 4; k++) {
          double x = a[k][p], y = a[k][q];
          a[k][p] = c * x - s * y;
          a[k][q] = s * x + c * y;
        }
        for (int k = 0; k < 4; k++) {
          double x = a[p][k], y = a[q][k];
          a[p][k] = c * x - s * y;
          a[q][k] = s * x + c * y;
          x = v[k][p], y = v[k][q];
          v[k][p] = c * x - s * y;
          v[k][q] = s * x + c * y;
        }
        a[p][q] = a[q][p] = 0.0;
      }
  }
  int best = 0;
  for (int i = 1; i < 4; i++)
    if (a[i][i] > a[best][best]) best = i;
  for (int k = 0; k < 4; k++) vector[k] = v[k][best];
  return 0;
}

/* fitted (7,): quaternion and translation that move source (N, 3) to target (N, 3) best with weights (N,). */
EXPORT int64_t STAGE(fit_rigid)(int64_t count, const double *source, const double *target, const double *weights,
                                double *fitted) {
  double total = 0.0, p[3] = {0.0}, q[3] = {0.0}, h[3][3] = {{0.0}};
  for (int64_t n = 0; n < count; n++) total += weights[n];
  for (int64_t n = 0; n < count; n++)
    for (int i = 0; i < 3; i++) {
      p[i] += weights[n] / total * source[3 * n + i];
      q[i] += weights[n] / total * target[3 * n + i];
    }
  for (int64_t n = 0; n < count; n++)
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++)
        h[i][j] += weights[n] / total * (source[3 * n + i] - p[i]) * (target[3 * n + j] - q[j]);
  double a[4][4]; /* Horn 1987 */
  double x = h[1][2] - h[2][1], y = h[2][0] - h[0][2], z = h[0][1] - h[1][0];
  a[0][0] = h[0][0] + h[1][1] + h[2][2];
  a[1][1] = h[0][0] - h[1][1] - h[2][2];
  a[2][2] = h[1][1] - h[0][0] - h[2][2];
  a[3][3] = h[2][2] - h[0][0] - h[1][1];
  a[0][1] = a[1][0] = x;
  a[0][2] = a[2][0] = y;
  a[0][3] = a[3][0] = z;
  a[1][2] = a[2][1] = h[0][1] + h[1][0];
  a[1][3] = a[3][1] = h[0][2] + h[2][0];
  a[2][3] = a[3][2] = h[1][2] + h[2][1];
  if (STAGE(largest_vector)(a, fitted)) return 2;
  double sign = fitted[0] < 0.0 ? -1.0 : 1.0;
  for (int i = 0; i < 4; i++) fitted[i] *= sign;
  double r[9];
  STAGE(matrix)(fitted, r);
  for (int c = 0; c < 3; c++) fitted[4 + c] = q[c] - (r[3 * c] * p[0] + r[3 * c + 1] * p[1] + r[3 * c + 2] * p[2]);
  return 0;
}
