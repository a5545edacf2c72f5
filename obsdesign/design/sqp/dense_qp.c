/* The convex program of one step (`ConicQP`) in units of its own, solved by what stands before this text: `conic_interior_point.c`.

   d = middle + half y, t_j = t_unit_j y_q+j, e = slack_unit y_N-1: margins change by about 1 within the bounds, and the penalty is no
   more than the rest of the objective. Rows of X: slack >= 0, rows, epigraph rows, cones. */

#define FIRST_PRODUCT 0.02 /* of slacks and their multipliers where the method begins, in units of the objective */
#define NEAR_BOUND 0.9     /* share of the way to a bound at which a start is still inside */
#define ACCEPTED 10.0      /* tolerances at which rounding may end the method */
#define TURNS 4            /* with ever smaller gaps, where what is active is small next to what is not */
#define AIM 1e-2           /* share of the tolerance that is aimed at: where the objective is flat, a gap says little of how far one is */

typedef struct { const double *A, *D, *E; count n, index; double factor; } Cone; /* index: of its t, -1 = none; factor: of the slack */

typedef struct { /* sizes; the program as it is given; in units of its own */
  int q, T, r, hard, cones, rows, N, side;
  const double *B, *g, *weights, *lower, *upper, *row, *jacobian, *epigraph_row, *epigraph_jacobian;
  const Cone* cone;
  double penalty, unit, slack, slack_unit;
  double *middle, *half, *gradient, *begin, *t, *t_unit, *P, *c, *X, *h, *at, *point, *square;
} Step;

static double dot(const double* a, const double* b, int n) {
  double sum = 0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

static void svec_of(const double* S, int n, double factor, double* column, int stride) {
  for (int i = 0, k = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j, ++k) column[(size_t)k * stride] = factor * S[i * n + j] * (i == j ? 1 : M_SQRT2);
}

static int margins(Step* s) { /* X and h but for the columns of t and slack, in the middle of the bounds; 0 where something is not finite */
  double checked = 0;
  for (int i = 0; i < s->q; ++i) {
    s->middle[i] = (s->upper[i] + s->lower[i]) / 2, s->half[i] = (s->upper[i] - s->lower[i]) / 2;
    if (!(s->half[i] >= 0)) return 0;
    checked += 0 * s->middle[i] * s->half[i];
  }
  for (int i = 0; i < s->q; ++i) s->gradient[i] = s->g[i] + dot(s->B + (size_t)i * s->q, s->middle, s->q);
  for (int k = 0; k < s->r + s->hard; ++k) {
    const double* slopes = k < s->r ? s->jacobian + (size_t)k * s->q : s->epigraph_jacobian + (size_t)(k - s->r) * s->q;
    double* x = s->X + (size_t)(1 + k) * s->N;
    s->h[1 + k] = (k < s->r ? s->row[k] : s->epigraph_row[k - s->r]) + dot(slopes, s->middle, s->q);
    for (int i = 0; i < s->q; ++i) x[i] = slopes[i] * s->half[i];
    checked += 0 * s->h[1 + k];
  }
  for (int k = 0, first = 1 + s->r + s->hard; k < s->cones; first += width_of(s->cone[k].n), ++k) {
    int n = (int)s->cone[k].n, width = width_of(n);
    double *h = s->h + first, *X = s->X + (size_t)first * s->N;
    svec_of(s->cone[k].A, n, 1, h, 1);
    for (int i = 0; i < s->q; ++i) svec_of(s->cone[k].D + (size_t)i * n * n, n, 1, X + i, s->N);
    for (int a = 0; a < width; ++a) {
      h[a] += dot(X + (size_t)a * s->N, s->middle, s->q);
      for (int i = 0; i < s->q; ++i) X[(size_t)a * s->N + i] *= s->half[i];
      checked += 0 * h[a];
    }
  }
  return checked == 0;
}

static double largest_norm(const Step* s, int first, int count) {
  double largest = 0;
  for (int k = first; k < first + count; ++k) largest = fmax(largest, dot(s->X + (size_t)k * s->N, s->X + (size_t)k * s->N, s->q));
  return sqrt(largest);
}

static int units(Step* s) { /* units of t, slack and objective, and strictly feasible t and slack; 0 where nothing bounds a t */
  double missing = 0, shared = largest_norm(s, 1, s->r);
  for (int k = 0; k < s->rows; ++k) s->at[k] = s->h[k] + dot(s->X + (size_t)k * s->N, s->begin, s->q);
  for (int j = 0; j < s->T; ++j) s->t[j] = INFINITY, s->t_unit[j] = 0;
  for (int k = 1; k <= s->r; ++k) missing = fmax(missing, -s->at[k]);
  if (s->hard && s->T) s->t_unit[0] = largest_norm(s, 1 + s->r, s->hard);
  for (int k = 1 + s->r; s->T && k <= s->r + s->hard; ++k) s->t[0] = fmin(s->t[0], s->at[k]);
  for (int k = 0, first = 1 + s->r + s->hard; k < s->cones; first += width_of(s->cone[k].n), ++k) {
    int n = (int)s->cone[k].n, width = width_of(n);
    double change = 0, lowest;
    for (int a = first; a < first + width; ++a) change += dot(s->X + (size_t)a * s->N, s->X + (size_t)a * s->N, s->q);
    smat(s->at + first, s->square, n);
    lowest = smallest_eigenvalue(s->square, n, s->square + n * n), change = sqrt(change);
    if (s->cone[k].index >= 0) {
      int j = (int)s->cone[k].index;
      s->t[j] = fmin(s->t[j], lowest), s->t_unit[j] = fmax(s->t_unit[j], change);
    }
    if (s->cone[k].factor > 0) missing = fmax(missing, -lowest / s->cone[k].factor), shared = fmax(shared, change / s->cone[k].factor);
  }
  s->unit = 0;
  for (int j = 0; j < s->T; ++j) {
    if (!(s->t[j] < INFINITY)) return 0;
    if (!(s->t_unit[j] > 0)) s->t_unit[j] = s->t[j] != 0 ? fabs(s->t[j]) : 1;
    s->t[j] -= s->t_unit[j], s->unit += s->weights[j] * s->t_unit[j];
  }
  for (int i = 0; i < s->q; ++i)
    s->unit += fabs(s->half[i] * s->gradient[i]) + 0.5 * s->B[(size_t)i * (s->q + 1)] * s->half[i] * s->half[i];
  s->slack_unit = shared > 0 ? shared : 1;
  if (!(s->unit > 0)) s->unit = s->penalty * s->slack_unit > 0 ? s->penalty * s->slack_unit : 1;
  if (s->penalty > 0) s->slack_unit = fmin(s->slack_unit, s->unit / s->penalty);
  s->slack = missing + s->slack_unit;
  return 1;
}

static void in_units(Step* s) { /* P, c, the columns of t and slack, and where the method begins */
  int q = s->q, N = s->N;
  for (int i = 0; i < q; ++i) {
    for (int j = 0; j < q; ++j) s->P[(size_t)i * q + j] = s->half[i] * s->B[(size_t)i * q + j] * s->half[j] / s->unit;
    s->c[i] = s->half[i] * s->gradient[i] / s->unit, s->point[i] = s->begin[i];
  }
  for (int j = 0; j < s->T; ++j) s->c[q + j] = -s->weights[j] * s->t_unit[j] / s->unit, s->point[q + j] = s->t[j] / s->t_unit[j];
  s->c[N - 1] = s->penalty * s->slack_unit / s->unit, s->point[N - 1] = s->slack / s->slack_unit;
  for (int k = 0; k < s->rows; ++k)
    for (int j = q; j < N; ++j) s->X[(size_t)k * N + j] = j == N - 1 && k <= s->r ? s->slack_unit : 0;
  for (int k = 1 + s->r; s->T && k <= s->r + s->hard; ++k) s->X[(size_t)k * N + q] = -s->t_unit[0];
  for (int k = 0, first = 1 + s->r + s->hard; k < s->cones; first += width_of(s->cone[k].n), ++k) {
    const Cone* cone = s->cone + k;
    double* X = s->X + (size_t)first * N;
    if (cone->index >= 0) svec_of(cone->E, (int)cone->n, -s->t_unit[cone->index], X + q + cone->index, N);
    for (int i = 0; i < cone->n; ++i) X[(size_t)(width_of(i + 1) - 1) * N + N - 1] = cone->factor * s->slack_unit;
  }
}

static int inverse_of(double* S, int n) { /* in place, by Cholesky; 0 where S is not positive definite */
  double *L = S, *inverse = S + n * n;
  if (!cholesky(L, n)) return 0;
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      double sum = i == j;
      for (int k = j; k < i; ++k) sum -= L[i * n + k] * inverse[k * n + j];
      inverse[i * n + j] = i < j ? 0 : sum / L[i * n + i];
    }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      S[i * n + j] = 0;
      for (int k = i > j ? i : j; k < n; ++k) S[i * n + j] += inverse[k * n + i] * inverse[k * n + j];
    }
  return 1;
}

static int first_multipliers(Step* s) {
  /* alike times their slacks, but of what bounds a t, and of slack >= 0, set by what these cost; 0 where the point is outside of a cone */
  int q = s->q, N = s->N, last = 1 + s->r + s->hard;
  double *bounds = s->point + N, *z = bounds + 2 * q, costs = s->c[N - 1];
  for (int i = 0; i < 2 * q; ++i) bounds[i] = FIRST_PRODUCT;
  for (int k = 0; k < s->rows; ++k) s->at[k] = s->h[k] + dot(s->X + (size_t)k * N, s->point, N);
  for (int k = 0; k < last; ++k) {
    if (!(s->at[k] > 0)) return 0;
    z[k] = FIRST_PRODUCT / s->at[k];
  }
  for (int k = 0, first = last; k < s->cones; first += width_of(s->cone[k].n), ++k) {
    smat(s->at + first, s->square, (int)s->cone[k].n);
    if (!inverse_of(s->square, (int)s->cone[k].n)) return 0;
    svec_of(s->square, (int)s->cone[k].n, FIRST_PRODUCT, z + first, 1);
  }
  for (int j = 0; j < s->T; ++j) {
    double sum = 0;
    for (int k = 0; k < s->rows; ++k) sum += s->X[(size_t)k * N + q + j] * z[k];
    double factor = s->c[q + j] / sum;
    for (int k = 1 + s->r; j == 0 && k < last; ++k) z[k] *= factor;
    for (int k = 0, first = last; k < s->cones; first += width_of(s->cone[k].n), ++k)
      for (int a = first; s->cone[k].index == j && a < first + width_of(s->cone[k].n); ++a) z[a] *= factor;
  }
  for (int k = 1; k < s->rows; ++k) costs -= s->X[(size_t)k * N + N - 1] * z[k];
  z[0] = fmax(z[0], costs / s->X[N - 1]);
  return 1;
}

static void write_solution(const Step* s, double* result) { /* d, slack, multipliers of cones, rows, epigraph rows and bounds */
  const double *low = s->point + s->N, *z = low + 2 * s->q;
  for (int i = 0; i < s->q; ++i) *result++ = fmin(fmax(s->middle[i] + s->half[i] * s->point[i], s->lower[i]), s->upper[i]);
  *result++ = s->slack_unit * s->point[s->N - 1];
  for (int k = 0, first = 1 + s->r + s->hard; k < s->cones; first += width_of(s->cone[k].n), result += s->cone[k].n * s->cone[k].n, ++k) {
    smat(z + first, result, (int)s->cone[k].n);
    for (int i = 0; i < s->cone[k].n * s->cone[k].n; ++i) result[i] *= s->unit;
  }
  for (int k = 1; k <= s->r + s->hard; ++k) *result++ = s->unit * z[k];
  for (int i = 0; i < s->q; ++i) *result++ = s->half[i] > 0 ? s->unit * fmax(low[i], low[s->q + i]) / s->half[i] : 0;
}

static double size_at_point(const Step* s) {
  /* what the objective is made of, and changes by within the bounds as its multipliers have it: t and slack, d, limits. Limits that are
     not active count for nothing, whatever they are next to the others */
  int q = s->q, N = s->N, last = 1 + s->r + s->hard;
  const double* z = s->point + N + 2 * q;
  double size = 0;
  for (int i = 0; i < q; ++i) size += fabs(s->c[i]) + 0.5 * s->P[(size_t)i * (q + 1)];
  for (int j = q; j < N; ++j) size += fabs(s->c[j] * s->point[j]);
  for (int k = 0; k < last; ++k)
    for (int i = 0; i < q; ++i) size += fabs(s->X[(size_t)k * N + i]) * z[k];
  for (int k = 0, first = last; k < s->cones; first += width_of(s->cone[k].n), ++k)
    for (int i = 0; i < q; ++i) {
      double paid = 0;
      for (int a = first; a < first + width_of(s->cone[k].n); ++a) paid += z[a] * s->X[(size_t)a * N + i];
      size += fabs(paid);
    }
  return size;
}

static int minimise_from(Step* s, count most, double tolerance, const Linear* linear) { /* 0 where there is no start, -1 where it fails */
  if (!units(s)) return -1;
  in_units(s);
  if (!first_multipliers(s)) return 0;
  count sizes[4 + s->cones];
  sizes[0] = s->N, sizes[1] = s->q, sizes[2] = 1 + s->r + s->hard, sizes[3] = s->cones;
  for (int k = 0; k < s->cones; ++k) sizes[4 + k] = s->cone[k].n;
  const double* data[] = {s->P, s->c, s->X, s->h};
  double value = s->penalty * (s->slack - s->slack_unit) + fabs(dot(s->weights, s->t, s->T));
  double aim = AIM * tolerance * fmin(1, value != 0 ? value / s->unit : 1), *gap = s->point + s->N + 2 * s->q + s->rows, before = INFINITY;
  for (int turn = 0; turn < TURNS; ++turn, before = *gap) {
    if (obsdesign_conic(most, s->rows, sizes, data, linear, s->point, &aim) || !(*gap < before)) return -1;
    double wanted = tolerance * fmin(1 + s->c[s->N - 1] * s->point[s->N - 1], size_at_point(s));
    if (*gap <= ACCEPTED * wanted) return 1;
    aim = AIM * wanted;
  }
  return -1;
}

/* sizes: q, T, rows, epigraph rows, cones, then side and t (-1 = none) of each. data: B, g, weights, lower, upper, rows, jacobian,
   epigraph rows and their jacobian, then A, D, E of each cone. numbers: penalty, tolerance, the slack's factor in each cone. result: d (q),
   slack, Z of each cone, multipliers of rows, of epigraph rows, of the bounds (q). Returns 1 where there is no minimiser to the tolerance. */
int obsdesign_dense_qp(
    count most, count cones, const count* sizes, const double* const* data, const Linear* linear, double* result, const double* numbers) {
  Cone cone[cones + 1];
  Step s = {(int)sizes[0], (int)sizes[1], (int)sizes[2], (int)sizes[3], (int)cones, 0, 0, 1, data[0], data[1], data[2], data[3], data[4],
            data[5],       data[6],       data[7],       data[8],       cone,       numbers[0]};
  s.N = s.q + s.T + 1, s.rows = 1 + s.r + s.hard;
  for (int k = 0; k < cones; ++k) {
    cone[k] = (Cone){data[9 + 3 * k], data[10 + 3 * k], data[11 + 3 * k], sizes[4 + 2 * k], sizes[5 + 2 * k], numbers[2 + k]};
    s.rows += width_of(cone[k].n);
    if (cone[k].n > s.side) s.side = (int)cone[k].n;
  }
  size_t parts[] = {s.q, s.q, s.q, s.q, s.T, s.T, (size_t)s.q * s.q, s.N, (size_t)s.rows * s.N, s.rows, s.rows,
                    (size_t)s.N + 2 * s.q + s.rows + 2, (size_t)3 * s.side * s.side};
  double** places[] = {&s.middle, &s.half, &s.gradient, &s.begin, &s.t, &s.t_unit, &s.P, &s.c, &s.X, &s.h, &s.at, &s.point, &s.square};
  size_t total = 0;
  for (int i = 0; i < 13; ++i) total += parts[i];
  double *memory = calloc(total, sizeof(double)), *next = memory;
  if (!memory) return 1;
  for (int i = 0; i < 13; next += parts[i], ++i) *places[i] = next;
  int ended = margins(&s) ? minimise_from(&s, most, numbers[1], linear) : -1;
  if (ended == 0) { /* from as near as may be to d = 0 instead of from the middle */
    for (int i = 0; i < s.q; ++i) s.begin[i] = s.half[i] > 0 ? fmin(fmax(-s.middle[i] / s.half[i], -NEAR_BOUND), NEAR_BOUND) : 0;
    ended = minimise_from(&s, most, numbers[1], linear);
  }
  if (ended == 1) write_solution(&s, result);
  free(memory);
  return ended != 1;
}
