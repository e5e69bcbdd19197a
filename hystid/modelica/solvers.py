"""Solvers in C that ``emit_c.py`` prints into a model that needs them."""

TURNS = """\
/* Relations take their values: in turn 0 all, in turn 1 the first that falls, else the first that rises, in turn 2 the
   first that rises, else the first that falls. 1 where one has changed. */
static int hy_renew(double *v, int n, const int *slots, const double *now, int turn)
{
    int moved = 0;
    for (int i = 0; !turn && i < n; i++) {
        moved |= now[i] != v[slots[i]];
        v[slots[i]] = now[i];
    }
    for (int k = 0; turn && k < 2; k++)
        for (int i = 0; i < n; i++)
            if ((turn == 1) == (k == 1) ? now[i] > v[slots[i]] : now[i] < v[slots[i]]) {
                v[slots[i]] = now[i];
                return 1;
            }
    return moved;
}
"""

SOLVERS = """\
static void hy_swap(double *a, double *b)
{
    const double t = *a;
    *a = *b;
    *b = t;
}

/* Solves A x = b by elimination with row exchange; b becomes x. 1 where A is singular to rounding. */
static int hy_solve(int n, double *A, double *b)
{
    for (int k = 0; k < n; k++) {
        int p = k;
        double largest = 0;
        for (int i = k; i < n; i++)
            if (fabs(A[i * n + k]) > fabs(A[p * n + k])) p = i;
        for (int j = k; j < n; j++) largest = fmax(largest, fabs(A[p * n + j]));
        if (!(fabs(A[p * n + k]) > 1e-14 * largest)) return 1;
        for (int j = k; j < n && p != k; j++) hy_swap(&A[k * n + j], &A[p * n + j]);
        if (p != k) hy_swap(&b[k], &b[p]);
        for (int i = k + 1; i < n; i++) {
            const double f = A[i * n + k] / A[k * n + k];
            if (f == 0) continue;
            for (int j = k + 1; j < n; j++) A[i * n + j] -= f * A[k * n + j];
            b[i] -= f * b[k];
        }
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++) b[i] -= A[i * n + j] * b[j];
        b[i] /= A[i * n + i];
    }
    return 0;
}
"""

NEAREST = """\
/* The same where A is singular but b fits, as two brakes that hold one shaft: of all solutions one that leaves as many
   variables as can be at their last values x. Elimination with the largest pivot of rows and columns that are scaled to
   1. work: 2*n numbers, order: n. told: whether it was said that there are many. 1 where there is no solution. */
static int hy_nearest(hy_data *m, double *told, const char *what, int n, double *A, double *b, const double *x,
                      double *work, int *order)
{
    double *const column = work, *const size = work + n; /* size: what a row of b is summed up from */
    int rank = 0;
    for (int i = 0; i < n; i++) {
        double largest = 0;
        for (int j = 0; j < n; j++) largest = fmax(largest, fabs(A[i * n + j]));
        if (!isfinite(b[i]) || !isfinite(largest)) return 1;
        size[i] = fabs(b[i]);
        for (int j = 0; j < n; j++) b[i] += A[i * n + j] * x[j], size[i] += fabs(A[i * n + j] * x[j]);
        if (fabs(b[i]) <= 1e-15 * n * size[i]) b[i] = 0; /* rounding is no reason to move */
        if (largest == 0) largest = 1;
        for (int j = 0; j < n; j++) A[i * n + j] /= largest;
        b[i] /= largest, size[i] /= largest;
    }
    for (int j = 0; j < n; j++) {
        column[j] = 0, order[j] = j;
        for (int i = 0; i < n; i++) column[j] = fmax(column[j], fabs(A[i * n + j]));
        for (int i = 0; i < n && column[j] > 0; i++) A[i * n + j] /= column[j];
    }
    for (; rank < n; rank++) {
        int p = rank, q = rank, t = 0;
        for (int i = rank; i < n; i++)
            for (int j = rank; j < n; j++)
                if (fabs(A[i * n + order[j]]) > fabs(A[p * n + order[q]])) p = i, q = j;
        if (!(fabs(A[p * n + order[q]]) > 1e-12)) break;
        t = order[q], order[q] = order[rank], order[rank] = t;
        for (int j = 0; j < n; j++) hy_swap(&A[rank * n + j], &A[p * n + j]);
        hy_swap(&b[rank], &b[p]), hy_swap(&size[rank], &size[p]);
        for (int i = rank + 1; i < n; i++) {
            const double f = A[i * n + t] / A[rank * n + t];
            if (f == 0) continue;
            for (int j = 0; j < n; j++) A[i * n + j] -= f * A[rank * n + j];
            b[i] -= f * b[rank], size[i] += fabs(f) * size[rank];
        }
    }
    for (int i = rank; i < n; i++)
        if (fabs(b[i]) > 1e-9 * size[i]) return 1;
    if (rank < n && *told == 0) {
        char text[400];
        snprintf(text, sizeof text, "many solutions from t = %.9g s, as of two brakes on one shaft, and the last ones "
                 "are kept where they fit: %.150s", m->v[0], what);
        m->log(m->owner, HY_WARNING, text);
        *told = 1;
    }
    for (int i = rank - 1; i >= 0; i--) {
        for (int j = i + 1; j < rank; j++) b[i] -= A[i * n + order[j]] * b[j];
        b[i] /= A[i * n + order[i]];
    }
    for (int i = 0; i < n; i++) size[order[i]] = i < rank ? b[i] / column[order[i]] : 0;
    for (int i = 0; i < n; i++) b[i] = size[i] - x[i];
    return 0;
}
"""

NEWTON = """\
typedef void hy_function(const double *v, double *out);

static double hy_norm(int n, const double *r, const double *scale)
{
    double sum = 0;
    for (int i = 0; i < n; i++) sum += r[i] * r[i] / (scale[i] * scale[i]);
    return sqrt(sum);
}

/* Newton's method with halved steps: a step is taken when it makes the residual, weighed by the rows of the first
   jacobian, smaller. With whole steps it goes from one straight piece of an equation to the next, over a corner where
   halved ones come to rest. r, A and x0 are scratch of n, n*n and 3*n numbers. 1 where it does not converge. */
static int hy_newton(double *v, int n, const int *slots, const double *nominal, hy_function *residual,
                     hy_function *jacobian, double *r, double *A, double *x0, int whole)
{
    double *const step = x0 + n, *const scale = x0 + 2 * n;
    residual(v, r);
    for (int k = 0; k < 60; k++) {
        double before, size = 0, part = 1;
        jacobian(v, A);
        for (int i = 0; k == 0 && i < n; i++) {
            scale[i] = 1e-300;
            for (int j = 0; j < n; j++)
                scale[i] = fmax(scale[i], fabs(A[i * n + j]) * fmax(fabs(v[slots[j]]), nominal[j]));
        }
        before = hy_norm(n, r, scale);
        for (int i = 0; i < n; i++) step[i] = r[i], x0[i] = v[slots[i]];
        if (hy_solve(n, A, step)) return 1;
        for (int i = 0; i < n; i++) size = fmax(size, fabs(step[i]) / fmax(fabs(x0[i]), nominal[i]));
        for (;;) {
            double after;
            for (int i = 0; i < n; i++) v[slots[i]] = x0[i] - part * step[i];
            residual(v, r);
            after = hy_norm(n, r, scale);
            if (after < before || after <= 1e-15 || (whole && isfinite(after))) break;
            if (size <= 1e-9 && isfinite(after)) return 0; /* rounding: no smaller residual to be had */
            part *= 0.5;
            if (part < 1e-10) return 1;
        }
        if (part == 1 && size <= 1e-12) return 0;
        if (part == 1 && before == 0) return 0;
    }
    return 1;
}
"""

OPERATING_POINT = """\
/* The start where Newton's method finds no answer, as for transistors between two supplies: start values mean an absurd
   current of a junction, beside which nothing else is to be seen. So exponentials grow along straight lines beyond a
   limit, where the equations are nearly linear, and the limit moves away, in steps that are halved where there is no
   answer. work: n * (n + 5) numbers. 1 where it cannot be moved away. */
static int hy_operating_point(double *v, int n, const int *slots, const double *nominal, hy_function *residual,
                              hy_function *jacobian, double *work, double *limit)
{
    double *const A = work, *const x0 = A + n * n, *const r = x0 + 3 * n, *const last = r + n;
    double step = 4, reached = 0;
    int failed = 0;
    while (!failed && reached < 60) {
        for (int i = 0; i < n; i++) last[i] = v[slots[i]];
        *limit = reached + step;
        if (!hy_newton(v, n, slots, nominal, residual, jacobian, r, A, x0, 0)) {
            reached = *limit;
            step *= 2;
            continue;
        }
        for (int i = 0; i < n; i++) v[slots[i]] = last[i];
        step *= 0.5;
        failed = step < 1e-3;
    }
    *limit = 0;
    return failed || hy_newton(v, n, slots, nominal, residual, jacobian, r, A, x0, 0);
}
"""

SILENT = """\
static void hy_silent(void *owner, int level, const char *text)
{
    (void)owner, (void)level, (void)text;
}
"""

SEARCH = """\
typedef int hy_look(hy_data *m, double *now);

/* Where relations switch each other back and forth, values with which all agree, those that change the fewest: a
   Schmitt trigger at its threshold has one answer, far away. first: scratch of size numbers. 1 where there are such
   values. */
static int hy_search(hy_data *m, int size, double *first, int n, const int *slots, hy_look *look, double *now)
{
    double *const v = m->v;
    hy_data quiet = {v, hy_silent, m->owner};
    for (int i = 0; i < size; i++) first[i] = v[i];
    for (int bits = 1; bits <= n; bits++)
        for (unsigned mask = 1; mask < 1u << n; mask++) {
            int count = 0, agree;
            for (int k = 0; k < n; k++) count += mask >> k & 1;
            if (count != bits) continue;
            for (int i = 0; i < size; i++) v[i] = first[i];
            for (int k = 0; k < n; k++)
                if (mask >> k & 1) v[slots[k]] = v[slots[k]] == 0;
            agree = look(&quiet, now) == HY_OK;
            for (int k = 0; agree && k < n; k++) agree = now[k] == v[slots[k]];
            if (agree) return 1;
        }
    for (int i = 0; i < size; i++) v[i] = first[i];
    return 0;
}
"""

HOMOTOPY_WAY = """\
/* The start from the simplified to the actual arguments of homotopy(), in steps that are halved where there is no
   answer. The way tells which of many solutions is meant. Where it is blocked, the actual equations by themselves. */
static int hy_follow(hy_data *m)
{{
    double *const v = m->v, *const share = &v[{share}];
    double first[{size}], last[{size}], step = 1;
    hy_data quiet = {{v, hy_silent, m->owner}};
    for (int i = 0; i < {size}; i++) first[i] = v[i];
    *share = 0;
    if (hy_begin(&quiet) == HY_OK) {{
        while (step > 1e-4) {{
            for (int i = 0; i < {size}; i++) last[i] = v[i];
            *share = fmin(1.0, last[{share}] + step);
            if (hy_begin(&quiet) == HY_OK) {{
                if (*share == 1) return HY_OK;
                step *= 2;
                continue;
            }}
            for (int i = 0; i < {size}; i++) v[i] = last[i];
            step *= 0.5;
        }}
    }}
    for (int i = 0; i < {size}; i++) v[i] = first[i];
    *share = 1;
    return hy_begin(m);
}}
"""
