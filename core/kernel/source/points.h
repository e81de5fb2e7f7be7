/* Filter of points with several models: core/geometry/multiple_model_filter.py. A model's row (18,) holds position,
   velocity and acceleration (3, 3), and the covariance (3, 3) that the axes share. */

/* The product of differences a (3, 3) with their own transpose, divided by 3. */
static double STAGE(spread)(const double *a, int i, int j) {
  return (a[3 * i] * a[3 * j] + a[3 * i + 1] * a[3 * j + 1] + a[3 * i + 2] * a[3 * j + 2]) / 3.0;
}

/* Weights (N, K) and rows (N, K, 18) of models that are mixed, then predicted over elapsed_s; see _predicted. stays:
   share of each model that is kept; densities (K,) of the jerk. */
EXPORT int64_t STAGE(predict_points)(int64_t point_count, int64_t models, double elapsed_s, double stays,
                                     const double *densities, const double *weights, const double *rows,
                                     double *next_weights, double *next_rows) {
  const double t = elapsed_s, half = 0.5 * t * t, leaves = (1.0 - stays) / (double)(models - 1);
  const double jerk[9] = {t * t * t * t * t / 20.0, t * t * t * t / 8.0, t * t * t / 6.0,
                          t * t * t * t / 8.0,      t * t * t / 3.0,     t * t / 2.0,
                          t * t * t / 6.0,          t * t / 2.0,         t};
  for (int64_t n = 0; n < point_count; n++, weights += models, rows += 18 * models) {
    for (int64_t j = 0; j < models; j++, next_weights++, next_rows += 18) {
      double total = 0.0, mixed[18] = {0.0}, apart[9];
      for (int64_t i = 0; i < models; i++) total += weights[i] * (i == j ? stays : leaves);
      *next_weights = total;
      for (int64_t i = 0; i < models; i++) {
        const double share = weights[i] * (i == j ? stays : leaves) / (total < 1e-300 ? 1e-300 : total);
        const double *row = rows + 18 * i;
        for (int k = 0; k < 9; k++) apart[k] = row[k] - rows[k]; /* from the first model's, which keeps precision */
        for (int k = 0; k < 9; k++) {
          mixed[k] += share * row[k];
          mixed[9 + k] += share * (row[9 + k] + STAGE(spread)(apart, k / 3, k % 3));
        }
      }
      for (int k = 0; k < 9; k++) apart[k] = mixed[k] - rows[k];
      double *p = mixed + 9, moved[9];
      for (int k = 0; k < 9; k++) p[k] -= STAGE(spread)(apart, k / 3, k % 3);
      for (int k = 0; k < 3; k++) {
        next_rows[k] = mixed[k] + t * mixed[3 + k] + half * mixed[6 + k];
        next_rows[3 + k] = mixed[3 + k] + t * mixed[6 + k];
        next_rows[6 + k] = mixed[6 + k];
        moved[k] = p[k] + t * p[3 + k] + half * p[6 + k];
        moved[3 + k] = p[3 + k] + t * p[6 + k];
        moved[6 + k] = p[6 + k];
      }
      for (int k = 0; k < 9; k += 3) {
        next_rows[9 + k] = moved[k] + t * moved[k + 1] + half * moved[k + 2] + densities[j] * jerk[k];
        next_rows[10 + k] = moved[k + 1] + t * moved[k + 2] + densities[j] * jerk[k + 1];
        next_rows[11 + k] = moved[k + 2] + densities[j] * jerk[k + 2];
      }
    }
  }
  return 0;
}

/* Weights (N, K) and rows (N, K, 18) corrected in place with points (N, 3), NaN where there is none; see _corrected.
   limits: squares of the distance, and of the distance in standard deviations, beyond which a point begins again, and
   the variances of its first velocity and acceleration. known (N,): whether a point is followed, then whether it went
   on. likely: work for 3 K values. */
EXPORT int64_t STAGE(correct_points)(int64_t point_count, int64_t models, const double *points, const double *sigmas,
                                     const double *limits, double *weights, double *rows, uint8_t *known,
                                     double *likely) {
  double *variances = likely + models, *unlikely = variances + models;
  for (int64_t n = 0; n < point_count; n++, points += 3, weights += models, rows += 18 * models) {
    const double square = sigmas[n] * sigmas[n];
    int is_far = 1;
    if (!isfinite(points[0])) {
      known[n] = 0;
      continue;
    }
    for (int64_t i = 0; i < models; i++) {
      const double *row = rows + 18 * i;
      double apart = 0.0;
      for (int k = 0; k < 3; k++) apart += (points[k] - row[k]) * (points[k] - row[k]);
      variances[i] = row[9] + square;
      unlikely[i] = apart / variances[i];
      if (!(apart > limits[0] && unlikely[i] > limits[1])) is_far = 0;
    }
    known[n] = known[n] && !is_far;
    if (known[n]) {
      double most = -INFINITY, total = 0.0;
      for (int64_t i = 0; i < models; i++) {
        double *row = rows + 18 * i, *cov = row + 9;
        const double across[3] = {cov[0], cov[1], cov[2]};
        const double gains[3] = {cov[0] / variances[i], cov[3] / variances[i], cov[6] / variances[i]};
        const double off[3] = {points[0] - row[0], points[1] - row[1], points[2] - row[2]};
        for (int k = 0; k < 9; k++) {
          row[k] += gains[k / 3] * off[k % 3];
          cov[k] -= gains[k / 3] * across[k % 3];
        }
        const double weight = weights[i] < 1e-300 ? 1e-300 : weights[i];
        likely[i] = log(weight / (variances[i] * sqrt(variances[i]))) - 0.5 * unlikely[i];
        if (!(likely[i] <= most)) most = likely[i]; /* one that is not a number stays */
      }
      for (int64_t i = 0; i < models; i++) {
        weights[i] = exp(likely[i] - most);
        total += weights[i];
      }
      for (int64_t i = 0; i < models; i++) weights[i] /= total;
      continue;
    }
    for (int64_t i = 0; i < models; i++) { /* begins at its measurement */
      double *row = rows + 18 * i;
      for (int k = 0; k < 18; k++) row[k] = k < 3 ? points[k] : 0.0;
      row[9] = square;
      row[13] = limits[2];
      row[17] = limits[3];
      weights[i] = 1.0 / (double)models;
    }
  }
  return 0;
}
