/* Runge-Kutta map of compiled equations of motion over segments of a flight, with derivatives.

   Models nothing itself. Segments lie side by side: every number is a row of `stride` segments,
   a multiple of the lanes, so that the functions and the chain rule run over segments in lanes.
   The function has the calling convention of a batch of native.NativeFunction and gives one
   column: the rate of the state, then the nonzeros of its Jacobian with respect to
   [state, prescribed]. The map is that of march.c to rounding.
*/

#include <math.h>
#include <string.h>

typedef void (*batch)(const double *const *arguments, double *const *results, long count,
                      long stride);

/* x <- x / |x| for a quaternion in the state, and its derivatives. */
static void normalize(long at, long width, long stride, double *x, double *slope)
{
    for (long m = 0; m < stride; ++m) {
        double norm = 0.0;
        for (long i = at; i < at + 4; ++i)
            norm += x[i * stride + m] * x[i * stride + m];
        norm = sqrt(norm);
        for (long i = at; i < at + 4; ++i)
            x[i * stride + m] /= norm;
        for (long d = 0; d < width; ++d) {
            double along = 0.0;
            for (long i = at; i < at + 4; ++i)
                along += x[i * stride + m] * slope[(i * width + d) * stride + m];
            for (long i = at; i < at + 4; ++i) {
                double *const s = slope + (i * width + d) * stride + m;
                *s = (*s - along * x[i * stride + m]) / norm;
            }
        }
    }
}

/* Steps of all segments.

   rate: of (state, row, robot, aero), its result (size + entries) rows.
   step: time step; step_slope: its derivative by each parameter, (parameters,).
   table: (2 segments steps + 1, row_size), a row every half step, segment after segment.
   table_slope: (2 segments steps + 1, outer), derivatives of prescribed columns by parameters.
   outer_begin: first of these of each prescribed column, and their number, (columns - size + 1,).
   outer_parameter: parameter of each, (outer,).
   entry_row, entry_column: place of each nonzero, (entries,).
   quaternions: places of the first entries of quaternions in the state, (turns,).
   x: (size, stride), states at the beginning, on return at the end.
   slope: (size, size + parameters, stride), derivatives of x, set by the caller at the beginning.
   work: (2 size stride + segments (size + row_size) + (size + entries) stride + 3 width size stride +
   outer stride), width = size + parameters. */
void wingbeat(batch rate, long segments, long stride, long steps, double step,
              const double *step_slope, long size, long row_size,
              long parameters, long outer, const double *table, const double *table_slope,
              const int *outer_begin, const int *outer_parameter,
              const double *robot, const double *aero, long entries,
              const int *entry_row, const int *entry_column, const long *quaternions, long turns,
              double *x, double *slope, double *work)
{
    static const double reach[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    static const int rows_ahead[4] = {0, 1, 1, 2};
    const long width = size + parameters, whole = width * size * stride;
    double *const k = work, *const sum = k + size * stride;
    double *const state = sum + size * stride, *const row = state + segments * size;
    double *const found = row + segments * row_size, *const dk = found + (size + entries) * stride;
    double *const dsum = dk + whole, *const trial = dsum + whole, *const given = trial + whole;
    const double *const arguments[4] = {state, row, robot, aero};

    for (long s = 0; s < steps; ++s) {
        for (long turn = 0; turn < turns; ++turn)
            normalize(quaternions[turn], width, stride, x, slope);
        memset(sum, 0, (size_t)(size * stride) * sizeof(double));
        memset(dsum, 0, (size_t)whole * sizeof(double));
        for (int stage = 0; stage < 4; ++stage) {
            const double far = reach[stage] * step;
            for (long m = 0; m < segments; ++m) {
                const long at = 2 * (m * steps + s) + rows_ahead[stage];
                for (long i = 0; i < size; ++i)
                    state[m * size + i] =
                        x[i * stride + m] + (stage ? far * k[i * stride + m] : 0.0);
                memcpy(row + m * row_size, table + at * row_size,
                       (size_t)row_size * sizeof(double));
                for (long e = 0; e < outer; ++e)
                    given[e * stride + m] = table_slope[at * outer + e];
            }
            for (long i = 0; i < size; ++i)
                for (long d = 0; d < width; ++d) {
                    const double *const b = slope + (i * width + d) * stride;
                    const double *const g = dk + (i * width + d) * stride;
                    double *const t = trial + (i * width + d) * stride;
                    const double more = d < size ? 0.0 : reach[stage] * step_slope[d - size];
                    for (long m = 0; m < stride; ++m)
                        t[m] = stage ? b[m] + (far * g[m] + more * k[i * stride + m]) : b[m];
                }
            double *const results[1] = {found};
            rate(arguments, results, segments, stride);
            memcpy(k, found, (size_t)(size * stride) * sizeof(double));
            memset(dk, 0, (size_t)whole * sizeof(double));
            for (long e = 0; e < entries; ++e) {
                const double *const j = found + (size + e) * stride;
                double *const into = dk + entry_row[e] * width * stride;
                const long c = entry_column[e];
                const long begin = c < size ? 0 : outer_begin[c - size];
                const long end = c < size ? width : outer_begin[c - size + 1];
                const double *const from = c < size ? trial + c * width * stride : given;
                for (long k = begin; k < end; ++k) {
                    const long d = c < size ? k : size + outer_parameter[k];
                    for (long m = 0; m < stride; ++m)
                        into[d * stride + m] += j[m] * from[k * stride + m];
                }
            }
            for (long i = 0; i < size * stride; ++i)
                sum[i] += weight[stage] * k[i];
            for (long i = 0; i < whole; ++i)
                dsum[i] += weight[stage] * dk[i];
        }
        for (long i = 0; i < size; ++i) {
            for (long d = 0; d < width; ++d) {
                const long at = (i * width + d) * stride;
                const double more = d < size ? 0.0 : step_slope[d - size] / 6.0;
                for (long m = 0; m < stride; ++m)
                    slope[at + m] += step / 6.0 * dsum[at + m] + more * sum[i * stride + m];
            }
            for (long m = 0; m < stride; ++m)
                x[i * stride + m] += step / 6.0 * sum[i * stride + m];
        }
    }
    for (long turn = 0; turn < turns; ++turn)
        normalize(quaternions[turn], width, stride, x, slope);
}
