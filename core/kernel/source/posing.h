/* Markers of many poses: core/body/posed_markers.py. */

/* cos(h) and sin(h) / h of a squared angle h^2, h up to pi / 2, by their series: what is left out is less than the
   rounding of 1 */
static void STAGE(half_turn)(v4d square, v4d *cosine, v4d *sine_share) {
  v4d even = {1.0, 1.0, 1.0, 1.0}, odd = even;
  for (int n = 12; n > 0; n--) {
    even = 1.0 - square * (1.0 / (double)((2 * n - 1) * (2 * n))) * even;
    odd = 1.0 - square * (1.0 / (double)((2 * n) * (2 * n + 1))) * odd;
  }
  *cosine = even, *sine_share = odd;
}

/* place = origin + offset (3,), turned by a rotation unless that is null */
static void STAGE(place)(const v4d *origin, const v4d *turn, const double *offset, v4d *place) {
  for (int i = 0; i < 3; i++) place[i] = origin[i] + offset[i];
  if (!turn) return;
  v4d twice[3];
  for (int i = 0; i < 3; i++) {
    int j = (i + 1) % 3, k = (i + 2) % 3;
    twice[i] = 2.0 * (turn[1 + j] * offset[k] - turn[1 + k] * offset[j]);
  }
  for (int i = 0; i < 3; i++) {
    int j = (i + 1) % 3, k = (i + 2) % 3;
    place[i] = origin[i] + (offset[i] + turn[0] * twice[i] + (turn[1 + j] * twice[k] - turn[1 + k] * twice[j]));
  }
}

/* product of two quaternions */
static void STAGE(turned)(const v4d *a, const v4d *b, v4d *product) {
  product[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
  product[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
  product[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
  product[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

/* out (F, M, 3): markers of poses (F, columns) with the root at rest. sizes: F, columns, B, M. Of B joints, parents
   first, the root, which is none of them, is parent -1. indices: their parents (B,), their places in a pose (B,), and
   the carriers of the markers (M,). lengths: reference rotations (B, 4), offsets (B, 3), offsets of the markers (M, 3).
   Returns 0, or 1 if B is more than 64. */
EXPORT int64_t STAGE(markers_at_rest)(const int64_t *sizes, const int64_t *indices, const double *lengths,
                                      const float *poses, float *out) {
  int64_t count = sizes[0], columns = sizes[1], joints = sizes[2], markers = sizes[3];
  const int64_t *parents = indices, *places = indices + joints, *carriers = places + joints;
  const double *means = lengths, *offsets = means + 4 * joints, *marker_offsets = offsets + 3 * joints;
  v4d world[64][4], origins[64][3];
  const v4d root[3] = {{0.0}};
  if (joints > 64) return 1;
  for (int64_t first = 0; first < count; first += 4) { /* four poses at a time; the last ones may be the same */
    const float *pose[4];
    for (int i = 0; i < 4; i++) pose[i] = poses + (first + i < count ? first + i : count - 1) * columns;
    for (int64_t b = 0; b < joints; b++) {
      v4d vector[3], turn[4], mean[4], own[4], cosine, share, square = {0.0};
      for (int i = 0; i < 3; i++) {
        int64_t at = places[b] + i;
        vector[i] = (v4d){pose[0][at], pose[1][at], pose[2][at], pose[3][at]};
        square += vector[i] * vector[i];
      }
      STAGE(half_turn)(0.25 * square, &cosine, &share);
      for (int i = 0; i < 4; i++)
        if (!(square[i] < 9.0)) { /* more than a half turn */
          double angle = sqrt(square[i]);
          cosine[i] = cos(0.5 * angle), share[i] = sin(0.5 * angle) / (0.5 * angle);
        }
      turn[0] = cosine;
      for (int i = 0; i < 3; i++) turn[1 + i] = vector[i] * (0.5 * share);
      for (int i = 0; i < 4; i++) mean[i] = (v4d){0.0} + means[4 * b + i];
      int64_t parent = parents[b];
      STAGE(turned)(mean, turn, parent < 0 ? world[b] : own);
      if (parent >= 0) STAGE(turned)(world[parent], own, world[b]);
      STAGE(place)(parent < 0 ? root : origins[parent], parent < 0 ? 0 : world[parent], offsets + 3 * b, origins[b]);
    }
    for (int64_t m = 0; m < markers; m++) {
      v4d place[3];
      int64_t c = carriers[m];
      STAGE(place)(c < 0 ? root : origins[c], c < 0 ? 0 : world[c], marker_offsets + 3 * m, place);
      for (int64_t k = 0; k < 4 && first + k < count; k++)
        for (int i = 0; i < 3; i++) out[((first + k) * markers + m) * 3 + i] = (float)place[i][k];
    }
  }
  return 0;
}
