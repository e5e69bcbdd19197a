/* Motion of one mass on a sum of force laws: m a + R = F.
 *
 * Fixed small steps of the classical Runge-Kutta method, with two things made exact where a step alone is not:
 * - dry friction is set-valued: each reversal of motion is located, and the mass then moves on or sticks;
 * - laws with memory of the path (sliders, superelastic plateaus) are maps of the displacement within the step, not
 *   differential equations, so that a step between two reversals takes them through any corner.
 * F and the gates of the terms are given on the half-step grid, so that no force is interpolated by a Runge-Kutta stage
 * of a whole step; a step cut by a reversal interpolates by the parabola through the three points of its step.
 */
#include <math.h>
#include <stddef.h>

enum { NP = 12, NMEM = 48, NODE = 2, NTERM = 16 };
enum {
  SLIDERS, BOUCWEN, PECORARI, POWER, EXPONENTIAL, STRING, SINE, RIPPLE, ONESIDED, UNLOADED, HUNT, KELVIN, STOPS,
  PLAY, FRICTION, DRAG, XDAMPING, WEAKENING, PINCH, MAXWELL, CONSTANT, MASS, HIDDEN, DELAYED, LEVER, FLAG, SOFTGEL,
  LATE_FRICTION
};

typedef struct {
  int kind, group, count;   /* group 0: baseline; 1: hysteretic force of the baseline; 2: concealed */
  double p[NP];
  const double *gate;       /* factor in time on the half-step grid, or NULL */
  const double *table;      /* sliders: stiffness, limit, stiffness, limit, ... */
} Term;

typedef struct {
  double x, v, s, u;        /* s: direction of motion, -1, 0 (sticking), 1; u: place within the step, 0..1 */
  double from;              /* displacement at which the memory was last stored */
  double ode[NTERM][NODE];
} State;

typedef struct {
  const Term *terms; int n; double mass, drag_of_shaker, h;
  long step; double f[3]; double gate[NTERM][3];
  const double *xs, *vs;    /* motion so far, for laws with a delay */
  double memory[NTERM][NMEM];  /* of the path, up to State.from */
} Rig;

typedef struct { double force, mass, baseline, hysteretic, concealed, heat; } Sum;

static double parabola(const double y[3], double u) {
  return y[0]*(1 - u)*(1 - 2*u) + y[1]*4*u*(1 - u) + y[2]*u*(2*u - 1);
}
static double clip(double x, double lo, double hi) { return x < lo ? lo : x > hi ? hi : x; }
static double plus(double d, double w) { return w > 0 ? 0.5*(d + sqrt(d*d + w*w)) : d > 0 ? d : 0; }
static double scaled_power(double d, double n, double L) { return n == 1 ? d : L*pow(d/L, n); }
static double direction(double v, double s, double width) { return width > 0 ? tanh(v/width) : s; }

static double past(const double *y, long step, double u, double steps_back) {
  double at = step + u - steps_back;
  if (at <= 0 || !y) return 0;
  long i = (long)at;
  if (i >= step) return y[step];
  return y[i] + (at - i)*(y[i + 1] - y[i]);
}

/* Force of one term; *inertia gets what multiplies the acceleration. h: hysteretic force of the baseline. */
static double law(const Rig *rig, int k, const State *y, double h, double *inertia) {
  const Term *t = rig->terms + k;
  const double *p = t->p, x = y->x, v = y->v, s = y->s;
  const double *mem = rig->memory[k], *ode = y->ode[k];
  *inertia = 0;
  switch (t->kind) {
  case SLIDERS: {
    double f = 0;
    for (int i = 0; i < t->count; i++)
      f += t->table[2*i]*clip(mem[i] + x - y->from, -t->table[2*i + 1], t->table[2*i + 1]);
    return p[0]*f; }
  case BOUCWEN: case MAXWELL: return p[0]*ode[0];
  case PECORARI: return p[0]*s*(0.5*(p[1] - p[2]) - plus(-s*x - p[2], 0));
  case POWER: { double d = x - p[3], f = scaled_power(fabs(d), p[1], p[2]); return p[0]*(p[4] || d > 0 ? f : -f); }
  case EXPONENTIAL: return p[0]*p[1]*(exp(x/p[1]) - 1 - x/p[1]);
  case STRING: return p[0]*x*(1 - 1/sqrt(1 + x*x/(p[1]*p[1])));
  case SINE: return p[0]*(p[1]*sin(x/p[1]) - x);
  case RIPPLE: return p[0]*sin(x/p[1] + p[2]);
  case ONESIDED: return p[0]*p[4]*scaled_power(plus(p[4]*x - p[1], p[2]), p[3], p[5]);
  case UNLOADED: return -p[0]*h*0.5*(1 + tanh((p[2]*x - p[1])/p[3]));
  case HUNT: {
    double f = 0;
    for (int side = -1; side <= 1; side += 2) {
      if (p[4] != 0 && p[4] != side) continue;
      double d = plus(side*x - p[1], 0), g = scaled_power(d, p[3], p[5])*(1 + p[2]*side*v);
      f += side*(g > 0 ? g : 0);
    }
    return p[0]*f; }
  case KELVIN: {
    double f = 0;
    for (int side = -1; side <= 1; side += 2) {
      if (p[4] != 0 && p[4] != side) continue;
      double d = plus(side*x - p[1], 0), g = d > 0 ? d + p[2]*side*v : 0;
      f += side*(g > 0 ? g : 0);
    }
    return p[0]*f; }
  case STOPS: return p[0]*(scaled_power(plus(x - p[1], 0), p[3], p[4]) - scaled_power(plus(-x - p[2], 0), p[3], p[4]));
  case PLAY: return -p[0]*clip(x - p[2], -p[1], p[1]);
  case FRICTION: {
    double dir = direction(v, s, p[4]), w = fabs(v)/p[2];
    double fall = p[1] == 0 ? 0 : p[3] == 0 ? 1/(1 + w*w) : exp(-pow(w, p[3]));
    double level = (1 + p[1]*fall)*(1 + p[5]*dir)*(1 + p[6]*x + p[7]*fabs(x) + p[8]*x*x);
    return p[0]*(level > 0 ? level : 0)*dir; }
  case DRAG: { double f = scaled_power(fabs(v), p[1], p[2]); return p[0]*(p[3] || v > 0 ? f : -f); }
  case XDAMPING: {
    double q = x/p[1], g = p[2] == 0 ? q*q : p[2] == 1 ? fabs(q) : p[2] == 2 ? p[3]*q + q*q : pow(1 - q, -3) - 1;
    return p[0]*v*g; }
  case WEAKENING: {
    double q = ode[0]/p[1], lost = p[3] == 0 ? 1 - exp(-q) : q/(1 + q);
    if (p[2] == 2) { double r = fabs(x) > mem[0] ? fabs(x) : mem[0]; lost = 1 - exp(-r/p[1]); }
    return -p[0]*(p[4] ? x : h)*lost; }
  case PINCH: {
    double q = (p[2] == 2 ? h : x - p[3])/p[1];
    return -p[0]*h*(p[2] == 1 ? 1/(1 + q*q) : exp(-q*q)); }
  case CONSTANT: return p[0];
  case MASS: *inertia = p[0]; return 0;
  case HIDDEN: {
    double d = x - ode[0], e = v - ode[1];
    return p[0]*p[1]*(p[1]*(p[3] > 0 ? d*d*d/(p[3]*p[3]) : d) + 2*p[2]*e); }
  case DELAYED: return p[0]*past(rig->xs, rig->step, y->u, p[1]/rig->h);
  case LATE_FRICTION: return p[0]*tanh(past(rig->vs, rig->step, y->u, p[1]/rig->h)/p[2]);
  case LEVER: *inertia = p[0]*x; return 0.5*p[0]*v*v;
  case FLAG: {
    double d = fabs(x), q = clip(mem[0], d - p[1], fmax(0, d - p[2]));
    return p[0]*(x < 0 ? -1 : 1)*(d - q); }
  case SOFTGEL: { double q = ode[0]; return p[0]*q*q*q/(p[2]*p[2]); }
  }
  return 0;
}

static Sum add(const Rig *rig, const State *y) {
  Sum sum = {0, rig->mass, 0, 0, 0, 0};
  for (int k = 0; k < rig->n; k++) {
    double inertia, f = law(rig, k, y, sum.hysteretic, &inertia);
    double g = rig->terms[k].gate ? parabola(rig->gate[k], y->u) : 1;
    f *= g; inertia *= g;
    sum.force += f; sum.mass += inertia;
    if (rig->terms[k].group == 1) sum.hysteretic += f;
    else if (rig->terms[k].group == 0) sum.baseline += f;
    else sum.concealed += f;
  }
  return sum;
}

static double acceleration(const Rig *rig, const State *y, Sum *sum) {
  *sum = add(rig, y);
  return (parabola(rig->f, y->u) - rig->drag_of_shaker*y->v - sum->force)/sum->mass;
}

static void rates(const Rig *rig, const State *y, double h, double out[NTERM][NODE]) {
  for (int k = 0; k < rig->n; k++) {
    const Term *t = rig->terms + k;
    const double *p = t->p, *z = y->ode[k], v = y->v;
    out[k][0] = out[k][1] = 0;
    switch (t->kind) {
    case BOUCWEN: {
      double r = pow(fabs(z[0]), p[4] - 1);
      out[k][0] = p[1]*v - p[2]*fabs(v)*r*z[0] - p[3]*v*r*fabs(z[0]); break; }
    case MAXWELL: out[k][0] = v - z[0]/p[1]; break;
    case SOFTGEL: out[k][0] = v - z[0]*(1 + z[0]*z[0]/(p[2]*p[2]))/p[1]; break;
    case WEAKENING: out[k][0] = p[2] == 1 ? fabs(h*v) : fabs(v); break;
    case HIDDEN: {
      double d = y->x - z[0], e = v - z[1];
      out[k][0] = z[1];
      out[k][1] = p[1]*(p[1]*(p[3] > 0 ? d*d*d/(p[3]*p[3]) : d) + 2*p[2]*e); break; }
    }
  }
}

static void derivative(const Rig *rig, const State *y, double *a, double z[NTERM][NODE]) {
  Sum sum;
  *a = acceleration(rig, y, &sum);
  rates(rig, y, sum.hysteretic, z);
}

static State moved(const Rig *rig, const State *y, double du, double dt, double v, double a, double z[NTERM][NODE]) {
  State next = *y;
  next.u += du; next.x += dt*v; next.v += dt*a;
  for (int k = 0; k < rig->n; k++) for (int j = 0; j < NODE; j++) next.ode[k][j] += dt*z[k][j];
  return next;
}

static State runge_kutta(const Rig *rig, const State *y, double du) {
  double dt = du*rig->h, a1, a2, a3, a4, z1[NTERM][NODE], z2[NTERM][NODE], z3[NTERM][NODE], z4[NTERM][NODE];
  derivative(rig, y, &a1, z1);
  State b = moved(rig, y, du/2, dt/2, y->v, a1, z1);
  derivative(rig, &b, &a2, z2);
  State c = moved(rig, y, du/2, dt/2, b.v, a2, z2);
  derivative(rig, &c, &a3, z3);
  State d = moved(rig, y, du, dt, c.v, a3, z3);
  derivative(rig, &d, &a4, z4);
  for (int k = 0; k < rig->n; k++) for (int j = 0; j < NODE; j++) z1[k][j] = (z1[k][j] + 2*z2[k][j] + 2*z3[k][j] + z4[k][j])/6;
  return moved(rig, y, du, dt, (y->v + 2*b.v + 2*c.v + d.v)/6, (a1 + 2*a2 + 2*a3 + a4)/6, z1);
}

/* Stores the path's memory at the displacement reached. */
static void store(Rig *rig, State *y) {
  for (int k = 0; k < rig->n; k++) {
    const Term *t = rig->terms + k;
    double *mem = rig->memory[k];
    if (t->kind == SLIDERS)
      for (int i = 0; i < t->count; i++) mem[i] = clip(mem[i] + y->x - y->from, -t->table[2*i + 1], t->table[2*i + 1]);
    else if (t->kind == FLAG) mem[0] = clip(mem[0], fabs(y->x) - t->p[1], fmax(0, fabs(y->x) - t->p[2]));
    else if (t->kind == WEAKENING && fabs(y->x) > mem[0]) mem[0] = fabs(y->x);
  }
  y->from = y->x;
}

/* Where the mass at rest goes: 1, -1, or 0 where friction holds it. Without friction it goes where the force of a
 * little later pulls it, if it is in balance now. */
static double goes(const Rig *rig, const State *y) {
  State trial = *y;
  Sum sum;
  trial.s = 1;
  double forward = acceleration(rig, &trial, &sum);
  if (forward > 0) return 1;
  trial.s = -1;
  double backward = acceleration(rig, &trial, &sum);
  if (backward < 0) return -1;
  if (backward > forward) return 0;
  trial.u = y->u < 1 ? 0.5*(y->u + 1) : 1;
  backward = acceleration(rig, &trial, &sum);
  return backward > 0 ? 1 : backward < 0 ? -1 : 0;
}

/* The mass at rest until friction lets go, at most du further. */
static State held(const Rig *rig, const State *y, double du) {
  double z[NTERM][NODE], lo = 0, hi = du;
  rates(rig, y, add(rig, y).hysteretic, z);
  State next = moved(rig, y, du, du*rig->h, 0, 0, z);
  if (goes(rig, &next) == 0) return next;
  while (hi - lo > 1e-9) {
    double middle = 0.5*(lo + hi);
    next = moved(rig, y, middle, middle*rig->h, 0, 0, z);
    if (goes(rig, &next) == 0) lo = middle; else hi = middle;
  }
  return moved(rig, y, hi, hi*rig->h, 0, 0, z);
}

static State advance(Rig *rig, State y) {
  for (int guard = 0; guard < 12 && y.u < 1; guard++) {
    double du = 1 - y.u;
    if (y.v == 0) {
      y.s = goes(rig, &y);
      if (y.s == 0) { y = held(rig, &y, du); continue; }
    }
    State next = runge_kutta(rig, &y, du);
    if (next.v*y.s < 0 || next.v == 0) {
      double lo = 0, hi = du;
      for (int i = 0; i < 50 && hi - lo > 1e-12; i++) {
        double middle = 0.5*(lo + hi);
        State trial = runge_kutta(rig, &y, middle);
        if (trial.v*y.s > 0) lo = middle; else hi = middle;
      }
      double s = y.s;
      next = runge_kutta(rig, &y, hi);
      next.v = 0; next.s = s;
    }
    y = next;
    store(rig, &y);
  }
  y.u = 1;
  return y;
}

static void load(Rig *rig, const double *force, long i) {
  rig->step = i;
  for (int j = 0; j < 3; j++) {
    rig->f[j] = force[2*i + j];
    for (int k = 0; k < rig->n; k++) if (rig->terms[k].gate) rig->gate[k][j] = rig->terms[k].gate[2*i + j];
  }
}

/* Drives the mass by force[2 n + 1] on half steps. out[n + 1][7]: x, v, a, F, hysteretic, concealed, R.
 * What an accelerated mass adds to the concealed terms (added mass, lever) is counted with them in R.
 * Returns n, or the step at which the motion left +-limit. */
long drive(const Term *terms, int n_terms, double mass, double drag_of_shaker, double h, long n, const double *force,
           double x0, double v0, double limit, double *xs, double *vs, double *out) {
  Rig rig = {.terms = terms, .n = n_terms, .mass = mass, .drag_of_shaker = drag_of_shaker, .h = h, .xs = xs, .vs = vs};
  State y = {.x = x0, .v = v0, .s = v0 > 0 ? 1 : v0 < 0 ? -1 : 0, .from = x0};
  int concealed_friction = 0;
  for (int k = 0; k < n_terms; k++) {
    if (terms[k].kind == HIDDEN) { y.ode[k][0] = x0; y.ode[k][1] = v0; }
    if (terms[k].kind == FRICTION && terms[k].p[4] == 0) concealed_friction = 1;
  }
  for (long i = 0; i <= n; i++) {
    Sum sum;
    y.u = 0;
    xs[i] = y.x; vs[i] = y.v;
    if (i < n) load(&rig, force, i);
    else { load(&rig, force, n - 1); y.u = 1; }
    if (y.v == 0) y.s = goes(&rig, &y);
    double a = acceleration(&rig, &y, &sum), drive_force = parabola(rig.f, y.u) - drag_of_shaker*y.v;
    if (y.v == 0 && y.s == 0) {
      /* Held: the friction takes what is left of the force, the concealed one where there is one. */
      a = 0;
      if (!concealed_friction) sum.hysteretic += drive_force - sum.force;
    }
    double *o = out + 7*i;
    o[0] = y.x; o[1] = y.v; o[2] = a; o[3] = drive_force;
    o[4] = sum.hysteretic; o[6] = drive_force - mass*a; o[5] = o[6] - sum.baseline - sum.hysteretic;
    if (!(fabs(y.x) < limit)) return i;
    if (i < n) y = advance(&rig, y);
  }
  return n;
}

/* Force that a prescribed motion x, v, a on the half-step grid needs; out as above. */
long follow(const Term *terms, int n_terms, double mass, double h, long n, const double *x, const double *v,
            const double *a, double *xs, double *vs, double *out) {
  Rig rig = {.terms = terms, .n = n_terms, .mass = mass, .h = h, .xs = xs, .vs = vs};
  State y = {.x = x[0], .v = v[0], .from = x[0]};
  for (int k = 0; k < n_terms; k++) if (terms[k].kind == HIDDEN) { y.ode[k][0] = x[0]; y.ode[k][1] = v[0]; }
  for (long i = 0; i <= n; i++) {
    double z1[NTERM][NODE], z2[NTERM][NODE];
    xs[i] = x[2*i]; vs[i] = v[2*i];
    if (i < n) { load(&rig, x, i); y.u = 0; } else { load(&rig, x, n - 1); y.u = 1; }
    y.x = x[2*i]; y.v = v[2*i]; y.s = y.v > 0 ? 1 : y.v < 0 ? -1 : 0;
    store(&rig, &y);
    Sum sum = add(&rig, &y);
    double *o = out + 7*i;
    o[0] = y.x; o[1] = y.v; o[2] = a[2*i]; o[4] = sum.hysteretic;
    o[3] = sum.force + sum.mass*a[2*i]; o[6] = o[3] - mass*a[2*i]; o[5] = o[6] - sum.baseline - sum.hysteretic;
    if (i == n) break;
    rates(&rig, &y, sum.hysteretic, z1);
    State half = moved(&rig, &y, 0.5, 0.5*h, 0, 0, z1);
    half.x = x[2*i + 1]; half.v = v[2*i + 1]; half.s = half.v > 0 ? 1 : half.v < 0 ? -1 : 0;
    rates(&rig, &half, add(&rig, &half).hysteretic, z2);
    y = moved(&rig, &y, 0, h, 0, 0, z2);
  }
  return n;
}
