/* Small symmetric systems: LAPACK takes longer to call than they take to solve. */

#include "internal.h"

int factor(Matrix a, Int n) {
  CHECK(0 <= n && n <= SIZE);
  for (Int k = 0; k < n; k++) {
    if (!(a[k][k] > 0.0)) return 0;
    double root = sqrt(a[k][k]);
    for (Int j = k; j < n; j++) a[k][j] /= root;
    for (Int i = k + 1; i < n; i++) {
      double by = a[k][i];
      for (Int j = i; j < n; j++) a[i][j] -= by * a[k][j];
    }
  }
  return 1;
}

void solve_upper(Matrix u, Int n, double *b) {
  for (Int i = n - 1; i >= 0; i--) {
    double sum = b[i];
    for (Int j = i + 1; j < n; j++) sum -= u[i][j] * b[j];
    b[i] = sum / u[i][i];
  }
}

void solve(Matrix u, Int n, double *b) {
  for (Int i = 0; i < n; i++) {
    double value = b[i] / u[i][i];
    b[i] = value;
    for (Int j = i + 1; j < n; j++) b[j] -= u[i][j] * value;
  }
  solve_upper(u, n, b);
}
