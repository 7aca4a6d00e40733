/* A law or guard as a C function over the arrays that Python has bound: the contract of runtime/contracts/compiled.py. */
#ifndef SRL_LAW_H
#define SRL_LAW_H

#include <float.h>
#include <math.h>

#define MOST_JOINTS 16
#define ORDINARY 1e100 /* a larger input is for Python, which knows what its sums make of it */

/* What a step returns. It writes nothing at all before it knows that it won't return RARE. */
enum { RARE = -1, DONE = 0, LIMITED = 1 };

enum { ANY = -1 }; /* `fixed` of a first array that may have any number of elements, not MOST_JOINTS at most */

typedef struct {
    const char *name;
    int fixed, each; /* it has fixed + each * n elements, for n joints */
    int written;
} Arg;

typedef int (*Step)(double *const *a, int n, double dt, int flag);

typedef struct {
    const char *name;
    Step step;
    const Arg *args; /* ends with a name of NULL; n is the number of elements of the first, where its `each` is 1 */
} Law;

#define COUNT(type) ((int)(sizeof(type) / sizeof(double))) /* of a struct of doubles: an array's elements */

extern const Law tool_pose, admittance, moca_impedance, kairos_clik, torque_guard, velocity_guard, position_guard,
    sent_tracker, command_left, ur_take, ur_fill, felt_wrench, object_mapping, panda_fill, panda_torque,
    panda_record, panda_watch, sample_check, rate_check, following_position, following_velocity;

/* As Python's: the first, unless the second is smaller (larger). */
static inline double least_of(double a, double b) { return b < a ? b : a; }
static inline double most_of(double a, double b) { return b > a ? b : a; }

/* Goes to what is wanted, in a second by `down` and `up` at most: as Python's Ramps. */
static inline void ramp(double *value, double wanted, double down, double up, double dt) {
    if (*value != wanted) *value = least_of(most_of(wanted, *value - dt * down), *value + dt * up);
}

/* Whether all are finite and so small that no sum of squares overflows. */
static inline int ordinary(const double *v, int count) {
    for (int i = 0; i < count; i++)
        if (!(fabs(v[i]) < ORDINARY)) return 0;
    return 1;
}

#endif
