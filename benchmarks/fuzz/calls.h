/* What the drivers of FMI 2 and FMI 3 share: random arguments from a seed, and the program around them.
 *
 *   orders TOKEN VALUES FIRST COUNT   COUNT random orders of calls, each on an instance of its own
 *   steps TOKEN VALUES KIND COUNT     COUNT steps of co-simulation (KIND 1) or of model exchange (KIND 0)
 *   threads TOKEN VALUES KIND COUNT   8 threads of 8 instances each, COUNT steps of every instance
 *
 * Exit code 0, and one line with how many calls were made. Memory and threads are watched by whoever built this. */
#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct {
    uint64_t seed;
    unsigned long long calls;
} dice;

static const char *the_token;
static unsigned n_slots;

static uint64_t draw(dice *d) /* splitmix64 */
{
    uint64_t z = d->seed += 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

static unsigned below(dice *d, unsigned n) { return (unsigned)(draw(d) % n); }

static int one_in(dice *d, unsigned n) { return below(d, n) == 0; }

static double number(dice *d)
{
    static const double odd[] = {0, -0.0, 1, -1, NAN, INFINITY, -INFINITY, 1e308, -1e308, 5e-324, 1e-300, 1e150, -1e9, 4294967296.0};
    if (one_in(d, 4)) return odd[below(d, sizeof odd / sizeof *odd)];
    return (below(d, 2001) / 1000.0 - 1) * pow(10, (int)below(d, 9) - 5);
}

static double step_size(dice *d) { return one_in(d, 20) ? fmin(number(d), 0.1) : 1e-4 * (1 + below(d, 50)); }

static unsigned slot(dice *d)
{
    if (one_in(d, 20)) return (unsigned)draw(d);
    return below(d, n_slots + (one_in(d, 10) ? 6 : 0));
}

/* An array of exactly n elements, so that one more is noticed; NULL for an n of 0, and now and then. */
static void *room(dice *d, size_t n, size_t size) { return n && !one_in(d, 50) ? calloc(n, size) : NULL; }

static size_t length(dice *d) { return below(d, 5); }

static unsigned *slots(dice *d, size_t n)
{
    unsigned *const made = room(d, n, sizeof *made);
    for (size_t i = 0; made && i < n; i++) made[i] = slot(d);
    return made;
}

static double *numbers(dice *d, size_t n)
{
    double *const made = room(d, n, sizeof *made);
    for (size_t i = 0; made && i < n; i++) made[i] = number(d);
    return made;
}

static int *integers(dice *d, size_t n)
{
    int *const made = room(d, n, sizeof *made);
    for (size_t i = 0; made && i < n; i++) made[i] = one_in(d, 4) ? (int)draw(d) : (int)below(d, 5) - 1;
    return made;
}

static void order(dice *d);
static int steps(int co_simulation, int n);

static void *work_of_a_thread(void *given)
{
    const int *const what = given;
    intptr_t failed = 0;
    for (int k = 0; k < 8 && !failed; k++) failed = steps(what[0], what[1]);
    return (void *)failed;
}

static int threads(int co_simulation, int n)
{
    pthread_t made[8];
    int what[2] = {co_simulation, n}, failed = 0;
    for (int i = 0; i < 8; i++)
        if (pthread_create(&made[i], NULL, work_of_a_thread, what)) return 90;
    for (int i = 0; i < 8; i++) {
        void *outcome;
        pthread_join(made[i], &outcome);
        if (outcome) failed = (int)(intptr_t)outcome;
    }
    return failed;
}

int main(int argc, char **argv)
{
    unsigned long long first, count, calls = 0;
    int outcome = 0;
    if (argc != 6) return 99;
    the_token = argv[2];
    n_slots = (unsigned)atoi(argv[3]);
    first = strtoull(argv[4], NULL, 10);
    count = strtoull(argv[5], NULL, 10);
    if (!strcmp(argv[1], "orders")) {
        for (unsigned long long k = first; k < first + count; k++) {
            dice d = {k * 0x2545f4914f6cdd1du + 1, 0};
            alarm(60); /* one order takes a millisecond */
            order(&d);
            calls += d.calls;
            if (count == 1) fprintf(stderr, "order %llu: %llu calls\n", k, d.calls);
        }
    } else {
        outcome = !strcmp(argv[1], "threads") ? threads((int)first, (int)count) : steps((int)first, (int)count);
        calls = count;
    }
    printf("%llu\n", calls);
    return outcome;
}
