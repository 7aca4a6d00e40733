/* A Franka robot's packets: drivers/panda/state.py and motion.py, and what a simulated one writes: sim/devices/panda/state.py.
 *
 * Buffers hold a packet's bytes; Python says at which of them its fields begin. `flag`: the reals of a state are floats.
 */
#include <string.h>

#include "law.h"
#include "rotation.h"

#define STATE 297 /* doubles that hold a RobotState of any version */
#define COMMAND 47 /* and a RobotCommand */

enum { JOINTS = 7, COPIED = 7, POSE = 16 };
static const int sizes[COPIED] = {7, 7, 7, 7, 7, 6, 1};

static void get(const char *from, double *to, int count, int single) {
    if (!single) {
        memcpy(to, from, (size_t)count * sizeof *to);
        return;
    }
    for (int i = 0; i < count; i++) {
        float value;
        memcpy(&value, from + (size_t)i * sizeof value, sizeof value);
        to[i] = value;
    }
}

/* Returns where the next field begins. */
static char *put(char *to, const double *from, int count, int single) {
    if (!single) {
        memcpy(to, from, (size_t)count * sizeof *from);
        return to + (size_t)count * sizeof *from;
    }
    for (int i = 0; i < count; i++) {
        float value = (float)from[i];
        memcpy(to + (size_t)i * sizeof value, &value, sizeof value);
    }
    return to + (size_t)count * sizeof(float);
}

/* As rotation.of_rows. */
static Quaternion of_rows(double a, double b, double c, double d, double e, double f, double g, double h, double i) {
    double trace = a + e + i;
    if (trace >= most_of(most_of(a, e), i)) return normalised((Quaternion){1 + trace, h - f, c - g, d - b});
    if (a >= most_of(e, i)) return normalised((Quaternion){h - f, 1 + a - e - i, b + d, c + g});
    if (e >= i) return normalised((Quaternion){c - g, b + d, 1 + e - a - i, f + h});
    return normalised((Quaternion){d - b, c + g, f + h, 1 + i - a - e});
}

static int fill(double *const *a, int n, double dt, int single) {
    const char *state = (const char *)a[0];
    const double *places = a[1];
    double *last = a[2], *pose = a[3 + COPIED], found[COPIED][JOINTS], T[POSE];
    (void)n;
    (void)dt;
    for (int k = 0; k < COPIED; k++) {
        get(state + (int)places[k], found[k], sizes[k], single);
        if (!ordinary(found[k], sizes[k])) return RARE;
    }
    get(state + (int)places[COPIED], T, POSE, single);
    if (!ordinary(T, POSE)) return RARE;
    Quaternion q = of_rows(T[0], T[4], T[8], T[1], T[5], T[9], T[2], T[6], T[10]);
    if (q.w * last[0] + q.x * last[1] + q.y * last[2] + q.z * last[3] < 0) q = (Quaternion){-q.w, -q.x, -q.y, -q.z};
    for (int k = 0; k < COPIED; k++) memcpy(a[3 + k], found[k], (size_t)sizes[k] * sizeof(double));
    memcpy(pose, T + 12, 3 * sizeof *pose);
    pose[3] = last[0] = q.w, pose[4] = last[1] = q.x, pose[5] = last[2] = q.y, pose[6] = last[3] = q.z;
    return DONE;
}

/* As TorqueLimiter.step, and what it sends goes into the command with the state's message id. */
static int torque(double *const *a, int n, double dt, int single) {
    const char *state = (const char *)a[0];
    const double *places = a[1], *wanted = a[2], *most = a[3] + 2;
    double step = a[3][0], apart = a[3][1], *sent = a[4], taken[JOINTS];
    char *command = (char *)a[5];
    (void)n;
    (void)dt;
    get(state + (int)places[0], taken, JOINTS, single);
    if (!ordinary(wanted, JOINTS) || !ordinary(taken, JOINTS)) return RARE;
    for (int i = 0; i < JOINTS; i++) {
        double w = wanted[i], t = taken[i], E = most[i];
        double near = -apart < sent[i] - t && sent[i] - t < apart ? sent[i] : t; /* t at first: it is NaN then */
        double low = near > t ? near - step : t - step, high = near > t ? t + step : near + step;
        low = low > -E ? low : -E;
        high = high < E ? high : E;
        w = w < low ? low : w;
        sent[i] = w > high ? high : w;
    }
    memcpy(command, state, 8);
    memcpy(command + (int)places[1], sent, JOINTS * sizeof *sent);
    return DONE;
}

/* As StateWriter._copy. */
static int record(double *const *a, int n, double dt, int single) {
    char *state = (char *)a[0], *at;
    const double *places = a[1], flip = a[1][6], *position = a[2], *velocity = a[2] + JOINTS, *effort = a[2] + 2 * JOINTS;
    const double *rate = a[3], *torques = a[4], *q = a[5], *dq = a[5] + JOINTS, *ddq = a[5] + 2 * JOINTS, *pose = a[9];
    const double *wrench = a[8], *k = a[10];
    double turned[POSE], turn[3][3], at_k[6];
    (void)n;
    (void)dt;
    const double elbows[4] = {position[2], position[3] >= flip ? 1.0 : -1.0, q[2], q[3] >= flip ? 1.0 : -1.0};
    for (int i = 0; i < POSE; i++) turned[i] = pose[i % 4 * 4 + i / 4];
    put(state + (int)places[0], turned, POSE, single);
    put(state + (int)places[1], elbows, 4, single);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            turn[i][j] = pose[4 * i] * k[j] + pose[4 * i + 1] * k[3 + j] + pose[4 * i + 2] * k[6 + j];
    for (int i = 0; i < 6; i++) {
        const double *v = wrench + i / 3 * 3;
        at_k[i] = v[0] * turn[0][i % 3] + v[1] * turn[1][i % 3] + v[2] * turn[2][i % 3];
    }
    const double *const moved[] = {effort, torques, rate, position, q, velocity, dq, ddq};
    at = state + (int)places[2];
    for (int k = 0; k < 8; k++) at = put(at, moved[k], JOINTS, single);
    at = put(state + (int)places[3], a[6], 2 * (JOINTS + 6), single);
    put(put(put(at, a[7], JOINTS, single), wrench, 6, single), at_k, 6, single);
    put(put(state + (int)places[4], position, JOINTS, single), velocity, JOINTS, single);
    put(state + (int)places[5], a[11], 1, single);
    return DONE;
}

/* As PandaController._watch: 1 where a joint is beyond its limits or a load beyond its upper threshold. */
static int watch(double *const *a, int n, double dt, int flag) {
    (void)n;
    (void)dt;
    (void)flag;
    for (int i = 0; i < 2 * JOINTS; i++) {
        double value = a[i / JOINTS][i % JOINTS];
        if (value < a[2][i] || value > a[3][i]) return LIMITED;
    }
    for (int i = JOINTS + 6; i < 2 * (JOINTS + 6); i++)
        if (a[4][i] != 0.0) return LIMITED;
    return DONE;
}

static const Arg fill_args[] = {
    {"state", STATE, 0, 0}, {"places", COPIED + 1, 0, 0}, {"quaternion", 4, 0, 1},
    {"position", 7, 0, 1}, {"velocity", 7, 0, 1}, {"effort", 7, 0, 1}, {"desired_effort", 7, 0, 1},
    {"external_effort", 7, 0, 1}, {"wrench", 6, 0, 1}, {"success_rate", 1, 0, 1}, {"pose", 7, 0, 1}, {NULL, 0, 0, 0},
};
static const Arg torque_args[] = {
    {"state", STATE, 0, 0}, {"places", 2, 0, 0}, {"wanted", JOINTS, 0, 0}, {"limits", 2 + JOINTS, 0, 0},
    {"sent", JOINTS, 0, 1}, {"command", COMMAND, 0, 1}, {NULL, 0, 0, 0},
};
static const Arg record_args[] = {
    {"state", STATE, 0, 1}, {"places", 7, 0, 0}, {"measured", 4 * JOINTS, 0, 0}, {"effort_rate", JOINTS, 0, 0},
    {"torque", JOINTS, 0, 0}, {"motion", 3 * JOINTS, 0, 0}, {"touching", 26, 0, 0}, {"external", JOINTS, 0, 0},
    {"wrench", 6, 0, 0}, {"pose", POSE, 0, 0}, {"turn_of_k", 9, 0, 0}, {"success_rate", 1, 0, 0}, {NULL, 0, 0, 0},
};
static const Arg watch_args[] = {
    {"position", JOINTS, 0, 0}, {"velocity", JOINTS, 0, 0}, {"least", 2 * JOINTS, 0, 0}, {"most", 2 * JOINTS, 0, 0},
    {"touching", 26, 0, 0}, {NULL, 0, 0, 0},
};
const Law panda_watch = {"panda-watch", watch, watch_args};
const Law panda_fill = {"panda-fill", fill, fill_args};
const Law panda_torque = {"panda-torque", torque, torque_args};
const Law panda_record = {"panda-record", record, record_args};
