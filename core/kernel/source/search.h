/* Search in the database: core/solver/search/stored_distances.py and core/solver/lagged_history.py. */

#define AHEAD 8 /* frames for which memory is asked beforehand, because frames lie apart in it */

/* The sum of weights (away)^2 of the eight values at a time and the rest, in one order for every instruction set. */
static float STAGE(sum)(const v8f *sums, float rest) {
  const v8f s = *sums;
  return (((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))) + rest;
}

/* Weighted squared distance of a stored row, times its unit, from a target. */
static float STAGE(row_distance)(const int16_t *row, int64_t count, float unit, const float *target,
                                 const float *weights) {
  v8f sums = {0.0f};
  float rest = 0.0f;
  int64_t i = 0;
  for (; i + 8 <= count; i += 8) {
    v8s stored;
    v8f aims, shares;
    memcpy(&stored, row + i, sizeof stored);
    memcpy(&aims, target + i, sizeof aims);
    memcpy(&shares, weights + i, sizeof shares);
    v8f away = __builtin_convertvector(stored, v8f) * unit - aims;
    sums += away * away * shares;
  }
  for (; i < count; i++) {
    float away = (float)row[i] * unit - target[i];
    rest += away * away * weights[i];
  }
  return STAGE(sum)(&sums, rest);
}

/* Squared distance of a pose (size,) from another. */
static float STAGE(pose_distance)(const float *own, const float *pose, int64_t size) {
  v8f sums = {0.0f};
  float rest = 0.0f;
  int64_t i = 0;
  for (; i + 8 <= size; i += 8) {
    v8f values, aims;
    memcpy(&values, own + i, sizeof values);
    memcpy(&aims, pose + i, sizeof aims);
    values -= aims;
    sums += values * values;
  }
  for (; i < size; i++) rest += (own[i] - pose[i]) * (own[i] - pose[i]);
  return STAGE(sum)(&sums, rest);
}

/* distances (K,) of stored rows (F, width), chosen by rows (K,), from a target (count,) in their units.

   Returns 0, or 1 if a row does not exist. */
EXPORT int64_t STAGE(row_distances)(const int16_t *stored, int64_t row_count, int64_t width, const int64_t *rows,
                                    int64_t chosen, const float *target, const float *weights, float *distances) {
  for (int64_t k = 0; k < chosen; k++) {
    if (rows[k] < 0 || rows[k] >= row_count) return 1;
    distances[k] = STAGE(row_distance)(stored + rows[k] * width, width, 1.0f, target, weights);
  }
  return 0;
}

/* The same of frames (K,) that are stored at places (F,), by their first `count` values; to them is added the squared
   distance of their poses (F, size) from a pose (size,), unless that is null, times its weight. */
EXPORT int64_t STAGE(frame_distances)(const int16_t *stored, int64_t row_count, int64_t width, const int32_t *places,
                                      float unit, const int64_t *frames, int64_t chosen, const float *target,
                                      const float *weights, int64_t count, const float *poses, int64_t size,
                                      const float *pose, float pose_weight, float *distances) {
  for (int64_t k = 0; k < chosen; k++) {
    int64_t frame = frames[k];
    if (frame < 0 || frame >= row_count) return 1;
    distances[k] = STAGE(row_distance)(stored + places[frame] * width, count, unit, target, weights);
    if (pose) distances[k] += pose_weight * STAGE(pose_distance)(poses + frame * size, pose, size);
  }
  return 0;
}

/* Asks for the markers of a frame and the rotation of its root. */
static void STAGE(fetch_earlier)(const int16_t *stored, int64_t width, const int32_t *places, const int16_t *matrices,
                                 int64_t frame) {
  __builtin_prefetch(stored + places[frame] * width);
  __builtin_prefetch(stored + places[frame] * width + 32);
  __builtin_prefetch(matrices + 9 * frame);
}

/* out (M, 3): markers of the stored row of a frame in the axes of the root of another, `now`. */
static void STAGE(markers_before)(const int16_t *row, float unit, int64_t marker_count, const int16_t *matrices,
                                  float matrix_unit, const float *positions, int64_t then, int64_t now, float *out) {
  float away[9], back[9], shift[3];
  for (int i = 0; i < 9; i++) back[i] = (float)matrices[9 * now + i] * matrix_unit;
  for (int i = 0; i < 9; i++) away[i] = (float)matrices[9 * then + i] * matrix_unit;
  for (int i = 0; i < 3; i++) shift[i] = positions[3 * then + i] - positions[3 * now + i];
  for (int64_t m = 0; m < marker_count; m++, out += 3) {
    float p[3], world[3];
    for (int i = 0; i < 3; i++) p[i] = (float)row[3 * m + i] * unit;
    for (int i = 0; i < 3; i++)
      world[i] = (away[3 * i] * p[0] + away[3 * i + 1] * p[1] + away[3 * i + 2] * p[2]) + shift[i];
    for (int i = 0; i < 3; i++) out[i] = world[0] * back[i] + world[1] * back[3 + i] + world[2] * back[6 + i];
  }
}

/* out (K, L, M, 3): markers in earlier frames (K, L), in the axes of the roots of frames (K,).

   matrices (F, 9): world-from-root rotations, in units; positions (F, 3): those of the roots. */
EXPORT int64_t STAGE(earlier_markers)(const int16_t *stored, int64_t row_count, int64_t width, const int32_t *places,
                                      float unit, int64_t marker_count, const int16_t *matrices, float matrix_unit,
                                      const float *positions, const int64_t *frames, const int64_t *earlier,
                                      int64_t chosen, int64_t lags, float *out) {
  for (int64_t k = 0; k < chosen; k++) {
    if (frames[k] < 0 || frames[k] >= row_count) return 1;
    for (int64_t l = 0; l < lags && k + AHEAD < chosen; l++) {
      int64_t later = earlier[(k + AHEAD) * lags + l];
      if (later < 0 || later >= row_count) return 1;
      STAGE(fetch_earlier)(stored, width, places, matrices, later);
    }
    for (int64_t l = 0; l < lags; l++, out += 3 * marker_count) {
      int64_t then = earlier[k * lags + l];
      if (then < 0 || then >= row_count) return 1;
      STAGE(markers_before)(stored + places[then] * width, unit, marker_count, matrices, matrix_unit, positions, then,
                            frames[k], out);
    }
  }
  return 0;
}
