/* What a solver knows before its first frame, as `Packed` in core/kernel/library.py lays it out: fields of eight bytes.
   F frames of a database, M markers, poses of D values, J joints, L lags. */

/* Markers in all frames: core/solver/database_markers.py */
typedef struct {
  int64_t count, width, markers;      /* F, values in a row, M */
  const int16_t *rows;                /* (F, width), in the order of the cells */
  const int32_t *order, *places;      /* (F,) frame of each row, row of each frame */
  double unit;                        /* of the coordinates in rows */
} Frames;

/* A body that carries markers: core/solver/marker_kinematics.py */
typedef struct {
  int64_t joints, carrying;           /* J, and those that carry markers */
  const int64_t *indices;
  const double *lengths;
} Body;

/* Search in cells: core/solver/search/inverted_file.py */
typedef struct {
  const Frames *frames;
  int64_t size;                       /* D */
  const float *poses;                 /* (F, D) */
  int64_t cells;
  const int64_t *starts;              /* (cells + 1,) */
  const float *centres;               /* (cells, width) */
  const float *units, *square_units;  /* (width,) */
  int64_t facts;                      /* values after the markers in a row: components of the pose, length of the rest */
  const float *components;            /* (D, facts - 1) */
  double alike;
  int64_t scanned, compared, first;   /* frames scanned and compared in full, and those that are sorted */
} Cells;

/* Every nth frame: core/solver/search/sample.py */
typedef struct {
  int64_t count, width, step;         /* frames of the sample, 3 M, n */
  const int16_t *rows;                /* (count, width) */
  double unit;                        /* of the coordinates in rows */
} Sample;

/* Root and examples: core/solver/locator.py */
typedef struct {
  const Cells *cells;
  const Body *body;
  const double *torso;                /* (M,) weights of the markers that locate the root, 0 for others */
  const double *factors;              /* (F,) of the squared distances, or null */
  double marker_weight, pose_weight;
  int64_t examples, closest;          /* examples wanted, and those whose mean torso locates the root again */
} Locator;

typedef struct {
  const Locator *locator;
  const Sample *sample;
  int64_t passes, wanted;             /* alternations with the sample, and frames around its closest */
} Hurried;

/* Earlier frames, markers and poses: core/solver/lagged_history.py */
typedef struct {
  int64_t count;                      /* L */
  const int64_t *lags, *ends;         /* (L,) frames; (clips, 2) first and last frames */
  const int32_t *clips;               /* (F,) */
} Lags;

typedef struct {
  const Frames *frames;
  const Lags *lags;
  const int16_t *matrices;            /* (F, 9) rotations of the roots */
  double matrix_unit;
  const float *positions;             /* (F, 3) of the roots */
} EarlierMarkers;

typedef struct {
  const float *poses;                 /* (F, D) */
  int64_t size, count, padded;        /* D; components, and columns of the array of them, a multiple of 32 */
  const float *components;            /* (D, padded) */
} EarlierPoses;

/* The method "best": core/solver/best_estimate.py */
typedef struct {
  const Body *body;
  const EarlierMarkers *markers;
  const EarlierPoses *poses;
  const float *floor;                 /* (N, N), N = D + L (3 M + components) */
  const double *change;               /* (D, D) covariance of a pose about the continued motion */
  const double *limits;               /* (2, D) */
  int64_t is_known;                   /* whether the body is in the database */
  double history_share, history_sigma_m, history_sigma_rad, root_sigma_m, root_sigma_rad, marker_sigma_m;
  double prior_share, momentum, trusted, uncertainty_share;
} Best;

/* Its constants */
typedef struct {
  double width, tiny, expected_sigma_m, vague, most_inflation, usual_deviation, joint_share, least_off, alone;
  double straight_rad, limit_rad, first_damping, damping_growth;
  int64_t steps;
} BestConstants;

/* The learned prior: core/solver/motion_prior.py */
typedef struct {
  int64_t lags, markers, joints, features, hidden, worn, width, outputs; /* L, M, J - 1, F, H, P, W, O */
  const double *lags_s, *torso, *rest, *offsets;                         /* (L,), (M,), (M, 3), (M, 3) scaled */
  const int64_t *parts;                                                  /* (M,) */
  const int16_t *marker_weights, *first, *weights, *output_weights;      /* (M, F, H), (P H, W), (2, W, W), (W, 2 O) */
  const float *marker_biases, *first_bias, *biases, *output_biases;      /* (M, H), (W,), (2, W), (2 O,) */
  const double *scales, *spread, *change, *back, *correlation;
  double lag_floor_s, by_one_camera, fastest, farthest, least_log, most_log, unit;
} Network;

/* Settings of tracks: core/labelling/marker_tracks.py */
typedef struct {
  double gate, speed_share, unknown_speed, hidden_speed, limb_gate, torso_gate, memory, steady;
} Tracking;

typedef struct {
  double distance;
  int64_t index;
} Candidate;
