/* FMU states: a copy of the engine's saved piece, and its form as bytes. The bytes hold numbers only, no addresses, so
 * that another process on a machine of the same byte order can take them; they are checked before they are believed. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "hy_fmi.h"

typedef struct {
    uint64_t magic, size, token, checksum;
} hy_head;

static const uint64_t MAGIC = 0x3130544154535948u; /* "HYSTAT01" */

static uint64_t fnv1a(const void *bytes, size_t n)
{
    const unsigned char *b = bytes;
    uint64_t hash = 0xcbf29ce484222325u;
    for (size_t i = 0; i < n; i++) hash = (hash ^ b[i]) * 0x100000001b3u;
    return hash;
}

/* What states of this model begin with, in memory and as bytes. A checksum is of bytes alone. */
static hy_head head_of(const hy_instance *c)
{
    const hy_head head = {MAGIC, c->engine.saved_size, fnv1a(hy_the_model.token, strlen(hy_the_model.token)), 0};
    return head;
}

static int is_own(const hy_instance *c, const hy_head *state)
{
    const hy_head own = head_of(c);
    return !memcmp(state, &own, sizeof own);
}

static size_t whole(const hy_instance *c) { return sizeof(hy_head) + c->engine.saved_size; }

/* Room for a state: a new one, or one of this model that the importer gave. */
static int room(hy_instance *c, void **state)
{
    if (*state) return is_own(c, *state) ? FMI_OK : hy_fail(c, "what was given for a state is no state of this model");
    *state = malloc(whole(c));
    return *state ? FMI_OK : hy_fail(c, "out of memory");
}

int hy_get_state(hy_instance *c, void **state)
{
    const hy_head head = head_of(c);
    int status;
    if (!state) return hy_fail(c, "get state: a NULL pointer was given");
    if ((status = room(c, state)) != FMI_OK) return status;
    memcpy(*state, &head, sizeof head);
    memcpy((hy_head *)*state + 1, c->engine.saved, c->engine.saved_size);
    return FMI_OK;
}

int hy_set_state(hy_instance *c, const void *state)
{
    const hy_head *head = state;
    if (!state) return hy_fail(c, "set state: a NULL pointer was given");
    if (!is_own(c, head)) return hy_fail(c, "set state: this is no state of this model");
    if (((const hy_status *)(head + 1))->kind != c->engine.status->kind)
        return hy_fail(c, "set state: a state of model exchange does not fit co-simulation, nor the other way round");
    memcpy(c->engine.saved, head + 1, c->engine.saved_size);
    c->engine.z_stands = 0;
    return FMI_OK;
}

int hy_free_state(hy_instance *c, void **state)
{
    (void)c;
    if (!state) return FMI_OK;
    free(*state);
    *state = NULL;
    return FMI_OK;
}

int hy_state_size(hy_instance *c, const void *state, size_t *size)
{
    if (!state || !size) return hy_fail(c, "state size: a NULL pointer was given");
    *size = whole(c);
    return FMI_OK;
}

int hy_write_state(hy_instance *c, const void *state, char *bytes, size_t size)
{
    hy_head head = head_of(c);
    if (!state || !bytes) return hy_fail(c, "write state: a NULL pointer was given");
    if (!is_own(c, state)) return hy_fail(c, "write state: this is no state of this model");
    if (size < whole(c)) return hy_fail(c, "write state: room for %zu bytes is not enough", size);
    head.checksum = fnv1a((const hy_head *)state + 1, c->engine.saved_size);
    memcpy(bytes, &head, sizeof head);
    memcpy(bytes + sizeof head, (const hy_head *)state + 1, c->engine.saved_size);
    return FMI_OK;
}

int hy_read_state(hy_instance *c, const char *bytes, size_t size, void **state)
{
    hy_head head, own = head_of(c);
    int status;
    if (!bytes || !state) return hy_fail(c, "read state: a NULL pointer was given");
    if (size < whole(c)) return hy_fail(c, "read state: %zu bytes are not a state of this model", size);
    memcpy(&head, bytes, sizeof head);
    own.checksum = fnv1a(bytes + sizeof head, c->engine.saved_size);
    if (memcmp(&head, &own, sizeof head)) return hy_fail(c, "read state: the bytes are damaged or of another model");
    if ((status = room(c, state)) != FMI_OK) return status;
    memcpy(*state, bytes, whole(c));
    ((hy_head *)*state)->checksum = 0;
    return FMI_OK;
}
