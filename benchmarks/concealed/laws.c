/* Laws and integrator of the concealed-case generator.
 *
 *   (m + sum of carried masses) a + B v + Kl x + sum of elements = F
 *
 * An element is a baseline law (role 0; its force is part of h) or a concealed effect (role 1; it may read h).
 * Rate-independent sliders are advanced by their return map over a step, so that a turn or a yield inside a step costs
 * second order locally and never a missed event. Everything else is an ordinary differential equation, Runge-Kutta 4.
 * Effects: p[0..2] = on, off, rise [s] of a time gate; p[3] = strength; the rest is described at each law.
 */
#include <math.h>
#include <stddef.h>
#include <string.h>

enum {
    JENKINS = 1, SLIDERS = 2, BOUCWEN = 3, PECORARI = 4,
    ODD_POWER = 10, TRANSVERSE = 11, EVEN_POWER = 12, EXPONENTIAL = 13, KNEE = 14, HERTZ_RELEASE = 15, FRICTION_RELEASE = 16,
    STOP = 17, TWO_STOPS = 18, GAP = 19, COULOMB = 20, STRIBECK = 21, ASYMMETRIC = 22, PLACE_FRICTION = 23, DRAG = 24,
    PLACE_DAMPING = 25, MAXWELL = 26, DRIFT = 27, CONSTANT = 28, MASS = 29, HIDDEN = 30, DEGRADE = 31, PINCH = 32,
    LOOP = 33, DUHEM = 34, SLIDER_GROUP = 35,
    COGGING = 40, PARAMETRIC = 41, DELAYED = 42, TONE = 43, INERTIAL = 44, KNOCKS = 45, CENTRIFUGAL = 46, MAGNET = 47,
    TABLE = 50
};
#define GATED 10
#define MAX_STATES 64
#define PI 3.14159265358979323846

/* x0 dx nx v0 dv nv, then nx rows of nv values: bilinear inside, continued by its edge outside */
static double table(const double *p, double x, double v) {
    int nx = (int)p[2], nv = (int)p[5];
    double i = (x - p[0]) / p[1], j = (v - p[3]) / p[4];
    i = i < 0 ? 0 : i > nx - 1 ? nx - 1 : i;
    j = j < 0 ? 0 : j > nv - 1 ? nv - 1 : j;
    int a = i < nx - 2 ? (int)i : nx - 2, b = j < nv - 2 ? (int)j : nv - 2;
    const double *row = p + 6 + a * nv + b;
    i -= a;
    j -= b;
    return (1 - i) * ((1 - j) * row[0] + j * row[1]) + i * ((1 - j) * row[nv] + j * row[nv + 1]);
}

typedef struct {
    double t, x, v;   /* instant [s], motion [m, m/s] */
    double dx;        /* displacement since the step began [m] */
    double h;         /* force of the baseline's law [N] */
    const double *past;  /* displacement on the grid so far [m] */
    long at;          /* index of the step's beginning in past */
    double dt;        /* grid step of past [s] */
} place;

static double sign(double u) { return (u > 0) - (u < 0); }
static double clip(double u, double limit) { return u > limit ? limit : u < -limit ? -limit : u; }

/* smooth sign: three shapes with unit slope scale */
static double smooth_sign(double u, int shape) {
    if (shape == 1) return 2 / PI * atan(0.5 * PI * u);
    if (shape == 2) return tanh(u);
    return u / sqrt(1 + u * u);
}

static double gate(const double *p, double t) {
    double rise = p[2] > 0 ? p[2] : 1e-9;
    double up = (t - p[0]) / rise, down = (p[1] - t) / rise;
    up = up < 0 ? 0 : up > 1 ? 1 : up * up * (3 - 2 * up);
    down = down < 0 ? 0 : down > 1 ? 1 : down * down * (3 - 2 * down);
    return up * down;
}

static int n_flow(int kind, const double *p) { /* states that follow a differential equation */
    switch (kind) {
    case BOUCWEN: case LOOP: case DUHEM: case DEGRADE: return 1;
    case HIDDEN: return 2;
    case MAXWELL: return (int)p[5];
    default: return 0;
    }
}
static int n_map(int kind, const double *p) { /* states that follow a return map */
    switch (kind) {
    case JENKINS: return 1;
    case SLIDERS: return (int)p[0];
    case SLIDER_GROUP: return (int)p[4];
    default: return 0;
    }
}

static double sliders(int n, const double *k, const double *limit, const double *from, double *to, double dx) {
    double force = 0;
    for (int i = 0; i < n; i++) {
        to[i] = clip(from[i] + k[i] * dx, limit[i]);
        force += to[i];
    }
    return force;
}

static double past_displacement(const place *q, double delay) {
    double position = (q->t - delay) / q->dt;
    long i = (long)floor(position);
    if (i < 0) return q->past[0];
    if (i >= q->at) return q->past[q->at];
    double w = position - (double)i;
    return (1 - w) * q->past[i] + w * q->past[i + 1];
}

/* Force of one element without the share of its carried mass; derivatives of flow states; new map states. */
static double element(int kind, const double *p, const place *q, const double *flow, double *rate, const double *from,
                      double *to, double *mass) {
    double x = q->x, v = q->v, A = p[3], u, w, e;
    *mass = 0;
    switch (kind) {
    case JENKINS: return sliders(1, p, p + 1, from, to, q->dx);                     /* stiffness, limit */
    case SLIDERS: { int n = (int)p[0]; return sliders(n, p + 1, p + 1 + n, from, to, q->dx); }
    case BOUCWEN:                                                                   /* alpha beta gamma delta nu */
        w = pow(fabs(flow[0]) + 1e-300, p[4] - 1);
        rate[0] = p[0] * v - p[1] * w * (p[2] * fabs(v) * flow[0] + p[3] * v * fabs(flow[0]));
        return flow[0];
    case PECORARI: {                                    /* Ks x0 x1, speed over which one branch takes over from the other */
        double s = smooth_sign(v / p[3], 0), force = 0;
        for (int side = -1; side <= 1; side += 2) {
            double K = 0.5 * p[0] * (1 - side * sign(x + p[2] * side));
            force += 0.5 * (1 + side * s) * (K * (x + p[2] * side) + 0.5 * p[0] * (p[1] - p[2]) * side);
        }
        return force;
    }
    case ODD_POWER: return A * sign(x) * pow(fabs(x) / p[4], p[5]);                 /* length, power */
    case TRANSVERSE: u = x / p[4]; return A * u * (1 - 1 / sqrt(1 + u * u));        /* length of a spring across the motion */
    case EVEN_POWER: return A * pow(fabs(x) / p[4], p[5]);
    case EXPONENTIAL: u = x / p[4]; return A * (exp(u) - 1 - u);
    case KNEE: u = p[5] * x - p[4]; return A * p[5] * 0.5 * (u + sqrt(u * u + p[6] * p[6])) / p[7]; /* place side width length */
    case HERTZ_RELEASE: u = 1 - p[5] * x / p[4]; return A * p[5] * (1 - (u > 0 ? u * sqrt(u) : 0));  /* place side */
    case FRICTION_RELEASE: u = (p[5] * x - p[4]) / p[6]; return -A * 0.5 * (1 + u / sqrt(1 + u * u)) * q->h;
    case STOP: /* place side length loss power: Hunt and Crossley, never pulling */
        u = p[5] * x - p[4];
        if (u <= 0) return 0;
        w = pow(u / p[6], p[8]) * (1 + p[7] * p[5] * v);
        return w > 0 ? A * p[5] * w : 0;
    case TWO_STOPS: /* place length power offset */
        u = fabs(x - p[7]) - p[4];
        return u > 0 ? A * sign(x - p[7]) * pow(u / p[5], p[6]) : 0;
    case GAP: u = x / p[4]; return -A * u / pow(1 + pow(fabs(u), p[5]), 1 / p[5]);  /* half gap, sharpness */
    case COULOMB: return A * smooth_sign(v / p[4], (int)p[5]);                      /* speed, shape */
    case STRIBECK: u = v / p[6]; return A * (1 + p[7] / (1 + u * u)) * smooth_sign(v / p[4], (int)p[5]); /* .. fall speed, rise */
    case ASYMMETRIC: w = smooth_sign(v / p[4], (int)p[5]); return A * (w + p[6] * w * w);
    case PLACE_FRICTION: /* speed shape length height-law */
        u = x / p[6];
        e = p[7] == 0 ? u : p[7] == 1 ? fabs(u) : p[7] == 2 ? u * u : exp(-u * u);
        return A * e * smooth_sign(v / p[4], (int)p[5]);
    case DRAG: return A * sign(v) * pow(fabs(v) / p[4], p[5]);                      /* speed, power */
    case PLACE_DAMPING: /* length speed law */
        u = x / p[4];
        e = p[6] == 0 ? u * u : p[6] == 1 ? 1 - exp(-u * u) : fabs(u);
        return A * e * v / p[5];
    case MAXWELL: { /* length n then n x (weight, time) */
        int n = (int)p[5];
        double force = 0;
        for (int i = 0; i < n; i++) {
            rate[i] = v - flow[i] / p[7 + 2 * i];
            force += p[6 + 2 * i] * flow[i];
        }
        return A * force / p[4];
    }
    case DRIFT: /* length span law */
        u = q->t / p[5];
        e = p[6] == 0 ? u : p[6] == 1 ? 1 - exp(-3 * u) : u * u;
        return A * x / p[4] * e;
    case CONSTANT: return A;
    case MASS: *mass = A; return 0;
    case HIDDEN: /* A = its mass, circular frequency, damping ratio */
        u = p[4] * p[4] * (x - flow[0]) + 2 * p[5] * p[4] * (v - flow[1]);
        rate[0] = flow[1];
        rate[1] = u;
        return A * u;
    case DEGRADE: /* energy scale, power, stiffness of the base (0: the law's own force) */
        w = p[6] > 0 ? p[6] * x : q->h;
        rate[0] = fabs(w * v) / p[4];
        e = pow(flow[0] > 0 ? flow[0] : 0, p[5]);
        return -A * e / (1 + e) * w;
    case PINCH: /* width of force, width of place, law */
        if (p[6] == 0) { u = q->h / p[4]; return -A * q->h / (1 + u * u); }
        u = x / p[5];
        return -A * q->h * exp(-u * u);
    case LOOP: /* length, power, share of the sign-dependent part */
        w = pow(fabs(flow[0]) + 1e-300, p[5]);
        rate[0] = v / p[4] * (1 - w * (p[6] * sign(v * flow[0]) + 1 - p[6]));
        return A * flow[0];
    case DUHEM: /* length, power */
        u = 1 - flow[0] * sign(v);
        rate[0] = v / p[4] * sign(u) * pow(fabs(u), p[5]);
        return A * flow[0];
    case SLIDER_GROUP: { int n = (int)p[4]; return A * sliders(n, p + 5, p + 5 + n, from, to, q->dx); }
    case COGGING: u = 2 * PI / p[4]; return A * (sin(u * x + p[5]) - sin(p[5]));
    case PARAMETRIC: return A * x / p[4] * cos(p[5] * q->t + p[6]);
    case DELAYED: u = past_displacement(q, p[5]) / p[4]; return A * u * u * u / (1 + u * u);
    case TONE: return A * cos(p[4] * q->t + p[5]);
    case INERTIAL: u = x / p[4]; *mass = A * u * u; return A * x * (v / p[4]) * (v / p[4]);
    case KNOCKS: { /* width n then n x (instant, size) */
        int n = (int)p[5];
        for (int i = 0; i < n; i++) {
            u = (q->t - p[6 + 2 * i]) / p[4];
            if (u > 0 && u < 1) return A * p[7 + 2 * i] * sin(PI * u) * sin(PI * u);
        }
        return 0;
    }
    case CENTRIFUGAL: u = v / p[5]; return A * x / p[4] * u * u;
    case MAGNET: u = 1 - x / p[4]; u = u < 0.05 ? 0.05 : u; return -A * (1 / (u * u) - 1 - 2 * (1 - u)); /* spring retuned */
    case TABLE: return A * table(p + 4, x, v);
    default: return 0;
    }
}

typedef struct {
    int n;
    const int *kind, *role, *at; /* at: first parameter of each element */
    const double *p;
    double m, B, Kl;
    int flows[32], maps[32]; /* first state of each element */
    int n_flows, n_maps;
} rig;

static int lay_out(rig *r) {
    if (r->n > 32) return 1;
    r->n_flows = r->n_maps = 0;
    for (int i = 0; i < r->n; i++) {
        const double *p = r->p + r->at[i];
        r->flows[i] = r->n_flows;
        r->maps[i] = r->n_maps;
        r->n_flows += n_flow(r->kind[i], p);
        r->n_maps += n_map(r->kind[i], p);
    }
    return r->n_flows > MAX_STATES || r->n_maps > MAX_STATES;
}

/* All forces at one instant. Returns R without carried mass; each receives the elements' forces, masses likewise. */
static double forces(const rig *r, place *q, const double *flow, double *rate, const double *from, double *to, double *each,
                     double *masses, double *mass) {
    double total = r->B * q->v + r->Kl * q->x;
    *mass = 0;
    q->h = 0;
    for (int role = 0; role < 2; role++)
        for (int i = 0; i < r->n; i++) {
            if (r->role[i] != role) continue;
            const double *p = r->p + r->at[i];
            double carried, f = element(r->kind[i], p, q, flow + r->flows[i], rate + r->flows[i], from + r->maps[i],
                                        to + r->maps[i], &carried);
            double open = r->kind[i] >= GATED ? gate(p, q->t) : 1;
            each[i] = open * f;
            masses[i] = open * carried;
            total += each[i];
            *mass += masses[i];
            if (role == 0) q->h += f;
        }
    return total;
}

/* Free run. F: 2n+1 values at half steps. state: x, v, flows, maps; in and out. x, v, a, h: n+1 values.
 * each: ne rows of n+1 values. Returns 0, or 1 + the step at which the motion is no longer finite, or -1. */
__attribute__((visibility("default"))) long concealed_run(int ne, const int *kind, const int *role, const int *at,
    const double *p, double m, double B, double Kl, long n, double dt, const double *F, double *state, double *x, double *v,
    double *a, double *h, double *each_out) {
    rig r = {ne, kind, role, at, p, m, B, Kl, {0}, {0}, 0, 0};
    if (lay_out(&r)) return -1;
    double flow[MAX_STATES] = {0}, map[MAX_STATES] = {0}, stage[MAX_STATES], to[MAX_STATES], each[32], masses[32], mass;
    double k[4][MAX_STATES + 2];
    memcpy(flow, state + 2, sizeof(double) * (size_t)r.n_flows);
    memcpy(map, state + 2 + r.n_flows, sizeof(double) * (size_t)r.n_maps);
    double X = state[0], V = state[1];
    static const double part[4] = {0, 0.5, 0.5, 1};
    for (long i = 0; i <= n; i++) {
        x[i] = X;
        v[i] = V;
        for (int s = 0; s < 4; s++) {
            double w = part[s] * dt, *back = k[s ? s - 1 : 0];
            double xs = s ? X + w * back[0] : X, vs = s ? V + w * back[1] : V;
            for (int j = 0; j < r.n_flows; j++) stage[j] = s ? flow[j] + w * back[2 + j] : flow[j];
            place q = {(double)i * dt + w, xs, vs, xs - X, 0, x, i, dt};
            double R = forces(&r, &q, stage, k[s] + 2, map, to, each, masses, &mass);
            k[s][0] = vs;
            k[s][1] = (F[2 * i + (i < n ? (s + 1) / 2 : 0)] - R) / (m + mass);
            if (s == 0) {
                a[i] = k[0][1];
                h[i] = q.h;
                for (int e = 0; e < ne; e++) each_out[(size_t)e * (size_t)(n + 1) + (size_t)i] = each[e] + masses[e] * a[i];
                if (i == n) break;
            }
        }
        if (i == n) break;
        double before = X;
        X += dt / 6 * (k[0][0] + 2 * k[1][0] + 2 * k[2][0] + k[3][0]);
        V += dt / 6 * (k[0][1] + 2 * k[1][1] + 2 * k[2][1] + k[3][1]);
        for (int j = 0; j < r.n_flows; j++)
            flow[j] += dt / 6 * (k[0][2 + j] + 2 * k[1][2 + j] + 2 * k[2][2 + j] + k[3][2 + j]);
        if (!isfinite(X) || !isfinite(V)) return i + 1;
        place q = {(double)(i + 1) * dt, X, V, X - before, 0, x, i, dt};
        forces(&r, &q, flow, stage, map, to, each, masses, &mass);
        memcpy(map, to, sizeof(double) * (size_t)r.n_maps);
    }
    state[0] = X;
    state[1] = V;
    memcpy(state + 2, flow, sizeof(double) * (size_t)r.n_flows);
    memcpy(state + 2 + r.n_flows, map, sizeof(double) * (size_t)r.n_maps);
    return 0;
}

/* Position and speed inside a sample interval: the cubic that meets both ends. w in 0..1. */
static void between(const double *x, const double *v, double dt, double w, double *at, double *speed) {
    double d = x[1] - x[0], s0 = dt * v[0] - d, s1 = d - dt * v[1], u = 1 - w;
    *at = x[0] + w * d + w * u * (u * s0 + w * s1);
    *speed = (d + (u - w) * (u * s0 + w * s1) + w * u * (s1 - s0)) / dt;
}

/* Forces on a given motion, n+1 values each, with sub steps per interval; inner states start at zero.
 * h: n+1; each: ne rows of n+1 values. */
__attribute__((visibility("default"))) long concealed_clamp(int ne, const int *kind, const int *role, const int *at,
    const double *p, long n, double dt, int sub, const double *x, const double *v, const double *a, double *h,
    double *each_out) {
    rig r = {ne, kind, role, at, p, 1, 0, 0, {0}, {0}, 0, 0};
    if (lay_out(&r)) return -1;
    double flow[MAX_STATES] = {0}, map[MAX_STATES] = {0}, stage[MAX_STATES], to[MAX_STATES], each[32], masses[32], mass;
    double k[4][MAX_STATES], step = dt / sub;
    static const double part[4] = {0, 0.5, 0.5, 1};
    for (long i = 0; i <= n; i++) {
        place now = {(double)i * dt, x[i], v[i], 0, 0, x, i, dt};
        forces(&r, &now, flow, k[0], map, to, each, masses, &mass);
        h[i] = now.h;
        for (int e = 0; e < ne; e++) each_out[(size_t)e * (size_t)(n + 1) + (size_t)i] = each[e] + masses[e] * a[i];
        if (i == n) break;
        for (int j = 0; j < sub; j++) {
            double from = 0;
            for (int s = 0; s < 4; s++) {
                double w = (j + part[s]) / sub, xs, vs;
                between(x + i, v + i, dt, w, &xs, &vs);
                if (s == 0) from = xs;
                for (int q = 0; q < r.n_flows; q++) stage[q] = s ? flow[q] + part[s] * step * k[s - 1][q] : flow[q];
                place q = {((double)i + w) * dt, xs, vs, xs - from, 0, x, i, dt};
                forces(&r, &q, stage, k[s], map, to, each, masses, &mass);
            }
            for (int q = 0; q < r.n_flows; q++) flow[q] += step / 6 * (k[0][q] + 2 * k[1][q] + 2 * k[2][q] + k[3][q]);
            memcpy(map, to, sizeof(double) * (size_t)r.n_maps);
        }
    }
    return 0;
}
