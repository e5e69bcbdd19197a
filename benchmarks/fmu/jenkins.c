/* The floor for 50,000 steps of the Jenkins oscillator: what one would write by hand for this one model.
 * m a + B v + Kl x + z = F; z' = Ks v while |z| < fc, else 0 until v turns; Runge-Kutta of order four, F linear.
 * Parameters are arguments, since a model whose parameters cannot be set is no model. Switches are not located. */
typedef struct {
    double m, B, Kl, Ks, fc;
} constants;

typedef struct {
    double x, v, z;
} state;

static state slope(const constants *p, state s, double F)
{
    const int slips = (s.z >= p->fc && s.v > 0) || (s.z <= -p->fc && s.v < 0);
    const state d = {s.v, (F - p->B * s.v - p->Kl * s.x - s.z) / p->m, slips ? 0 : p->Ks * s.v};
    return d;
}

static state ahead(state s, state d, double h)
{
    const state r = {s.x + h * d.x, s.v + h * d.v, s.z + h * d.z};
    return r;
}

void jenkins(const constants *p, int n, double h, const double *F, double *x, double *v)
{
    state s = {0, 0, 0};
    for (int k = 0; k < n; k++) {
        x[k] = s.x;
        v[k] = s.v;
        if (k + 1 == n) break;
        const double middle = 0.5 * (F[k] + F[k + 1]);
        const state a = slope(p, s, F[k]), b = slope(p, ahead(s, a, h / 2), middle);
        const state c = slope(p, ahead(s, b, h / 2), middle), d = slope(p, ahead(s, c, h), F[k + 1]);
        s.x += h / 6 * (a.x + 2 * b.x + 2 * c.x + d.x);
        s.v += h / 6 * (a.v + 2 * b.v + 2 * c.v + d.v);
        s.z += h / 6 * (a.z + 2 * b.z + 2 * c.z + d.z);
        s.z = s.z > p->fc ? p->fc : s.z < -p->fc ? -p->fc : s.z;
    }
}
