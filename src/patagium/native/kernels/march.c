/* Classic fourth-order Runge-Kutta march of compiled equations of motion.

   Models nothing itself: the rate of the state, and what is done where a step
   begins, are functions with the calling convention of native.NativeFunction,
       void f(const double *const *arguments, double *const *results);
   both take (state, row, robot parameters, aero parameters). A row holds what is
   prescribed at one time: the gait, the mount, the wind; and then what strips meet of a
   gust that travels, looked up where the state is.

   Nothing is repaired: a state that broke is left in `state`, and the samples
   before it stand.
*/

#include <math.h>
#include <string.h>

#include "gust.h"

enum { COMPLETED = 0, NOT_FINITE = 1, LIMIT_REACHED = 3 }; /* errors.Outcome */

typedef void (*function)(const double *const *arguments, double *const *results);

/* Outcome of a state, and where: the first quantity that is not finite, else the
   first outside of its limits. */
static int judge(long size, const double *state, const double *lower, const double *upper,
                 long *which)
{
    int outcome = COMPLETED;
    for (long k = 0; k < size; ++k) {
        if (!isfinite(state[k])) {
            *which = k;
            return NOT_FINITE;
        }
        if (outcome == COMPLETED && (state[k] < lower[k] || state[k] > upper[k])) {
            *which = k;
            outcome = LIMIT_REACHED;
        }
    }
    return outcome;
}

/* What strips meet of a gust that travels, sample after sample; see gust.h.

   times: (count,). delays: (count, strips, 4). met: (count, strips, 9). */
void met_by_strips(long count, long knots, const double *knot, const double *cubics,
                   double decay, const double *times, long strips, const double *delays, double *met)
{
    for (long k = 0; k < count; ++k)
        gust_meet(knots, knot, cubics, decay, times[k], strips, delays + 4 * strips * k,
                  met + MET * strips * k);
}

/* Returns an Outcome.

   prepare: NULL, or (state, row, ...) -> state, applied to every sample.
   rate: (state, row, ...) -> rate of the state.
   state: (size,), at the first sample; at the last one on return.
   table: (2 steps + 1, row_size), a row every half step.
   samples: (steps + 1, size), the state at every whole step. work: (5, size).
   done: steps completed. which: index in the state of what went wrong, else -1.
   meet: NULL, or (state, row, ...) -> delays of the strips, (4, strips); the others only with
   it: knot, cubics and decay as in gust.h, times: (2 steps + 1,), room: (row_size + 13 strips,). */
int march(function prepare, function rate, long steps, double time_step, long size,
          double *state, const double *lower, const double *upper, long row_size,
          const double *table, const double *robot, const double *aero, double *samples,
          double *work, long *done, long *which, function meet, long strips, long knots,
          const double *knot, const double *cubics, double decay, const double *times, double *room)
{
    double *const trial = work;
    double *const slope[4] = {work + size, work + 2 * size, work + 3 * size, work + 4 * size};
    const double *arguments[4] = {state, table, robot, aero};
    double *results[1];
    static const double reach[4] = {0.0, 0.5, 0.5, 1.0};
    static const int rows_ahead[4] = {0, 1, 1, 2};

    *done = 0;
    *which = -1;
    for (long step = 0;; ++step) {
        const double *row = table + 2 * step * row_size;
        if (prepare) {
            arguments[0] = state;
            arguments[1] = row;
            results[0] = trial;
            prepare(arguments, results);
            memcpy(state, trial, (size_t)size * sizeof(double));
        }
        memcpy(samples + step * size, state, (size_t)size * sizeof(double));
        if (step == steps)
            return COMPLETED;

        for (int s = 0; s < 4; ++s) {
            for (long k = 0; s > 0 && k < size; ++k)
                trial[k] = state[k] + reach[s] * time_step * slope[s - 1][k];
            arguments[0] = s > 0 ? trial : state;
            arguments[1] = row + rows_ahead[s] * row_size;
            if (meet) {
                double *const delays = room + row_size + MET * strips;
                memcpy(room, arguments[1], (size_t)row_size * sizeof(double));
                arguments[1] = room;
                results[0] = delays;
                meet(arguments, results);
                gust_meet(knots, knot, cubics, decay, times[2 * step + rows_ahead[s]], strips,
                          delays, room + row_size);
            }
            results[0] = slope[s];
            rate(arguments, results);
        }
        for (long k = 0; k < size; ++k)
            state[k] += time_step / 6.0 *
                        ((slope[0][k] + slope[3][k]) + 2.0 * (slope[1][k] + slope[2][k]));
        const int outcome = judge(size, state, lower, upper, which);
        if (outcome != COMPLETED)
            return outcome;
        *done = step + 1;
    }
}
