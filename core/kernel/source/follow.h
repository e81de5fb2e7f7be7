/* Successive frames of a tracked body in one call: core/solver/following.py. */

/* F frames and what is found for them. `solved` begins with earlier poses (E, D), which the frames' own follow; `roots`
   and `bodies` begin with those of the last frame. Of the learned prior, means to sigmas, all or none are null. */
typedef struct {
  int64_t count, earlier, checked;            /* F, E, and the first frame after which the motion may be left */
  const double *points, *observed;            /* (F, M, 3) markers, (F, L, M, 3) earlier ones in the world */
  const int64_t *places;                      /* (F, L) earlier poses in `solved`, -1 where unknown */
  const int64_t *starts, *row_markers;        /* (F + 1,) first rows of each frame; rows of `Controls` */
  const double *axes, *origins, *noise;
  const double *means, *covariances, *expected, *sigmas; /* (F, D), (F, D, D), (F, 7), (F, 2) */
  const uint8_t *hidden;                      /* (F, J - 1) whether a joint moves no visible marker */
  const double *last, *before;                /* (D,) the last two poses; the earlier one may be null */
  int64_t errors_last;                        /* whether the source's errors last */
  double cut, jump;                           /* movements of the markers, m */
  double *doubles;                            /* work, see `_work` in Python */
  float *singles;
  Candidate *among;
  int64_t *found, *chosen;                    /* of the last frame, as in `locate`, with distances and poses */
  double *distances;
  float *poses, *markers;
  int64_t *counts;                            /* (4,) frames found, chosen, visited in all; frames solved */
  double *solved, *roots, *bodies;            /* (E + F, D), (1 + F, 7), (1 + F, M, 3) */
  double *uncertainties, *numbers;            /* (F, J - 1), (F, 5): see `_NUMBERS` in Python */
  double *mean, *covariance, *root;           /* (D,), (D, D), (9,) prior of the last frame */
} STAGE(Stretch);

/* RMS length of the differences between markers (M, 3), where points are located. */
static double STAGE(rms)(int64_t markers, const double *points, const double *one, const double *other) {
  double sum = 0.0;
  int64_t located = 0;
  for (int64_t m = 0; m < markers; m++) {
    if (!STAGE(is_located)(points + 3 * m)) continue;
    located++;
    for (int64_t i = 3 * m; i < 3 * m + 3; i++) sum += (one[i] - other[i]) * (one[i] - other[i]);
  }
  return sqrt(sum / (double)(located ? located : 1));
}

/* Solves frames until the last, or until one after which the motion so far may be misleading; see `misleads`.
   Returns as `locate` and `estimate`. */
EXPORT int64_t STAGE(follow)(const Locator *l, const Best *b, const BestConstants *c, STAGE(Stretch) * s) {
  int64_t markers = l->cells->frames->markers, size = b->poses->size, lags = b->markers->lags->count;
  int64_t joints = size / 3, visited = 0, status;
  double *continued = s->doubles, *recent = continued + size, *local = recent + lags * size;
  double *work = local + 6 * markers;
  const double *last = s->last, *before = s->before;
  for (int64_t t = 0; t < s->count; t++) {
    const double *points = s->points + 3 * markers * t;
    double *pose = s->solved + (s->earlier + t) * size, *root = s->roots + 7 * (t + 1), *numbers = s->numbers + 5 * t;
    double *body = s->bodies + 3 * markers * (t + 1), located[7], matrix[9];
    int64_t first = s->starts[t], steps;
    memcpy(located, root - 7, sizeof located);
    for (int64_t d = 0; d < size; d++) continued[d] = before ? 2.0 * last[d] - before[d] : last[d];
    if ((status = STAGE(locate)(l, points, continued, work, s->singles, s->among, located, s->found, s->chosen,
                                s->distances, s->poses, s->markers, s->counts, numbers + 2)))
      return status;
    s->counts[2] = visited += s->counts[2];
    for (int64_t i = 0; i < lags * size; i++) {
      int64_t place = s->places[lags * t + i / size];
      recent[i] = place < 0 ? NAN : s->solved[place * size + i % size];
    }
    STAGE(Frame) frame = {s->counts[1], s->chosen, s->distances, s->poses, s->observed + 3 * lags * markers * t, recent,
                          located, before ? last : 0, before, s->starts[t + 1] - first, s->row_markers + first,
                          s->axes + 3 * first, s->origins + 3 * first, s->noise + first, 0, 0, 0, 0,
                          s->hidden + joints * t};
    if (s->means) {
      frame.learned_mean = s->means + size * t;
      frame.learned_covariance = s->covariances + size * size * t;
      frame.learned_root = s->expected + 7 * t;
      frame.learned_sigmas = s->sigmas + 2 * t;
    }
    if ((status = STAGE(estimate)(b, c, &frame, work, s->singles, s->mean, s->covariance, s->root, pose, root,
                                  s->uncertainties + joints * t, numbers, &steps)))
      return status;
    numbers[3] = (double)steps;
    numbers[4] = (double)s->counts[1];
    STAGE(matrix)(root, matrix);
    if (STAGE(markers)(1, b->body->joints, b->body->carrying, markers, b->body->indices, b->body->lengths, pose, matrix,
                       root + 4, body, 0))
      return 1;
    s->counts[3] = t + 1;
    before = last, last = pose;
    if (t < s->checked) continue;
    STAGE(to_root_frame)(markers, points, root, local);
    STAGE(to_root_frame)(markers, body - 3 * markers, root - 7, local + 3 * markers);
    double jump = STAGE(rms)(markers, points, local, local + 3 * markers);
    int misleads = jump > s->jump || STAGE(rms)(markers, points, body, points) > numbers[2];
    if (jump > s->cut || (!s->errors_last && misleads)) return 0;
  }
  return 0;
}
