/* Memory of one learner of low rank; STORE is double or float. */
#ifndef PATAGIUM_LOW_RANK_H
#define PATAGIUM_LOW_RANK_H

#include <stddef.h>
#include <stdint.h>

#ifndef STORE
#define STORE double
#endif

#include "low_rank_struct.h"

#endif
