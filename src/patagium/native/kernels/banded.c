/* Solution and inverse, within the band, of a symmetric positive definite banded matrix.
 *
 * A row i holds the entries (i, i - band) to (i, i), band + 1 of them; those before the first
 * column are zero. Cholesky's factor by rows, then the inverse from the last column to the first
 * [Takahashi, Fagan & Chin 1973], whose entries within the band need no others. */
#include <math.h>
#include <stddef.h>

static double dot(const double *x, const double *y, ptrdiff_t n) {
  double part[4] = {0, 0, 0, 0};
  ptrdiff_t k = 0;
  for (; k + 4 <= n; k += 4)
    for (int m = 0; m < 4; m++) part[m] += x[k + m] * y[k + m];
  for (; k < n; k++) part[0] += x[k] * y[k];
  return (part[0] + part[1]) + (part[2] + part[3]);
}

static double dot_and_add(const double *restrict row, const double *restrict x, double scale,
                          double *restrict out, ptrdiff_t n) {
  double part[4] = {0, 0, 0, 0};
  ptrdiff_t k = 0;
  for (; k + 4 <= n; k += 4)
    for (int m = 0; m < 4; m++) {
      part[m] += row[k + m] * x[k + m];
      out[k + m] += scale * row[k + m];
    }
  for (; k < n; k++) {
    part[0] += row[k] * x[k];
    out[k] += scale * row[k];
  }
  return (part[0] + part[1]) + (part[2] + part[3]);
}

/* matrix (size, band + 1) becomes its inverse, vector (size) the solution; factor is memory of
 * the matrix's size, work of 2 (band + 1). Returns 0, or 1 if the matrix is not definite. */
int banded_inverse(double *matrix, double *vector, double *factor, double *work, ptrdiff_t size,
                   ptrdiff_t band) {
  const ptrdiff_t wide = band + 1;
  for (ptrdiff_t i = 0; i < size; i++) {
    double *row = factor + i * wide;
    const ptrdiff_t first = i < band ? 0 : i - band;
    for (ptrdiff_t j = first; j <= i; j++) {
      const double *other = factor + j * wide;
      const ptrdiff_t from = j - band > first ? j - band : first;
      const double sum = dot(row + (from - i + band), other + (from - j + band), j - from);
      const double rest = matrix[i * wide + (j - i + band)] - sum;
      if (j < i) {
        row[j - i + band] = rest / other[band];
      } else if (rest > 0 && isfinite(rest)) {
        row[band] = sqrt(rest);
      } else {
        return 1;
      }
    }
    vector[i] -= dot(row + (first - i + band), vector + first, i - first);
    vector[i] /= row[band];
  }
  for (ptrdiff_t i = size - 1; i >= 0; i--) {
    const double *row = factor + i * wide;
    const ptrdiff_t first = i < band ? 0 : i - band;
    vector[i] /= row[band];
    for (ptrdiff_t j = first; j < i; j++) vector[j] -= row[j - i + band] * vector[i];
  }
  double *below = work, *found = work + wide;
  for (ptrdiff_t j = size - 1; j >= 0; j--) {
    const ptrdiff_t count = size - 1 - j < band ? size - 1 - j : band;
    const double pivot = factor[j * wide + band];
    for (ptrdiff_t k = 0; k < count; k++) {
      below[k] = factor[(j + 1 + k) * wide + (band - 1 - k)] / pivot;
      found[k] = 0;
    }
    for (ptrdiff_t k = 0; k < count; k++) {
      const double *row = matrix + (j + 1 + k) * wide + (band - k);
      found[k] += dot_and_add(row, below, below[k], found, k) + row[k] * below[k];
    }
    for (ptrdiff_t k = 0; k < count; k++)
      matrix[(j + 1 + k) * wide + (band - 1 - k)] = -found[k];
    matrix[j * wide + band] = 1 / (pivot * pivot) + dot(below, found, count);
  }
  return 0;
}

/* Add rows' rows and rows' residual of samples to a banded matrix and a vector; the rows (count,
 * values, wide) of a sample begin at its first column. */
void banded_add(double *matrix, double *vector, const double *rows, const double *residual,
                const ptrdiff_t *first, ptrdiff_t count, ptrdiff_t values, ptrdiff_t wide) {
  for (ptrdiff_t n = 0; n < count; n++)
    for (ptrdiff_t v = 0; v < values; v++) {
      const double *row = rows + (n * values + v) * wide;
      const double error = residual[n * values + v];
      for (ptrdiff_t a = 0; a < wide; a++) {
        const double entry = row[a];
        if (entry == 0) continue;
        double *into = matrix + (first[n] + a) * wide + (wide - 1 - a);
        for (ptrdiff_t b = 0; b <= a; b++) into[b] += entry * row[b];
        vector[first[n] + a] += entry * error;
      }
    }
}

/* Variances row' matrix row of samples, (count, values); rows as above. */
void banded_variance(const double *matrix, const double *rows, const ptrdiff_t *first,
                     double *variance, ptrdiff_t count, ptrdiff_t values, ptrdiff_t wide) {
  for (ptrdiff_t n = 0; n < count; n++)
    for (ptrdiff_t v = 0; v < values; v++) {
      const double *row = rows + (n * values + v) * wide;
      double sum = 0;
      for (ptrdiff_t a = 0; a < wide; a++) {
        const double *from = matrix + (first[n] + a) * wide + (wide - 1 - a);
        if (row[a] != 0) sum += row[a] * (2 * dot(from, row, a) + from[a] * row[a]);
      }
      variance[n * values + v] = sum;
    }
}
