"""Factorisations of small matrices in C, for the functions of ``Modelica.Math`` that call LAPACK.

Each is called once per number that is wanted of it: ``name(wanted, size, given, work)``, matrices row by row. Signs
that are free are chosen so that the largest entry of a vector is positive. One-sided Jacobi rotations are of M. R.
Hestenes (1958), reflections of A. S. Householder (1958), the double-shift QR algorithm of J. G. F. Francis (1961).
"""

from __future__ import annotations

from collections.abc import Sequence

SLOPE = "_slope"
"""Behind the name of such an operation: its slope as what is given moves; how it moves comes last."""

# compilers that make a copy of a kernel for each of its numbers take minutes
_APART = """\
#if defined(__clang__)
#define HY_APART __attribute__((noinline))
#elif defined(__GNUC__)
#define HY_APART __attribute__((noinline, noclone))
#else
#define HY_APART
#endif
"""

_ORTHOGONAL = """\
/* Rotates columns of b (rows x cols, rows >= cols) until they are orthogonal, the longest first; v gathers that. */
static void hy_orthogonal(int rows, int cols, double *b, double *v)
{
    int turned = 1;
    for (int i = 0; i < cols * cols; i++) v[i] = i % (cols + 1) == 0;
    for (int sweep = 0; turned && sweep < 60; sweep++) {
        turned = 0;
        for (int p = 0; p + 1 < cols; p++) {
            for (int q = p + 1; q < cols; q++) {
                double a = 0, c = 0, g = 0, zeta, t, cs, sn;
                for (int k = 0; k < rows; k++) {
                    const double x = b[k * cols + p], y = b[k * cols + q];
                    a += x * x, c += y * y, g += x * y;
                }
                if (fabs(g) <= 2.3e-16 * sqrt(a * c)) continue;
                turned = 1;
                zeta = (c - a) / (2 * g);
                t = (zeta < 0 ? -1 : 1) / (fabs(zeta) + hypot(1, zeta));
                cs = 1 / hypot(1, t), sn = cs * t;
                for (int k = 0; k < rows + cols; k++) {
                    double *row = k < rows ? b + k * cols : v + (k - rows) * cols;
                    const double x = row[p], y = row[q];
                    row[p] = cs * x - sn * y, row[q] = sn * x + cs * y;
                }
            }
        }
    }
    for (int p = 0; p < cols; p++) {
        int longest = p, large = 0;
        double most = -1;
        for (int q = p; q < cols; q++) {
            double a = 0;
            for (int k = 0; k < rows; k++) a += b[k * cols + q] * b[k * cols + q];
            if (a > most) most = a, longest = q;
        }
        for (int k = 1; k < cols; k++) {
            if (fabs(v[k * cols + longest]) > fabs(v[large * cols + longest]) * (1 + 1e-9)) large = k;
        }
        const double sign = v[large * cols + longest] < 0 ? -1 : 1;
        for (int k = 0; k < rows + cols; k++) {
            double *row = k < rows ? b + k * cols : v + (k - rows) * cols;
            const double x = row[longest];
            row[longest] = row[p], row[p] = sign * x;
        }
    }
}

/* The taller of a (n x m) and its transpose, with orthogonal columns; their lengths follow v, which is cols x cols. */
static void hy_decomposed(int n, int m, const double *a, double *b, double *v)
{
    const int rows = n >= m ? n : m, cols = n >= m ? m : n;
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < cols; j++) b[i * cols + j] = n >= m ? a[i * m + j] : a[j * m + i];
    }
    hy_orthogonal(rows, cols, b, v);
    for (int j = 0; j < cols; j++) {
        double square = 0;
        for (int k = 0; k < rows; k++) square += b[k * cols + j] * b[k * cols + j];
        v[cols * cols + j] = sqrt(square);
    }
}
"""

_SVD = """\
/* Of a (n x m): the singular values, U (n x n), and V' (m x m). */
HY_APART static double hy_svd(int wanted, const int *size, const double *a, double *w)
{
    const int n = size[0], m = size[1], rows = n >= m ? n : m, cols = n >= m ? m : n;
    double *b = w, *v = b + rows * cols, *length = v + cols * cols, *u = length + cols;
    hy_decomposed(n, m, a, b, v);
    if (wanted < cols) return length[wanted];
    for (int j = 0; j < rows; j++) { /* columns beyond the rank: what the others leave of a unit vector */
        const int known = j < cols && length[j] > 2.3e-16 * rows * length[0];
        double most = -1;
        for (int unit = 0; unit < (known ? 1 : rows); unit++) {
            double *x = u + rows * rows, square = 0;
            for (int k = 0; k < rows; k++) x[k] = known ? b[k * cols + j] / length[j] : k == unit;
            for (int again = 0; !known && again < 2; again++) {
                for (int i = 0; i < j; i++) {
                    double along = 0;
                    for (int k = 0; k < rows; k++) along += u[k * rows + i] * x[k];
                    for (int k = 0; k < rows; k++) x[k] -= along * u[k * rows + i];
                }
            }
            for (int k = 0; k < rows; k++) square += x[k] * x[k];
            if (square <= most * (1 + 1e-9)) continue;
            most = square;
            for (int k = 0; k < rows; k++) u[k * rows + j] = x[k] / sqrt(square);
        }
    }
    wanted -= cols;
    if (wanted < n * n) return n >= m ? u[wanted] : v[wanted];
    wanted -= n * n;
    const int i = wanted / m, j = wanted % m;
    return n >= m ? v[j * m + i] : u[j * m + i];
}
"""

_LSQ = """\
/* x (m x k) of least norm for which a x - b is least, a (n x m), b (n x k); and the rank of a, by the limit after b.
   Where that is negative, a has to be regular: not a number if it is not. */
HY_APART static double hy_lsq(int wanted, const int *size, const double *a, double *w)
{
    const int n = size[0], m = size[1], k = size[2], rows = n >= m ? n : m, cols = n >= m ? m : n;
    const double *given = a + n * m, limit = given[n * k];
    double *b = w, *v = b + rows * cols, *length = v + cols * cols, sum = 0;
    const double *left = n >= m ? b : v, *right = n >= m ? v : b;
    int rank = 0;
    hy_decomposed(n, m, a, b, v);
    while (rank < cols && length[rank] > fabs(limit) * length[0]) rank++;
    if (limit < 0 && rank < m) return NAN;
    if (wanted == m * k) return rank;
    for (int j = 0; j < rank; j++) {
        double along = 0;
        for (int i = 0; i < n; i++) along += left[i * cols + j] * given[i * k + wanted % k];
        sum += right[wanted / k * cols + j] * along / (length[j] * length[j]);
    }
    return sum;
}
"""

_REFLECT = """\
/* A reflection that leaves x (count) nothing but its first entry, which it returns; x becomes its direction. */
static double hy_reflection(int count, double *x)
{
    double rest = 0, first = x[0], square;
    for (int i = 1; i < count; i++) rest += x[i] * x[i];
    if (rest == 0) {
        x[0] = 0;
        return first;
    }
    const double left = first >= 0 ? -sqrt(first * first + rest) : sqrt(first * first + rest);
    x[0] = first - left;
    square = sqrt(0.5 * (x[0] * x[0] + rest));
    for (int i = 0; i < count; i++) x[i] /= square;
    return left;
}

/* Reflects so many entries of each of the lines of a, entries and lines these steps apart. */
static void hy_reflect(int count, const double *x, double *a, int step, int lines, int apart)
{
    for (int line = 0; line < lines; line++) {
        double along = 0;
        for (int i = 0; i < count; i++) along += x[i] * a[line * apart + i * step];
        for (int i = 0; i < count; i++) a[line * apart + i * step] -= along * x[i];
    }
}
"""

_QR = """\
/* Of a (n x m, n >= m): Q (n x m), R (m x m) and the columns in their new order; size[2]: whether they may move. */
HY_APART static double hy_qr(int wanted, const int *size, const double *a, double *w)
{
    const int n = size[0], m = size[1];
    double *r = w, *q = r + n * m, *x = q + n * n, *order = x + n;
    for (int i = 0; i < n * m; i++) r[i] = a[i];
    for (int i = 0; i < n * n; i++) q[i] = i % (n + 1) == 0;
    for (int j = 0; j < m; j++) order[j] = j + 1;
    for (int k = 0; k < m; k++) {
        int best = k;
        double most = -1;
        for (int j = k; size[2] && j < m; j++) {
            double square = 0;
            for (int i = k; i < n; i++) square += r[i * m + j] * r[i * m + j];
            if (square > most * (1 + 1e-12)) most = square, best = j;
        }
        for (int i = -1; i < n; i++) {
            double *row = i < 0 ? order : r + i * m, kept = row[k];
            row[k] = row[best], row[best] = kept;
        }
        for (int i = k; i < n; i++) x[i - k] = r[i * m + k];
        hy_reflection(n - k, x);
        hy_reflect(n - k, x, r + k * m + k, m, m - k, 1);
        hy_reflect(n - k, x, q + k, 1, n, n);
    }
    if (wanted < n * m) return q[wanted / m * n + wanted % m];
    wanted -= n * m;
    if (wanted >= m * m) return order[wanted - m * m];
    return wanted / m <= wanted % m ? r[wanted] : 0;
}
"""

_REDUCED = """\
/* H, zero below its first lower diagonal, and U with a = U H U'. */
static void hy_reduced(int n, const double *a, double *h, double *u, double *x)
{
    for (int i = 0; i < n * n; i++) h[i] = a[i], u[i] = i % (n + 1) == 0;
    for (int k = 0; k + 2 < n; k++) {
        for (int i = k + 1; i < n; i++) x[i - k - 1] = h[i * n + k];
        hy_reflection(n - k - 1, x);
        hy_reflect(n - k - 1, x, h + (k + 1) * n + k, n, n - k, 1);
        hy_reflect(n - k - 1, x, h + k + 1, 1, n, n);
        hy_reflect(n - k - 1, x, u + k + 1, 1, n, n);
        for (int i = k + 2; i < n; i++) h[i * n + k] = 0;
    }
}
"""

_HESSENBERG = """\
/* Of a (n x n): H and U. */
HY_APART static double hy_hessenberg(int wanted, const int *size, const double *a, double *w)
{
    const int n = size[0];
    hy_reduced(n, a, w, w + n * n, w + 2 * n * n);
    return w[wanted];
}
"""

_TRIANGULAR = """\
/* Turns two rows and columns from p on so that h has a triangle there, or equal entries on its diagonal. */
static void hy_standard(int n, int p, double *h, double *z)
{
    double *first = h + p * n + p, *second = first + n;
    const double half = 0.5 * (first[0] - second[1]), inside = half * half + first[1] * second[0];
    double cs, sn;
    if (inside >= 0) {
        const double along = half + (half < 0 ? -sqrt(inside) : sqrt(inside)), length = hypot(along, second[0]);
        cs = along / length, sn = second[0] / length;
    } else {
        const double angle = 0.5 * atan2(-2 * half, first[1] + second[0]);
        cs = cos(angle), sn = sin(angle);
    }
    for (int j = p; j < n; j++) {
        const double x = h[p * n + j], y = h[(p + 1) * n + j];
        h[p * n + j] = cs * x + sn * y, h[(p + 1) * n + j] = cs * y - sn * x;
    }
    for (int i = 0; i < p + 2 + n; i++) {
        double *row = i < p + 2 ? h + i * n + p : z + (i - p - 2) * n + p;
        const double x = row[0], y = row[1];
        row[0] = cs * x + sn * y, row[1] = cs * y - sn * x;
    }
    if (inside >= 0) second[0] = 0;
    else first[0] = second[1] = 0.5 * (first[0] + second[1]);
}

/* T, with blocks of one or two rows on its diagonal, and z with a = z T z'; not a number where no end is found. */
static void hy_triangular(int n, const double *a, double *h, double *z, double *x)
{
    int hi = n - 1, count = 0;
    double size = 0;
    hy_reduced(n, a, h, z, x);
    for (int i = 0; i < n * n; i++) size = fmax(size, fabs(h[i]));
    while (hi > 0) {
        int lo = hi;
        while (lo > 0) {
            const double near = fabs(h[(lo - 1) * n + lo - 1]) + fabs(h[lo * n + lo]);
            if (fabs(h[lo * n + lo - 1]) <= 2.3e-16 * (near > 0 ? near : size)) {
                h[lo * n + lo - 1] = 0;
                break;
            }
            lo--;
        }
        if (lo >= hi - 1) {
            if (lo == hi - 1) hy_standard(n, lo, h, z);
            hi = lo - 1, count = 0;
            continue;
        }
        if (++count > 300) {
            for (int i = 0; i < n * n; i++) h[i] = z[i] = NAN;
            return;
        }
        const double *end = h + hi * n + hi, *begin = h + lo * n + lo, odd = fabs(end[-1]) + fabs(end[-n - 1 - 1]);
        const double sum = count % 10 ? end[-n - 1] + end[0] : 1.5 * odd;
        const double product = count % 10 ? end[-n - 1] * end[0] - end[-n] * end[-1] : odd * odd;
        x[0] = begin[0] * begin[0] + begin[1] * begin[n] - sum * begin[0] + product;
        x[1] = begin[n] * (begin[0] + begin[n + 1] - sum);
        x[2] = begin[n] * begin[2 * n + 1];
        for (int k = lo; k < hi; k++) {
            const int rows = k + 2 < hi ? 3 : hi - k + 1, from = k > lo ? k - 1 : lo, last = k + 3 < hi ? k + 3 : hi;
            hy_reflection(rows, x);
            hy_reflect(rows, x, h + k * n + from, n, n - from, 1);
            hy_reflect(rows, x, h + k, 1, last + 1, n);
            hy_reflect(rows, x, z + k, 1, n, n);
            for (int i = 1; k > lo && i < rows; i++) h[(k + i) * n + k - 1] = 0;
            for (int i = 0; i < 3 && k + 1 + i <= hi; i++) x[i] = h[(k + 1 + i) * n + k];
        }
    }
}

/* Eigenvalues of T: the real part at of[0], the imaginary one at of[1], the positive one of a pair first. */
static void hy_values(int n, const double *t, int row, double *of)
{
    const int below = row + 1 < n && t[(row + 1) * n + row] != 0, above = row > 0 && t[row * n + row - 1] != 0;
    const int p = above ? row - 1 : row;
    of[0] = t[row * n + row];
    of[1] = below || above ? sqrt(fabs(t[p * n + p + 1] * t[(p + 1) * n + p])) * (above ? -1 : 1) : 0;
}

"""

_SCHUR = """\
/* Of a (n x n): T, z, and the real and imaginary parts of the eigenvalues. */
HY_APART static double hy_schur(int wanted, const int *size, const double *a, double *w)
{
    const int n = size[0];
    double pair[2];
    hy_triangular(n, a, w, w + n * n, w + 2 * n * n);
    if (wanted < 2 * n * n) return w[wanted];
    wanted -= 2 * n * n;
    hy_values(n, w, wanted % n, pair);
    return pair[wanted / n];
}
"""

_EIGEN = """\
/* y = r / d for complex numbers, of which d is kept off nought. */
static void hy_over(double rr, double ri, double dr, double di, double least, double *y)
{
    if (hypot(dr, di) < least) dr = least, di = 0;
    const double square = dr * dr + di * di;
    y[0] = (rr * dr + ri * di) / square, y[1] = (ri * dr - rr * di) / square;
}

/* Of a (n x n): eigenvalues (n x 2), and vectors of length 1 as columns, the parts of a pair in two of them. */
HY_APART static double hy_eigen(int wanted, const int *size, const double *a, double *w)
{
    const int n = size[0];
    double *t = w, *z = t + n * n, *y = z + n * n, *x = y + 2 * n, pair[2], least = 0, square = 0;
    int large = 0;
    hy_triangular(n, a, t, z, y);
    if (wanted < 2 * n) {
        hy_values(n, t, wanted / 2, pair);
        return pair[wanted % 2];
    }
    const int row = (wanted - 2 * n) / n, column = (wanted - 2 * n) % n;
    hy_values(n, t, column, pair);
    const int k = pair[1] < 0 ? column - 1 : column, twice = pair[1] != 0;
    pair[1] = fabs(pair[1]);
    for (int i = 0; i < 2 * n; i++) y[i] = 0;
    for (int i = 0; i < n * n; i++) least = fmax(least, 2.3e-16 * fabs(t[i]));
    least = fmax(least, 1e-300);
    y[2 * k] = twice ? t[k * n + k + 1] : 1;
    if (twice) y[2 * k + 3] = pair[1];
    for (int i = k - 1; i >= 0; i--) {
        const int both = i > 0 && t[i * n + i - 1] != 0, from = both ? i - 1 : i;
        double r[4] = {0, 0, 0, 0};
        for (int line = from; line <= i; line++) {
            for (int j = i + 1; j < n; j++) {
                r[2 * (line - from)] -= t[line * n + j] * y[2 * j];
                r[2 * (line - from) + 1] -= t[line * n + j] * y[2 * j + 1];
            }
        }
        if (both) {
            const double p = t[from * n + from] - pair[0], q = t[i * n + i] - pair[0];
            const double b = t[from * n + i], c = t[i * n + from], li = pair[1];
            const double dr = p * q - li * li - b * c, di = -li * (p + q);
            double *first = y + 2 * from, *last = y + 2 * i, small = least * least;
            hy_over(r[0] * q + r[1] * li - b * r[2], r[1] * q - r[0] * li - b * r[3], dr, di, small, first);
            hy_over(r[2] * p + r[3] * li - c * r[0], r[3] * p - r[2] * li - c * r[1], dr, di, small, last);
            i--;
        } else {
            hy_over(r[0], r[1], t[i * n + i] - pair[0], -pair[1], least, y + 2 * i);
        }
    }
    for (int i = 0; i < n; i++) {
        x[2 * i] = x[2 * i + 1] = 0;
        for (int j = 0; j < n; j++) x[2 * i] += z[i * n + j] * y[2 * j], x[2 * i + 1] += z[i * n + j] * y[2 * j + 1];
        square += x[2 * i] * x[2 * i] + x[2 * i + 1] * x[2 * i + 1];
        if (hypot(x[2 * i], x[2 * i + 1]) > hypot(x[2 * large], x[2 * large + 1]) * (1 + 1e-9)) large = i;
    }
    const double top = hypot(x[2 * large], x[2 * large + 1]), cr = x[2 * large] / top, ci = x[2 * large + 1] / top;
    const double re = x[2 * row] * cr + x[2 * row + 1] * ci, im = x[2 * row + 1] * cr - x[2 * row] * ci;
    return (column > k ? im : re) / sqrt(square);
}
"""

_EXPM = """\
static void hy_product(int n, const double *a, const double *b, double by, double *c)
{
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            double sum = 0;
            for (int k = 0; k < n; k++) sum += a[i * n + k] * b[k * n + j];
            c[i * n + j] = by * sum;
        }
    }
}

/* exp(a), a (n x n): Taylor's series of a / 2^s, squared s times. */
HY_APART static double hy_expm(int wanted, const int *size, const double *a, double *w)
{
    const int n = size[0];
    double *x = w, *term = x + n * n, *next = term + n * n, *small = next + n * n, norm = 0;
    int halves = 0;
    for (int j = 0; j < n; j++) {
        double sum = 0;
        for (int i = 0; i < n; i++) sum += fabs(a[i * n + j]);
        norm = fmax(norm, sum);
    }
    if (!(norm < 1e300)) return NAN;
    while (ldexp(norm, -halves) > 0.5) halves++;
    for (int i = 0; i < n * n; i++) small[i] = ldexp(a[i], -halves), x[i] = term[i] = i % (n + 1) == 0;
    for (int k = 1; k < 20; k++) {
        hy_product(n, term, small, 1.0 / k, next);
        for (int i = 0; i < n * n; i++) term[i] = next[i], x[i] += next[i];
    }
    while (halves-- > 0) {
        hy_product(n, x, x, 1, next);
        for (int i = 0; i < n * n; i++) x[i] = next[i];
    }
    return x[wanted];
}
"""

_ROWS = """\
/* The rows of a (n x m), upwards if size[2], by their first entry that differs; and their numbers. */
HY_APART static double hy_rows(int wanted, const int *size, const double *a, double *w)
{
    const int n = size[0], m = size[1];
    for (int i = 0; i < n; i++) {
        int at = i;
        for (; at > 0; at--) {
            const double *before = a + (int)w[at - 1] * m, *here = a + i * m;
            int j = 0;
            while (j < m && before[j] == here[j]) j++;
            if (j == m || (size[2] ? before[j] < here[j] : before[j] > here[j])) break;
            w[at] = w[at - 1];
        }
        w[at] = i;
    }
    return wanted < n * m ? a[(int)w[wanted / m] * m + wanted % m] : w[wanted - n * m] + 1;
}
"""

_BALANCE = """\
/* Powers of 2 that make rows and columns of a (n x n) alike, beside b (n x size[1]) and c (size[2] x n); and these. */
HY_APART static double hy_balance(int wanted, const int *size, const double *given, double *w)
{
    const int n = size[0], right = n + size[1], down = n + size[2];
    double *scale = w, *a = w + n;
    int moved = 1;
    for (int i = 0; i < down; i++) {
        for (int j = 0; j < right; j++) {
            const double *b = given + n * n, *c = b + n * size[1];
            const double *from = i < n ? (j < n ? given + i * n + j : b + i * size[1] + j - n) : c + (i - n) * n + j;
            a[i * right + j] = i < n || j < n ? *from : 0;
        }
    }
    for (int i = 0; i < n; i++) scale[i] = 1;
    for (int round = 0; moved && round < 1000; round++) {
        moved = 0;
        for (int i = 0; i < n; i++) {
            double column = 0, row = 0, by = 1, both;
            for (int k = 0; k < down; k++) column += k == i ? 0 : fabs(a[k * right + i]);
            for (int k = 0; k < right; k++) row += k == i ? 0 : fabs(a[i * right + k]);
            if (!(column + row < 1e300)) return NAN;
            both = column + row;
            for (; column != 0 && column < row / 2; column *= 4) by *= 2;
            for (; row != 0 && column >= row * 2; column /= 4) by /= 2;
            if ((column + row) / by >= 0.95 * both) continue;
            for (int k = 0; k < right; k++) a[i * right + k] /= by;
            for (int k = 0; k < down; k++) a[k * right + i] *= by;
            scale[i] *= by;
            moved = 1;
        }
    }
    if (wanted < n) return scale[wanted];
    wanted -= n;
    if (wanted < n * n) return a[wanted / n * right + wanted % n];
    wanted -= n * n;
    if (wanted < n * size[1]) return a[wanted / size[1] * right + n + wanted % size[1]];
    wanted -= n * size[1];
    return a[(n + wanted / n) * right + wanted % n];
}
"""

SLOPE_TEXT = """\
/* Slope of an output where so many numbers move as those behind them say, by the difference of two points. */
static double hy_slope(double (*kernel)(int, const int *, const double *, double *), int wanted, const int *size,
                       const double *given, int count, double *w)
{
    double most = 0, fastest = 0, sum = 0;
    for (int i = 0; i < count; i++) {
        most = fmax(most, fabs(given[i]));
        fastest = fmax(fastest, fabs(given[count + i]));
    }
    const double step = 6e-6 * (most > 0 ? most : 1) / (fastest > 0 ? fastest : 1);
    for (int side = -1; side < 2; side += 2) {
        for (int i = 0; i < count; i++) w[i] = given[i] + side * step * given[count + i];
        sum += side * kernel(wanted, size, w, w + count);
    }
    return sum / (2 * step);
}
"""

TEXTS = {
    "hy_svd": (_APART, _ORTHOGONAL, _SVD),
    "hy_lsq": (_APART, _ORTHOGONAL, _LSQ),
    "hy_qr": (_APART, _REFLECT, _QR),
    "hy_hessenberg": (_APART, _REFLECT, _REDUCED, _HESSENBERG),
    "hy_schur": (_APART, _REFLECT, _REDUCED, _TRIANGULAR, _SCHUR),
    "hy_eigen": (_APART, _REFLECT, _REDUCED, _TRIANGULAR, _EIGEN),
    "hy_expm": (_APART, _EXPM),
    "hy_rows": (_APART, _ROWS),
    "hy_balance": (_APART, _BALANCE),
}
"""Name of the operation -> texts in C that it needs, in this order, its own the last. Its arguments are the number of
the output, three sizes, and what is given."""


def work(sizes: Sequence[int]) -> int:
    """Numbers that an operation of these sizes writes down."""
    most = max(sizes[0], sizes[1])
    return 5 * most**2 + 8 * most + (sizes[0] + sizes[1]) * (sizes[0] + sizes[2])
