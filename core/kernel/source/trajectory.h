/* Distances of recent markers from the database: core/solver/trajectory_check.py. */

/* distances (2, K), m^2: of markers now (M, 3) from those of frames (K,), plus those of earlier markers observed (L, M, 3)
   from those before the frames, all in the axes of their roots and NaN where not located; in the second row, earlier
   markers are compared relative to their mean. earlier: work for K L frames; singles and doubles: work for 3 M.
   Returns 0, or 1 if a frame does not exist. */
EXPORT int64_t STAGE(trajectory_distances)(const EarlierMarkers *e, const double *now, const double *observed,
                                           int64_t count, const int64_t *frames, int64_t *earlier, float *singles,
                                           double *doubles, double *distances) {
  const Frames *f = e->frames;
  const int64_t lags = e->lags->count, points = 3 * f->markers;
  if (STAGE(earlier_frames)(e->lags, f->count, count, frames, earlier)) return 1;
  for (int64_t k = 0; k < count; k++) {
    const int16_t *row = f->rows + f->places[frames[k]] * f->width;
    double away = 0.0, relative;
    for (int64_t l = 0; l < lags && k + AHEAD < count; l++)
      STAGE(fetch_earlier)(f->rows, f->width, f->places, e->matrices, earlier[(k + AHEAD) * lags + l]);
    if (k + AHEAD < count) STAGE(fetch_earlier)(f->rows, f->width, f->places, e->matrices, frames[k + AHEAD]);
    for (int64_t m = 0; m < f->markers; m++)
      for (int64_t i = 3 * m; i < 3 * m + 3 && STAGE(is_located)(now + 3 * m); i++) {
        const double apart = (double)((float)row[i] * (float)f->unit) - now[i];
        away += apart * apart;
      }
    relative = away;
    for (int64_t l = 0; l < lags; l++) {
      const int64_t then = earlier[k * lags + l];
      double shift[3] = {0.0}, *apart = doubles;
      STAGE(markers_before)(f->rows + f->places[then] * f->width, (float)f->unit, f->markers, e->matrices,
                            (float)e->matrix_unit, e->positions, then, frames[k], singles);
      for (int64_t m = 0; m < f->markers; m++) {
        const double *seen = observed + l * points + 3 * m;
        if (!STAGE(is_located)(seen)) continue;
        for (int i = 0; i < 3; i++) {
          *apart = (double)singles[3 * m + i] - seen[i];
          shift[i] += *apart++;
        }
      }
      const double located = (double)((apart - doubles) / 3);
      for (int64_t i = 0; i < apart - doubles; i++) {
        const double centred = doubles[i] - shift[i % 3] / located;
        away += doubles[i] * doubles[i];
        relative += centred * centred;
      }
    }
    distances[k] = away < 1e-12 ? 1e-12 : away;
    distances[count + k] = relative < 1e-12 ? 1e-12 : relative;
  }
  return 0;
}
