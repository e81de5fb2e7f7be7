/* Choice of points for limb markers: core/labelling/limb_choices.py. */

/* The cheapest choices rows (P, best, L) of points for L limb markers, -1 for none, with their costs (P, best), from the
   costs pairs (P, L, C + 1, L, C + 1) and candidates (P, L, C). sizes: P, L, C, the choices kept while markers are
   added, and in the end. among: work for the former times C + 1; work: 4 L times the former; count: choices found. */
EXPORT int64_t STAGE(cheapest_choices)(const int64_t *sizes, double hidden_cost, const float *pairs,
                                       const int64_t *candidates, Candidate *among, int64_t *work, int64_t *rows,
                                       double *costs, int64_t *count) {
  int64_t limbs = sizes[1], none = sizes[2], most = sizes[3], best = sizes[4], width = none + 1;
  float others = limbs > 1 ? (float)(limbs - 1) : 1.0f;
  for (int64_t p = 0; p < sizes[0]; p++, pairs += limbs * width * limbs * width, candidates += limbs * none) {
    int64_t found = 1, *columns = work, *next = work + most * limbs; /* of candidates, for each choice */
    double *sums = (double *)(work + 2 * most * limbs);              /* costs of the choices */
    sums[0] = 0.0;
    for (int64_t l = 0; l < limbs; l++) {
      const int64_t *own = candidates + l * none;
      for (int64_t k = 0; k < found; k++)
        for (int64_t c = 0; c < width; c++) {
          const int64_t *column = columns + k * limbs;
          float sum = 0.0f;
          int is_taken = c < none && own[c] < 0;
          for (int64_t m = 0; m < l; m++) {
            sum += pairs[((m * width + column[m]) * limbs + l) * width + c];
            is_taken |= c < none && column[m] < none && candidates[m * none + column[m]] == own[c];
          }
          double cost = sums[k] + (double)(sum / others) + (c == none ? hidden_cost : 0.0);
          among[k * width + c] = STAGE(candidate)(is_taken ? INFINITY : cost, k * width + c);
        }
      int64_t all = found * width;
      found = all < most ? all : most;
      STAGE(select)(among, all, found);
      STAGE(sort)(among, found);
      for (int64_t k = 0; k < found; k++) {
        memcpy(next + k * limbs, columns + among[k].index / width * limbs, (size_t)l * sizeof(int64_t));
        next[k * limbs + l] = among[k].index % width;
        sums[k] = among[k].distance;
      }
      int64_t *kept = columns;
      columns = next, next = kept;
    }
    *count = found < best ? found : best;
    for (int64_t k = 0; k < *count; k++) {
      int64_t hidden = 0;
      for (int64_t l = 0; l < limbs; l++) {
        int64_t column = columns[k * limbs + l], point = column < none ? candidates[l * none + column] : -1;
        rows[(p * best + k) * limbs + l] = point;
        hidden += point < 0;
      }
      costs[p * best + k] = sums[k] - hidden_cost * (double)hidden;
    }
  }
  return 0;
}
