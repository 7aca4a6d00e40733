/* runtime/guard/torque.py, velocity.py, position.py: a command that is followed. Stops are Python's. */
#include <string.h>

#include "law.h"

/* Whether no element's change is above the tolerance. */
static int outcome(const double *wanted, const double *applied, double tolerance, int n) {
    for (int i = 0; i < n; i++)
        if (fabs(wanted[i] - applied[i]) > tolerance) return LIMITED;
    return DONE;
}

/* -- torque: TorqueGuard._follow, Barrier.range */

enum { T_E, T_V, T_LOWER, T_UPPER, T_SLOPE, T_K, T_D, T_A, T_RATE, T_WIDE };

static int torque_step(double *const *a, int n, double dt, int weighed) {
    const double *wanted = a[0], *q = a[1], *qd = a[2], *gravity = a[3], *limits = a[4], *tolerance = a[5];
    double *applied = a[6], *kept = a[7], out[MOST_JOINTS];
    if (!ordinary(wanted, n) || !ordinary(q, n) || !ordinary(qd, n) || !ordinary(applied, n)) return RARE;
    if (weighed && !ordinary(gravity, n)) return RARE;
    for (int i = 0; i < n; i++) {
        const double *row = limits + T_WIDE * i;
        double E = row[T_E], k = row[T_K], g = weighed ? gravity[i] : kept[i], last = applied[i];
        double least = -row[T_SLOPE] * (row[T_V] + qd[i]), most = row[T_SLOPE] * (row[T_V] - qd[i]);
        if (k > 0.0) {
            double way = qd[i] * fabs(qd[i]) / (2 * row[T_A]), drag = 2 * row[T_D] * qd[i];
            double outward = qd[i] > 0 ? k * (row[T_UPPER] - q[i] - way) - drag : k * (row[T_UPPER] - q[i]);
            double inward = qd[i] < 0 ? k * (row[T_LOWER] - q[i] - way) - drag : k * (row[T_LOWER] - q[i]);
            most = outward < most ? outward : most;
            least = inward > least ? inward : least;
        }
        least = least < -E ? -E : least > E ? E : least;
        most = most < -E ? -E : most > E ? E : most;
        double tau, left = wanted[i] - g, change = row[T_RATE] * dt;
        left = left < least ? least : left;
        tau = (left > most ? most : left) + g;
        tau = tau < -E ? -E : tau > E ? E : tau;
        tau = tau < last - change ? last - change : tau;
        out[i] = tau > last + change ? last + change : tau;
    }
    if (weighed) memcpy(kept, gravity, n * sizeof *kept);
    memcpy(applied, out, n * sizeof *out);
    return outcome(wanted, applied, *tolerance, n);
}

static const Arg torque_args[] = {
    {"desired", 0, 1, 0}, {"position", 0, 1, 0}, {"velocity", 0, 1, 0}, {"gravity", 0, 1, 0},
    {"limits", 0, T_WIDE, 0}, {"tolerance", 1, 0, 0}, {"applied", 0, 1, 1}, {"kept", 0, 1, 1}, {NULL, 0, 0, 0},
};
const Law torque_guard = {"torque-guard", torque_step, torque_args};

/* -- velocity: VelocityGuard._bounded, without a clearance */

enum { V_V, V_A, V_LOWER, V_UPPER, V_RAMP, V_WIDE };

static double arrival(const double *row, double distance) {
    if (distance <= 0) return 0.0;
    return sqrt(row[V_RAMP] * row[V_RAMP] + 2 * row[V_A] * distance) - row[V_RAMP];
}

static int velocity_step(double *const *a, int n, double dt, int held_in) {
    const double *wanted = a[0], *position = a[1], *limits = a[2], *tolerance = a[3];
    double *applied = a[4], out[MOST_JOINTS];
    if (!ordinary(wanted, n) || !ordinary(position, n) || !ordinary(applied, n)) return RARE;
    for (int i = 0; i < n; i++) {
        const double *row = limits + V_WIDE * i;
        double V = row[V_V], v = applied[i], step = row[V_A] * dt, least = v - step, most = v + step;
        double u = wanted[i] < -V ? -V : wanted[i] > V ? V : wanted[i];
        if (held_in) {
            double way = arrival(row, u > 0.0 ? row[V_UPPER] - position[i] : position[i] - row[V_LOWER]);
            u = u > way ? way : u < -way ? -way : u;
        }
        out[i] = u < least ? least : u > most ? most : u;
    }
    memcpy(applied, out, n * sizeof *out);
    return outcome(wanted, applied, *tolerance, n);
}

static const Arg velocity_args[] = {
    {"desired", 0, 1, 0}, {"position", 0, 1, 0}, {"limits", 0, V_WIDE, 0}, {"tolerance", 1, 0, 0},
    {"applied", 0, 1, 1}, {NULL, 0, 0, 0},
};
const Law velocity_guard = {"velocity-guard", velocity_step, velocity_args};

/* -- position: PositionGuard._follow where each joint reaches its target within the cycle (`reach`), which is most of
 * the time. Jerk unbounded, no clearance. What ruckig plans is Python's. */

enum { P_V, P_A, P_LOWER, P_UPPER, P_WIDE };
enum { P_POSITION, P_SPEED, P_TARGET, P_RAW, P_RATE, P_STATE };
#define SLACK 1e-10
#define SQRT2 1.4142135623730951

static int reach(double p, double v, double target, double speed, double V, double A, double dt, double *found) {
    double step = A * dt, w = (target - p - v * dt) / (step * dt), low, high, u;
    if (fabs(w) > 0.5 || fabs(target - p) > V * dt) return 0;
    low = most_of(v + step * (1 - sqrt(2 - 4 * w)), -V);
    high = least_of(v + step * (sqrt(2 + 4 * w) - 1), V);
    u = least_of(most_of(speed, low), high);
    *found = u;
    return low <= high && fabs(u - speed) <= (SQRT2 - 1) * step;
}

static int position_step(double *const *a, int n, double dt, int told) {
    const double *wanted = a[0], *rates = a[1], *limits = a[2], *tolerance = a[3];
    double *state = a[4], *applied = a[5], *velocity = a[6], next[MOST_JOINTS * P_STATE];
    if (!ordinary(wanted, n) || (told && !ordinary(rates, n)) || !ordinary(state, P_STATE * n)) return RARE;
    if (!(dt > 0.0)) return RARE;
    for (int i = 0; i < n; i++) {
        const double *row = limits + P_WIDE * i, *now = state + P_STATE * i;
        double *after = next + P_STATE * i, V = row[P_V], A = row[P_A], low = row[P_LOWER], high = row[P_UPPER];
        double p = now[P_POSITION], v = now[P_SPEED], step = A * dt, raw, change, speed, u, end;
        double target = wanted[i] < low ? low : wanted[i] > high ? high : wanted[i];
        /* _motion */
        raw = !told ? (target - now[P_TARGET]) / dt : target == wanted[i] ? rates[i] : 0.0;
        change = raw - now[P_RAW];
        after[P_TARGET] = target;
        after[P_RAW] = raw;
        if (fabs(change) <= step) {
            after[P_RATE] = raw;
            speed = told ? raw : raw + change / 2;
        } else {
            after[P_RATE] = least_of(most_of(raw, now[P_RATE] - step), now[P_RATE] + step);
            speed = told ? raw : after[P_RATE];
        }
        /* _towards */
        if (speed != 0.0) {
            double room = speed > 0 ? high - target : target - low;
            double most = least_of(room <= 0 ? 0.0 : sqrt(2 * A * room), V);
            if (fabs(speed) > most) speed = copysign(most, speed);
        }
        if (!reach(p, v, target, speed, V, A, dt, &u)) return RARE;
        /* _safe */
        end = target + u * fabs(u) / (2 * A);
        if ((u >= 0 ? target : end) < low - SLACK || (u >= 0 ? end : target) > high + SLACK) return RARE;
        if (fabs(u) > V * (1 + 1e-9)) return RARE;
        after[P_POSITION] = target;
        after[P_SPEED] = u;
    }
    memcpy(state, next, P_STATE * n * sizeof *state);
    for (int i = 0; i < n; i++) {
        applied[i] = state[P_STATE * i + P_POSITION];
        velocity[i] = state[P_STATE * i + P_SPEED];
    }
    return outcome(wanted, applied, *tolerance, n);
}

static const Arg position_args[] = {
    {"desired", 0, 1, 0}, {"rate", 0, 1, 0}, {"limits", 0, P_WIDE, 0}, {"tolerance", 1, 0, 0},
    {"state", 0, P_STATE, 1}, {"applied", 0, 1, 1}, {"velocity", 0, 1, 1}, {NULL, 0, 0, 0},
};
const Law position_guard = {"position-guard", position_step, position_args};

/* -- what was sent: SentTracker.compare where all was sent as it was applied */

static int sent_step(double *const *a, int n, double dt, int flag) {
    const double *sent = a[0], *applied = a[1];
    (void)dt;
    (void)flag;
    for (int i = 0; i < n; i++)
        if (!(sent[i] == applied[i])) return RARE;
    memcpy(a[2], applied, n * sizeof *applied);
    return DONE;
}

static const Arg sent_args[] = {{"sent", 0, 1, 0}, {"applied", 0, 1, 0}, {"kept", 0, 1, 1}, {NULL, 0, 0, 0}};
const Law sent_tracker = {"sent-tracker", sent_step, sent_args};

/* -- what has left: Device.publish where a driver reports all elements of a command, or none */

static int left_step(double *const *a, int n, double dt, int flag) {
    double *found = a[0];
    int none = 0;
    (void)dt;
    (void)flag;
    for (int i = 0; i < n; i++) none += isnan(found[i]) != 0;
    if (none == n) return DONE;
    if (!ordinary(found, n)) return RARE;
    for (int i = 0; i < n; i++) a[1][i] = found[i], found[i] = NAN;
    return LIMITED;
}

static const Arg left_args[] = {{"found", 0, 1, 1}, {"sent", 0, 1, 1}, {NULL, 0, 0, 0}};
const Law command_left = {"command-left", left_step, left_args};
