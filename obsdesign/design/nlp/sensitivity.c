/* G_k+1 = A_k G_k + B_k M_k along a path, and sum_k D_k G_k: how states and what is gained answer to parameters.

   Most entries of A, B, D and M are 0 and are passed over; so are parameters that nothing depends on yet. All matrices row by row. */

#pragma GCC optimize("O3") /* vectors of parameters at once */

typedef long long count;

static void add(double* restrict into, double factor, const double* restrict row, count n) {
  for (count j = 0; j < n; ++j) into[j] += factor * row[j];
}

static count last_of(const double* row, count least, count q) { /* entries up to the last that is not 0, or more */
  while (q > least && row[q - 1] == 0) --q;
  return q;
}

/* sizes: c, m, b, q, and whether M is each run's own. data: A (runs, steps, c, c), B (., c, m), D (., b, c), M (steps, m, q) or one for
   each run. result: G (runs, steps + 1, c, q), whose first matrices are given, the rest 0; S (runs, b, q), 0 on entry. */
int obsdesign_sensitivity(
    count runs, count steps, const count* sizes, const double* const* data, const void* none, double* const* result, const void* nothing) {
  const count c = sizes[0], m = sizes[1], b = sizes[2], q = sizes[3];
  for (count r = 0; r < runs; ++r) {
    const double *A = data[0] + r * steps * c * c, *B = data[1] + r * steps * c * m, *D = data[2] + r * steps * b * c;
    const double* M = data[3] + (sizes[4] ? r * steps * m * q : 0);
    double *G = result[0] + r * (steps + 1) * c * q, *S = result[1] + r * b * q;
    count reach = 0;
    for (count i = 0; i < c; ++i) reach = last_of(G + i * q, reach, q);
    for (count k = 0; k < steps; ++k, A += c * c, B += c * m, D += b * c, M += m * q, G += c * q) {
      for (count i = 0; i < b; ++i)
        for (count j = 0; j < c; ++j)
          if (D[i * c + j] != 0) add(S + i * q, D[i * c + j], G + j * q, reach);
      for (count i = 0; i < m; ++i) reach = last_of(M + i * q, reach, q);
      for (count i = 0; i < c; ++i) {
        double* next = G + (c + i) * q;
        for (count j = 0; j < c; ++j)
          if (A[i * c + j] != 0) add(next, A[i * c + j], G + j * q, reach);
        for (count j = 0; j < m; ++j)
          if (B[i * m + j] != 0) add(next, B[i * m + j], M + j * q, reach);
      }
    }
  }
  (void)none, (void)nothing;
  return 0;
}
