/* Search in a sample of the database, and what is located by it: core/solver/search/sample.py and locator.py. */

/* The nearest `wanted` > 0 frames of a sample, nearest first, as frames of the database; returns their number. target
   and weights (3 M,); among has room for 4 times those wanted. */
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

/* As `locate`, but only among the frames around the closest of the sample. expected (M, 3): markers in the frame of the
   root, to which the first one is fitted; continued (D,): null if it is unknown; root (7,): that of the last frame, or
   any if three markers of the torso are located. doubles: work for 10 M values; singles: 6 M + D; among and found have
   room for the frames wanted and a step of the sample, and among for 4 times the examples. */
EXPORT int64_t STAGE(locate_hurried)(const Hurried *h, const double *points, const double *expected,
                                     const double *continued, double *doubles, float *singles, Candidate *among,
                                     double *root, int64_t *found, int64_t *chosen, double *distances, float *poses,
                                     float *markers, int64_t *counts, double *nearest_m) {
  const Locator *l = h->locator;
  const Sample *s = h->sample;
  const int64_t count = l->cells->frames->markers;
  int64_t sampled = 0, around = 0;
  double *local = doubles, *work = local + 3 * count;
  float *target = singles, *weights = target + 3 * count, *pose = weights + 3 * count;
  if (continued && STAGE(narrow)(l->cells->size, continued, pose)) return 2;
  if (!continued || !(l->pose_weight > 0.0)) pose = 0;
  memcpy(local, expected, 3 * (size_t)count * sizeof(double));
  for (int64_t pass = 0; pass < h->passes; pass++) {
    if (STAGE(fit_root)(count, l->torso, points, local, work, root)) return 2;
    STAGE(query)(l, points, root, local, target, weights);
    sampled = STAGE(nearest_in_sample)(s, target, weights, l->examples, among);
    STAGE(closest_mean)(l, sampled, among, local);
  }
  for (int64_t k = 0; k < sampled && k * s->step < h->wanted; k++)
    for (int64_t i = 0; i < s->step; i++) {
      int64_t frame = among[k].index - s->step / 2 + i;
      if (frame >= 0 && frame < l->cells->frames->count) found[around++] = frame;
    }
  for (int64_t k = 0; k < around; k++) among[k].index = found[k];
  counts[0] = around, counts[2] = h->passes * s->count;
  if (STAGE(fit_root)(count, l->torso, points, local, work, root)) return 2;
  STAGE(query)(l, points, root, local, target, weights);
  STAGE(compare)(l, around, target, weights, pose, among);
  STAGE(select)(among, around, l->closest);
  STAGE(closest_mean)(l, around, among, local);
  return STAGE(choose)(l, points, pose, doubles, singles, among, root, chosen, distances, poses, markers, counts,
                       nearest_m);
}
