/* Quadratic program of optimal control: boxes on inputs and on their changes, soft limits of states.
 *
 *   min sum_k 1/2 x'Q x + u'S x + 1/2 u'R u + q'x + r'u + 1/2 sum_i w_i dist(x_i, [least, most])^2
 *   x+ = A x + B u + c,  lower <= u <= upper,  fall <= u - u_before <= rise,  x_0 given
 *
 * A warm start goes by active constraints: semismooth Newton steps with a line search on the
 * augmented Lagrangian of the boxes [Bertsekas 1982]. For the limits that are active at a point a
 * Riccati recursion gives the minimum of the quadratic piece, and where the next point has the same
 * ones, the minimum is that of the whole. A step with the same active limits goes without a
 * factorization. Where there is no warm start, or it does not lead there in a few steps, an
 * interior point method (Mehrotra's predictor and corrector, the same recursion) finds where the
 * first method begins. The change u - v has v, the input before, as a state of its own, whose blocks
 * are there only where it is limited. Where the matrices come again, condensed_qp.h is faster. What
 * is returned is checked by its own conditions of optimality (Karush, Kuhn, Tucker), by costates
 * and not by factors, so that an inverse of other matrices is found out, and the recursion taken.
 * Sizes are set at build: STAGES, STATES, INPUTS; all memory is the structure's, which Python
 * mirrors (`control/quadratic_program.py`), or given in it. */
#ifndef PATAGIUM_RICCATI_QP_H
#define PATAGIUM_RICCATI_QP_H

#include <math.h>
#include <stdint.h>
#include <string.h>

enum { N = STAGES, NX = STATES, NU = INPUTS };
enum { BOXES = 2 * N * NU, LIMITS = BOXES + (N + 1) * NX }; /* of inputs, changes, then states */
enum { SOLVED, NOT_FINITE, NOT_CONVEX, INFEASIBLE, NOT_CONVERGED };
#define MOST_WARM 16          /* factorizations from a warm start */
#define MOST_INTERIOR 40     /* of the interior point method */
#define MOST_POLISHING 20    /* from where that leads */
#define MOST_SWEEPS 90
#define PENALTY 1e4          /* over the curvature of the cost along an input, at first */
#define GAP 1e-8             /* of the interior point method, over the first */
#define SLIGHT_GAP 1e-18     /* the same where all departures are a rounding of the limits' widths */
#define TOLERANCE 1e-9       /* of a limit, over its width */
#define OPTIMALITY 1e-7      /* of the gradient, over its largest term */

typedef struct {
  double A[N][NX][NX], B[N][NX][NU], c[N][NX];
  double Q[N + 1][NX][NX], S[N][NU][NX], R[N][NU][NU], q[N + 1][NX], r[N][NU];
  double low[LIMITS], high[LIMITS]; /* lower, fall, least; upper, rise, most */
  double weight[N + 1][NX];
  double start[NX], before[NU];
  double u[N][NU], x[N + 1][NX], force[BOXES], penalty[NU];
  double cost, gradient, violation;
  int64_t status, factorizations, sweeps;
  const double *inverse; /* (N NU) x (N NU), of the Hessian in the inputs alone; NULL: not kept */
  void *held;            /* memory that goes with it */
  /* memory: the next point, limits at both, pieces, factors, slacks and duals */
  double u_next[N][NU], x_next[N + 1][NX], value[LIMITS], value_next[LIMITS];
  double rigidity[LIMITS], stiffness[LIMITS], pull[LIMITS];
  double L[N][NU][NU], Kx[N][NU][NX], Kv[N][NU][NU], H[N][NU][NX], Pc[N][NX], Pvc[N][NU];
  double curvature[NU];
  double slack[2][LIMITS], dual[2][LIMITS], ds[2][LIMITS], dz[2][LIMITS];
  double alone[N * NU]; /* minimum without limits, where an inverse is kept */
  int8_t active[LIMITS];
} riccati_qp;

static inline double clipped(double x, double low, double high) {
  return x < low ? low : x > high ? high : x;
}

static inline double width_of(double low, double high) {
  const double width = high - low;
  return width > 0 && width < 1e300 ? width : 1.0;
}

/* out (NX, columns) = P (NX, NX, symmetric) M (NX, columns) */
#define MULTIPLY(out, P, M, columns) \
  for (int i = 0; i < NX; i++) { \
    double row[columns] = {0}; \
    for (int l = 0; l < NX; l++) { \
      const double one = P[i][l]; \
      for (int j = 0; j < (columns); j++) row[j] += one * M[l][j]; \
    } \
    memcpy(out[i], row, sizeof row); \
  }

/* out (rows, columns) += sign * M' Y of (inner, rows) and (inner, columns) */
#define ADD_TRANSPOSED(out, M, Y, inner, rows, columns, sign) \
  for (int i = 0; i < (rows); i++) { \
    double row[columns]; \
    memcpy(row, out[i], sizeof row); \
    for (int l = 0; l < (inner); l++) { \
      const double one = sign M[l][i]; \
      for (int j = 0; j < (columns); j++) row[j] += one * Y[l][j]; \
    } \
    memcpy(out[i], row, sizeof row); \
  }

/* Lower factor of a symmetric matrix in its place, its diagonal inverted. */
static int factored(double (*L)[NU]) {
  for (int i = 0; i < NU; i++) {
    for (int j = 0; j < i; j++) {
      double sum = L[i][j];
      for (int l = 0; l < j; l++) sum -= L[i][l] * L[j][l];
      L[i][j] = sum * L[j][j];
    }
    double pivot = L[i][i];
    for (int l = 0; l < i; l++) pivot -= L[i][l] * L[i][l];
    if (!(pivot > 0 && pivot < INFINITY)) return pivot <= 0 ? NOT_CONVEX : NOT_FINITE;
    L[i][i] = 1 / sqrt(pivot);
  }
  return SOLVED;
}

#define FORWARD(L, Y, columns) \
  for (int i = 0; i < NU; i++) { \
    for (int l = 0; l < i; l++) \
      for (int j = 0; j < (columns); j++) Y[i][j] -= L[i][l] * Y[l][j]; \
    for (int j = 0; j < (columns); j++) Y[i][j] *= L[i][i]; \
  }

#define BACKWARD(L, Y, columns) \
  for (int i = NU - 1; i >= 0; i--) { \
    for (int l = i + 1; l < NU; l++) \
      for (int j = 0; j < (columns); j++) Y[i][j] -= L[l][i] * Y[l][j]; \
    for (int j = 0; j < (columns); j++) Y[i][j] *= L[i][i]; \
  }

/* Factors of the recursion for the active constraints. */
static int factorize(riccati_qp *o) {
  double(*range)[NU] = (void *)o->stiffness, (*turn)[NU] = range + N;
  double(*limit)[NX] = (void *)(o->stiffness + BOXES);
  double P[NX][NX], Pxv[NX][NU], Pvv[NU][NU];
  int coupled = 0;
  o->factorizations++;
  memset(o->curvature, 0, sizeof o->curvature);
  memcpy(P, o->Q[N], sizeof P);
  for (int i = 0; i < NX; i++) P[i][i] += limit[N][i];
  for (int k = N - 1; k >= 0; k--) {
    double PA[NX][NX], G[NX][NU], Y[NU][NX], Yv[NU][NU];
    MULTIPLY(PA, P, o->A[k], NX)
    MULTIPLY(G, P, o->B[k], NU)
    for (int i = 0; i < NX; i++) {
      double sum = 0;
      for (int j = 0; j < NX; j++) sum += P[i][j] * o->c[k][j];
      o->Pc[k][i] = sum;
    }
    memcpy(o->L[k], o->R[k], sizeof o->L[k]);
    memset(o->Pvc[k], 0, sizeof o->Pvc[k]);
    if (coupled) {
      for (int i = 0; i < NX; i++)
        for (int j = 0; j < NU; j++) {
          G[i][j] += Pxv[i][j];
          o->Pvc[k][j] += Pxv[i][j] * o->c[k][i];
        }
      ADD_TRANSPOSED(o->L[k], Pxv, o->B[k], NX, NU, NU, +)
      for (int i = 0; i < NU; i++)
        for (int j = 0; j < NU; j++) o->L[k][i][j] += Pvv[i][j];
    }
    ADD_TRANSPOSED(o->L[k], o->B[k], G, NX, NU, NU, +)
    memcpy(o->H[k], o->S[k], sizeof o->H[k]);
    ADD_TRANSPOSED(o->H[k], G, o->A[k], NX, NU, NX, +)
    coupled = 0;
    for (int i = 0; i < NU; i++) {
      o->curvature[i] = fmax(o->curvature[i], o->L[k][i][i]);
      coupled |= turn[k][i] > 0;
      o->L[k][i][i] += turn[k][i] + range[k][i];
    }
    const int status = factored(o->L[k]);
    if (status != SOLVED) return status;
    memcpy(Y, o->H[k], sizeof Y);
    FORWARD(o->L[k], Y, NX)
    memcpy(P, o->Q[k], sizeof P);
    for (int i = 0; i < NX; i++) P[i][i] += limit[k][i];
    ADD_TRANSPOSED(P, o->A[k], PA, NX, NX, NX, +)
    ADD_TRANSPOSED(P, Y, Y, NU, NX, NX, -)
    for (int i = 0; i < NX; i++) /* rounding must not grow from stage to stage */
      for (int j = 0; j < i; j++) P[i][j] = P[j][i] = 0.5 * (P[i][j] + P[j][i]);
    memset(Yv, 0, sizeof Yv);
    if (coupled) {
      memset(Pxv, 0, sizeof Pxv);
      memset(Pvv, 0, sizeof Pvv);
      for (int i = 0; i < NU; i++) Yv[i][i] = Pvv[i][i] = turn[k][i];
      FORWARD(o->L[k], Yv, NU)
      ADD_TRANSPOSED(Pxv, Y, Yv, NU, NX, NU, +)
      ADD_TRANSPOSED(Pvv, Yv, Yv, NU, NU, NU, -)
      BACKWARD(o->L[k], Yv, NU)
    }
    memcpy(o->Kv[k], Yv, sizeof Yv);
    BACKWARD(o->L[k], Y, NX)
    memcpy(o->Kx[k], Y, sizeof Y); /* u = -Kx x + Kv v + k */
  }
  return SOLVED;
}

static void roll_out(riccati_qp *o, int k, double (*u)[NU], double (*x)[NX]) {
  for (int i = 0; i < NX; i++) {
    double sum = o->c[k][i];
    for (int j = 0; j < NX; j++) sum += o->A[k][i][j] * x[k][j];
    for (int j = 0; j < NU; j++) sum += o->B[k][i][j] * u[k][j];
    x[k + 1][i] = sum;
  }
}

/* States from the start on. */
static void roll_out_all(riccati_qp *o, double (*u)[NU], double (*x)[NX]) {
  memcpy(x[0], o->start, sizeof o->start);
  for (int k = 0; k < N; k++) roll_out(o, k, u, x);
}

/* Values that are limited: inputs, their changes, states. */
static void limited(const riccati_qp *o, double (*u)[NU], double (*x)[NX], double *value) {
  memcpy(value, u, sizeof o->u);
  for (int k = 0; k < N; k++)
    for (int i = 0; i < NU; i++)
      value[(N + k) * NU + i] = u[k][i] - (k ? u[k - 1][i] : o->before[i]);
  memcpy(value + BOXES, x, sizeof o->x);
}

/* Minimum of the piece, with the factors there are, into u_next and x_next. */
static int sweep(riccati_qp *o) {
  double(*range)[NU] = (void *)o->pull, (*turn)[NU] = range + N;
  double(*limit)[NX] = (void *)(o->pull + BOXES);
  const double *stiff = o->stiffness + N * NU;
  double p[NX], pv[NU] = {0}, free[N][NU];
  o->sweeps++;
  for (int i = 0; i < NX; i++) p[i] = o->q[N][i] - limit[N][i];
  for (int k = N - 1; k >= 0; k--) {
    double g[NX], h[NU];
    for (int i = 0; i < NX; i++) g[i] = o->Pc[k][i] + p[i];
    for (int i = 0; i < NU; i++)
      h[i] = o->r[k][i] + o->Pvc[k][i] + pv[i] - range[k][i] - turn[k][i];
    for (int l = 0; l < NX; l++)
      for (int i = 0; i < NU; i++) h[i] += o->B[k][l][i] * g[l];
    for (int i = 0; i < NX; i++) p[i] = o->q[k][i] - limit[k][i];
    for (int l = 0; l < NX; l++)
      for (int i = 0; i < NX; i++) p[i] += o->A[k][l][i] * g[l];
    for (int i = 0; i < NU; i++) {
      double sum = h[i];
      for (int l = 0; l < i; l++) sum -= o->L[k][i][l] * free[k][l];
      free[k][i] = sum * o->L[k][i][i];
    }
    for (int i = NU - 1; i >= 0; i--) {
      double sum = free[k][i];
      for (int l = i + 1; l < NU; l++) sum -= o->L[k][l][i] * free[k][l];
      free[k][i] = sum * o->L[k][i][i];
    }
    for (int i = 0; i < NU; i++) free[k][i] = -free[k][i];
    for (int l = 0; l < NU; l++)
      for (int i = 0; i < NX; i++) p[i] += o->H[k][l][i] * free[k][l];
    for (int i = 0; i < NU; i++) pv[i] = turn[k][i] - stiff[k * NU + i] * free[k][i];
  }
  memcpy(o->x_next[0], o->start, sizeof o->start);
  for (int k = 0; k < N; k++) {
    const double *v = k ? o->u_next[k - 1] : o->before;
    for (int i = 0; i < NU; i++) {
      double sum = free[k][i];
      for (int j = 0; j < NX; j++) sum -= o->Kx[k][i][j] * o->x_next[k][j];
      for (int j = 0; j < NU; j++) sum += o->Kv[k][i][j] * v[j];
      o->u_next[k][i] = sum;
    }
    roll_out(o, k, o->u_next, o->x_next);
  }
  limited(o, o->u_next, o->x_next, o->value_next);
  double sum = 0;
  for (int m = 0; m < LIMITS; m++) sum += o->value_next[m];
  return isfinite(sum) ? SOLVED : NOT_FINITE;
}

static inline int side(double x, double low, double high) { return (x > high) - (x < low); }

/* Active limits at values, and the pull of each; how many are others than before. A limit that is
 * met to less than the tolerance stays as it was: rounding must not switch it back and forth. */
static int classify(riccati_qp *o, const double *value) {
  int changed = 0;
  for (int m = 0; m < LIMITS; m++) {
    const double rigid = o->rigidity[m], force = m < BOXES ? o->force[m] : 0;
    const double at = value[m] + force / rigid, low = o->low[m], high = o->high[m];
    int now = rigid > 0 ? side(at, low, high) : 0;
    if (now != o->active[m] && rigid > 0) {
      const double met = 0.1 * TOLERANCE * width_of(low, high);
      if (fabs(at - (now + o->active[m] > 0 ? high : low)) <= met) now = o->active[m];
    }
    changed += now != o->active[m];
    o->active[m] = (int8_t)now;
    o->stiffness[m] = now ? rigid : 0;
    o->pull[m] = now ? rigid * (now > 0 ? o->high[m] : o->low[m]) - force : 0;
  }
  return changed;
}

static inline double beyond(double x, double low, double high) { return x - clipped(x, low, high); }

/* Slope of the augmented Lagrangian's limits at a part t of the step, along the step. */
static double limit_slope(const riccati_qp *o, double t) {
  double slope = 0;
  for (int m = 0; m < LIMITS; m++)
    if (o->rigidity[m] > 0) {
      const double step = o->value_next[m] - o->value[m], force = m < BOXES ? o->force[m] : 0;
      const double at = o->value[m] + t * step + force / o->rigidity[m];
      slope += o->rigidity[m] * step * beyond(at, o->low[m], o->high[m]);
    }
  return slope;
}

/* Gradient of the cost without limits at stage k, in states and inputs. */
static void stage_gradient(const riccati_qp *o, int k, const double *x, const double *u, double *gx,
                           double *gu) {
  for (int i = 0; i < NX; i++) {
    gx[i] = 0;
    for (int j = 0; j < NX; j++) gx[i] += o->Q[k][i][j] * x[j];
  }
  if (k == N) return;
  for (int i = 0; i < NU; i++) {
    gu[i] = 0;
    for (int j = 0; j < NX; j++) {
      gu[i] += o->S[k][i][j] * x[j];
      gx[j] += o->S[k][i][j] * u[i];
    }
    for (int j = 0; j < NU; j++) gu[i] += o->R[k][i][j] * u[j];
  }
}

/* Length in [0, 1] of the step to u_next at which the augmented Lagrangian is least. */
static double step_length(const riccati_qp *o) {
  double slope = 0, bend = 0;
  for (int k = 0; k <= N; k++) {
    double gx[NX], gu[NU], du[NU], dx[NX], hx[NX], hu[NU];
    const double *u = k < N ? o->u[k] : o->before;
    for (int i = 0; i < NX; i++) dx[i] = o->x_next[k][i] - o->x[k][i];
    for (int i = 0; k < N && i < NU; i++) du[i] = o->u_next[k][i] - o->u[k][i];
    stage_gradient(o, k, o->x[k], u, gx, gu);
    stage_gradient(o, k, dx, du, hx, hu);
    for (int i = 0; i < NX; i++) {
      slope += (gx[i] + o->q[k][i]) * dx[i];
      bend += hx[i] * dx[i];
    }
    for (int i = 0; k < N && i < NU; i++) {
      slope += (gu[i] + o->r[k][i]) * du[i];
      bend += hu[i] * du[i];
    }
  }
  double low = 0, high = 1;
  double at_low = slope + limit_slope(o, 0), at_high = slope + bend + limit_slope(o, 1);
  if (!(at_high > 0) || !(at_low < 0)) return 1;
  const double flat = 1e-3 * -at_low;
  for (int i = 0; i < 40; i++) {
    double t = i % 3 == 2 ? 0.5 * (low + high) : low - at_low * (high - low) / (at_high - at_low);
    const double here = slope + bend * t + limit_slope(o, t);
    if (fabs(here) <= flat) return t;
    if (here < 0) {
      low = t;
      at_low = here;
    } else {
      high = t;
      at_high = here;
    }
  }
  return low;
}

/* New forces of the boxes; the largest violation of one, or of its complementarity, over its
 * width. */
static double renew_forces(riccati_qp *o) {
  double worst = 0;
  for (int m = 0; m < BOXES; m++) {
    const double rigid = o->rigidity[m], at = o->value[m] + o->force[m] / rigid;
    const int now = o->active[m];
    const double next = now ? rigid * (at - (now > 0 ? o->high[m] : o->low[m])) : 0;
    worst = fmax(worst, fabs(next - o->force[m]) / rigid / width_of(o->low[m], o->high[m]));
    o->force[m] = next;
  }
  return worst;
}

/* Largest gradient of the Lagrangian in an input, over the largest of its terms, or where all are
 * slight over what moves the input by less than a limit's tolerance; also the cost. */
static double optimality(riccati_qp *o) {
  double costate[NX] = {0}, worst[NU] = {0}, largest = 1e-300, cost = 0, ratio = 0;
  for (int k = N; k >= 0; k--) {
    double gx[NX], gu[NU], next[NX];
    stage_gradient(o, k, o->x[k], k < N ? o->u[k] : o->before, gx, gu);
    for (int i = 0; i < NX; i++) {
      const int m = BOXES + k * NX + i;
      const double over = o->rigidity[m] > 0 ? beyond(o->x[k][i], o->low[m], o->high[m]) : 0;
      const double half = k < N ? gx[i] : 0.5 * gx[i];
      cost += (k < N ? 0.0 : half * o->x[k][i]) + o->q[k][i] * o->x[k][i];
      cost += 0.5 * o->weight[k][i] * over * over;
      next[i] = gx[i] + o->q[k][i] + o->weight[k][i] * over;
    }
    if (k < N) {
      for (int i = 0; i < NX; i++) cost += 0.5 * gx[i] * o->x[k][i];
      for (int i = 0; i < NU; i++) {
        cost += 0.5 * gu[i] * o->u[k][i] + o->r[k][i] * o->u[k][i];
        double pull = 0;
        for (int j = 0; j < NX; j++) pull += o->B[k][j][i] * costate[j];
        const double *force = o->force + k * NU + i, *turn = force + N * NU;
        const double forces = *force + *turn - (k + 1 < N ? turn[NU] : 0);
        const double all = gu[i] + o->r[k][i] + pull + forces;
        worst[i] = fmax(worst[i], fabs(all));
        largest = fmax(largest, fmax(fabs(gu[i] + o->r[k][i]), fmax(fabs(pull), fabs(forces))));
      }
      for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++) next[j] += o->A[k][i][j] * costate[i];
    }
    memcpy(costate, next, sizeof costate);
  }
  o->cost = cost;
  for (int i = 0; i < NU; i++) {
    const double slight = o->curvature[i] * width_of(o->low[i], o->high[i]);
    ratio = fmax(ratio, worst[i] / fmax(largest, TOLERANCE / OPTIMALITY * slight));
  }
  return ratio;
}

static inline int any_lost(const double *values, int count, int bounded) {
  int found = 0;
  for (int i = 0; i < count; i++) found |= bounded ? !isfinite(values[i]) : isnan(values[i]);
  return found;
}

/* Whether limits are numbers, the others finite, and some inputs keep ranges and changes: each
 * input for itself, as an interval. A number that is none in matrices and gradients is seen in the
 * solution. */
static int possible(const riccati_qp *o) {
  if (any_lost(o->low, LIMITS, 0) || any_lost(o->high, LIMITS, 0) || any_lost(o->start, NX, 1) ||
      any_lost(o->weight[0], (N + 1) * NX, 1) || any_lost(o->before, NU, 1))
    return NOT_FINITE;
  for (int i = 0; i < NU; i++) {
    double low = o->before[i], high = low;
    for (int k = 0; k < N; k++) {
      const int m = k * NU + i, turn = m + N * NU;
      low = fmax(low + o->low[turn], o->low[m]);
      high = fmin(high + o->high[turn], o->high[m]);
      if (!(low <= high + TOLERANCE * width_of(o->low[m], o->high[m]))) return INFEASIBLE;
    }
  }
  return SOLVED;
}

static void set_rigidity(riccati_qp *o, double growth) {
  for (int m = 0; m < BOXES; m++) o->rigidity[m] = growth * o->penalty[m % NU];
  memcpy(o->rigidity + BOXES, o->weight, sizeof o->weight);
  memset(o->rigidity + BOXES, 0, NX * sizeof(double)); /* the first state is given */
}

/* Steps between active limits from u, x and the forces; status. */
static int minimize(riccati_qp *o, int most) {
  int fresh = 0; /* factors belong to the active limits */
  const int64_t last = o->factorizations + most, last_sweep = o->sweeps + MOST_SWEEPS;
  double before = INFINITY, growth = 1;
  set_rigidity(o, growth);
  limited(o, o->u, o->x, o->value);
  classify(o, o->value);
  while (o->factorizations < last && o->sweeps < last_sweep) {
    int status = fresh ? SOLVED : factorize(o);
    if (status == SOLVED) status = sweep(o);
    if (status != SOLVED) return status;
    if (classify(o, o->value_next) == 0) { /* the minimum of this Lagrangian */
      memcpy(o->u, o->u_next, sizeof o->u);
      memcpy(o->x, o->x_next, sizeof o->x);
      memcpy(o->value, o->value_next, sizeof o->value);
      o->violation = renew_forces(o);
      if (o->violation <= TOLERANCE) {
        o->gradient = optimality(o);
        return o->gradient <= OPTIMALITY && isfinite(o->cost) ? SOLVED : NOT_CONVERGED;
      }
      const int slow = o->violation > 0.1 * before;
      before = o->violation;
      if (slow) set_rigidity(o, growth *= 10);
      fresh = classify(o, o->value) == 0 && !slow;
      continue;
    }
    const double t = step_length(o);
    for (int k = 0; k < N; k++)
      for (int i = 0; i < NU; i++) o->u[k][i] += t * (o->u_next[k][i] - o->u[k][i]);
    for (int k = 0; k <= N; k++)
      for (int i = 0; i < NX; i++) o->x[k][i] += t * (o->x_next[k][i] - o->x[k][i]);
    limited(o, o->u, o->x, o->value);
    classify(o, o->value);
    fresh = 0;
  }
  return NOT_CONVERGED;
}

static inline int has(const riccati_qp *o, int m, int up) {
  return o->rigidity[m] > 0 && (up ? o->high[m] < INFINITY : o->low[m] > -INFINITY);
}

/* Room to a limit at values, negative beyond it. */
static inline double room(const riccati_qp *o, int m, int up) {
  return up ? o->high[m] - o->value[m] : o->value[m] - o->low[m];
}

/* Stiffness and pull of the barrier; `target` is the mean product that is aimed at, second order
 * terms are those of the step in ds and dz. A soft limit gives way by its dual over its weight. */
static void set_barrier(riccati_qp *o, double target, int second) {
  for (int m = 0; m < LIMITS; m++) {
    const double give = m < BOXES ? 0 : 1 / o->rigidity[m];
    o->stiffness[m] = o->pull[m] = 0;
    for (int up = 0; up < 2; up++)
      if (has(o, m, up)) {
        const double s = o->slack[up][m], z = o->dual[up][m], sign = up ? 1 : -1;
        const double loose = s + z * give, left = room(o, m, up) + z * give - s;
        const double product = target - s * z - (second ? o->ds[up][m] * o->dz[up][m] : 0);
        const double force = z + (product - z * left) / loose;
        o->stiffness[m] += z / loose;
        o->pull[m] += z / loose * o->value[m] - sign * force;
      }
  }
}

/* Steps of slacks and duals on the way to the next values, for what `set_barrier` was given; the
 * longest part of it that keeps them above zero. */
static double barrier_step(riccati_qp *o, double target, int second) {
  double longest = 1;
  for (int m = 0; m < LIMITS; m++) {
    const double give = m < BOXES ? 0 : 1 / o->rigidity[m];
    for (int up = 0; up < 2; up++)
      if (has(o, m, up)) {
        const double s = o->slack[up][m], z = o->dual[up][m], sign = up ? 1 : -1;
        const double left = room(o, m, up) + z * give - s;
        const double product = target - s * z - (second ? o->ds[up][m] * o->dz[up][m] : 0);
        const double moved = sign * (o->value_next[m] - o->value[m]);
        const double dz = (product - z * left + z * moved) / (s + z * give);
        const double ds = left - moved + dz * give;
        o->dz[up][m] = dz;
        o->ds[up][m] = ds;
        if (ds < 0) longest = fmin(longest, -s / ds);
        if (dz < 0) longest = fmin(longest, -z / dz);
      }
  }
  return longest;
}

/* Mean product of slacks and duals after a part t of the step. */
static double mean_product(const riccati_qp *o, double t) {
  double sum = 0;
  int count = 0;
  for (int m = 0; m < LIMITS; m++)
    for (int up = 0; up < 2; up++)
      if (has(o, m, up)) {
        sum += (o->slack[up][m] + t * o->ds[up][m]) * (o->dual[up][m] + t * o->dz[up][m]);
        count++;
      }
  return count ? sum / count : 0;
}

/* Slacks of a tenth of the width at least, and duals with one product. */
static double begin_barrier(riccati_qp *o) {
  memset(o->ds, 0, sizeof o->ds);
  memset(o->dz, 0, sizeof o->dz);
  for (int m = 0; m < LIMITS; m++)
    for (int up = 0; up < 2; up++) {
      const double width = width_of(o->low[m], o->high[m]);
      const double rigid = m < BOXES ? o->rigidity[m] / PENALTY : o->rigidity[m];
      o->slack[up][m] = fmax(room(o, m, up), 0.1 * width);
      const double over = fabs(beyond(o->value_next[m], o->low[m], o->high[m]));
      o->dual[up][m] = rigid * fmax(0.1 * width, over);
    }
  const double product = mean_product(o, 0);
  for (int m = 0; m < LIMITS; m++)
    for (int up = 0; up < 2; up++) o->dual[up][m] = product / o->slack[up][m];
  return product;
}

/* Interior point method from the minimum without limits; u, x and forces near the solution. */
static int interior(riccati_qp *o, double gap) {
  memset(o->stiffness, 0, sizeof o->stiffness);
  memset(o->pull, 0, sizeof o->pull);
  int status = factorize(o);
  if (status == SOLVED) status = sweep(o);
  if (status != SOLVED) return status;
  for (int i = 0; i < NU; i++) o->penalty[i] = PENALTY * fmax(o->curvature[i], 1e-200);
  set_rigidity(o, 1);
  memcpy(o->x[0], o->start, sizeof o->start);
  for (int k = 0; k < N; k++) {
    for (int i = 0; i < NU; i++)
      o->u[k][i] = clipped(o->u_next[k][i], o->low[k * NU + i], o->high[k * NU + i]);
    roll_out(o, k, o->u, o->x);
  }
  limited(o, o->u, o->x, o->value);
  const double first = begin_barrier(o);
  for (int round = 0; round < MOST_INTERIOR; round++) {
    const double product = mean_product(o, 0);
    if (!(product > gap * first)) break;
    set_barrier(o, 0, 0);
    status = factorize(o);
    if (status == SOLVED) status = sweep(o);
    if (status != SOLVED) return status;
    const double after = mean_product(o, barrier_step(o, 0, 0)) / product;
    const double target = after * after * after * product;
    set_barrier(o, target, 1);
    status = sweep(o);
    if (status != SOLVED) return status;
    const double t = fmin(1, 0.995 * barrier_step(o, target, 1));
    for (int k = 0; k < N; k++)
      for (int i = 0; i < NU; i++) o->u[k][i] += t * (o->u_next[k][i] - o->u[k][i]);
    for (int k = 0; k <= N; k++)
      for (int i = 0; i < NX; i++) o->x[k][i] += t * (o->x_next[k][i] - o->x[k][i]);
    for (int m = 0; m < LIMITS; m++) {
      o->value[m] += t * (o->value_next[m] - o->value[m]);
      for (int up = 0; up < 2; up++) {
        o->slack[up][m] += t * o->ds[up][m];
        o->dual[up][m] += t * o->dz[up][m];
      }
    }
    memset(o->ds, 0, sizeof o->ds);
    memset(o->dz, 0, sizeof o->dz);
  }
  for (int m = 0; m < BOXES; m++) {
    o->force[m] = (has(o, m, 1) ? o->dual[1][m] : 0) - (has(o, m, 0) ? o->dual[0][m] : 0);
  }
  return SOLVED;
}

#include "condensed_qp.h"

/* Whether a state after the first, which is given, has a soft limit. */
static int any_weight(const riccati_qp *o) {
  for (const double *w = o->weight[1]; w < o->weight[N + 1]; w++)
    if (*w > 0) return 1;
  return 0;
}

/* Status of the solution in u and x, which are also where the next call begins. */
static int solve(riccati_qp *o) {
  o->cost = o->gradient = o->violation = NAN;
  o->factorizations = o->sweeps = 0;
  o->status = possible(o);
  if (o->status != SOLVED) return (int)o->status;
  o->status = NOT_CONVERGED;
  if (o->inverse && !any_weight(o)) o->status = solve_condensed(o);
  if (o->status == NOT_CONVERGED && o->penalty[0] > 0) {
    roll_out_all(o, o->u, o->x);
    o->status = minimize(o, MOST_WARM);
  }
  for (int again = 0; again < 2 && o->status == NOT_CONVERGED; again++) {
    o->status = interior(o, again ? SLIGHT_GAP : GAP);
    if (o->status == SOLVED) o->status = minimize(o, MOST_POLISHING);
  }
  if (o->status != SOLVED) memset(o->penalty, 0, sizeof o->penalty); /* the next begins anew */
  return (int)o->status;
}

#endif
