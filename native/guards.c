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

/* -- position: PositionGuard._follow with an unbounded jerk and without a clearance. A joint that no plan keeps within
 * its limits brakes: that is Python's. */

enum { P_V, P_A, P_LOWER, P_UPPER, P_WIDE };
enum { P_POSITION, P_SPEED, P_TARGET, P_RAW, P_RATE, P_STATE };
#define SLACK 1e-10
#define SQRT2 1.4142135623730951
#define CATCH_UP_V 0.01
#define CATCH_UP_A 0.1

static double within(double value, double most) {
    return -most <= value && value <= most ? value : copysign(most, value);
}

static int reach(double p, double v, double target, double speed, double V, double A, double dt, double *found) {
    double step = A * dt, w = (target - p - v * dt) / (step * dt), low, high, u;
    if (fabs(w) > 0.5 || fabs(target - p) > V * dt) return 0;
    low = most_of(v + step * (1 - sqrt(2 - 4 * w)), -V);
    high = least_of(v + step * (sqrt(2 + 4 * w) - 1), V);
    u = least_of(most_of(speed, low), high);
    *found = u;
    return low <= high && fabs(u - speed) <= (SQRT2 - 1) * step;
}

/* runtime/guard/approach.py */
static void approach(double *x, double *v, double slowest, double fastest, double A, double dt) {
    double sign = 1.0, top = fastest, peak, a, begin, end, left, p = *x, u = *v;
    if (p + u * fabs(u) / (2 * A) > 0) sign = -1.0, p = -p, u = -u, top = -slowest;
    peak = top, a = -A;
    if (u <= top) peak = least_of(sqrt(most_of(u * u / 2 - A * p, 0.0)), top), a = A;
    begin = most_of((peak - u) / a, 0.0);
    if (dt < begin) {
        *x = sign * (p + dt * (u + a * dt / 2));
        *v = sign * (u + a * dt);
        return;
    }
    p = p + begin * (u + peak) / 2;
    dt = dt - begin;
    end = peak / A;
    if (peak == top) {
        double cruise = peak > 0 ? most_of(-(p + peak * end / 2) / peak, 0.0) : INFINITY;
        if (dt < cruise) {
            *x = sign * (p + peak * dt);
            *v = sign * peak;
            return;
        }
        dt -= cruise;
    }
    left = end - dt;
    *x = left > 0 ? sign * (-A * left * left / 2) : 0.0;
    *v = left > 0 ? sign * (A * left) : 0.0;
}

/* PositionGuard._planned: whether there is a plan; p and v are where it is after dt. */
static int planned(double *p, double *v, double wanted, double speed, double acceleration, const double *row, double dt) {
    double V = row[P_V], A = row[P_A], room = (1 - CATCH_UP_V) * V, spare = (1 - CATCH_UP_A) * A, x, xd, earlier, way, after;
    speed = within(speed, room);
    acceleration = within(acceleration, spare);
    earlier = within(speed - acceleration * dt, room);
    x = *p - (wanted - speed * dt + acceleration * dt * dt / 2);
    xd = *v - (speed - acceleration * dt);
    if (speed < earlier)
        approach(&x, &xd, -V - speed, V - earlier, A - fabs(acceleration), dt);
    else
        approach(&x, &xd, -V - earlier, V - speed, A - fabs(acceleration), dt);
    way = wanted + x - *p;
    after = speed + xd;
    if (!isfinite(xd) || !(fabs(way) <= V * dt * (1 + 1e-9))) return 0;
    if (!(fabs(way - dt * (*v + after) / 2) <= A * dt * dt / 4 * (1 + 1e-6) + SLACK)) return 0;
    *p = wanted + x;
    *v = after;
    return 1;
}

static int safe(double p, double v, const double *row) {
    double end = p + v * fabs(v) / (2 * row[P_A]);
    return (v >= 0 ? p : end) >= row[P_LOWER] - SLACK && (v >= 0 ? end : p) <= row[P_UPPER] + SLACK &&
           fabs(v) <= row[P_V] * (1 + 1e-9);
}

/* PositionGuard._towards */
static int towards(double *p, double *v, double wanted, double speed, double acceleration, const double *row, double dt) {
    double V = row[P_V], A = row[P_A], u;
    if (speed != 0.0) {
        double room = speed > 0 ? row[P_UPPER] - wanted : wanted - row[P_LOWER];
        double most = least_of(room <= 0 ? 0.0 : sqrt(2 * A * room), V);
        if (fabs(speed) > most) speed = copysign(most, speed), acceleration = 0.0;
    }
    if (reach(*p, *v, wanted, speed, V, A, dt, &u) && safe(wanted, u, row)) {
        *p = wanted;
        *v = u;
        return 1;
    }
    const double tries[3][2] = {{speed, acceleration}, {speed, 0.0}, {0.0, 0.0}};
    for (int k = 0; k < 3; k++) {
        double q = *p, qd = *v;
        if (k && tries[k][0] == tries[k - 1][0] && tries[k][1] == tries[k - 1][1]) continue;
        if (!planned(&q, &qd, wanted, tries[k][0], tries[k][1], row, dt) || !safe(q, qd, row)) continue;
        *p = q;
        *v = qd;
        return 1;
    }
    return 0;
}

static int position_step(double *const *a, int n, double dt, int told) {
    const double *wanted = a[0], *rates = a[1], *limits = a[2], *tolerance = a[3];
    double *state = a[4], *applied = a[5], *velocity = a[6], next[MOST_JOINTS * P_STATE];
    if (!ordinary(wanted, n) || (told && !ordinary(rates, n)) || !ordinary(state, P_STATE * n)) return RARE;
    if (!(dt > 0.0)) return RARE;
    for (int i = 0; i < n; i++) {
        const double *row = limits + P_WIDE * i, *now = state + P_STATE * i;
        double *after = next + P_STATE * i, low = row[P_LOWER], high = row[P_UPPER], step = row[P_A] * dt;
        double target = wanted[i] < low ? low : wanted[i] > high ? high : wanted[i], raw, change, speed, acceleration;
        /* PositionGuard._motion */
        raw = !told ? (target - now[P_TARGET]) / dt : target == wanted[i] ? rates[i] : 0.0;
        change = raw - now[P_RAW];
        after[P_TARGET] = target;
        after[P_RAW] = raw;
        if (fabs(change) <= step) {
            after[P_RATE] = raw;
            speed = told ? raw : raw + change / 2;
            acceleration = change / dt;
        } else {
            after[P_RATE] = least_of(most_of(raw, now[P_RATE] - step), now[P_RATE] + step);
            speed = told ? raw : after[P_RATE];
            acceleration = 0.0;
        }
        after[P_POSITION] = now[P_POSITION];
        after[P_SPEED] = now[P_SPEED];
        if (!towards(after + P_POSITION, after + P_SPEED, target, speed, acceleration, row, dt)) return RARE;
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
