/* What runtime/guard/samples.py, rates.py and following.py do in the ordinary cycle. */
#include <stddef.h>

#include "law.h"

/* -- each sample of a device: within what can be, and where a joint can have moved to */

enum { LOW, HIGH, SLACK, SPEED, WIDE };
enum { LAST, BEFORE, EARLIER, TAKEN, AGE, AGREED, KEPT };
enum { AGREE = 3 };
enum { Q, W, WAY, COMMON, OWN, WRONG, RATE_KEPT };
#define RATE_MEMORY 0.5
#define RATE_LATE 0.06
#define RATE_MOST 1.5
#define RATE_SMOOTH 0.01

static int sample_step(double *const *a, int n, double dt, int flag) {
    const double *values = a[0], *limits = a[1];
    double *state = a[2];
    for (int i = 0; i < n; i++) {
        double x = values[i];
        const double *l = limits + WIDE * i, *s = state + KEPT * i;
        int known = isfinite(x), judged = isfinite(l[SPEED]); /* a joint that is at infinity is wrong, not unknown */
        if ((known || (judged && isinf(x))) && (x < l[LOW] || x > l[HIGH])) return RARE;
        if (judged && (known ? s[AGE] > 0.0 || s[AGREED] < AGREE : flag)) return RARE;
        if (known && judged && !(fabs(x - s[LAST]) <= l[SLACK] + l[SPEED] * dt)) return RARE;
    }
    for (int i = 0; i < n; i++) {
        double x = values[i], *s = state + KEPT * i;
        int known = isfinite(x);
        if (known && (flag || !(x == s[BEFORE]))) s[EARLIER] = s[BEFORE], s[BEFORE] = x;
        if (known) s[LAST] = x;
        s[TAKEN] = x;
    }
    return DONE;
}

static const Arg sample_args[] = {{"values", ANY, 1, 0}, {"limits", 0, WIDE, 0}, {"state", 0, KEPT, 1}, {NULL, 0, 0, 0}};
const Law sample_check = {"sample-check", sample_step, sample_args};

/* -- a measured velocity: whether it is that of the measured position; returns one more than the element that is wrong */

static int rate_step(double *const *a, int n, double dt, int flag) {
    const double *q = a[0], *w = a[1], *off = a[2];
    double keep = most_of(0.0, 1.0 - dt / RATE_MEMORY), share = dt / (dt + RATE_SMOOTH);
    int found = 0;
    (void)flag;
    for (int i = 0; i < n; i++) {
        double *s = a[3] + RATE_KEPT * i;
        int known = isfinite(q[i]) && isfinite(w[i]);
        s[WAY] *= keep, s[COMMON] *= keep;
        if (known && isfinite(s[Q]) && dt > 0.0) {
            double went = q[i] - s[Q], speed = went / dt;
            s[WAY] += 0.5 * (w[i] + s[W]) * dt - went;
            s[COMMON] = most_of(s[COMMON], least_of(fabs(w[i]), fabs(went) / dt));
            s[OWN] += (speed - s[OWN]) * share;
        }
        double most = off[i] + RATE_LATE * s[COMMON];
        s[WRONG] = known && !(fabs(s[WAY]) <= most);
        if (s[WRONG] && !found) found = i + 1;
        s[WAY] = least_of(most_of(s[WAY], -RATE_MOST * most), RATE_MOST * most);
        s[Q] = known ? q[i] : NAN, s[W] = known ? w[i] : NAN;
    }
    return found;
}

static const Arg rate_args[] = {
    {"position", 0, 1, 0}, {"velocity", 0, 1, 0}, {"off", 0, 1, 0}, {"state", 0, RATE_KEPT, 1}, {NULL, 0, 0, 0},
};
const Law rate_check = {"rate-check", rate_step, rate_args};

/* -- a commanded position: whether the limb is where its command was within the lag */

static int position_step(double *const *a, int n, double dt, int flag) {
    const double *measured = a[0], *applied = a[1], *window = a[2];
    double *trace = a[4], share = least_of(1.0, dt / a[3][0]);
    int far = 0;
    (void)flag;
    for (int i = 0; i < n; i++) {
        trace[i] += (applied[i] - trace[i]) * share;
        double low = least_of(trace[i], applied[i]) - window[i], high = most_of(trace[i], applied[i]) + window[i];
        far |= !(measured[i] >= low && measured[i] <= high);
    }
    return far ? LIMITED : DONE;
}

static const Arg position_args[] = {
    {"measured", 0, 1, 0}, {"applied", 0, 1, 0}, {"window", 0, 1, 0}, {"lag", 1, 0, 0}, {"trace", 0, 1, 1}, {NULL, 0, 0, 0},
};
const Law following_position = {"following-position", position_step, position_args};

/* -- a commanded velocity: whether the way that was measured is the way that was commanded; flag: x, y, yaw of a base */

static int velocity_step(double *const *a, int n, double dt, int flag) {
    const double *measured = a[0], *applied = a[1], *window = a[2];
    double *behind = a[4], *before = a[5], keep = 1.0 - least_of(1.0, dt / a[3][0]), way[MOST_JOINTS];
    int far = 0;
    for (int i = 0; i < n; i++)
        if (!isfinite(measured[i]) || !isfinite(applied[i])) return RARE;
    for (int i = 0; i < n; i++) way[i] = measured[i] - before[i], before[i] = measured[i];
    if (flag && n == 3) {
        double yaw = measured[2] - way[2] / 2, c = cos(yaw), s = sin(yaw), x = way[0], y = way[1];
        way[0] = c * x + s * y, way[1] = c * y - s * x;
    }
    for (int i = 0; i < n; i++) {
        behind[i] = behind[i] * keep + (applied[i] * dt - way[i]);
        far |= !(fabs(behind[i]) <= window[i]);
    }
    return far ? LIMITED : DONE;
}

static const Arg velocity_args[] = {
    {"measured", 0, 1, 0}, {"applied", 0, 1, 0}, {"window", 0, 1, 0}, {"memory", 1, 0, 0}, {"behind", 0, 1, 1},
    {"before", 0, 1, 1}, {NULL, 0, 0, 0},
};
const Law following_velocity = {"following-velocity", velocity_step, velocity_args};
