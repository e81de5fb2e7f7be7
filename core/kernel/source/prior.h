/* Priors of a pose: core/solver/neighbours_prior.py, core/solver/gaussian_conditioning.py. */

#define PANEL 16 /* columns of samples that lie together */

/* weights (K,), with sum 1, of neighbours at distances (K,), to which the squared distances of their earlier markers
   (K, H) from those of the performer, NaN where unknown, are added, times a share. */
static void STAGE(weights)(int64_t count, int64_t marker_count, const float *markers, const double *distances,
                           const double *past, double share, double width, double *weights) {
  double most = -INFINITY, total = 0.0;
  for (int64_t k = 0; k < count; k++) {
    const float *own = markers + k * marker_count;
    double sum = 0.0;
    for (int64_t i = 0; i < marker_count; i++)
      if (isfinite(past[i])) sum += (own[i] - past[i]) * (own[i] - past[i]);
    double distance = (distances[k] < 0.0 ? 0.0 : distances[k]) + share * sum;
    if (distance > most || isnan(distance)) most = distance; /* NaN stays */
    weights[k] = distance;
  }
  for (int64_t k = 0; k < count; k++) total += weights[k] = exp(-weights[k] / (width * most + 1e-12));
  for (int64_t k = 0; k < count; k++) weights[k] /= total;
}

/* tile (4, PANEL) = left^T right, of the first four columns of one panel (K, PANEL) and those of another */
static void STAGE(tile)(int64_t count, const float *left, const float *right, float *tile) {
  v8f sums[4][2];
  memset(sums, 0, sizeof sums);
  for (int64_t k = 0; k < count; k++, left += PANEL, right += PANEL) {
    v8f low, high;
    memcpy(&low, right, sizeof low);
    memcpy(&high, right + 8, sizeof high);
    for (int i = 0; i < 4; i++) {
      sums[i][0] += left[i] * low;
      sums[i][1] += left[i] * high;
    }
  }
  memcpy(tile, sums, sizeof sums);
}

/* mean (D,) and covariance (D, D) of the neighbours' poses (K, D), given earlier markers and poses.

   sizes: K, D, and the numbers H and C of columns of the neighbours' earlier markers (K, H) and poses (K, C).
   past (H + C,): those of the performer, NaN where unknown, with variances (H + C,).
   floor (N, N), N = D + H + C: covariance that is added to the neighbours'.
   columns (N,), single (N rounded up to PANEL, times K), work (K + (N + 1) (N + 4)): work.
   Returns 0, or 3 if a covariance is not positive definite. */
EXPORT int64_t STAGE(neighbours_prior)(const int64_t *sizes, const float *poses, const float *markers,
                                       const float *before, const double *distances, double share, double width,
                                       float tiny, const double *past, const double *variances, const float *floor,
                                       int64_t *columns, float *single, double *work, double *mean,
                                       double *covariance) {
  int64_t count = sizes[0], size = sizes[1], marker_count = sizes[2], whole = size + marker_count + sizes[3];
  int64_t seen = 0;
  STAGE(weights)(count, marker_count, markers, distances, past, share, width, work);
  /* what is known comes first, then the pose */
  for (int64_t i = size; i < whole; i++)
    if (isfinite(past[i - size])) columns[seen++] = i;
  for (int64_t i = 0; i < size; i++) columns[seen + i] = i;
  int64_t used = seen + size, stride = used + 4;
  double *means = work + count, *joint = means + used;
  for (int64_t first = 0; first < used; first += PANEL) {
    float start[PANEL] = {0.0f}, *panel = single + first * count;
    double shift[PANEL] = {0.0}; /* digits are left where the first sample is far from the others */
    const float *from[PANEL];
    int64_t step[PANEL];
    for (int64_t c = 0; c < PANEL; c++) { /* the last columns of the last panel are zero */
      int64_t at = first + c < used ? columns[first + c] : 0;
      from[c] = poses + at, step[c] = size;
      if (at >= size + marker_count)
        from[c] = before + (at - size - marker_count), step[c] = sizes[3];
      else if (at >= size)
        from[c] = markers + (at - size), step[c] = marker_count;
      start[c] = from[c][0];
      if (first + c < used) means[first + c] = start[c];
    }
    int is_whole = first + PANEL <= used; /* columns that lie next to each other are read together */
    for (int c = 1; c < PANEL; c++) is_whole &= from[c] == from[0] + c && step[c] == step[0];
    for (int64_t k = 0; k < count; k++) {
      float weight = (float)work[k], *row = panel + k * PANEL;
      if (is_whole)
        memcpy(row, from[0] + k * step[0], PANEL * sizeof(float));
      else
        for (int c = 0; c < PANEL; c++) row[c] = first + c < used ? from[c][k * step[c]] : start[c];
      for (int c = 0; c < PANEL; c++) row[c] -= start[c];
      for (int c = 0; c < PANEL; c++) shift[c] += (double)weight * (double)row[c];
    }
    for (int64_t k = 0; k < count; k++) {
      float root = sqrtf((float)work[k]);
      for (int c = 0; c < PANEL; c++) {
        float away = panel[k * PANEL + c] - (float)shift[c];
        float rounded = away + tiny; /* adding and subtracting rounds tiny differences to zero */
        panel[k * PANEL + c] = (rounded - tiny) * root;
      }
    }
    for (int64_t c = 0; c < PANEL && first + c < used; c++) means[first + c] += shift[c];
  }
  for (int64_t first = 0; first < used; first += PANEL) /* one panel stays in the nearest memory */
    for (int64_t top = 0; top < first + PANEL && top < used; top += 4) {
      float tile[4 * PANEL];
      STAGE(tile)(count, single + top / PANEL * PANEL * count + top % PANEL, single + first * count, tile);
      for (int64_t i = top; i < top + 4 && i < used; i++)
        for (int64_t j = i > first ? i : first; j < first + PANEL && j < used; j++)
          joint[i * stride + j] = tile[(i - top) * PANEL + j - first] + floor[columns[i] * whole + columns[j]];
    }
  for (int64_t i = 0; i < used; i++) {
    joint[i * stride + used] = i < seen ? past[columns[i] - size] - means[i] : 0.0;
    if (i < seen) joint[i * stride + i] += variances[columns[i] - size];
  }
  if (STAGE(eliminate)(seen, used, stride, joint)) return 3;
  /* the regression was subtracted from nothing */
  STAGE(remaining)(seen, size, stride, joint, means + seen, mean, covariance);
  return 0;
}

/* fused (D,), fused_covariance (D, D): the product of two Gaussians, a mean (D,) and covariance (D, D), and others.
   work: 2 D (2 D + 4). Returns 0, or 3 if the sum of the covariances is not positive definite. */
EXPORT int64_t STAGE(continue_prior)(int64_t size, const double *mean, const double *covariance, const double *expected,
                                     const double *change, double *work, double *fused, double *fused_covariance) {
  int64_t width = 2 * size, stride = width + 4;
  for (int64_t i = 0; i < size; i++) {
    double *restrict row = work + i * stride, *restrict below = row + size * stride;
    const double *restrict own = covariance + i * size, *restrict other = change + i * size;
    for (int64_t j = 0; j < size; j++) {
      row[j] = own[j] + other[j];
      row[size + j] = below[size + j] = own[j];
    }
    row[width] = expected[i] - mean[i];
    below[width] = 0.0;
  }
  if (STAGE(eliminate)(size, width, stride, work)) return 3;
  STAGE(remaining)(size, size, stride, work, mean, fused, fused_covariance);
  return 0;
}
