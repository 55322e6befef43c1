/* How long each call of a compiled pipeline takes, packet by packet, as a loop on a robot would.
 *
 * Packets are taken in a circle, their time stamps go on. With a period the loop sleeps until a
 * packet is due, and the response is counted from there: waking up late and waiting for the call
 * before count, too. Without one packets follow each other. Not modeled: sensors, their bus.
 */
#define _GNU_SOURCE
#include <stdint.h>
#include <string.h>
#include <time.h>

typedef int64_t (*run)(void *, int64_t, const double *, double *);

typedef struct {
  run function;            /* pipeline_run */
  void *pipeline;
  int64_t rows, columns;   /* of the packets */
  const double *packets;
  double *row, *record;    /* room for one packet and its record */
  double time_step;        /* between time stamps [s] */
  double period;           /* between packets [ns]; 0: one after the other */
} paced;

static double now_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static void sleep_until(double ns) {
#ifdef TIMER_ABSTIME
  struct timespec t = {(time_t)(ns / 1e9), 0};
  t.tv_nsec = (long)(ns - 1e9 * (double)t.tv_sec);
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
#else
  while (now_ns() < ns) continue;
#endif
}

/* Packets first .. first + count - 1; duration and response of each [ns]. */
void latency_run(paced *p, int64_t first, int64_t count, float *duration, float *response) {
  const double began = now_ns() + p->period;
  for (int64_t k = 0; k < count; k++) {
    const double due = began + (double)k * p->period;
    memcpy(p->row, p->packets + (first + k) % p->rows * p->columns, sizeof(double) * p->columns);
    p->row[0] = (double)(first + k) * p->time_step;
    if (p->period > 0 && now_ns() < due) sleep_until(due);
    const double started = now_ns();
    p->function(p->pipeline, 1, p->row, p->record);
    const double ended = now_ns();
    duration[k] = (float)(ended - started);
    response[k] = (float)(ended - (p->period > 0 ? due : started));
  }
}
