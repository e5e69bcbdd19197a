/* An FMI 3.0 FMU for Co-Simulation with a variable of every type, written by hand from the standard; functions that nobody
 * calls are left out. Outputs follow their inputs; "steps" counts the steps. The output BROKEN goes wrong after 0.5 s. */
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#pragma GCC visibility push(default)
#ifndef BROKEN
#define BROKEN -1
#endif
typedef int fmi3Status; /* 0 OK, 3 error */
typedef uint32_t vref;
typedef const void *pointer;

enum { F32, F64, I8, U8, I16, U16, I32, U32, I64, U64, BOOLEAN, ENUMERATION, TEXT, BINARY, ARRAY, STEPS };
typedef struct {
    float f32; double f64; int8_t i8; uint8_t u8; int16_t i16; uint16_t u16; int32_t i32; uint32_t u32; int64_t i64;
    uint64_t u64; bool boolean; int64_t enumeration; char text[40]; uint8_t binary[2]; double array[2];
    double t; int32_t steps;
} model;

static bool wrong(const model *m, vref vr) { return (int)(vr % 100) == BROKEN && m->t > 0.5; }

const char *fmi3GetVersion(void) { return "3.0"; }
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool log,
                                  bool events, bool early, const vref *required, size_t n, void *environment, void *logger,
                                  void *update)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)log, (void)events, (void)early, (void)required;
    (void)n, (void)environment, (void)logger, (void)update;
    model *m = calloc(1, sizeof *m);
    if (m) strcpy(m->text, "start"), m->enumeration = 1;
    return m;
}
void fmi3FreeInstance(void *c) { free(c); }
fmi3Status fmi3EnterInitializationMode(void *c, bool a, double b, double t, bool d, double e)
{
    (void)a, (void)b, (void)d, (void)e;
    ((model *)c)->t = t;
    return 0;
}
fmi3Status fmi3ExitInitializationMode(void *c) { return c == NULL; }
fmi3Status fmi3DoStep(void *c, double t, double h, bool flag, bool *event, bool *end, bool *early, double *last)
{
    model *m = c;
    (void)flag;
    m->t = *last = t + h;
    m->steps++;
    *event = *end = *early = false;
    return 0;
}

/* References 0 to 99 are inputs, 100 to 199 outputs. */
#define NUMBER(Name, type, member, which) \
    fmi3Status fmi3Get##Name(void *c, const vref *vr, size_t n, type *values, size_t n_values) \
    { \
        const model *m = c; \
        if (n != n_values) return 3; \
        for (size_t i = 0; i < n; i++) { \
            if (vr[i] % 100 != which) return 3; \
            values[i] = (type)(m->member + wrong(m, vr[i])); \
        } \
        return 0; \
    } \
    fmi3Status fmi3Set##Name(void *c, const vref *vr, size_t n, const type *values, size_t n_values) \
    { \
        if (n != n_values) return 3; \
        for (size_t i = 0; i < n; i++) { \
            if (vr[i] != which) return 3; \
            ((model *)c)->member = values[i]; \
        } \
        return 0; \
    }
NUMBER(Float32, float, f32, F32)
NUMBER(Int8, int8_t, i8, I8)
NUMBER(UInt8, uint8_t, u8, U8)
NUMBER(Int16, int16_t, i16, I16)
NUMBER(UInt16, uint16_t, u16, U16)
NUMBER(UInt32, uint32_t, u32, U32)
NUMBER(UInt64, uint64_t, u64, U64)

fmi3Status fmi3GetFloat64(void *c, const vref *vr, size_t n, double *values, size_t n_values)
{
    const model *m = c;
    size_t k = 0;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] % 100 == F64) values[k++] = m->f64 + 0.01 * wrong(m, vr[i]);
        else if (vr[i] % 100 == ARRAY) values[k++] = m->array[0], values[k++] = m->array[1] + wrong(m, vr[i]);
        else return 3;
    }
    return k == n_values ? 0 : 3;
}
fmi3Status fmi3SetFloat64(void *c, const vref *vr, size_t n, const double *values, size_t n_values)
{
    model *m = c;
    size_t k = 0;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == F64) m->f64 = values[k++];
        else if (vr[i] == ARRAY) m->array[0] = values[k++], m->array[1] = values[k++];
        else return 3;
    }
    return k == n_values ? 0 : 3;
}
fmi3Status fmi3GetInt32(void *c, const vref *vr, size_t n, int32_t *values, size_t n_values)
{
    const model *m = c;
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) values[i] = (vr[i] == STEPS ? m->steps : m->i32) + wrong(m, vr[i]);
    return 0;
}
fmi3Status fmi3SetInt32(void *c, const vref *vr, size_t n, const int32_t *values, size_t n_values)
{
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != I32) return 3;
        ((model *)c)->i32 = values[i];
    }
    return 0;
}
fmi3Status fmi3GetInt64(void *c, const vref *vr, size_t n, int64_t *values, size_t n_values)
{
    const model *m = c;
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) values[i] = (vr[i] % 100 == I64 ? m->i64 : m->enumeration) + wrong(m, vr[i]);
    return 0;
}
fmi3Status fmi3SetInt64(void *c, const vref *vr, size_t n, const int64_t *values, size_t n_values)
{
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) *(vr[i] == I64 ? &((model *)c)->i64 : &((model *)c)->enumeration) = values[i];
    return 0;
}
fmi3Status fmi3GetBoolean(void *c, const vref *vr, size_t n, bool *values, size_t n_values)
{
    const model *m = c;
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) values[i] = m->boolean != wrong(m, vr[i]);
    return 0;
}
fmi3Status fmi3SetBoolean(void *c, const vref *vr, size_t n, const bool *values, size_t n_values)
{
    (void)vr;
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) ((model *)c)->boolean = values[i];
    return 0;
}
fmi3Status fmi3GetString(void *c, const vref *vr, size_t n, const char **values, size_t n_values)
{
    model *m = c;
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) values[i] = wrong(m, vr[i]) ? "something else" : m->text;
    return 0;
}
fmi3Status fmi3SetString(void *c, const vref *vr, size_t n, const char *const *values, size_t n_values)
{
    (void)vr;
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) strncpy(((model *)c)->text, values[i], 39);
    return 0;
}
fmi3Status fmi3GetBinary(void *c, const vref *vr, size_t n, size_t *sizes, const uint8_t **values, size_t n_values)
{
    model *m = c;
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) values[i] = m->binary, sizes[i] = wrong(m, vr[i]) ? 1 : 2;
    return 0;
}
fmi3Status fmi3SetBinary(void *c, const vref *vr, size_t n, const size_t *sizes, const uint8_t *const *values, size_t n_values)
{
    (void)vr;
    if (n != n_values) return 3;
    for (size_t i = 0; i < n; i++) {
        if (sizes[i] != 2) return 3;
        memcpy(((model *)c)->binary, values[i], 2);
    }
    return 0;
}
