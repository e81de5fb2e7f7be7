/* Search in a sample of the database: core/solver/search/sample.py. */

/* The nearest `wanted` > 0 frames of a sample, nearest first, as frames of the database; returns their number. target and
   weights (3 M,); among has room for 4 times those wanted. */
EXPORT int64_t STAGE(nearest_in_sample)(const Sample *s, const float *target, const float *weights, int64_t wanted,
                                        Candidate *among) {
  int64_t count = 0;
  double limit = NAN;
  for (int64_t k = 0; k < s->count; k++) {
    float distance = STAGE(row_distance)(s->rows + k * s->width, s->width, (float)s->unit, target, weights);
    STAGE(keep)(STAGE(candidate)(distance, k * s->step), wanted, among, &count, &limit);
  }
  if (wanted > count) wanted = count;
  STAGE(select)(among, count, wanted);
  STAGE(sort)(among, wanted);
  return wanted;
}
