/* The learned prior of one frame: core/solver/motion_prior.py. */

/* x / (1 + exp(-x)) of n values */
static void STAGE(silu)(int64_t n, float *x) {
  for (int64_t i = 0; i < n; i++) x[i] /= 1.0f + expf(-x[i]);
}

/* a weight in half precision, in a unit; see `MotionPrior.packed` */
static float STAGE(half)(int16_t stored) {
  int32_t wide = (int32_t)((uint32_t)(int32_t)stored << 13) & (int32_t)0x8fffe000;
  float value;
  memcpy(&value, &wide, sizeof value);
  return value;
}

/* eight of them */
static v8f STAGE(halves)(const int16_t *stored) {
  v8s bits;
  v8f values;
  memcpy(&bits, stored, sizeof bits);
  v8i wide = (__builtin_convertvector(bits, v8i) << 13) & (int32_t)0x8fffe000;
  memcpy(&values, &wide, sizeof values);
  return values;
}

/* out (columns,) = bias + x (rows,) weights (rows, columns), of which up to four rows are added at once */
static void STAGE(layer)(int64_t rows, int64_t columns, const float *restrict x, const int16_t *weights, float unit,
                         const float *bias, float *restrict out) {
  memcpy(out, bias, (size_t)columns * sizeof(float));
  for (int64_t r = 0; r < rows; r += 4) {
    const int16_t *w[4];
    float share[4];
    for (int64_t i = 0; i < 4; i++) {
      int is_row = r + i < rows;
      w[i] = weights + (is_row ? r + i : r) * columns;
      share[i] = is_row ? x[r + i] * unit : 0.0f;
    }
    int64_t c = 0;
    for (; c + 8 <= columns; c += 8) {
      v8f sum;
      memcpy(&sum, out + c, sizeof sum);
      sum += (share[0] * STAGE(halves)(w[0] + c) + share[1] * STAGE(halves)(w[1] + c)) +
             (share[2] * STAGE(halves)(w[2] + c) + share[3] * STAGE(halves)(w[3] + c));
      memcpy(out + c, &sum, sizeof sum);
    }
    for (; c < columns; c++)
      out[c] += (share[0] * STAGE(half)(w[0][c]) + share[1] * STAGE(half)(w[1][c])) +
                (share[2] * STAGE(half)(w[2][c]) + share[3] * STAGE(half)(w[3][c]));
  }
}

/* features (F,) of a marker at L lags in the body frame, points (L, stride, 3); see `marker_features`. Returns whether
   it was located at any of them. */
static int STAGE(features)(const Network *n, int64_t marker, const double *points, int is_single, float *features) {
  int64_t lags = n->lags, stride = 3 * n->markers, latest = 0, any = 0;
  const double *offset = n->offsets + 3 * marker, *rest = n->rest + 3 * marker;
  double values[3];
  float *moved = features + 9, *certain = moved + 3 * (lags - 1);
  while (latest < lags && !isfinite(points[latest * stride])) latest++;
  int is_visible = latest < lags;
  if (!is_visible) latest = 0;
  for (int64_t l = 0; l < lags; l++) {
    int is_seen = isfinite(points[l * stride]);
    if (l) {
      double square = 0.0;
      for (int i = 0; i < 3; i++) {
        values[i] = (points[l * stride + i] - points[latest * stride + i]) / (n->lag_floor_s + n->lags_s[l]);
        square += values[i] * values[i];
      }
      is_seen = is_seen && square < n->fastest * n->fastest;
      for (int i = 0; i < 3; i++) moved[3 * (l - 1) + i] = is_seen ? (float)values[i] : 0.0f;
    }
    certain[l] = is_seen ? (l == 0 && is_single ? (float)n->by_one_camera : 1.0f) : 0.0f;
    any |= is_seen;
  }
  for (int i = 0; i < 3; i++) {
    features[i] = any ? (float)(points[latest * stride + i] - rest[i]) : 0.0f;
    features[3 + i] = (float)offset[i];
    features[6 + i] = (float)rest[i];
  }
  for (int64_t i = 0; i < n->features; i++) { /* bounded inputs keep the outputs finite */
    if (features[i] > (float)n->fastest) features[i] = (float)n->fastest;
    if (features[i] < -(float)n->fastest) features[i] = -(float)n->fastest;
  }
  return is_visible;
}

/* mean (D,) and covariance (D, D) of a pose, root (7,) and two deviations, for points (L, M, 3) in the world, NaN where
   not located, and a mask (M,) of those that only one camera sees now. root: at first that of the last frame.
   doubles: 3 L M + 7 M + 4 O + 9 O; singles: F + H + P H + 2 W + 2 O. Returns 0, or 2 if a point is too large. */
EXPORT int64_t STAGE(learned_prior)(const Network *n, const double *points, const uint8_t *single, double *doubles,
                                    float *singles, double *mean, double *covariance, double *root, double *sigmas) {
  int64_t markers = n->markers, width = n->width, outputs = n->outputs;
  double *local = doubles, *means = local + 3 * n->lags * markers, *deviations = means + outputs;
  double *work = deviations + outputs;
  float *features = singles, *hidden = features + n->features, *parts = hidden + n->hidden;
  float *state = parts + n->worn * n->hidden, *added = state + width, *found = added + width;
  if (STAGE(fit_root)(markers, n->torso, points, n->rest, work, root)) return 2;
  STAGE(to_root_frame)(n->lags * markers, points, root, local);
  memset(parts, 0, (size_t)(n->worn * n->hidden) * sizeof(float));
  for (int64_t m = 0; m < markers; m++) {
    if (!STAGE(features)(n, m, local + 3 * m, single[m], features)) continue;
    STAGE(layer)(n->features, n->hidden, features, n->marker_weights + m * n->features * n->hidden,
                 (float)n->unit, n->marker_biases + m * n->hidden, hidden);
    STAGE(silu)(n->hidden, hidden);
    for (int64_t h = 0; h < n->hidden; h++) parts[n->parts[m] * n->hidden + h] += hidden[h];
  }
  STAGE(layer)(n->worn * n->hidden, width, parts, n->first, (float)n->unit, n->first_bias, state);
  STAGE(silu)(width, state);
  for (int64_t l = 0; l < 2; l++) {
    STAGE(layer)(width, width, state, n->weights + l * width * width, (float)n->unit, n->biases + l * width, added);
    STAGE(silu)(width, added);
    for (int64_t i = 0; i < width; i++) state[i] += added[i];
  }
  STAGE(layer)(width, 2 * outputs, state, n->output_weights, (float)n->unit, n->output_biases, found);
  for (int64_t o = 0; o < outputs; o++) {
    double value = found[o], log_sigma = found[outputs + o];
    value = value < -n->farthest ? -n->farthest : value > n->farthest ? n->farthest : value;
    log_sigma = log_sigma < n->least_log ? n->least_log : log_sigma > n->most_log ? n->most_log : log_sigma;
    means[o] = n->scales[o] + n->scales[outputs + o] * value;
    deviations[o] = hypot(n->spread[o] * n->scales[outputs + o] * exp(log_sigma), n->spread[outputs + o]);
  }
  double turn[4], q[4], r[9];
  STAGE(matrix)(root, r);
  STAGE(quaternion)(means, turn);
  memcpy(q, root, sizeof q);
  STAGE(multiply)(q, turn, root);
  STAGE(carry)(root + 4, r, means + 3, root + 4);
  for (int s = 0; s < 2; s++) { /* position, then rotation */
    const double *own = deviations + 3 * (1 - s);
    sigmas[s] = sqrt((own[0] * own[0] + own[1] * own[1] + own[2] * own[2]) / 3.0);
  }
  STAGE(moved_gaussian)(n->joints, means + 6, deviations + 6, n->change, n->back, n->correlation, work, mean,
                        covariance);
  return 0;
}
