/* The filter of a robot's motion, one step at a time, for Python; see motion.h. */
#include "motion.h"

void motion_predict(const motion_filter *f, double *from, double span, double *to,
                    double *turned) {
  predict_motion(f, from, span, to, turned);
}

int motion_update(const motion_filter *f, int count, const int32_t *numbers, const double *values,
                  double *from, double *to, double *found) {
  return update_motion(f, count, numbers, values, from, to, found);
}
