/* The program of riccati_qp.h where its matrices come again: a dual active-set method.
 *
 * The caller keeps the inverse of the Hessian of the cost in the inputs alone. From the minimum
 * without limits, or under those that were active last, the most violated limit is met step by
 * step, and limits that would pull the wrong way are left [Goldfarb & Idnani 1983]. A step costs
 * the number of inputs times that of active limits. Ranges of inputs and of their changes only.
 * Neglected: soft limits of states, for which riccati_qp.h takes its own recursion.
 *
 * Goldfarb & Idnani (1983), A numerically stable dual method for solving strictly convex quadratic
 * programs, Mathematical Programming 27. */
#ifndef PATAGIUM_CONDENSED_QP_H
#define PATAGIUM_CONDENSED_QP_H /* part of riccati_qp.h, after its functions */

enum { NV = N * NU };
#define MOST_CHANGES (10 * NV) /* of the active limits */
#define DEPENDENT 1e-10        /* part of a limit's curvature that is its own, at least */

/* Active limits in the order of the factor. */
typedef struct {
  double L[NV][NV];       /* of M = C Z C', its rows; Z the inverse, C the rows of active limits */
  double way[NV + 1][NV]; /* of each place: Z C'; one is looked at */
  double dual[NV];
  int row[NV], place[NV + 1], side[NV], count;
} active_set;
_Static_assert(sizeof(active_set) <= sizeof(double) * (2 * NV * (NV + 4) + 16), "Python's memory");

static inline double dot(const double *a, const double *b, int count) {
  double lanes[8] = {0}, rest = 0;
  const int even = count / 8 * 8;
  for (int i = 0; i < even; i += 8)
    for (int l = 0; l < 8; l++) lanes[l] += a[i + l] * b[i + l];
  for (int i = even; i < count; i++) rest += a[i] * b[i];
  for (int l = 0; l < 8; l++) rest += lanes[l];
  return rest;
}

/* Input that a limit is of, and the one before it where it is of a change; -1 for the first. */
static inline int input_of(int m) { return m < NV ? m : m - NV; }
static inline int before_of(int m) { return m >= NV + NU ? m - NV - NU : -1; }

static inline double along(int m, const double *u) {
  return u[input_of(m)] - (before_of(m) >= 0 ? u[before_of(m)] : 0);
}

static inline double value_of(const riccati_qp *o, int m, const double *u) {
  return along(m, u) - (m >= NV && m < NV + NU ? o->before[m - NV] : 0);
}

/* Violation of a limit on a side, above zero beyond it. */
static inline double beyond_side(const riccati_qp *o, int m, int side, const double *u) {
  return side * (value_of(o, m, u) - (side > 0 ? o->high[m] : o->low[m]));
}

/* b <- L^-1 b, and b <- L^-T b. */
static void forward(const active_set *s, double *b) {
  for (int i = 0; i < s->count; i++) b[i] = (b[i] - dot(s->L[i], b, i)) / s->L[i][i];
}

static void backward(const active_set *s, double *b) {
  for (int i = s->count - 1; i >= 0; i--) {
    const double one = b[i] /= s->L[i][i];
    for (int j = 0; j < i; j++) b[j] -= one * s->L[i][j];
  }
}

/* The way of a limit in a free place, and L^-1 C Z c of it; its own part of the curvature. */
static double looked_at(const riccati_qp *o, active_set *s, int m, int side, double *part) {
  double *way = s->way[s->place[s->count]];
  const double *own = o->inverse + input_of(m) * NV;
  const double *past = before_of(m) >= 0 ? o->inverse + before_of(m) * NV : NULL;
  for (int j = 0; j < NV; j++) way[j] = side * (past ? own[j] - past[j] : own[j]);
  for (int a = 0; a < s->count; a++) part[a] = s->side[a] * along(s->row[a], way);
  forward(s, part);
  const double whole = side * along(m, way), left = whole - dot(part, part, s->count);
  return s->count < NV && left > DEPENDENT * whole ? left : 0;
}

static void append(active_set *s, int m, int side, const double *part, double left, double dual) {
  const int k = s->count++;
  memcpy(s->L[k], part, sizeof(double) * k);
  s->L[k][k] = sqrt(left);
  s->row[k] = m;
  s->side[k] = side;
  s->dual[k] = dual;
}

static void leave(active_set *s, int k) {
  const int place = s->place[k];
  s->count--;
  for (int i = k; i < s->count; i++) {
    memcpy(s->L[i], s->L[i + 1], sizeof(double) * (i + 2));
    s->row[i] = s->row[i + 1];
    s->side[i] = s->side[i + 1];
    s->dual[i] = s->dual[i + 1];
    s->place[i] = s->place[i + 1];
  }
  s->place[s->count] = place;
  for (int j = k; j < s->count; j++) { /* turn columns j and j + 1 until L is triangular again */
    const double a = s->L[j][j], b = s->L[j][j + 1], size = sqrt(a * a + b * b);
    const double cosine = a / size, sine = b / size;
    for (int i = j; i < s->count; i++) {
      const double left = s->L[i][j], right = s->L[i][j + 1];
      s->L[i][j] = cosine * left + sine * right;
      s->L[i][j + 1] = cosine * right - sine * left;
    }
  }
}

/* Duals at which the active limits are met exactly, and the inputs; a second time for rounding. */
static void meet(const riccati_qp *o, active_set *s, double *u) {
  double part[NV];
  memcpy(u, o->alone, sizeof o->alone);
  memset(s->dual, 0, sizeof s->dual);
  for (int again = 0; again < 2; again++) {
    for (int a = 0; a < s->count; a++) part[a] = beyond_side(o, s->row[a], s->side[a], u);
    forward(s, part);
    backward(s, part);
    for (int a = 0; a < s->count; a++) {
      s->dual[a] += part[a];
      for (int j = 0; j < NV; j++) u[j] -= part[a] * s->way[s->place[a]][j];
    }
  }
}

/* Gradient at no inputs, and the minimum without limits. */
static void begin_condensed(riccati_qp *o) {
  double costate[NX] = {0}, gx[NX], gu[NU], next[NX], base[NV];
  memset(o->u_next, 0, sizeof o->u_next);
  roll_out_all(o, o->u_next, o->x_next);
  for (int k = N; k >= 0; k--) {
    stage_gradient(o, k, o->x_next[k], k < N ? o->u_next[k] : o->before, gx, gu);
    for (int i = 0; i < NX; i++) next[i] = gx[i] + o->q[k][i];
    for (int i = 0; k < N && i < NU; i++) {
      double *one = base + k * NU + i;
      *one = gu[i] + o->r[k][i];
      for (int j = 0; j < NX; j++) *one += o->B[k][j][i] * costate[j];
    }
    for (int i = 0; k < N && i < NX; i++)
      for (int j = 0; j < NX; j++) next[j] += o->A[k][i][j] * costate[i];
    memcpy(costate, next, sizeof costate);
  }
  for (int j = 0; j < NV; j++) o->alone[j] = -dot(o->inverse + j * NV, base, NV);
  memset(o->curvature, 0, sizeof o->curvature);
  for (int k = 0; k < N; k++) /* at least, and told by the program, not by the inverse */
    for (int i = 0; i < NU; i++) o->curvature[i] = fmax(o->curvature[i], o->R[k][i][i]);
}

/* Active limits to begin with: the last ones, but for those that pull the wrong way. */
static void begin_active(const riccati_qp *o, active_set *s, double *u) {
  double part[NV];
  s->count = 0;
  for (int k = 0; k <= NV; k++) s->place[k] = k;
  for (int m = 0; m < BOXES; m++) {
    const int side = (o->force[m] > 0) - (o->force[m] < 0);
    if (!side || !isfinite(side > 0 ? o->high[m] : o->low[m])) continue;
    const double left = looked_at(o, s, m, side, part);
    if (left > 0) append(s, m, side, part, left, 0);
  }
  for (;;) {
    int worst = -1;
    meet(o, s, u);
    for (int a = 0; a < s->count; a++)
      if (s->dual[a] < 0 && (worst < 0 || s->dual[a] < s->dual[worst])) worst = a;
    if (worst < 0) return;
    leave(s, worst);
  }
}

/* Most violated limit and its side; -1 where none is beyond the tolerance. */
static int most_violated(const riccati_qp *o, const double *u, int *side) {
  double most = 0.1 * TOLERANCE;
  int found = -1;
  for (int m = 0; m < BOXES; m++) {
    const double value = value_of(o, m, u), high = value - o->high[m], low = o->low[m] - value;
    const double over = fmax(high, low) / width_of(o->low[m], o->high[m]);
    if (over > most) {
      most = over;
      found = m;
      *side = high > low ? 1 : -1;
    }
  }
  return found;
}

/* Status of the solution in u and x by the kept inverse. */
static int solve_condensed(riccati_qp *o) {
  active_set *s = (active_set *)o->held;
  double *u = o->u[0], part[NV], turn[NV];
  int changes = 0, side = 0, m;
  begin_condensed(o);
  begin_active(o, s, u);
  while ((m = most_violated(o, u, &side)) >= 0) {
    double dual = 0;
    for (;;) {
      if (++changes > MOST_CHANGES) return NOT_CONVERGED;
      const double left = looked_at(o, s, m, side, part);
      double *way = s->way[s->place[s->count]];
      memcpy(turn, part, sizeof(double) * s->count);
      backward(s, turn);
      double step = left > 0 ? beyond_side(o, m, side, u) / left : INFINITY;
      int blocking = -1;
      for (int a = 0; a < s->count; a++)
        if (turn[a] > 0 && s->dual[a] < step * turn[a]) {
          step = s->dual[a] / turn[a];
          blocking = a;
        }
      if (!(step < INFINITY)) return NOT_CONVERGED;
      for (int j = 0; left > 0 && j < NV; j++) u[j] -= step * way[j];
      for (int a = 0; a < s->count; a++) {
        const double part_of = step * turn[a], *other = s->way[s->place[a]];
        s->dual[a] -= part_of;
        for (int j = 0; left > 0 && j < NV; j++) u[j] += part_of * other[j];
      }
      dual += step;
      if (blocking < 0) {
        append(s, m, side, part, left, dual);
        break;
      }
      leave(s, blocking);
    }
  }
  meet(o, s, u); /* without the rounding of the steps */
  memset(o->force, 0, sizeof o->force);
  for (int a = 0; a < s->count; a++) o->force[s->row[a]] = s->side[a] * fmax(s->dual[a], 0);
  memset(o->rigidity, 0, sizeof o->rigidity);
  roll_out_all(o, o->u, o->x);
  o->factorizations = changes;
  o->violation = 0;
  for (int k = 0; k < BOXES; k++) {
    const double over = fabs(beyond(value_of(o, k, u), o->low[k], o->high[k]));
    o->violation = fmax(o->violation, over / width_of(o->low[k], o->high[k]));
  }
  o->gradient = optimality(o);
  const int good = o->violation <= TOLERANCE && o->gradient <= OPTIMALITY && isfinite(o->cost);
  return good ? SOLVED : NOT_CONVERGED;
}

#endif
