/* One-to-one assignment: core/geometry/gated_assignment.py. */

/* columns (N,): a different one of M >= N columns for each row, with the smallest sum of costs (N, M) (shortest
   augmenting paths, Crouse 2016). path: work for N + 3 M integers; prices: work for N + 2 M values.
   Returns 0, or 2 if a cost is not finite. */
static int64_t STAGE(cheapest_columns)(int64_t row_count, int64_t column_count, const double *costs, int64_t *path,
                                       double *prices, int64_t *columns) {
  int64_t *owners = path + column_count, *is_done = owners + column_count, *visited = is_done + column_count;
  double *column_prices = prices + row_count, *shortest = column_prices + column_count;
  for (int64_t i = 0; i < row_count * column_count; i++)
    if (!isfinite(costs[i])) return 2;
  for (int64_t i = 0; i < row_count + column_count; i++) prices[i] = 0.0;
  for (int64_t j = 0; j < column_count; j++) owners[j] = -1;
  for (int64_t row = 0; row < row_count; row++) {
    int64_t at = row, nearest = -1, count = 0;
    double least = 0.0;
    for (int64_t j = 0; j < column_count; j++) shortest[j] = INFINITY, is_done[j] = 0;
    for (;;) { /* the shortest path from the row to a column without an owner */
      visited[count++] = at;
      nearest = -1;
      for (int64_t j = 0; j < column_count; j++) {
        if (is_done[j]) continue;
        double length = least + costs[at * column_count + j] - prices[at] - column_prices[j];
        if (length < shortest[j]) shortest[j] = length, path[j] = at;
        if (nearest < 0 || shortest[j] < shortest[nearest]) nearest = j;
      }
      least = shortest[nearest];
      if (!isfinite(least)) return 2; /* sums of costs are too large */
      is_done[nearest] = 1;
      if (owners[nearest] < 0) break;
      at = owners[nearest];
    }
    prices[row] += least;
    for (int64_t i = 1; i < count; i++) prices[visited[i]] += least - shortest[columns[visited[i]]];
    for (int64_t j = 0; j < column_count; j++)
      if (is_done[j]) column_prices[j] -= least - shortest[j];
    for (at = -1; at != row;) { /* rows along the path move to the next column */
      at = path[nearest];
      owners[nearest] = at;
      int64_t before = columns[at];
      columns[at] = nearest;
      nearest = before;
    }
  }
  return 0;
}

/* Pairs (2, K) of rows and columns whose costs (N, M) are below the gate and have the smallest sum, in the order of the
   rows, and their count; K is the smaller of N and M. indices: work for 4 (N + M) integers; values: work for
   N M + 2 (N + M) values. Returns 0, or 2 if a cost is -inf. */
EXPORT int64_t STAGE(assign)(int64_t row_count, int64_t column_count, double gate, const double *costs,
                             int64_t *indices, double *values, int64_t *pairs, int64_t *count) {
  const int64_t room = row_count < column_count ? row_count : column_count;
  int64_t *rows = indices, *columns = rows + row_count, height = 0, width = 0;
  for (int64_t n = 0; n < row_count; n++) { /* rows and columns with any cost below the gate */
    int is_used = 0;
    for (int64_t m = 0; m < column_count; m++) is_used |= costs[n * column_count + m] < gate;
    if (is_used) rows[height++] = n;
  }
  for (int64_t m = 0; m < column_count; m++) {
    int is_used = 0;
    for (int64_t n = 0; n < row_count; n++) is_used |= costs[n * column_count + m] < gate;
    if (is_used) columns[width++] = m;
  }
  const int is_wide = height <= width; /* each of the few gets a partner among the many */
  const int64_t few = is_wide ? height : width, many = is_wide ? width : height;
  double *table = values + 2 * (row_count + column_count);
  for (int64_t i = 0; i < few; i++)
    for (int64_t j = 0; j < many; j++) {
      const double cost = costs[rows[is_wide ? i : j] * column_count + columns[is_wide ? j : i]];
      table[i * many + j] = cost < gate ? cost : gate; /* what is forbidden costs as much as no pair at all */
    }
  int64_t *partners = columns + column_count, *path = partners + few, *owners = path;
  if (STAGE(cheapest_columns)(few, many, table, path, values, partners)) return 2;
  for (int64_t j = 0; j < many; j++) owners[j] = -1;
  for (int64_t i = 0; i < few; i++) owners[partners[i]] = i;
  *count = 0;
  for (int64_t n = 0; n < height; n++) {
    const int64_t i = is_wide ? n : owners[n], j = is_wide ? partners[n] : n;
    if (i < 0 || !(table[i * many + j] < gate)) continue;
    pairs[*count] = rows[n];
    pairs[room + (*count)++] = columns[is_wide ? j : i];
  }
  return 0;
}
