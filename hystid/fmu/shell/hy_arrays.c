/* Arrays of FMI 3: one value reference, that of the first element, for elements that lie side by side in the block. */
#include "hy_fmi.h"

#include <stdlib.h>

static size_t size_of(const hy_instance *c, unsigned vr)
{
    return vr < (unsigned)c->engine.model->n_values && hy_variables[vr].type ? (size_t)hy_variables[vr].size : 1;
}

int hy_spread(hy_instance *c, const char *call, const unsigned *vr, size_t n, size_t n_values, hy_elements *e)
{
    size_t k = 0, size = 0;
    e->made = NULL;
    e->vr = vr;
    if (n && !vr) return hy_fail(c, "%s: a NULL array was given for %zu variables", call, n);
    for (size_t i = 0; i < n; i++) {
        const size_t own = size_of(c, vr[i]);
        if (!own) return hy_fail(c, "%s: value reference %u is inside of an array, which is got and set as a whole", call, vr[i]);
        size += own;
        if (size > n_values) break;
    }
    if (size != n_values) return hy_fail(c, "%s: %zu variables, %zu values", call, n, n_values);
    if (size == n) return FMI_OK;
    e->made = malloc(size * sizeof *e->made);
    if (!e->made) return hy_fail(c, "out of memory");
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < size_of(c, vr[i]); j++) e->made[k++] = vr[i] + (unsigned)j;
    e->vr = e->made;
    return FMI_OK;
}
