/* Time of one call of a compiled function, on random states.

   A round is a run of calls over successive states, about half a millisecond long; the
   answer is the median over the rounds, so that interrupts do not count. Warmed up.
   Not modelled: cold caches, other threads. */

#define _POSIX_C_SOURCE 199309L
#include <stdint.h>
#include <stdlib.h>
#include <time.h>

#define MAX_ARGUMENTS 16
#define MAX_ROUNDS 400
#define ROUND_NS 5e5

typedef void (*timed_function)(const double *const *, double *const *);

static double now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Calls `calls` times, walking through the states from *state on; returns elapsed ns. */
static double run(timed_function f, int64_t calls, int64_t *state, int64_t states, int arguments,
                  const int64_t *sizes, const double *const *values, double *const *results)
{
    const double *argument[MAX_ARGUMENTS];
    double start = now_ns();
    for (int64_t call = 0; call < calls; ++call) {
        for (int i = 0; i < arguments; ++i) argument[i] = values[i] + *state * sizes[i];
        f(argument, results);
        if (++*state == states) *state = 0;
    }
    return now_ns() - start;
}

/* spread <- lower quartile, median, upper quartile of the ns a call.
   values[i] holds `states` rows of sizes[i] numbers (0: the same for every call).
   Returns the number of rounds, or 0 where there are too many arguments. */
int time_calls(timed_function f, int arguments, const int64_t *sizes, const double *const *values,
               int64_t states, double *const *results, double budget_ns, double *spread)
{
    double rounds[MAX_ROUNDS];
    int64_t state = 0, calls = 1;
    if (arguments > MAX_ARGUMENTS) return 0;
    double elapsed = run(f, calls, &state, states, arguments, sizes, values, results);
    while (elapsed < ROUND_NS) { /* warms up and finds the length of a round */
        calls *= 2;
        elapsed = run(f, calls, &state, states, arguments, sizes, values, results);
    }
    double wanted = budget_ns / elapsed;
    int count = wanted < 5 ? 5 : wanted > MAX_ROUNDS ? MAX_ROUNDS : (int)wanted;
    for (int k = 0; k < count; ++k)
        rounds[k] = run(f, calls, &state, states, arguments, sizes, values, results) / (double)calls;
    qsort(rounds, (size_t)count, sizeof(double), ascending);
    spread[0] = rounds[count / 4];
    spread[1] = rounds[count / 2];
    spread[2] = rounds[3 * count / 4];
    return count;
}
