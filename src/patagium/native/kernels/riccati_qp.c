/* The quadratic program of `riccati_qp.h`, solved in the memory that Python owns. */
#include "riccati_qp.h"

int64_t riccati_qp_size(void) { return sizeof(riccati_qp); }

int riccati_qp_solve(riccati_qp *program) { return solve(program); }
