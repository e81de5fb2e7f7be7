/* Root and closest examples of a frame that continues a motion: core/solver/locator.py. */

static int STAGE(is_nearer)(Candidate a, Candidate b) {
  return a.distance < b.distance || (a.distance == b.distance && a.index < b.index);
}

static void STAGE(swap)(Candidate *a, Candidate *b) {
  Candidate kept = *a;
  *a = *b;
  *b = kept;
}

/* Brings the nearest k of n candidates to the front, in any order (Hoare 1961). */
static void STAGE(select)(Candidate *all, int64_t n, int64_t k) {
  int64_t low = 0, high = n - 1;
  while (0 < k && k < n && low < high) {
    int64_t middle = low + (high - low) / 2, i = low, j = high;
    if (STAGE(is_nearer)(all[middle], all[low])) STAGE(swap)(all + middle, all + low);
    if (STAGE(is_nearer)(all[high], all[low])) STAGE(swap)(all + high, all + low);
    if (STAGE(is_nearer)(all[high], all[middle])) STAGE(swap)(all + high, all + middle);
    const Candidate pivot = all[middle];
    while (i <= j) {
      while (STAGE(is_nearer)(all[i], pivot)) i++;
      while (STAGE(is_nearer)(pivot, all[j])) j--;
      if (i <= j) STAGE(swap)(all + i++, all + j--);
    }
    if (k - 1 <= j)
      high = j;
    else if (k - 1 >= i)
      low = i;
    else
      return;
  }
}

/* Sorts n candidates, nearest first (Williams 1964). */
static void STAGE(sort)(Candidate *all, int64_t n) {
  for (int64_t start = n / 2 - 1, stop = n; stop > 1;) {
    if (start < 0) STAGE(swap)(all, all + --stop);
    int64_t root = start < 0 ? 0 : start--;
    for (int64_t child; (child = 2 * root + 1) < stop; root = child) {
      if (child + 1 < stop && STAGE(is_nearer)(all[child], all[child + 1])) child++;
      if (!STAGE(is_nearer)(all[root], all[child])) break;
      STAGE(swap)(all + root, all + child);
    }
  }
}

/* A distance that is not a number counts as infinite. */
static Candidate STAGE(candidate)(double distance, int64_t index) {
  Candidate found = {isnan(distance) ? INFINITY : distance, index};
  return found;
}

/* Adds one of the candidates of which the nearest k > 0 are wanted; whenever there are 4 times as many, only these are
   kept. limit: not a number at first, then the distance from which on no other is added. */
static inline void STAGE(keep)(Candidate next, int64_t k, Candidate *among, int64_t *count, double *limit) {
  if (next.distance >= *limit) return;
  among[(*count)++] = next;
  if (*count < 4 * k) return;
  STAGE(select)(among, *count, k);
  *count = k, *limit = among[0].distance;
  for (int64_t i = 1; i < k; i++)
    if (among[i].distance > *limit) *limit = among[i].distance;
}

/* Asks for what is stored about a frame. */
static void STAGE(fetch)(const Cells *cells, int64_t frame) {
  const char *row = (const char *)(cells->frames->rows + cells->frames->places[frame] * cells->frames->width);
  const char *pose = (const char *)(cells->poses + frame * cells->size);
  for (int64_t at = 0; at < cells->frames->width * 2; at += 64) __builtin_prefetch(row + at);
  for (int64_t at = 0; at < cells->size * 4; at += 64) __builtin_prefetch(pose + at);
}

/* Distance of a database frame from a target and weights (3 M,) and a pose (D,), of which the latter may be null. */
static float STAGE(frame_distance)(const Cells *cells, int64_t frame, const float *target, const float *weights,
                                   const float *pose, float pose_weight) {
  const Frames *f = cells->frames;
  float distance = STAGE(row_distance)(f->rows + f->places[frame] * f->width, 3 * f->markers, (float)f->unit, target,
                                       weights);
  return pose ? distance + pose_weight * STAGE(pose_distance)(cells->poses + frame * cells->size, pose, cells->size)
              : distance;
}

/* Sets found to the frames most likely to be closest, as `CellSearch.near` does; returns their number. visited: number
   of frames and cells that were compared. query, of which the first 3 M stand for the markers: work for 2 rows.
   among: work for the cells, or for 4 times the frames compared in full if these are more. */
static int64_t STAGE(near)(const Cells *cells, const float *target, const float *weights, const float *pose,
                           float pose_weight, float *query, Candidate *among, int64_t *found, int64_t *visited) {
  const Frames *f = cells->frames;
  int64_t width = f->width, points = 3 * f->markers, count = 0, rows = 0, known = cells->facts - 1;
  float *shares = query + width;
  memset(query, 0, 2 * (size_t)width * sizeof(float));
  memcpy(query, target, (size_t)points * sizeof(float));
  memcpy(shares, weights, (size_t)points * sizeof(float));
  if (pose) {
    float *facts = query + points, whole = 0.0f, strongest = 0.0f;
    for (int64_t d = 0; d < cells->size; d++) {
      whole += pose[d] * pose[d];
      for (int64_t c = 0; c < known; c++) facts[c] += pose[d] * cells->components[d * known + c];
    }
    for (int64_t c = 0; c < known; c++) strongest += facts[c] * facts[c];
    facts[known] = sqrtf(whole - strongest > 0.0f ? whole - strongest : 0.0f) * (float)cells->alike;
    for (int64_t c = 0; c <= known; c++) shares[points + c] = pose_weight;
  }
  for (int64_t i = 0; i < width; i++) {
    query[i] /= cells->units[i];
    shares[i] *= cells->square_units[i];
  }
  int64_t every = cells->scanned >= f->count, chosen = 1;
  if (every) {
    rows = *visited = f->count;
  } else {
    for (int64_t c = 0; c < cells->cells; c++) {
      const float *centre = cells->centres + c * width;
      v8f sums = {0.0f};
      float away = 0.0f;
      int64_t i = 0;
      for (; i + 8 <= width; i += 8) {
        v8f middle, aim, share;
        memcpy(&middle, centre + i, sizeof middle);
        memcpy(&aim, query + i, sizeof aim);
        memcpy(&share, shares + i, sizeof share);
        sums += (middle * middle - 2.0f * aim * middle) * share;
      }
      for (; i < width; i++) away += (centre[i] * centre[i] - 2.0f * query[i] * centre[i]) * shares[i];
      among[c] = STAGE(candidate)(STAGE(sum)(&sums, away), c);
    }
    chosen = (int64_t)ceil((double)cells->scanned / (double)f->count * (double)cells->cells) + 1;
    if (chosen > cells->cells) chosen = cells->cells;
    STAGE(select)(among, cells->cells, chosen);
    for (int64_t c = 0; c < chosen; c++) rows += cells->starts[among[c].index + 1] - cells->starts[among[c].index];
    if (rows < cells->compared) {
      STAGE(sort)(among, cells->cells);
      for (chosen = rows = 0; chosen < cells->cells && rows < cells->compared; chosen++)
        rows += cells->starts[among[chosen].index + 1] - cells->starts[among[chosen].index];
    }
    *visited = rows + cells->cells;
    for (int64_t c = 0; c < chosen; c++) found[c] = among[c].index;
  }
  int64_t wanted = (cells->compared < rows - 1 ? cells->compared : rows - 1) + 1;
  double limit = NAN;
  for (int64_t c = 0; c < chosen; c++) {
    int64_t row = every ? 0 : cells->starts[found[c]], stop = every ? f->count : cells->starts[found[c] + 1];
    for (; row < stop; row++)
      STAGE(keep)(STAGE(candidate)(STAGE(row_distance)(f->rows + row * width, width, 1.0f, query, shares), row), wanted,
                  among, &count, &limit);
  }
  STAGE(select)(among, count, wanted);
  int64_t sorted = wanted == f->count || wanted < cells->first ? wanted : cells->first;
  STAGE(select)(among, wanted, sorted);
  for (int64_t k = 0; k < wanted; k++) {
    int64_t frame = f->order[among[k].index];
    among[k].index = frame;
    if (k + AHEAD < sorted) STAGE(fetch)(cells, f->order[among[k + AHEAD].index]);
    if (k < sorted)
      among[k] = STAGE(candidate)(STAGE(frame_distance)(cells, frame, target, weights, pose, pose_weight), frame);
  }
  STAGE(sort)(among, sorted);
  for (int64_t k = 0; k < wanted; k++) found[k] = among[k].index;
  return wanted;
}

/* points (n, 3) in the frame of a root (7,) */
static void STAGE(to_root_frame)(int64_t n, const double *points, const double *root, double *local) {
  double r[9];
  STAGE(matrix)(root, r);
  for (int64_t k = 0; k < n; k++, points += 3, local += 3) {
    double p[3] = {points[0] - root[4], points[1] - root[5], points[2] - root[6]};
    for (int i = 0; i < 3; i++) local[i] = p[0] * r[i] + p[1] * r[3 + i] + p[2] * r[6 + i];
  }
}

static int STAGE(is_located)(const double *point) {
  return isfinite(point[0]) && isfinite(point[1]) && isfinite(point[2]);
}

/* Fits a root (7,), the last frame's, to points (M, 3), NaN where not located; local (M, 3) are a pose's markers, torso
   (M,) their weights; see `root_from_torso`. work: 7 M. Returns 0, or 2 if a point is too large. */
static int64_t STAGE(fit_root)(int64_t markers, const double *torso, const double *points, const double *local,
                               double *work, double *root) {
  double *source = work, *target = source + 3 * markers, *weights = target + 3 * markers;
  int64_t fitted = 0, located = 0;
  double r[9], shift[3] = {0.0};
  STAGE(matrix)(root, r);
  for (int64_t m = 0; m < markers; m++) {
    double world[3];
    if (!STAGE(is_located)(points + 3 * m)) continue;
    STAGE(carry)(root + 4, r, local + 3 * m, world);
    located++;
    for (int i = 0; i < 3; i++) shift[i] += points[3 * m + i] - world[i];
    if (torso[m] == 0.0) continue;
    memcpy(source + 3 * fitted, local + 3 * m, 3 * sizeof(double));
    memcpy(target + 3 * fitted, points + 3 * m, 3 * sizeof(double));
    weights[fitted++] = torso[m];
  }
  if (fitted >= 3) return STAGE(fit_rigid)(fitted, source, target, weights, root);
  for (int i = 0; i < 3 && located; i++) root[4 + i] += shift[i] / (double)located;
  return 0;
}

/* target and weights (3 M,) of a search for points (M, 3) in the frame of a root; local: work for 3 M */
static void STAGE(query)(const Locator *l, const double *points, const double *root, double *local, float *target,
                         float *weights) {
  int64_t markers = l->cells->frames->markers;
  STAGE(to_root_frame)(markers, points, root, local);
  for (int64_t i = 0; i < 3 * markers; i++) {
    int is_seen = isfinite(local[i]);
    target[i] = is_seen ? (float)local[i] : 0.0f;
    weights[i] = is_seen ? (float)l->marker_weight : 0.0f;
  }
}

/* pose (D,): one that continues the motion, in single precision. Returns 0, or 2 if it is not finite. */
static int64_t STAGE(narrow)(int64_t size, const double *continued, float *pose) {
  for (int64_t d = 0; d < size; d++) {
    if (!isfinite(continued[d])) return 2;
    pose[d] = (float)continued[d];
  }
  return 0;
}

/* local (M, 3): mean markers of the first of n > 0 candidates */
static void STAGE(closest_mean)(const Locator *l, int64_t n, const Candidate *among, double *local) {
  const Frames *f = l->cells->frames;
  int64_t points = 3 * f->markers, closest = l->closest < n ? l->closest : n;
  memset(local, 0, (size_t)points * sizeof(double));
  for (int64_t k = 0; k < closest; k++) {
    const int16_t *row = f->rows + f->places[among[k].index] * f->width;
    for (int64_t i = 0; i < points; i++) local[i] += (double)((float)row[i] * (float)f->unit);
  }
  for (int64_t i = 0; i < points; i++) local[i] /= (double)closest;
}

/* Computes the distances of n > 0 candidates again; returns the place of the nearest. */
static int64_t STAGE(compare)(const Locator *l, int64_t n, const float *target, const float *weights, const float *pose,
                              Candidate *among) {
  const Cells *cells = l->cells;
  const float pose_weight = (float)l->pose_weight;
  int64_t nearest = 0;
  for (int64_t k = 0; k < n; k++) {
    int64_t frame = among[k].index;
    if (k + AHEAD < n) STAGE(fetch)(cells, among[k + AHEAD].index);
    among[k] = STAGE(candidate)(STAGE(frame_distance)(cells, frame, target, weights, pose, pose_weight), frame);
    if (STAGE(is_nearer)(among[k], among[nearest])) nearest = k;
  }
  return nearest;
}

/* Root and examples of `locate` from counts[0] candidates and the mean markers of the closest, with which doubles begin.
   singles: work for 6 M. Sets counts[1], but not counts[2]. Returns 0, or 2 if a point is not finite. */
static int64_t STAGE(choose)(const Locator *l, const double *points, const float *pose, double *doubles, float *singles,
                             Candidate *among, double *root, int64_t *chosen, double *distances, float *poses,
                             float *markers, int64_t *counts, double *nearest_m) {
  const Frames *f = l->cells->frames;
  int64_t count = f->markers, size = l->cells->size;
  double *local = doubles, *work = local + 3 * count;
  float *target = singles, *weights = target + 3 * count;
  if (STAGE(fit_root)(count, l->torso, points, local, work, root)) return 2;
  STAGE(query)(l, points, root, local, target, weights);
  int64_t nearest = STAGE(compare)(l, counts[0], target, weights, pose, among);
  for (int64_t k = 0; k < counts[0] && l->factors; k++) {
    if (!(among[k].distance > 0.0)) among[k].distance = 0.0;
    if (k != nearest) among[k].distance *= l->factors[among[k].index];
  }
  double square = 0.0;
  int64_t located = 0;
  const int16_t *own = f->rows + f->places[among[nearest].index] * f->width;
  for (int64_t m = 0; m < count; m++) { /* local are the points in the root's frame */
    if (!STAGE(is_located)(points + 3 * m)) continue;
    located++;
    for (int64_t i = 3 * m; i < 3 * m + 3; i++) {
      double away = local[i] - (double)((float)own[i] * (float)f->unit);
      square += away * away;
    }
  }
  *nearest_m = located ? sqrt(square / (double)located) : NAN;
  counts[1] = l->examples < counts[0] ? l->examples : counts[0];
  STAGE(select)(among, counts[0], counts[1]);
  STAGE(sort)(among, counts[1]);
  for (int64_t k = 0; k < counts[1]; k++) {
    int64_t frame = chosen[k] = among[k].index;
    const int16_t *row = f->rows + f->places[frame] * f->width;
    distances[k] = among[k].distance;
    memcpy(poses + k * size, l->cells->poses + frame * size, (size_t)size * sizeof(float));
    for (int64_t i = 0; i < 3 * count; i++) markers[3 * count * k + i] = (float)row[i] * (float)f->unit;
  }
  return 0;
}

/* Root (7,) and examples for points (M, 3), NaN where not located, and a pose (D,) that continues the motion.

   root: that of the last frame; then the one found. found: frames from which examples were chosen; chosen (examples,):
   these, with their distances, poses (examples, D) and markers (examples, M, 3), closest first.
   counts (3,): frames found, chosen and visited; nearest: RMS distance (m) of the points from the closest example.
   doubles: work for 13 M + 3 values; singles: 6 M + 2 rows + D; among: see `near`; found has room for the cells and for
   all frames compared. Returns 0, or 2 if a point or a pose is not finite. */
EXPORT int64_t STAGE(locate)(const Locator *l, const double *points, const double *continued, double *doubles,
                             float *singles, Candidate *among, double *root, int64_t *found, int64_t *chosen,
                             double *distances, float *poses, float *markers, int64_t *counts, double *nearest_m) {
  static const double still[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}, origin[3] = {0.0};
  const Cells *cells = l->cells;
  int64_t count = cells->frames->markers, size = cells->size;
  double *local = doubles, *work = local + 3 * count;
  float *target = singles, *weights = target + 3 * count, *pose = weights + 3 * count, *query = pose + size;
  if (STAGE(markers)(1, l->body->joints, l->body->carrying, count, l->body->indices, l->body->lengths, continued, still,
                     origin, local, 0))
    return 1;
  if (STAGE(narrow)(size, continued, pose)) return 2;
  if (!(l->pose_weight > 0.0)) pose = 0;
  if (STAGE(fit_root)(count, l->torso, points, local, work, root)) return 2;
  STAGE(query)(l, points, root, local, target, weights);
  counts[0] = STAGE(near)(cells, target, weights, pose, (float)l->pose_weight, query, among, found, counts + 2);
  STAGE(closest_mean)(l, counts[0], among, local);
  return STAGE(choose)(l, points, pose, doubles, singles, among, root, chosen, distances, poses, markers, counts,
                       nearest_m);
}
