/* Pose and root fitted to markers: core/solver/gaussian_conditioning.py. */

/* What is observed: R rows a (p - o) of marker p with axes a (R, 3) and origins o (R, 3), that should be 0, on a body as
   in `markers`. counts: J, B, M, R. */
typedef struct {
  const int64_t *counts, *indices, *row_markers;
  const double *lengths, *axes, *origins;
} STAGE(Controls);

/* residual (R,) and jacobian (R, 6 + D) of the rows, for a pose and a root's matrix and position.
   points: work for 3 M (7 + D) values */
static int64_t STAGE(linearised)(const STAGE(Controls) * controls, const double *pose, const double *matrix,
                                 const double *position, double *points, double *residual, double *jacobian) {
  const int64_t *counts = controls->counts;
  int64_t width = 3 + 3 * counts[0];
  double *full = points + 3 * counts[2];
  if (STAGE(markers)(1, counts[0], counts[1], counts[2], controls->indices, controls->lengths, pose, matrix, position,
                     points, full))
    return 1;
  for (int64_t r = 0; r < counts[3]; r++) {
    const double *axis = controls->axes + 3 * r, *origin = controls->origins + 3 * r;
    int64_t marker = controls->row_markers[r];
    if (marker < 0 || marker >= counts[2]) return 1;
    const double *point = points + 3 * marker, *restrict x = full + 3 * marker * width;
    residual[r] = axis[0] * (point[0] - origin[0]) + axis[1] * (point[1] - origin[1]) + axis[2] * (point[2] - origin[2]);
    double *restrict row = jacobian + r * width;
    for (int64_t j = 0; j < width; j++) row[j] = axis[0] * x[j] + axis[1] * x[width + j] + axis[2] * x[2 * width + j];
  }
  return 0;
}

/* spread (m, 6 + D): J diag(variances, P), and upper triangle of across (m, m), with a stride: spread J^T, of a Jacobian
   J (m, 6 + D), the variances of the root's position and rotation, and the covariance P (D, D) of the pose */
static void STAGE(observed_covariance)(int64_t rows, int64_t size, const double *jacobian, const double *variances,
                                       const double *covariance, double *spread, double *across, int64_t stride) {
  int64_t width = 6 + size;
  for (int64_t i = 0; i < rows; i++) {
    const double *own = jacobian + i * width;
    double *restrict out = spread + i * width;
    for (int j = 0; j < 6; j++) out[j] = own[j] * variances[j / 3];
    for (int64_t j = 6; j < width; j++) out[j] = 0.0;
    for (int64_t k = 0; k < size; k++) {
      double share = own[6 + k];
      const double *restrict row = covariance + k * size;
      if (share == 0.0) continue; /* joints that do not move the marker */
      for (int64_t j = 0; j < size; j++) out[6 + j] += share * row[j];
    }
    for (int64_t j = 0; j <= i; j++) across[j * stride + i] = STAGE(dot)(width, out, jacobian + j * width);
  }
}

/* whitened (R,): deviations of the markers from a prior in its standard deviations, by the Cholesky factor of their
   covariance, whose diagonal (R,) is also a result. root (12,): matrix and position; sigmas: standard deviations of the
   root's position and rotation, and of a marker. work: 3 M (7 + D) + R (2 (6 + D) + R + 4).
   Returns 0, 1 if an index is outside, or 3 if the covariance is not positive definite. */
EXPORT int64_t STAGE(innovation)(const int64_t *counts, const int64_t *indices, const double *lengths,
                                 const int64_t *row_markers, const double *axes, const double *origins,
                                 const double *mean, const double *covariance, const double *root,
                                 const double *sigmas, double *work, double *whitened, double *diagonal) {
  const STAGE(Controls) controls = {counts, indices, row_markers, lengths, axes, origins};
  int64_t rows = counts[3], width = 3 + 3 * counts[0], stride = rows + 4;
  double *jacobian = work + 3 * counts[2] * (1 + width), *spread = jacobian + rows * width;
  double *across = spread + rows * width, variances[2] = {sigmas[0] * sigmas[0], sigmas[1] * sigmas[1]};
  if (STAGE(linearised)(&controls, mean, root, root + 9, work, whitened, jacobian)) return 1;
  STAGE(observed_covariance)(rows, width - 6, jacobian, variances, covariance, spread, across, stride);
  for (int64_t r = 0; r < rows; r++) {
    across[r * stride + r] += sigmas[2] * sigmas[2];
    across[r * stride + rows] = -whitened[r];
  }
  if (STAGE(eliminate)(rows, rows, stride, across)) return 3;
  for (int64_t r = 0; r < rows; r++) {
    whitened[r] = across[r * stride + rows];
    diagonal[r] = across[r * stride + r];
  }
  return 0;
}

/* moved (7,): a root (7,), quaternion and position, moved by a translation and a rotation vector (6,); its matrix */
static void STAGE(moved_root)(const double *root, const double *change, double *moved, double *matrix) {
  double q[4];
  STAGE(quaternion)(change + 3, q);
  STAGE(multiply)(root, q, moved);
  for (int i = 0; i < 3; i++) moved[4 + i] = root[4 + i] + change[i];
  STAGE(matrix)(moved, matrix);
}

/* How far the value is outside its limits, of which the upper ones stand `size` after the lower */
static double STAGE(beyond)(double value, const double *limits, int64_t size) {
  double within = value < limits[0] ? limits[0] : value;
  return value - (within > limits[size] ? limits[size] : within);
}

/* fitted pose (D,) and root (7,), quaternion and position, to R rows (see Controls) with standard deviations (R,) under
   a prior; `fit_to_markers` in Python has the steps in NumPy.

   root (7,) with sigmas (2,); limits (2, D). settings: straight_rad, limit_rad, damping at first, its growth.
   work: 3 M (7 + D) + Q (3 W + 2 Q + 7) + 4 W + 2 D, with Q = R + D and W = 6 + D. taken: number of steps.
   Returns 0, 1 if an index is outside, or 3 if a system is not positive definite. */
EXPORT int64_t STAGE(fit_to_markers)(const int64_t *counts, const int64_t *indices, const double *lengths,
                                     const int64_t *row_markers, const double *axes, const double *origins,
                                     const double *row_sigmas, const double *mean, const double *covariance,
                                     const double *root, const double *root_sigmas, const double *limits,
                                     const double *settings, int64_t steps, double *work, double *pose,
                                     double *fitted, int64_t *taken) {
  const STAGE(Controls) controls = {counts, indices, row_markers, lengths, axes, origins};
  int64_t width = 3 + 3 * counts[0], size = width - 6, rows = counts[3], most = rows + size, used = 0;
  double *jacobian = work + 3 * counts[2] * (1 + width), *slopes = jacobian + most * width;
  double *spread = slopes + most * width, *across = spread + most * width, *system = across + most * most;
  double *residual = system + most * (most + 4), *innovation = residual + most, *forces = innovation + most;
  double *change = forces + most, *dual = change + width, *kept = dual + width, *kept_dual = kept + width;
  double *beyond = kept_dual + width, *is_within = beyond + size;
  double variances[2] = {root_sigmas[0] * root_sigmas[0], root_sigmas[1] * root_sigmas[1]};
  double damping = 0.0, least = INFINITY, matrix[9];
  memset(change, 0, (size_t)(4 * width) * sizeof(double));
  memcpy(fitted, root, 7 * sizeof(double));
  STAGE(matrix)(fitted, matrix);
  for (int64_t j = 0; j < size; j++) {
    pose[j] = mean[j];
    beyond[j] = STAGE(beyond)(pose[j], limits + j, size);
  }
  for (*taken = 0; *taken < steps;) {
    ++*taken;
    if (STAGE(linearised)(&controls, pose, matrix, fitted + 4, work, residual, jacobian)) return 1;
    for (int64_t r = 0; r < rows; r++) {
      residual[r] /= row_sigmas[r];
      for (int64_t j = 0; j < width; j++) jacobian[r * width + j] /= row_sigmas[r];
    }
    int64_t found = rows;
    for (int64_t j = 0; j < size; j++) {
      if (beyond[j] == 0.0) continue;
      residual[found] = beyond[j] / settings[1];
      memset(jacobian + found * width, 0, (size_t)width * sizeof(double));
      jacobian[found++ * width + 6 + j] = 1.0 / settings[1];
    }
    double cost = STAGE(dot)(found, residual, residual) + STAGE(dot)(width, change, dual);
    if (cost > least) {
      memcpy(change, kept, (size_t)(2 * width) * sizeof(double)); /* and the dual one */
      damping = damping * settings[3] > settings[2] ? damping * settings[3] : settings[2];
    } else {
      double *before = slopes;
      slopes = jacobian, jacobian = before, used = found, least = cost;
      memcpy(kept, change, (size_t)(2 * width) * sizeof(double));
      damping /= settings[3] * settings[3];
      STAGE(observed_covariance)(used, size, slopes, variances, covariance, spread, across, most);
      for (int64_t q = 0; q < used; q++) innovation[q] = STAGE(dot)(width, slopes + q * width, change) - residual[q];
      for (int64_t j = 0; j < size; j++) is_within[j] = beyond[j] == 0.0;
    }
    double share = 1.0 / (1.0 + damping);
    int64_t stride = used + 4;
    for (int64_t q = 0; q < used; q++) {
      double *row = system + q * stride;
      for (int64_t j = q; j < used; j++) row[j] = share * across[q * most + j];
      row[q] += 1.0;
      row[used] = innovation[q] - (1.0 - share) * STAGE(dot)(width, slopes + q * width, change);
    }
    if (STAGE(eliminate)(used, used, stride, system)) return 3;
    for (int64_t q = used - 1; q >= 0; q--) {
      const double *row = system + q * stride;
      forces[q] = (row[used] - STAGE(dot)(used - 1 - q, row + q + 1, forces + q + 1)) / row[q];
    }
    for (int64_t j = 0; j < width; j++) change[j] *= 1.0 - share, dual[j] *= 1.0 - share;
    for (int64_t q = 0; q < used; q++) {
      const double *restrict gains = spread + q * width, *restrict slope = slopes + q * width;
      double force = share * forces[q];
      for (int64_t j = 0; j < width; j++) change[j] += gains[j] * force, dual[j] += slope[j] * force;
    }
    STAGE(moved_root)(root, change, fitted, matrix);
    int moves = 0; /* whether anything turned too far for a linear model */
    for (int64_t j = 3; j < width; j++) moves |= !(fabs(change[j] - kept[j]) < settings[0]);
    for (int64_t j = 0; j < size; j++) {
      pose[j] = mean[j] + change[6 + j];
      beyond[j] = STAGE(beyond)(pose[j], limits + j, size);
      moves |= is_within[j] != 0.0 && !(fabs(beyond[j]) < settings[0]);
    }
    if (!moves) return 0;
  }
  /* the cost after the last step is unknown, so the state before it is returned */
  STAGE(moved_root)(root, kept, fitted, matrix);
  for (int64_t j = 0; j < size; j++) pose[j] = mean[j] + kept[6 + j];
  return 0;
}
