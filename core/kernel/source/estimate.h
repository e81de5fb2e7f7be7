/* A frame's pose under all its priors: core/solver/best_estimate.py. */

/* What a frame is solved from: its K examples, the performer's earlier markers (L, M, 3) in the world and poses (L, D),
   NaN where unknown, the root (7,), the last two poses (D,) or null, R rows of `Controls` with their noise (R,), and of
   the learned prior, unless null, mean and covariance, root (7,) with two deviations, and whether each joint of the
   pose moves no visible marker. */
typedef struct {
  int64_t count;
  const int64_t *chosen;
  const double *distances;
  const float *poses;
  const double *observed, *solved, *root, *last, *before;
  int64_t rows;
  const int64_t *row_markers;
  const double *axes, *origins, *noise;
  const double *learned_mean, *learned_covariance, *learned_root, *learned_sigmas;
  const uint8_t *hidden;
} STAGE(Frame);

/* earlier (K, L): frames before others, within their clips. Returns 0, or 1 if a frame is outside. */
static int64_t STAGE(earlier_frames)(const Lags *lags, int64_t frames, int64_t count, const int64_t *chosen,
                                     int64_t *earlier) {
  for (int64_t k = 0; k < count; k++) {
    if (chosen[k] < 0 || chosen[k] >= frames) return 1;
    const int64_t *ends = lags->ends + 2 * lags->clips[chosen[k]];
    for (int64_t l = 0; l < lags->count; l++, earlier++) {
      *earlier = chosen[k] - lags->lags[l];
      if (*earlier < ends[0]) *earlier = ends[0];
      if (*earlier > ends[1]) *earlier = ends[1];
    }
  }
  return 0;
}

/* out (n, count): components of the poses of n frames, two at a time, so that no sum waits for the one before */
static void STAGE(components)(const EarlierPoses *e, int64_t n, const int64_t *frames, float *out) {
  for (int64_t k = 0; k < n; k += 2, out += 2 * e->count) {
    int64_t is_pair = k + 1 < n;
    const float *pose = e->poses + frames[k] * e->size, *other = e->poses + frames[k + is_pair] * e->size;
    for (int64_t later = k + AHEAD; later < n && later < k + AHEAD + 2; later++)
      for (int64_t d = 0; d < e->size; d += 16) __builtin_prefetch(e->poses + frames[later] * e->size + d);
    for (int64_t first = 0; first < e->padded; first += 32) {
      v8f sums[2][4] = {{{0.0f}}};
      for (int64_t d = 0; d < e->size; d++)
        for (int q = 0; q < 4; q++) {
          v8f column;
          memcpy(&column, e->components + d * e->padded + first + 8 * q, sizeof column);
          sums[0][q] += pose[d] * column;
          sums[1][q] += other[d] * column;
        }
      int64_t kept = e->count - first < 32 ? e->count - first : 32;
      for (int64_t i = 0; i <= is_pair; i++) memcpy(out + i * e->count + first, sums[i], (size_t)kept * sizeof(float));
    }
  }
}

/* Mean and covariance of the neighbours' poses given the past, as `neighbours_prior`. doubles, singles: work. */
static int64_t STAGE(closest_prior)(const Best *b, const BestConstants *c, const STAGE(Frame) * frame, double *doubles,
                                    float *singles, double *mean, double *covariance) {
  const Frames *f = b->markers->frames;
  const Lags *lags = b->markers->lags;
  const EarlierPoses *e = b->poses;
  int64_t count = frame->count, points = 3 * f->markers, seen = lags->count * points, solved = lags->count * e->count;
  int64_t sizes[4] = {count, e->size, seen, solved};
  double *past = doubles, *variances = past + seen + solved, *work = variances + seen + solved;
  int64_t *earlier = (int64_t *)work, *columns = earlier + count * lags->count;
  float *markers = singles, *poses = markers + count * seen, *single = poses + count * solved;
  work = (double *)(columns + e->size + seen + solved);
  if (STAGE(earlier_frames)(lags, f->count, count, frame->chosen, earlier)) return 1;
  if (STAGE(earlier_markers)(f->rows, f->count, f->width, f->places, (float)f->unit, f->markers, b->markers->matrices,
                             (float)b->markers->matrix_unit, b->markers->positions, frame->chosen, earlier, count,
                             lags->count, markers))
    return 1;
  STAGE(components)(e, count * lags->count, earlier, poses);
  STAGE(to_root_frame)(lags->count * f->markers, frame->observed, frame->root, past);
  for (int64_t l = 0; l < lags->count; l++)
    for (int64_t q = 0; q < e->count; q++) {
      double sum = 0.0;
      for (int64_t d = 0; d < e->size; d++)
        sum += frame->solved[l * e->size + d] * (double)e->components[d * e->padded + q];
      past[seen + l * e->count + q] = sum;
    }
  for (int64_t i = 0; i < seen + solved; i++) {
    double sigma = i < seen ? b->history_sigma_m : b->history_sigma_rad;
    variances[i] = sigma * sigma;
  }
  return STAGE(neighbours_prior)(sizes, frame->poses, markers, poses, frame->distances, b->history_share, c->width,
                                 (float)c->tiny, past, variances, b->floor, columns, single, work, mean, covariance);
}

/* off: RMS of the markers' distance from a prior (D,), in its standard deviations. root (9,): quaternion, position and
   two deviations. Returns as `innovation`. */
static int64_t STAGE(deviation)(const Best *b, const BestConstants *c, const STAGE(Frame) * frame, const double *mean,
                                const double *covariance, const double *root, double *work, double *off) {
  int64_t counts[4] = {b->body->joints, b->body->carrying, b->markers->frames->markers, frame->rows};
  double place[12], sigmas[3] = {root[7], root[8], c->expected_sigma_m};
  double *whitened = work, *diagonal = whitened + frame->rows;
  STAGE(matrix)(root, place);
  memcpy(place + 9, root + 4, 3 * sizeof(double));
  int64_t status =
      STAGE(innovation)(counts, b->body->indices, b->body->lengths, frame->row_markers, frame->axes, frame->origins,
                        mean, covariance, place, sigmas, diagonal + frame->rows, whitened, diagonal);
  int64_t rows = frame->rows > 1 ? frame->rows : 1;
  *off = sqrt(STAGE(dot)(frame->rows, whitened, whitened) / (double)rows);
  return status;
}

/* Factor of the neighbours' variances; see `_inflation`. */
static double STAGE(inflation)(double off, double learned_off, const Best *b, const BestConstants *c) {
  double ratio = learned_off != 0.0 ? off / (learned_off * b->trusted) : 1.0;
  if (!b->is_known && off < 1.0) ratio *= off;
  ratio = ratio * ratio * (ratio * ratio);
  if (ratio < 1.0 / c->most_inflation) return 1.0 / c->most_inflation;
  return ratio > c->most_inflation ? c->most_inflation : ratio;
}

/* Multiplies the variances of joints (J - 1,) of a covariance by inflations, most where the prior differs from the
   learned one; see `widen_joints`. widths: work for D. */
static void STAGE(widen_joints)(int64_t size, const double *mean, const double *other, const double *others,
                                const uint8_t *hidden, double inflation, double of_hidden, double share,
                                double *widths, double *covariance) {
  for (int64_t j = 0; j < size; j += 3) {
    double shift = 0.0, mine = 0.0, theirs = 0.0, factor = hidden[j / 3] ? of_hidden : inflation;
    for (int64_t i = j; i < j + 3; i++) {
      shift += (mean[i] - other[i]) * (mean[i] - other[i]);
      mine += covariance[i * size + i];
      theirs += others[i * size + i];
    }
    double apart = share * factor * shift / (mine + theirs);
    double width = sqrt((factor < 1.0 ? 1.0 : factor) * (apart < 1.0 ? 1.0 : apart));
    for (int64_t i = j; i < j + 3; i++) widths[i] = width;
  }
  for (int64_t i = 0; i < size; i++)
    for (int64_t j = 0; j < size; j++) covariance[i * size + j] *= widths[j] * widths[i];
}

/* Angle between the vertical in the axes of a root (7,) and the mean one in those of examples; see `tilt_rad`. */
static double STAGE(tilt)(const EarlierMarkers *e, int64_t count, const int64_t *chosen, const double *root) {
  double among[3] = {0.0}, r[9];
  STAGE(matrix)(root, r);
  for (int64_t k = 0; k < count; k++)
    for (int i = 0; i < 3; i++) among[i] += (double)((float)e->matrices[9 * chosen[k] + 3 + i] * (float)e->matrix_unit);
  double length = sqrt(among[0] * among[0] + among[1] * among[1] + among[2] * among[2]);
  double cosine = (among[0] * r[3] + among[1] * r[4] + among[2] * r[5]) / (length < 1e-9 ? 1e-9 : length);
  return acos(cosine < -1.0 ? -1.0 : cosine > 1.0 ? 1.0 : cosine);
}

/* scaled (n,) = factor times values */
static void STAGE(scale)(int64_t n, const double *values, double factor, double *scaled) {
  for (int64_t i = 0; i < n; i++) scaled[i] = factor * values[i];
}

/* Pose (D,) and root (7,) of a frame, their prior's mean (D,), covariance (D, D) and root (9,), and the uncertainty
   (J - 1,) of joints. numbers (2,): factor of the neighbours' variances, and tilt; steps: those taken by the fit.
   doubles, singles: work, see `_work` in Python. Returns as `innovation`, or 2 if a matrix is not finite. */
EXPORT int64_t STAGE(estimate)(const Best *b, const BestConstants *c, const STAGE(Frame) * frame, double *doubles,
                               float *singles, double *mean, double *covariance, double *root, double *pose,
                               double *fitted, double *uncertainty, double *numbers, int64_t *steps) {
  int64_t size = b->poses->size, square = size * size, status;
  double *closest = doubles, *closest_covariance = closest + size, *between = closest_covariance + square;
  double *between_covariance = between + size, *scaled = between_covariance + square, *work = scaled + square;
  const double *learned = frame->learned_mean;
  if ((status = STAGE(closest_prior)(b, c, frame, work, singles, closest, closest_covariance))) return status;
  memcpy(root, frame->root, 7 * sizeof(double));
  root[7] = b->root_sigma_m, root[8] = b->root_sigma_rad;
  if (learned) {
    const double *sigmas = frame->learned_sigmas;
    int is_vague = sigmas[0] > c->vague * root[7] || sigmas[1] > c->vague * root[8];
    if (!b->is_known && !is_vague) { /* the torso markers of a known body give a better root */
      memcpy(root, frame->learned_root, 7 * sizeof(double));
      memcpy(root + 7, sigmas, 2 * sizeof(double));
    }
  }
  double off, learned_off;
  if ((status = STAGE(deviation)(b, c, frame, closest, closest_covariance, root, work, &off))) return status;
  double widening = off / c->usual_deviation * (off / c->usual_deviation);
  if (!b->is_known || widening < 1.0) widening = 1.0;
  double *inflation = numbers;
  *inflation = 0.0;
  double *prior = closest, *spread = scaled; /* the prior so far */
  if (!learned) {
    STAGE(scale)(square, closest_covariance, widening, scaled);
  } else {
    if ((status = STAGE(deviation)(b, c, frame, learned, frame->learned_covariance, root, work, &learned_off)))
      return status;
    *inflation = STAGE(inflation)(off, learned_off, b, c);
    if (b->is_known) {
      STAGE(scale)(square, closest_covariance, widening > *inflation ? widening : *inflation, scaled);
    } else {
      double least = learned_off < c->least_off ? c->least_off : learned_off;
      memcpy(scaled, closest_covariance, (size_t)square * sizeof(double));
      STAGE(widen_joints)(size, closest, learned, frame->learned_covariance, frame->hidden, *inflation,
                          STAGE(inflation)(off, least, b, c), c->joint_share, work, scaled);
    }
    double share = b->prior_share * (*inflation < 1.0 ? *inflation : 1.0);
    STAGE(scale)(square, frame->learned_covariance, 1.0 / share, covariance);
    if ((status = STAGE(continue_prior)(size, closest, scaled, learned, covariance, work, between, between_covariance)))
      return status;
    prior = between, spread = between_covariance;
  }
  if (frame->last && frame->before) {
    for (int64_t d = 0; d < size; d++)
      pose[d] = frame->last[d] + b->momentum * (frame->last[d] - frame->before[d]);
    if ((status = STAGE(continue_prior)(size, prior, spread, pose, b->change, work, mean, covariance))) return status;
  } else {
    memcpy(mean, prior, (size_t)size * sizeof(double));
    memcpy(covariance, spread, (size_t)square * sizeof(double));
  }
  int64_t counts[4] = {b->body->joints, b->body->carrying, b->markers->frames->markers, frame->rows};
  double settings[4] = {c->straight_rad, c->limit_rad, c->first_damping, c->damping_growth}, *sigmas = work;
  for (int64_t r = 0; r < frame->rows; r++) sigmas[r] = hypot(b->marker_sigma_m, frame->noise[r]);
  if ((status = STAGE(fit_to_markers)(counts, b->body->indices, b->body->lengths, frame->row_markers, frame->axes,
                                      frame->origins, sigmas, mean, covariance, root, root + 7, b->limits, settings,
                                      c->steps, work + frame->rows, pose, fitted, steps)))
    return status;
  numbers[1] = STAGE(tilt)(b->markers, frame->count, frame->chosen, fitted);
  const double *vague = learned ? learned : closest;
  const double *deviations = learned ? frame->learned_covariance : closest_covariance;
  for (int64_t j = 0; j < size; j += 3) {
    double sum = 0.0;
    for (int64_t i = j; i < j + 3; i++) {
      double away = pose[i] - vague[i], other = pose[i] - closest[i];
      sum += deviations[i * size + i] + away * away + other * other;
    }
    uncertainty[j / 3] = sqrt(sum / 3.0) * (learned ? 1.0 : c->alone) * b->uncertainty_share;
  }
  return 0;
}
