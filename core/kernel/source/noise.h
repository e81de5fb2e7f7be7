/* Noise of markers: core/markers/marker_noise.py. */

/* differences (M,) of positions (F, M, 3), F up to 8, at times (F,) from the polynomial through them; see
   differences. Returns 0, or 1 if F is more than 8. */
EXPORT int64_t STAGE(differences)(int64_t frames, int64_t count, const double *times, const double *points,
                                  double *differences) {
  double weights[8], length = 0.0;
  if (frames > 8) return 1;
  for (int64_t f = 0; f < frames; f++) {
    double product = 1.0;
    for (int64_t g = 0; g < frames; g++)
      if (g != f) product *= times[f] - times[g];
    weights[f] = 1.0 / product;
    length += weights[f] * weights[f];
  }
  length = sqrt(length);
  for (int64_t f = 0; f < frames; f++) weights[f] /= length;
  for (int64_t m = 0; m < count; m++) {
    double square = 0.0;
    for (int i = 0; i < 3; i++) {
      double sum = 0.0;
      for (int64_t f = 0; f < frames; f++) sum += weights[f] * points[3 * (f * count + m) + i];
      square += sum * sum;
    }
    differences[m] = sqrt(square);
  }
  return 0;
}

/* Median of the distances of n > 0 candidates, which are moved. */
static double STAGE(median)(Candidate *all, int64_t n) {
  const int64_t half = (n - 1) / 2 + 1;
  double low = -INFINITY, high = INFINITY;
  STAGE(select)(all, n, half);
  for (int64_t i = 0; i < half; i++)
    if (all[i].distance > low) low = all[i].distance;
  for (int64_t i = half; i < n; i++)
    if (all[i].distance < high) high = all[i].distance;
  return n % 2 ? low : 0.5 * (low + high);
}

/* sigmas (M,) from differences (N, M), NaN where unknown; see noise. fewest: differences that an estimate needs;
   length: what the median is divided by; values: work for N M + M candidates. */
EXPORT int64_t STAGE(noise)(int64_t rows, int64_t count, int64_t fewest, double length, const double *differences,
                            Candidate *values, double *sigmas) {
  Candidate *estimates = values + rows * count;
  int64_t total = 0, known = 0;
  for (int64_t m = 0; m < count; m++) {
    int64_t n = 0;
    for (int64_t row = 0; row < rows; row++) {
      const double value = differences[row * count + m];
      if (isfinite(value)) values[n++] = STAGE(candidate)(value, row);
    }
    total += n;
    sigmas[m] = n < fewest ? NAN : STAGE(median)(values, n) / length;
    if (n >= fewest) estimates[known++] = STAGE(candidate)(sigmas[m], m);
  }
  double other = 0.0;
  if (known)
    other = STAGE(median)(estimates, known);
  else if (total >= fewest) { /* soon after the start, there is one estimate for all markers */
    int64_t n = 0;
    for (int64_t i = 0; i < rows * count; i++)
      if (isfinite(differences[i])) values[n++] = STAGE(candidate)(differences[i], i);
    other = STAGE(median)(values, n) / length;
  }
  for (int64_t m = 0; m < count; m++)
    if (isnan(sigmas[m])) sigmas[m] = other;
  return 0;
}
