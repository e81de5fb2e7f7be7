/* Tracks of labelled markers: core/labelling/marker_tracks.py. */

static double STAGE(apart)(const double *a, const double *b) {
  const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  return sqrt((x * x + y * y) + z * z);
}

/* expected (M, 3) and gates (M,) of markers, given their tracks and the last pose's markers, predicted (M, 3). */
EXPORT int64_t STAGE(expected_markers)(int64_t count, double elapsed_s, const Tracking *settings, const double *positions,
                                       const double *velocities, const double *hidden_s, const double *predicted,
                                       const uint8_t *is_steady, const uint8_t *torso, double *expected,
                                       double *gates) {
  static const double none[3] = {0.0, 0.0, 0.0};
  for (int64_t m = 0; m < count; m++, positions += 3, velocities += 3, predicted += 3, expected += 3) {
    const int is_known = isfinite(velocities[0]), is_fresh = is_known && hidden_s[m] < settings->memory;
    const int goes_on = is_fresh && hidden_s[m] > 0.0 && is_steady[m];
    double movement[3] = {0.0, 0.0, 0.0};
    for (int i = 0; i < 3; i++) {
      if (is_fresh) movement[i] = velocities[i] * elapsed_s;
      expected[i] = (goes_on ? positions[i] + velocities[i] * hidden_s[m] : predicted[i]) + movement[i];
    }
    const double most = torso[m] ? settings->torso_gate : settings->limb_gate;
    const double gate = settings->gate + settings->speed_share * STAGE(apart)(movement, none) +
                        (settings->hidden_speed * (isfinite(hidden_s[m]) ? hidden_s[m] : 1.0) +
                         (is_known ? 0.0 : settings->unknown_speed * elapsed_s));
    gates[m] = gate > most ? most : gate;
  }
  return 0;
}

/* Tracks of M markers, changed in place by points (N, 3) with labels (N,). Returns 0, or 1 if a marker does not exist. */
EXPORT int64_t STAGE(located_tracks)(int64_t count, int64_t point_count, double elapsed_s, const Tracking *settings,
                                     const double *points, const int64_t *labels, double *positions,
                                     double *velocities, double *hidden_s, uint8_t *is_steady, uint8_t *is_confident) {
  int64_t labelled = 0, steady_count = 0;
  for (int64_t n = 0; n < point_count; n++) {
    if (labels[n] >= count) return 1;
    labelled += labels[n] >= 0;
  }
  for (int64_t n = 0; n < point_count; n++) { /* confidence; positions are still those before */
    const int64_t marker = labels[n];
    double own = INFINITY, nearest = INFINITY;
    if (marker < 0) continue;
    for (int64_t m = 0; m < count; m++) { /* this point from all markers, and this marker from all points */
      double at[3];
      const double since_s = hidden_s[m] + elapsed_s, moving_s = since_s < settings->memory ? since_s : 0.0;
      for (int i = 0; i < 3; i++) {
        const double velocity = velocities[3 * m + i];
        at[i] = positions[3 * m + i] + (isfinite(velocity) ? velocity : 0.0) * moving_s;
      }
      const double away = STAGE(apart)(points + 3 * n, at);
      if (m != marker) {
        if (away < nearest) nearest = away;
        continue;
      }
      if (!isnan(away)) own = away;
      for (int64_t k = 0; k < point_count; k++) {
        const double other = k == n ? INFINITY : STAGE(apart)(points + 3 * k, at);
        if (other < nearest) nearest = other;
      }
    }
    const int steady = own < settings->steady;
    steady_count += steady;
    is_steady[marker] = (uint8_t)steady;
    is_confident[marker] = is_confident[marker] && steady && nearest > own + settings->steady;
  }
  for (int64_t m = 0; m < count; m++)
    is_confident[m] = is_confident[m] && hidden_s[m] + elapsed_s < settings->memory && 2 * steady_count > labelled;
  for (int64_t n = 0; n < point_count; n++) {
    const int64_t marker = labels[n];
    if (marker < 0) continue;
    for (int i = 0; i < 3; i++) {
      double *velocity = velocities + 3 * marker + i, *position = positions + 3 * marker + i;
      if (elapsed_s > 0.0)
        *velocity = hidden_s[marker] < settings->memory
                        ? (points[3 * n + i] - *position) / (elapsed_s + hidden_s[marker])
                        : NAN;
      *position = points[3 * n + i];
    }
    hidden_s[marker] = -elapsed_s;
  }
  for (int64_t m = 0; m < count; m++) hidden_s[m] += elapsed_s;
  return 0;
}
