/* Dense linear algebra of the Gaussians. */

/* sum += of the products of two rows (n,) */
static double STAGE(dot)(int64_t n, const double *left, const double *right) {
  v4d sums = {0.0};
  double rest = 0.0;
  int64_t k = 0;
  for (; k + 4 <= n; k += 4) {
    v4d a, b;
    memcpy(&a, left + k, sizeof a);
    memcpy(&b, right + k, sizeof b);
    sums += a * b;
  }
  for (; k < n; k++) rest += left[k] * right[k];
  return ((sums[0] + sums[2]) + (sums[1] + sums[3])) + rest;
}

/* below (2, stride) -= shares^T rows, of four rows, in columns `first` to `last` and up to three more */
static void STAGE(subtract)(int64_t first, int64_t last, int64_t stride, const double *rows, const double *at,
                            double *below) {
  double c[4][2];
  for (int q = 0; q < 4; q++) c[q][0] = at[q * stride], c[q][1] = at[q * stride + 1];
  for (int64_t j = first; j <= last; j += 4) {
    v4d upper, lower, row;
    memcpy(&upper, below + j, sizeof upper);
    memcpy(&lower, below + stride + j, sizeof lower);
    for (int q = 0; q < 4; q++) {
      memcpy(&row, rows + q * stride + j, sizeof row);
      upper -= c[q][0] * row;
      lower -= c[q][1] * row;
    }
    memcpy(below + j, &upper, sizeof upper);
    memcpy(below + stride + j, &lower, sizeof lower);
  }
}

/* Conditions the last n - m of n Gaussian variables on the first m: a is the upper triangle of their covariance, row by
   row with a stride of n + 4, and column n a vector; the rest of a is overwritten. Afterwards the first m rows are those of the covariance's Cholesky factor,
   the others the covariance given the first (its Schur complement); to the vector's first m entries the inverse factor
   was applied, from the others their regression on the first was subtracted.

   Returns 0, or 3 if the covariance of the first m is not positive definite. */
static int64_t STAGE(eliminate)(int64_t m, int64_t n, int64_t stride, double *a) {
  for (int64_t first = 0; first < m; first += 4) { /* four rows at a time are subtracted from those below */
    int64_t stop = first + 4 < m ? first + 4 : m;
    for (int64_t p = first; p < stop; p++) {
      double *restrict pivot = a + p * stride;
      for (int64_t q = first; q < p; q++) {
        const double *restrict row = a + q * stride;
        double share = row[p];
        for (int64_t j = p; j <= n; j++) pivot[j] -= share * row[j];
      }
      if (pivot[p] <= 0.0) return 3;
      pivot[p] = sqrt(pivot[p]);
      double scale = 1.0 / pivot[p];
      for (int64_t j = p + 1; j <= n; j++) pivot[j] *= scale;
    }
    int64_t i = stop;
    if (stop - first == 4) /* two rows at a time */
      for (; i + 1 < n; i += 2)
        STAGE(subtract)(i, n, stride, a + first * stride, a + first * stride + i, a + i * stride);
    for (; i < n; i++)
      for (int64_t q = first; q < stop; q++) {
        const double *restrict row = a + q * stride;
        double *restrict below = a + i * stride, share = row[i];
        for (int64_t j = i; j <= n; j++) below[j] -= share * row[j];
      }
  }
  return 0;
}

/* mean (size,) and covariance (size, size) after the elimination of m variables before them; start: the mean before */
static void STAGE(remaining)(int64_t m, int64_t size, int64_t stride, const double *a, const double *start,
                             double *mean, double *covariance) {
  for (int64_t i = 0; i < size; i++) {
    const double *row = a + (m + i) * stride + m;
    mean[i] = start[i] - row[size];
    for (int64_t j = i; j < size; j++) covariance[i * size + j] = covariance[j * size + i] = row[j];
  }
}
