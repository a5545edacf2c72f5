/* minimise y'P y / 2 + c'y over -1 <= y_i <= 1, i < q, with X y + h in r half-lines and in cones of positive semidefinite matrices.

   Matrices of the cones as columns (svec), all others row by row. Primal and dual by predictor and corrector (Mehrotra, 1992) in the
   scaling of Nesterov and Todd (1997): a slack s and its multiplier z become the same l = sqrt(s z), matrices the same diag(l), by
   S -> V S V' and Z -> V^-T Z V^-1. Slacks are computed anew from y, so that y stays feasible; what the dual misses counts as gap. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef long long count;

typedef struct { /* of BLAS and LAPACK */
  void (*syrk)(char*, char*, int*, int*, double*, double*, int*, double*, double*, int*);
  void (*gemm)(char*, char*, int*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
  void (*gemv)(char*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
  void (*potrf)(char*, int*, double*, int*, int*);
  void (*potrs)(char*, int*, int*, double*, int*, double*, int*, int*);
} Linear;

typedef struct { /* sizes: variables, bounds, half-lines, cones, sides of the cones; rows of X, of half-lines and cones */
  int N, q, r, cones, rows, side, widest;
  const count* n;
  const double *P, *c, *X, *h;
  const Linear* linear;
} Program;

typedef struct { /* M: of the equations of a step; Y: X scaled; slack, l of all rows; ds, dz, C scaled; K: maps of the cones */
  double *y, *bounds, *z;
  double *M, *Y, *gradient, *residual, *step, *spare, *slack, *l, *ds, *dz, *C, *K, *diagonal, *scratch;
  double *low, *high, *curvature, *dlow, *dhigh, *plow, *phigh, *best;
} State;

static int one = 1;
static double unit = 1.0, zero = 0.0, minus = -1.0;

static int width_of(count n) { return (int)(n * (n + 1) / 2); }

static void smat(const double* column, double* S, int n) {
  for (int i = 0, k = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j, ++k) S[i * n + j] = S[j * n + i] = i == j ? column[k] : column[k] * M_SQRT1_2;
}

static int cholesky(double* L, int n) { /* S = L L' in place, 0 above the diagonal; returns 0 where S is not positive definite */
  for (int j = 0; j < n; ++j) {
    for (int k = 0; k < j; ++k)
      for (int i = j; i < n; ++i) L[i * n + j] -= L[i * n + k] * L[j * n + k];
    if (!(L[j * n + j] > 0)) return 0;
    double pivot = L[j * n + j] = sqrt(L[j * n + j]);
    for (int i = j + 1; i < n; ++i) L[i * n + j] /= pivot, L[j * n + i] = 0;
  }
  return 1;
}

static void eigenvalues(double* S, double* Q, int n) { /* Jacobi: S becomes diagonal, Q its vectors as columns */
  for (int i = 0; i < n * n; ++i) Q[i] = i % (n + 1) == 0;
  for (int sweep = 0; sweep < 30; ++sweep) {
    double off = 0, on = 0;
    for (int i = 0; i < n; ++i)
      for (int j = 0; j <= i; ++j) *(i == j ? &on : &off) += S[i * n + j] * S[i * n + j];
    if (!(off > 1e-28 * on)) return;
    for (int p = 0; p < n; ++p)
      for (int o = p + 1; o < n; ++o) {
        if (S[p * n + o] == 0) continue;
        double theta = (S[o * n + o] - S[p * n + p]) / (2 * S[p * n + o]);
        double t = copysign(1, theta) / (fabs(theta) + sqrt(theta * theta + 1)), cosine = 1 / sqrt(t * t + 1), sine = t * cosine;
        for (int k = 0; k < n; ++k) {
          double a = S[k * n + p], b = S[k * n + o];
          S[k * n + p] = cosine * a - sine * b, S[k * n + o] = sine * a + cosine * b;
          a = Q[k * n + p], b = Q[k * n + o], Q[k * n + p] = cosine * a - sine * b, Q[k * n + o] = sine * a + cosine * b;
        }
        for (int k = 0; k < n; ++k) {
          double a = S[p * n + k], b = S[o * n + k];
          S[p * n + k] = cosine * a - sine * b, S[o * n + k] = sine * a + cosine * b;
        }
      }
  }
}

static int scaling_of(const double* slack, const double* z, int n, double* V, double* l, double* scratch) {
  /* V with V S V' = V^-T Z V^-1 = diag(l): S = L L', L'Z L = Q diag(l^2) Q', V = diag(l)^1/2 Q'L^-1; 0 where there is none */
  double *L = scratch, *Z = L + n * n, *Q = Z + n * n, *inverse = Q + n * n;
  smat(slack, L, n), smat(z, Z, n);
  if (!cholesky(L, n)) return 0;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      V[i * n + j] = 0;
      for (int k = j; k < n; ++k) V[i * n + j] += Z[i * n + k] * L[k * n + j];
    }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j) {
      double sum = 0;
      for (int k = i; k < n; ++k) sum += L[k * n + i] * V[k * n + j];
      Z[i * n + j] = Z[j * n + i] = sum;
    }
  eigenvalues(Z, Q, n);
  for (int j = 0; j < n; ++j)
    for (int i = j; i < n; ++i) {
      double sum = i == j;
      for (int k = j; k < i; ++k) sum -= L[i * n + k] * inverse[k * n + j];
      inverse[i * n + j] = sum / L[i * n + i];
    }
  for (int i = 0; i < n; ++i) {
    if (!(Z[i * n + i] > 0)) return 0;
    l[i] = sqrt(Z[i * n + i]);
    for (int j = 0; j < n; ++j) {
      double sum = 0;
      for (int k = j; k < n; ++k) sum += Q[k * n + i] * inverse[k * n + j];
      V[i * n + j] = sqrt(l[i]) * sum;
    }
  }
  return 1;
}

static void map_of(const double* V, int n, double* K) { /* svec(V F V') = K svec(F) */
  for (int i = 0, a = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j)
      for (int k = 0; k < n; ++k)
        for (int o = 0; o <= k; ++o, ++a) {
          double first = V[i * n + k] * V[j * n + o], second = V[i * n + o] * V[j * n + k];
          K[a] = i == j && k == o ? first : i == j || k == o ? M_SQRT2 * first : first + second;
        }
}

static double smallest_eigenvalue(double* S, int n, double* scratch) { /* from below; S is overwritten */
  double *u = scratch, *w = scratch + n;
  for (int k = 0; k < n - 2; ++k) { /* Householder: S becomes tridiagonal */
    double norm = 0, dot = 0;
    for (int i = k + 1; i < n; ++i) norm += S[i * n + k] * S[i * n + k];
    if (!(norm - S[(k + 1) * n + k] * S[(k + 1) * n + k] > 0)) continue;
    double alpha = -copysign(sqrt(norm), S[(k + 1) * n + k]), scale = norm - alpha * S[(k + 1) * n + k];
    for (int i = k + 1; i < n; ++i) u[i] = S[i * n + k] - (i == k + 1 ? alpha : 0);
    for (int i = k + 1; i < n; ++i) {
      w[i] = 0;
      for (int j = k + 1; j < n; ++j) w[i] += S[i * n + j] * u[j];
      w[i] /= scale, dot += w[i] * u[i];
    }
    for (int i = k + 1; i < n; ++i) w[i] -= 0.5 * dot / scale * u[i];
    for (int i = k + 1; i < n; ++i)
      for (int j = k + 1; j < n; ++j) S[i * n + j] -= u[i] * w[j] + w[i] * u[j];
    S[(k + 1) * n + k] = S[k * n + k + 1] = alpha;
  }
  double x = INFINITY, size = 0;
  for (int i = 0; i < n; ++i) {
    double radius = (i ? fabs(S[i * n + i - 1]) : 0) + (i + 1 < n ? fabs(S[i * n + i + 1]) : 0);
    x = fmin(x, S[i * n + i] - radius), size = fmax(size, fabs(S[i * n + i]) + radius);
  }
  for (int iteration = 0; iteration < 40; ++iteration) { /* Laguerre, from below all roots of det(S - x I) */
    double p0 = 1, p1 = S[0] - x, d0 = 0, d1 = -1, e0 = 0, e1 = 0;
    for (int i = 1; i < n; ++i) {
      double a = S[i * n + i] - x, b = S[i * n + i - 1] * S[i * n + i - 1];
      double p = a * p1 - b * p0, d = a * d1 - p1 - b * d0, e = a * e1 - 2 * d1 - b * e0;
      p0 = p1, p1 = p, d0 = d1, d1 = d, e0 = e1, e1 = e;
    }
    if (!(p1 > 0)) break;
    double root = (n - 1) * fmax(0, (n - 1) * d1 * d1 - n * p1 * e1), step = n * p1 / (-d1 + sqrt(root));
    x += step;
    if (!(step > 1e-9 * size)) break;
  }
  return x;
}

static double least_share(const double* step, const double* l, int n, double* S) { /* eigenvalue of diag(l)^-1/2 step diag(l)^-1/2 */
  smat(step, S, n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) S[i * n + j] /= sqrt(l[i] * l[j]);
  return smallest_eigenvalue(S, n, S + n * n);
}

static void centre(const double* ds, const double* dz, const double* l, double target, int n, double* C, double* scratch) {
  /* (diag(l) C + C diag(l)) / 2 = target I - diag(l)^2 - (ds dz + dz ds) / 2 */
  double *A = scratch, *B = scratch + n * n;
  smat(ds, A, n), smat(dz, B, n);
  for (int i = 0, k = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j, ++k) {
      double sum = i == j ? target - l[i] * l[i] : 0;
      for (int o = 0; o < n; ++o) sum -= 0.5 * (A[i * n + o] * B[o * n + j] + B[i * n + o] * A[o * n + j]);
      C[k] = sum * 2 / (l[i] + l[j]) * (i == j ? 1 : M_SQRT2);
    }
}

static double measure(const Program* p, State* s, double* gap) { /* slacks and gradient at y; returns the gap and what the dual misses */
  int N = p->N, q = p->q, R = p->rows;
  memcpy(s->slack, p->h, R * sizeof(double));
  p->linear->gemv("T", &N, &R, &unit, (double*)p->X, &N, s->y, &one, &unit, s->slack, &one);
  memcpy(s->gradient, p->c, N * sizeof(double));
  p->linear->gemv("N", &q, &q, &unit, (double*)p->P, &q, s->y, &one, &unit, s->gradient, &one);
  memcpy(s->residual, s->gradient, N * sizeof(double));
  p->linear->gemv("N", &N, &R, &minus, (double*)p->X, &N, s->z, &one, &unit, s->residual, &one);
  double left = *gap = 0;
  for (int i = 0; i < q; ++i) {
    s->low[i] = 1 + s->y[i], s->high[i] = 1 - s->y[i];
    *gap += s->low[i] * s->bounds[i] + s->high[i] * s->bounds[q + i];
    s->residual[i] += s->bounds[q + i] - s->bounds[i];
    s->curvature[i] = s->bounds[i] / s->low[i] + s->bounds[q + i] / s->high[i];
  }
  for (int i = 0; i < R; ++i) *gap += s->slack[i] * s->z[i];
  for (int i = 0; i < N; ++i) left += fabs(s->residual[i]) * (i < q ? 2 : fmax(1, fabs(s->y[i])));
  return *gap + left;
}

static int equations(const Program* p, State* s) { /* the scaling, and M = P + curvature of the bounds + Y'Y, factored; 0 where it fails */
  int N = p->N, q = p->q, R = p->rows, info;
  for (int i = 0; i < p->r; ++i) {
    if (!(s->slack[i] > 0) || !(s->z[i] > 0)) return 0;
    double share = sqrt(s->z[i] / s->slack[i]);
    s->l[i] = sqrt(s->z[i] * s->slack[i]);
    for (int j = 0; j < N; ++j) s->Y[(size_t)i * N + j] = share * p->X[(size_t)i * N + j];
  }
  for (int k = 0, at = p->r; k < p->cones; ++k) {
    int n = (int)p->n[k], width = width_of(n);
    double *l = s->diagonal + k * p->side, *K = s->K + (size_t)k * p->widest * p->widest, *V = s->scratch + 4 * n * n;
    if (!scaling_of(s->slack + at, s->z + at, n, V, l, s->scratch)) return 0;
    map_of(V, n, K);
    p->linear->gemm("N", "N", &N, &width, &width, &unit, (double*)p->X + (size_t)at * N, &N, K, &width, &zero, s->Y + (size_t)at * N, &N);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j <= i; ++j, ++at) s->l[at] = i == j ? l[i] : 0;
  }
  memset(s->M, 0, (size_t)N * N * sizeof(double));
  for (int i = 0; i < q; ++i) {
    memcpy(s->M + (size_t)i * N, p->P + (size_t)i * q, q * sizeof(double));
    s->M[(size_t)i * (N + 1)] += s->curvature[i];
  }
  p->linear->syrk("L", "N", &N, &R, &unit, s->Y, &N, &unit, s->M, &N);
  p->linear->potrf("L", &N, s->M, &N, &info);
  return info == 0;
}

static double direction(const Program* p, State* s, double target, int corrects) { /* returns 1 / the step at which something becomes 0 */
  int N = p->N, q = p->q, R = p->rows, info;
  for (int i = 0; i < p->r; ++i) s->C[i] = corrects ? (target - s->ds[i] * s->dz[i]) / s->l[i] - s->l[i] : -s->l[i];
  for (int k = 0, at = p->r; k < p->cones; at += width_of(p->n[k]), ++k)
    if (corrects) centre(s->ds + at, s->dz + at, s->diagonal + k * p->side, target, (int)p->n[k], s->C + at, s->scratch);
    else for (int i = at; i < at + width_of(p->n[k]); ++i) s->C[i] = -s->l[i];
  for (int i = 0; i < N; ++i) s->step[i] = -s->residual[i];
  p->linear->gemv("N", &N, &R, &unit, s->Y, &N, s->C, &one, &unit, s->step, &one);
  for (int i = 0; i < q; ++i) {
    s->dlow[i] = (corrects ? (target - s->plow[i]) / s->low[i] : 0) - s->bounds[i];
    s->dhigh[i] = (corrects ? (target - s->phigh[i]) / s->high[i] : 0) - s->bounds[q + i];
    s->step[i] += s->dlow[i] - s->dhigh[i];
  }
  memcpy(s->spare, s->step, N * sizeof(double));
  p->linear->potrs("L", &N, &one, s->M, &N, s->step, &N, &info);
  p->linear->gemv("T", &N, &R, &unit, s->Y, &N, s->step, &one, &zero, s->ds, &one);
  if (corrects) { /* refined once */
    p->linear->gemv("N", &q, &q, &minus, (double*)p->P, &q, s->step, &one, &unit, s->spare, &one);
    for (int i = 0; i < q; ++i) s->spare[i] -= s->curvature[i] * s->step[i];
    p->linear->gemv("N", &N, &R, &minus, s->Y, &N, s->ds, &one, &unit, s->spare, &one);
    p->linear->potrs("L", &N, &one, s->M, &N, s->spare, &N, &info);
    for (int i = 0; i < N; ++i) s->step[i] += s->spare[i];
    p->linear->gemv("T", &N, &R, &unit, s->Y, &N, s->step, &one, &zero, s->ds, &one);
  }
  double share = 0;
  for (int i = 0; i < R; ++i) s->dz[i] = s->C[i] - s->ds[i];
  for (int i = 0; i < p->r; ++i) share = fmax(share, fmax(-s->ds[i], -s->dz[i]) / s->l[i]);
  for (int k = 0, at = p->r; k < p->cones; at += width_of(p->n[k]), ++k) {
    share = fmax(share, -least_share(s->ds + at, s->diagonal + k * p->side, (int)p->n[k], s->scratch));
    share = fmax(share, -least_share(s->dz + at, s->diagonal + k * p->side, (int)p->n[k], s->scratch));
  }
  for (int i = 0; i < q; ++i) {
    s->dlow[i] -= s->bounds[i] / s->low[i] * s->step[i], s->dhigh[i] += s->bounds[q + i] / s->high[i] * s->step[i];
    share = fmax(share, fmax(-s->step[i] / s->low[i], s->step[i] / s->high[i]));
    share = fmax(share, fmax(-s->dlow[i] / s->bounds[i], -s->dhigh[i] / s->bounds[q + i]));
  }
  return share;
}

static double gap_after(const Program* p, State* s, double length) { /* of the predictor, whose products are stored */
  double gap = 0;
  for (int i = 0; i < p->rows; ++i) gap += (s->l[i] + length * s->ds[i]) * (s->l[i] + length * s->dz[i]);
  for (int i = 0; i < p->q; ++i) {
    gap += (s->low[i] + length * s->step[i]) * (s->bounds[i] + length * s->dlow[i]);
    gap += (s->high[i] - length * s->step[i]) * (s->bounds[p->q + i] + length * s->dhigh[i]);
    s->plow[i] = s->step[i] * s->dlow[i], s->phigh[i] = -s->step[i] * s->dhigh[i];
  }
  return gap;
}

static void advance(const Program* p, State* s, double length) {
  for (int i = 0; i < p->N; ++i) s->y[i] += length * s->step[i];
  for (int i = 0; i < p->q; ++i) s->bounds[i] += length * s->dlow[i], s->bounds[p->q + i] += length * s->dhigh[i];
  for (int i = 0; i < p->r; ++i) s->z[i] += length * s->dz[i] * sqrt(s->z[i] / s->slack[i]);
  for (int k = 0, at = p->r; k < p->cones; ++k) {
    int width = width_of(p->n[k]);
    double* K = s->K + (size_t)k * p->widest * p->widest;
    p->linear->gemv("N", &width, &width, &length, K, &width, s->dz + at, &one, &unit, s->z + at, &one);
    at += width;
  }
}

/* sizes: N, q, r, cones, their sides. data: P (q, q), c (N), X (rows, N), h (rows). result: y (N), lower and upper bounds' multipliers
   (2 q), multipliers z (rows), all three interior on entry, one after the other; then the gap, and the iterations. The best iterate is
   returned, once its gap is at most `aim`, or nothing better comes. Returns 1 without memory. */
int obsdesign_conic(count most, count rows, const count* sizes, const double* const* data, const Linear* linear, double* result, const double* aim) {
  Program p = {(int)sizes[0], (int)sizes[1], (int)sizes[2], (int)sizes[3], (int)rows, 1, 1, sizes + 4, data[0], data[1], data[2], data[3], linear};
  int N = p.N, q = p.q, R = p.rows, degree = 2 * q + p.r, worse = 0, iteration = 0, length = N + 2 * q + R;
  for (int k = 0; k < p.cones; ++k) {
    degree += (int)p.n[k];
    if (p.n[k] > p.side) p.side = (int)p.n[k], p.widest = width_of(p.n[k]);
  }
  size_t sides[] = {(size_t)N * N, (size_t)R * N, N, N, N, N, R, R, R, R, R, (size_t)p.cones * p.widest * p.widest,
                    (size_t)p.cones * p.side, (size_t)5 * p.side * p.side, q, q, q, q, q, q, q, length};
  size_t total = 0;
  for (int i = 0; i < 22; ++i) total += sides[i];
  double *memory = malloc(total * sizeof(double)), *next = memory;
  if (!memory) return 1;
  State s = {.y = result, .bounds = result + N, .z = result + N + 2 * q};
  double** parts[] = {&s.M,  &s.Y, &s.gradient, &s.residual, &s.step, &s.spare, &s.slack,     &s.l,    &s.ds,    &s.dz,   &s.C,
                      &s.K, &s.diagonal, &s.scratch, &s.low, &s.high, &s.curvature, &s.dlow, &s.dhigh, &s.plow, &s.phigh, &s.best};
  for (int i = 0; i < 22; next += sides[i], ++i) *parts[i] = next;
  double best = INFINITY, gap;
  for (;; ++iteration) {
    double missing = measure(&p, &s, &gap);
    worse = missing < best || best > 1e-6 ? 0 : worse + 1;
    if (missing < best) memcpy(s.best, result, length * sizeof(double)), best = missing;
    if (!(missing > *aim) || iteration == most || worse == 5 || !equations(&p, &s)) break;
    double share = direction(&p, &s, 0, 0), cut = fmax(0, gap_after(&p, &s, 1 / fmax(1, share)) / gap);
    if (missing > 2 * gap && gap < 1e-6) cut = 1; /* rounding is what is left: first that of the dual */
    share = direction(&p, &s, gap / degree * cut * cut * cut, 1);
    if (!(share < INFINITY)) break;
    advance(&p, &s, fmin(1, (share > 1.1 ? 0.9 : 0.99) / share));
  }
  memcpy(result, s.best, length * sizeof(double));
  result[length] = best, result[length + 1] = iteration;
  free(memory);
  return 0;
}
