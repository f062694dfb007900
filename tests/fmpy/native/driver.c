/* A host in C that runs a plan of calls and prints what it reads: for libraries of other platforms (under wine and qemu)
 * and for memory checkers.
 *
 *   driver LIBRARY GUID PLAN
 *
 * Lines of the plan: "start T0", "real VR VALUE", "integer VR VALUE", "boolean VR VALUE", "step T H",
 * "get-real VR", "get-integer VR", "get-boolean VR", "state" (copy, serialise, read back, restore, free), "reset",
 * "again N" (the plan from the top, N more times in all, each with an instance of its own). */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <windows.h>
#define LOAD(path) ((void *)LoadLibraryA(path))
#define FIND(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#define UNLOAD(library) FreeLibrary((HMODULE)(library))
#define REASON "LoadLibrary failed"
#else
#include <dlfcn.h>
#define LOAD(path) dlopen(path, RTLD_NOW | RTLD_LOCAL)
#define FIND(library, name) dlsym(library, name)
#define UNLOAD(library) dlclose(library)
#define REASON dlerror()
#endif

typedef void *Component;
typedef unsigned int Reference;
typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

static void logger(void *environment, const char *instance, int status, const char *category, const char *text, ...) {
    (void)environment, (void)instance;
    fprintf(stderr, "%d %s: %s\n", status, category, text);
}

static void *library;

static void *find(const char *name) {
    void *function = FIND(library, name);
    if (!function) {
        fprintf(stderr, "%s is not exported\n", name);
        exit(3);
    }
    return function;
}

/* The function of FMI 2.0 with this name and these parameters. */
#define CALL(name, types) ((int(*) types)find(#name))
#define DO(call)                                                             \
    do {                                                                     \
        int status = (call);                                                 \
        if (status) {                                                        \
            fprintf(stderr, "line %d: status %d of %s\n", line, status, #call); \
            exit(4);                                                         \
        }                                                                    \
    } while (0)

static Component instantiate(const char *guid) {
    static const Callbacks callbacks = {logger, calloc, free, NULL, NULL};
    Component (*make)(const char *, int, const char *, const char *, const Callbacks *, int, int);
    *(void **)&make = find("fmi2Instantiate");
    Component c = make("driver", 1, guid, "", &callbacks, 0, 0);
    if (!c) exit(5);
    return c;
}

static void cycle_state(Component c, int line) {
    void *state = NULL, *copy = NULL;
    size_t size = 0;
    DO(CALL(fmi2GetFMUstate, (Component, void **))(c, &state));
    DO(CALL(fmi2SerializedFMUstateSize, (Component, void *, size_t *))(c, state, &size));
    char *bytes = malloc(size);
    DO(CALL(fmi2SerializeFMUstate, (Component, void *, char *, size_t))(c, state, bytes, size));
    DO(CALL(fmi2DeSerializeFMUstate, (Component, const char *, size_t, void **))(c, bytes, size, &copy));
    DO(CALL(fmi2SetFMUstate, (Component, void *))(c, copy));
    DO(CALL(fmi2FreeFMUstate, (Component, void **))(c, &state));
    DO(CALL(fmi2FreeFMUstate, (Component, void **))(c, &copy));
    free(bytes);
}

static int run(const char *guid, FILE *plan) {
    char word[32];
    double first, second;
    int again = 0, line = 0;
    Component c = instantiate(guid);
    rewind(plan);
    while (fscanf(plan, "%31s", word) == 1) {
        line++;
        if (!strcmp(word, "state")) {
            cycle_state(c, line);
            continue;
        }
        if (!strcmp(word, "reset")) {
            DO(CALL(fmi2Reset, (Component))(c));
            continue;
        }
        if (fscanf(plan, "%lf", &first) != 1) exit(6);
        Reference reference = (Reference)first;
        if (!strcmp(word, "start")) {
            DO(CALL(fmi2SetupExperiment, (Component, int, double, double, int, double))(c, 0, 0.0, first, 0, 0.0));
            DO(CALL(fmi2EnterInitializationMode, (Component))(c));
            DO(CALL(fmi2ExitInitializationMode, (Component))(c));
        } else if (!strcmp(word, "again")) {
            again = (int)first;
        } else if (!strcmp(word, "get-real")) {
            double value;
            DO(CALL(fmi2GetReal, (Component, const Reference *, size_t, double *))(c, &reference, 1, &value));
            printf("%.17g\n", value);
        } else if (!strncmp(word, "get-", 4)) {
            int value;
            if (word[4] == 'i') {
                DO(CALL(fmi2GetInteger, (Component, const Reference *, size_t, int *))(c, &reference, 1, &value));
            } else {
                DO(CALL(fmi2GetBoolean, (Component, const Reference *, size_t, int *))(c, &reference, 1, &value));
            }
            printf("%d\n", value);
        } else {
            if (fscanf(plan, "%lf", &second) != 1) exit(6);
            int whole = (int)second;
            if (!strcmp(word, "step")) {
                DO(CALL(fmi2DoStep, (Component, double, double, int))(c, first, second, 1));
            } else if (!strcmp(word, "real")) {
                DO(CALL(fmi2SetReal, (Component, const Reference *, size_t, const double *))(c, &reference, 1, &second));
            } else if (!strcmp(word, "integer")) {
                DO(CALL(fmi2SetInteger, (Component, const Reference *, size_t, const int *))(c, &reference, 1, &whole));
            } else {
                DO(CALL(fmi2SetBoolean, (Component, const Reference *, size_t, const int *))(c, &reference, 1, &whole));
            }
        }
    }
    DO(CALL(fmi2Terminate, (Component))(c));
    void (*release)(Component);
    *(void **)&release = find("fmi2FreeInstance");
    release(c);
    return again;
}

int main(int count, char **arguments) {
    if (count != 4) return 2;
    FILE *plan = fopen(arguments[3], "r");
    if (!plan) return 2;
    for (int rounds = 0;; rounds++) {
        /* loaded anew each time, as hosts do */
        library = LOAD(arguments[1]);
        if (!library) {
            fprintf(stderr, "%s\n", REASON);
            return 3;
        }
        int again = run(arguments[2], plan);
        UNLOAD(library);
        if (rounds >= again) break;
    }
    fclose(plan);
    return 0;
}
