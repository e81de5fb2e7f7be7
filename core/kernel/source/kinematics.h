/* Markers of a body and their Jacobian: core/solver/marker_kinematics.py. Matrices are 3 x 3, row by row. */

/* out = a b */
static void STAGE(product)(const double *a, const double *b, double *out) {
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

/* out = p + a v */
static void STAGE(carry)(const double *p, const double *a, const double *v, double *out) {
  for (int i = 0; i < 3; i++) out[i] = p[i] + (a[3 * i] * v[0] + a[3 * i + 1] * v[1] + a[3 * i + 2] * v[2]);
}

/* quaternion of a rotation vector */
static void STAGE(quaternion)(const double *v, double *q) {
  double half = 0.5 * sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]), safe = half > DBL_MIN ? half : DBL_MIN;
  double factor = 0.5 * sin(safe) / safe;
  q[0] = cos(half);
  for (int i = 0; i < 3; i++) q[1 + i] = factor * v[i];
}

/* rotation vector of a quaternion, with an angle of at most pi */
static void STAGE(rotation_vector)(const double *q, double *v) {
  double sine = sqrt((q[1] * q[1] + q[2] * q[2]) + q[3] * q[3]);
  if (sine < DBL_MIN) sine = DBL_MIN;
  double scale = 2.0 * atan2(sine, fabs(q[0])) / sine * (q[0] < 0.0 ? -1.0 : 1.0);
  for (int i = 0; i < 3; i++) v[i] = scale * q[1 + i];
}

/* out = a b, of quaternions; out is neither of them */
static void STAGE(multiply)(const double *a, const double *b, double *out) {
  out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
  out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
  out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
  out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

/* matrix of a unit quaternion */
static void STAGE(matrix)(const double *q, double *matrix) {
  double w = q[0], i = q[1], j = q[2], k = q[3];
  double r[9] = {1 - 2 * (j * j + k * k), 2 * (i * j - w * k),     2 * (i * k + w * j),
                 2 * (i * j + w * k),     1 - 2 * (i * i + k * k), 2 * (j * k - w * i),
                 2 * (i * k - w * j),     2 * (j * k + w * i),     1 - 2 * (i * i + j * j)};
  memcpy(matrix, r, sizeof r);
}

/* exp(v) and its right Jacobian (Sola 2018, Eq. 143) */
static void STAGE(exponential)(const double *v, double *turn, double *jacobian) {
  double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
  double angle = sqrt(square);
  if (angle < 1e-5) angle = 1e-5;
  double sine = sin(angle) / angle, versine = (1.0 - cos(angle)) / (angle * angle);
  double rest = (1.0 - sine) / (angle * angle);
  double cross[9] = {0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0};
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      double both = v[i] * v[j], c = cross[3 * i + j];
      turn[3 * i + j] = sine * c + versine * both + (i == j ? 1.0 - versine * square : 0.0);
      jacobian[3 * i + j] = rest * both - versine * c + (i == j ? sine : 0.0);
    }
}

/* markers (P, M, 3) and, unless null, jacobian (P, M, 3, columns) of poses (P, J - 1, 3) with roots (P, 3, 3), (P, 3).

   The B joints that carry markers stand in order of depth. indices: their parents (B,), their places in the pose (B,),
   and the carrier of each marker (M,). lengths: offsets (B, 3), means (B, 3, 3), offsets of the markers (M, 3).
   Returns 0, or 1 if B is more than 64. */
EXPORT int64_t STAGE(markers)(int64_t poses, int64_t joint_count, int64_t body_count, int64_t marker_count,
                              const int64_t *indices, const double *lengths, const double *pose,
                              const double *root_matrix, const double *root_position, double *markers,
                              double *jacobian) {
  double world[9 * 64], axes[9 * 64], places[3 * 64];
  if (body_count > 64) return 1;
  const int64_t *parents = indices, *joints = indices + body_count, *carriers = joints + body_count;
  const double *offsets = lengths, *means = lengths + 3 * body_count, *marker_offsets = means + 9 * body_count;
  int64_t columns = 3 + 3 * joint_count;
  for (int64_t p = 0; p < poses; p++) {
    memcpy(world, root_matrix + 9 * p, 9 * sizeof(double));
    memcpy(axes, world, 9 * sizeof(double));
    memcpy(places, root_position + 3 * p, 3 * sizeof(double));
    for (int64_t b = 1; b < body_count; b++) {
      double turn[9], right[9], local[9];
      const double *parent = world + 9 * parents[b];
      STAGE(exponential)(pose + 3 * (p * (joint_count - 1) + joints[b] - 1), turn, right);
      STAGE(product)(means + 9 * b, turn, local);
      STAGE(product)(parent, local, world + 9 * b);
      STAGE(product)(world + 9 * b, right, axes + 9 * b);
      STAGE(carry)(places + 3 * parents[b], parent, offsets + 3 * b, places + 3 * b);
    }
    double *found = markers + 3 * marker_count * p;
    for (int64_t m = 0; m < marker_count; m++) {
      int64_t c = carriers[m];
      STAGE(carry)(places + 3 * c, world + 9 * c, marker_offsets + 3 * m, found + 3 * m);
    }
    if (!jacobian) continue;
    double *rows = jacobian + 3 * marker_count * columns * p;
    memset(rows, 0, (size_t)(3 * marker_count * columns) * sizeof(double));
    for (int64_t m = 0; m < marker_count; m++, rows += 3 * columns) {
      for (int i = 0; i < 3; i++) rows[i * columns + i] = 1.0;
      for (int64_t b = carriers[m]; b >= 0; b = parents[b]) {
        double arm[3];
        const double *axis = axes + 9 * b;
        double *x = rows + 3 + 3 * joints[b], *y = x + columns, *z = y + columns;
        for (int i = 0; i < 3; i++) arm[i] = places[3 * b + i] - found[3 * m + i];
        for (int j = 0; j < 3; j++) {
          x[j] = arm[1] * axis[6 + j] - arm[2] * axis[3 + j];
          y[j] = arm[2] * axis[j] - arm[0] * axis[6 + j];
          z[j] = arm[0] * axis[3 + j] - arm[1] * axis[j];
        }
      }
    }
  }
  return 0;
}
