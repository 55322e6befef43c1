/* The most multiplications with additions one core does in a time, in registers alone.
 *
 * Chains side by side, enough to hide the latency of each. In time of the
 * processor, so that others do not count. Neglected: memory.
 */
#define _POSIX_C_SOURCE 199309L
#include <time.h>

#include "activations.h"

enum { CHAINS = 12 }; /* latency of an operation times operations at once, and some */

/* `turns` links of every chain; returns ns of one multiplication with addition of a lane. */
double peak_time(int turns, double factor, double *sum) {
  reals chain[CHAINS];
  const reals scale = reals_all(R(factor)), added = reals_all(R(1) - R(factor));
  struct timespec start, end;
  for (int c = 0; c < CHAINS; c++) chain[c] = reals_all(R(c));
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &start);
  for (int k = 0; k < turns; k++)
    for (int c = 0; c < CHAINS; c++) chain[c] = chain[c] * scale + added;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &end);
  *sum = 0;
  for (int c = 0; c < CHAINS; c++) *sum += (double)chain[c][0];
  return (1e9 * (double)(end.tv_sec - start.tv_sec) + (double)(end.tv_nsec - start.tv_nsec)) /
         ((double)turns * CHAINS * WIDTH);
}
