/* Memory of one learner of low rank; its twin is `low_rank_kernel.py`, field by field.
 *
 * Everything is the caller's and begins on cache lines; STORE is double or float.
 */
#ifndef PATAGIUM_LOW_RANK_H
#define PATAGIUM_LOW_RANK_H

#include <stddef.h>
#include <stdint.h>

#ifndef STORE
#define STORE double
#endif

typedef struct {
  int32_t rank;       /* r */
  int32_t padded;     /* n_y rounded up to whole vectors */
  int32_t depth;      /* r + n_y rounded up to a multiple of 8 */
  int32_t items;      /* how often the mlp is evaluated for one y */
  int32_t layers;     /* of the mlp */
  int32_t activation;
  int64_t room;       /* numbers of one half of `points` */
  double growth;      /* factor of U in this sample: the forgetting factor */
  const int32_t *widths; /* layers + 1 */
  const double *mean;    /* n */
  const STORE *diagonal; /* n: U */
  const STORE *columns;  /* n x r: F */
  double *next_mean;
  STORE *next_diagonal;
  STORE *next_columns;
  const double *inputs; /* by layers: items x widths[l]: what it takes in at the mean */
  const double *seeds;  /* by layers: items x widths[l + 1] x padded: dy / d its sums */
  double *gram;         /* depth x depth */
  const double *turn;   /* depth x padded for points, depth x depth for the change */
  const double *gains;  /* depth */
  double *points;       /* 2 x room: items x widest x 2 x padded */
} low_rank;

#endif
