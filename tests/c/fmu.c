/* The binary of the FMUs as an importer that makes every call and every mistake: for a run under
 * valgrind or with the sanitizer of addresses. Usage: fmu LIBRARY */
#define _POSIX_C_SOURCE 200809L
#include <dlfcn.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { OK = 0, ERROR = 3, INSTANCES = 100, STEPS = 60, MOST = 40 };
typedef void *unit;
static const char *const tokens[] = {
    "zivi-impacting-mass-1",  "zivi-twisting-regulator-1", "zivi-twisting-tracker-1",
    "zivi-twisting-loop-1", "zivi-impact-observer-1",
};
static void *library;
static int failures, told;

#define EXPECT(condition) \
    do { \
        if (!(condition)) { \
            printf("%s:%d: %s\n", __FILE__, __LINE__, #condition); \
            failures++; \
        } \
    } while (0)

/* A function of the library; POSIX promises that the copy works. */
static void find(const char *name, void *function)
{
    void *const found = dlsym(library, name);
    if (found == NULL) {
        printf("no %s\n", name);
        exit(2);
    }
    memcpy(function, &found, sizeof found);
}

static void log2_(void *environment, const char *name, int status, const char *category, const char *text, ...)
{
    (void)environment, (void)status;
    told += strlen(name) > 0 && strlen(category) > 0 && strlen(text) > 0;
}

static void log3_(void *environment, int status, const char *category, const char *text)
{
    (void)environment, (void)status;
    told += strlen(category) > 0 && strlen(text) > 0;
}

/* One version of the standard. */
typedef struct {
    int fmi;
    void (*free_)(unit);
    int (*enter2)(unit), (*exit)(unit), (*terminate)(unit), (*reset)(unit);
    int (*enter3)(unit, bool, double, double), (*setup2)(unit, int, double, double, int, double);
    int (*step2)(unit, double, double, int);
    int (*step3)(unit, double, double, bool, bool *, bool *, bool *, double *);
    int (*get2)(unit, const uint32_t *, size_t, double *), (*set2)(unit, const uint32_t *, size_t, const double *);
    int (*get3)(unit, const uint32_t *, size_t, double *, size_t);
    int (*set3)(unit, const uint32_t *, size_t, const double *, size_t);
    int (*get_state)(unit, void **), (*set_state)(unit, void *), (*free_state)(unit, void **);
    int (*size)(unit, void *, size_t *), (*store)(unit, void *, uint8_t *, size_t);
    int (*restore)(unit, const uint8_t *, size_t, void **);
} interface;

typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *allocate, *release, *finished, *environment;
} callbacks;

static interface version(int fmi)
{
    interface it;
    char name[64];
    memset(&it, 0, sizeof it);
    it.fmi = fmi;
#define FIND(member, function) (sprintf(name, "fmi%d%s", fmi, function), find(name, &it.member))
    FIND(free_, "FreeInstance");
    FIND(exit, "ExitInitializationMode");
    FIND(terminate, "Terminate");
    FIND(reset, "Reset");
    FIND(get_state, fmi == 2 ? "GetFMUstate" : "GetFMUState");
    FIND(set_state, fmi == 2 ? "SetFMUstate" : "SetFMUState");
    FIND(free_state, fmi == 2 ? "FreeFMUstate" : "FreeFMUState");
    FIND(size, fmi == 2 ? "SerializedFMUstateSize" : "SerializedFMUStateSize");
    FIND(store, fmi == 2 ? "SerializeFMUstate" : "SerializeFMUState");
    FIND(restore, fmi == 2 ? "DeSerializeFMUstate" : "DeserializeFMUState");
    if (fmi == 2) {
        FIND(setup2, "SetupExperiment");
        FIND(enter2, "EnterInitializationMode");
        FIND(step2, "DoStep");
        FIND(get2, "GetReal");
        FIND(set2, "SetReal");
    } else {
        FIND(enter3, "EnterInitializationMode");
        FIND(step3, "DoStep");
        FIND(get3, "GetFloat64");
        FIND(set3, "SetFloat64");
    }
    return it;
}

static unit made(const interface *it, const char *token, const char *name)
{
    if (it->fmi == 2) {
        static callbacks given;
        unit (*make)(const char *, int, const char *, const char *, const callbacks *, int, int);
        given.logger = log2_;
        find("fmi2Instantiate", &make);
        return make(name, 1, token, "", &given, 0, 0);
    } else {
        unit (*make)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *,
                     size_t, void *, void (*)(void *, int, const char *, const char *), void *);
        find("fmi3InstantiateCoSimulation", &make);
        return make(name, token, NULL, false, false, false, false, NULL, 0, NULL, log3_, NULL);
    }
}

static int get(const interface *it, unit one, const uint32_t *which, size_t n, double *values)
{
    return it->fmi == 2 ? it->get2(one, which, n, values) : it->get3(one, which, n, values, n);
}

static int set(const interface *it, unit one, const uint32_t *which, size_t n, const double *values)
{
    return it->fmi == 2 ? it->set2(one, which, n, values) : it->set3(one, which, n, values, n);
}

static int started(const interface *it, unit one)
{
    const int entered = it->fmi == 2 ? it->setup2(one, 0, 0.0, 0.0, 0, 0.0) | it->enter2(one)
                                     : it->enter3(one, false, 0.0, 0.0);
    return entered | it->exit(one);
}

/* Sets the first inputs and makes a communication step. */
static int stepped(const interface *it, unit one, int k, int n)
{
    const uint32_t inputs[2] = {1, 2};
    const double values[2] = {0.5 + 0.01 * n + 1e-3 * k, -0.1 * n};
    bool flag[3];
    double last;
    set(it, one, inputs, 1, values); /* one is an input in every model, two in most */
    set(it, one, inputs, 2, values);
    return it->fmi == 2 ? it->step2(one, 1e-3 * k, 1e-3, 1)
                        : it->step3(one, 1e-3 * k, 1e-3, true, &flag[0], &flag[1], &flag[2], &last);
}

static void seen(const interface *it, unit one, double *values)
{
    uint32_t k;
    for (k = 0; k < MOST; k++) {
        values[k] = 0.0;
        get(it, one, &k, 1, &values[k]); /* refused where it is of another type, or not there */
    }
}

/* Stored as bytes, restored in another instance, both continued. */
static void copied(const interface *it, unit one, unit other)
{
    double a[MOST], b[MOST];
    void *state = NULL, *again = NULL;
    size_t size = 0;
    uint8_t *bytes;
    int k;
    EXPECT(it->get_state(one, &state) == OK && it->get_state(one, &state) == OK && state != NULL);
    EXPECT(it->size(one, state, &size) == OK && size > 0);
    bytes = malloc(size);
    EXPECT(it->store(one, state, bytes, size - 1) == ERROR && it->store(one, state, bytes, size) == OK);
    EXPECT(it->restore(other, bytes, size - 1, &again) == ERROR && again == NULL);
    EXPECT(it->restore(other, bytes, size, &again) == OK && it->restore(other, bytes, size, &again) == OK);
    free(bytes);
    EXPECT(it->set_state(other, again) == OK);
    for (k = STEPS; k < STEPS + 20; k++)
        EXPECT(stepped(it, one, k, 3) == stepped(it, other, k, 3));
    seen(it, one, a);
    seen(it, other, b);
    EXPECT(memcmp(a, b, sizeof a) == 0);
    EXPECT(it->free_state(one, &state) == OK && state == NULL && it->free_state(one, &state) == OK);
    EXPECT(it->free_state(other, &again) == OK);
}

static void many(const interface *it, const char *token)
{
    unit units[INSTANCES];
    double first[MOST], again[MOST];
    int k, n;
    for (n = 0; n < INSTANCES; n++) {
        units[n] = made(it, token, n == 0 ? "" : "a name that is longer than the sixty-three bytes that are kept of it");
        EXPECT(units[n] != NULL && started(it, units[n]) == OK);
    }
    for (k = 0; k < STEPS; k++)
        for (n = 0; n < INSTANCES; n++)
            stepped(it, units[n], k, n % 7);
    seen(it, units[3], first);
    seen(it, units[10], again); /* had the same inputs */
    EXPECT(memcmp(first, again, sizeof first) == 0);
    copied(it, units[3], units[50]);
    EXPECT(it->terminate(units[4]) == OK && stepped(it, units[4], 0, 0) == ERROR);
    EXPECT(it->reset(units[3]) == OK && started(it, units[3]) == OK);
    for (k = 0; k < STEPS; k++)
        stepped(it, units[3], k, 3);
    seen(it, units[3], again);
    EXPECT(memcmp(first, again, sizeof first) == 0);
    for (n = INSTANCES - 1; n >= 0; n--)
        it->free_(units[n]);
}

static void mistakes(const interface *it)
{
    const uint32_t nowhere[2] = {1, 4000000000u};
    double values[2] = {NAN, INFINITY};
    void *state = NULL;
    size_t size;
    const int before = told;
    unit one = made(it, tokens[2], NULL), other = made(it, tokens[0], "other");
    EXPECT(made(it, "no such token", "name") == NULL && made(it, NULL, NULL) == NULL);
    EXPECT(get(it, one, nowhere, 2, values) == ERROR && set(it, one, nowhere, 2, values) == ERROR);
    EXPECT(get(it, one, NULL, 2, values) == ERROR && set(it, one, NULL, 2, values) == ERROR);
    EXPECT(get(it, one, NULL, 0, NULL) == OK && set(it, one, NULL, 0, NULL) == OK);
    EXPECT(it->exit(one) == ERROR && stepped(it, one, 0, 0) == ERROR);
    EXPECT(it->get_state(other, &state) == OK && it->set_state(one, state) == ERROR);
    EXPECT(it->set_state(one, NULL) == ERROR && it->get_state(one, NULL) == ERROR);
    EXPECT(it->store(one, NULL, NULL, 0) == ERROR && it->restore(one, NULL, 0, &state) == ERROR);
    EXPECT(it->size(one, NULL, NULL) == ERROR && it->free_state(one, NULL) == OK);
    EXPECT(it->free_state(one, &state) == OK);
    EXPECT(told > before);
    it->free_(one);
    it->free_(other);
    it->free_(NULL);
    EXPECT(started(it, NULL) != OK && it->reset(NULL) == ERROR && it->terminate(NULL) == ERROR);
    EXPECT(get(it, NULL, nowhere, 1, values) == ERROR && set(it, NULL, nowhere, 1, values) == ERROR);
    EXPECT(it->get_state(NULL, &state) == ERROR && it->size(NULL, NULL, &size) == OK);
}

int main(int count, char **arguments)
{
    size_t k;
    int fmi;
    if (count != 2 || (library = dlopen(arguments[1], RTLD_NOW)) == NULL) {
        printf("usage: fmu LIBRARY (%s)\n", count == 2 ? dlerror() : "one argument");
        return 2;
    }
    for (fmi = 2; fmi <= 3; fmi++) {
        const interface it = version(fmi);
        for (k = 0; k < sizeof tokens / sizeof *tokens; k++)
            many(&it, tokens[k]);
        mistakes(&it);
    }
    dlclose(library);
    printf("fmu: %s\n", failures == 0 ? "as promised" : "NOT as promised");
    return failures == 0 ? 0 : 1;
}
