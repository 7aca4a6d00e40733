/* control/cobot/kairos_clik.py: eqs. 10 to 17; and contact_compliance.py, where the load is identified. */
#include <string.h>

#include "law.h"
#include "rotation.h"
#include "whole_body.h"

#define LATELY 0.1
#define BASE 3

typedef struct {
    double gain[6], firm[6]; /* K; W_1^-1 */
    double damping, manipulability;
    double base[2], arm[2], posture[2]; /* of manipulation, locomotion */
    double blend, quickest;
    double arm_bound, acceleration, base_bound, base_speed[BASE], base_held, base_acceleration[BASE]; /* 0: unbounded */
    double complies, mass[6], damper[6], stiffness[6], load_time, open[2], carrying[2], firmness[2], release;
} Options;

typedef struct { double firmness, pushed[3]; } Against;

typedef struct {
    double turn[3], factors[2]; /* speed, gain */
    Priority priority;
    double share, quiet;
    Against against[2];
    double yielding[6], deviation[6];
    double velocity[6], contact[6]; /* of the contact: written before they are read */
    double cycles, damped, slowed, least; /* figures: may be infinite */
} State;

#define UNREAD 16 /* of State, the last ones */

/* sqrt(det(J_a J_a^T)): what Householder's reflections leave of J_a^T on its diagonal. */
static double manipulability(const double *J, int n) {
    double A[MOST_JOINTS][6], found = 1.0;
    if (n < 6) return 0.0;
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 6; k++) A[i][k] = J[(BASE + n) * k + BASE + i];
    for (int k = 0; k < 6; k++) {
        double size = 0.0, square = 0.0;
        for (int i = k; i < n; i++) size += A[i][k] * A[i][k];
        size = sqrt(size);
        found *= size;
        if (size == 0.0) break;
        A[k][k] += copysign(size, A[k][k]);
        for (int i = k; i < n; i++) square += A[i][k] * A[i][k];
        for (int j = k + 1; j < 6; j++) {
            double sum = 0.0;
            for (int i = k; i < n; i++) sum += A[i][k] * A[i][j];
            sum *= 2.0 / square;
            for (int i = k; i < n; i++) A[i][j] -= sum * A[i][k];
        }
    }
    return found;
}

/* w_a J_a^T y, with y of (w_a G + W_1^-1 [+ the base's part]) y = b. */
static void share_out(const Options *o, const double *J, int n, double G[6][6], double w_a, double w_b, const double *b,
                      double *y, double *arm) {
    double A[6][6];
    Factors f;
    int wide = BASE + n;
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 6; j++) A[i][j] = w_a * G[i][j];
        A[i][i] += o->firm[i];
    }
    if (w_b > 0.0) add_base(A, J, wide, w_b, w_b);
    factorise(&f, A);
    solve(&f, b, y);
    for (int i = 0; i < n; i++) {
        double sum = 0.0;
        for (int k = 0; k < 6; k++) sum += y[k] * J[wide * k + BASE + i];
        arm[i] = w_a * sum;
    }
}

static double square(const double *v) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; }

/* As admittance.beyond. */
static void beyond(const double *v, double band, double *found) {
    double size = sqrt(square(v)), k = size <= band ? 0.0 : 1.0 - band / size;
    for (int i = 0; i < 3; i++) found[i] = size <= band ? 0.0 : k * v[i];
}

/* _Against.take */
static void keep_from(Against *s, double firm, double release, const double *f, const double *motion, double dt,
                      double *taken) {
    double size = sqrt(square(f)), *p = s->pushed;
    s->firmness = most_of(release / (release + dt) * s->firmness, least_of(size / firm, 1.0));
    if (size > 0.0) {
        double fade = LATELY / (LATELY + dt);
        for (int i = 0; i < 3; i++) p[i] = fade * p[i] + dt * f[i];
    }
    size = square(p);
    taken[0] = taken[1] = taken[2] = 0.0;
    if (size == 0.0) return;
    double inward = s->firmness * least_of(p[0] * motion[0] + p[1] * motion[1] + p[2] * motion[2], 0.0) / size;
    for (int i = 0; i < 3; i++) taken[i] = -inward * p[i];
}

/* ContactCompliance.update for the contact `whole`, with the desired twist. */
static void comply(const Options *o, State *s, const double *whole, const double *desired, int closed, double dt) {
    double part = dt / o->load_time, taken[6], *e = s->deviation, *v = s->yielding;
    int felt = square(whole) > o->open[0] * o->open[0] || square(whole + 3) > o->open[1] * o->open[1];
    s->quiet = felt ? 0.0 : s->quiet + dt;
    if (closed)
        s->share = least_of(s->share + part, 1.0);
    else if (s->share < 1.0 || s->quiet >= o->load_time)
        s->share = most_of(s->share - part, 0.0);
    for (int k = 0; k < 2; k++) {
        double *f = s->contact + 3 * k;
        beyond(whole + 3 * k, o->open[k] + s->share * (o->carrying[k] - o->open[k]), f);
        keep_from(&s->against[k], o->firmness[k], o->release, f, desired + 3 * k, dt, taken + 3 * k);
    }
    for (int i = 0; i < 6; i++) {
        double M = o->mass[i], D = o->damper[i], K = o->stiffness[i];
        v[i] = (v[i] + dt / M * (s->contact[i] - K * e[i])) / (1.0 + dt / M * (D + dt * K));
        s->velocity[i] = v[i] + taken[i];
        e[i] += dt * s->velocity[i];
    }
}

/* _slow_down; `base` NULL: at rest. Returns 0 where a limit is zero. */
static int slow_down(const Options *o, State *s, const double *fastest, double *arm, int n, double *base) {
    double share = 1.0, k = s->factors[0];
    for (int i = 0; o->arm_bound != 0.0 && i < n; i++) {
        double most = k * fastest[i];
        if (most == 0.0) return 0;
        share = most_of(share, fabs(arm[i]) / most);
    }
    for (int i = 0; o->base_bound != 0.0 && i < BASE; i++) {
        double most = k * o->base_speed[i];
        if (most == 0.0) return 0;
        if (base) share = most_of(share, fabs(base[i]) / most);
    }
    if (share == 1.0) return 1;
    s->slowed += 1.0;
    for (int i = 0; i < n; i++) arm[i] = arm[i] / share;
    for (int i = 0; base && i < BASE; i++) base[i] = base[i] / share;
    return 1;
}

enum { Q, BASE_POSE, POSE, JACOBIAN, WANTED_POSE, WANTED_TWIST, MODES, OUTSIDE, APPLIED, APPLIED_BASE, P_SPEED, P_GAIN,
       OPTIONS, FASTEST, STATE, POSTURES, VELOCITY, BASE_TWIST, MANIPULABILITY, CONTACT };

static int step(double *const *a, int n, double dt, int flag) {
    const double *q = a[Q], *pose = a[POSE], *J = a[JACOBIAN], *wanted = a[WANTED_POSE], *modes = a[MODES];
    const Options *o = (const Options *)a[OPTIONS];
    State next = *(const State *)a[STATE], *s = &next;
    double postures[3 * MOST_JOINTS], arm[MOST_JOINTS], base[BASE], second[MOST_JOINTS], late[BASE] = {0};
    double G[6][6], twist[6], task[6], y[6], away[6], add[MOST_JOINTS];
    int wide = BASE + n, complies = o->complies != 0.0;
    (void)flag;
    if (!ordinary(q, n) || !ordinary(a[BASE_POSE], 3) || !ordinary(pose, 7) || !ordinary(J, 6 * wide)) return RARE;
    if (!ordinary(wanted, 7) || !ordinary(a[WANTED_TWIST], 6) || !ordinary(modes, 4)) return RARE;
    if (!ordinary(a[OUTSIDE], 6) || !ordinary(a[APPLIED], n) || !ordinary(a[APPLIED_BASE], BASE)) return RARE;
    if (!ordinary(a[P_SPEED], 1) || !ordinary(a[P_GAIN], 1) || !ordinary(a[POSTURES], 3 * n)) return RARE;
    if (!ordinary((const double *)s, COUNT(State) - UNREAD)) return RARE;

    /* update */
    s->cycles += 1.0;
    ramp(&s->factors[0], a[P_SPEED][0], o->quickest, o->quickest, dt);
    ramp(&s->factors[1], a[P_GAIN][0], o->quickest, o->quickest, dt);
    memcpy(postures, a[POSTURES], 3 * n * sizeof *q);
    prefer(&s->priority, postures, modes[3] > 0.5, q, n, o->blend > 0.0 ? dt / o->blend : 1.0);

    /* _damping */
    double w = manipulability(J, n), k = 1.0;
    s->least = least_of(s->least, w);
    if (w < o->manipulability) {
        double near = 1.0 - w / o->manipulability;
        k = 1.0 + o->damping * near * near;
        s->damped += 1.0;
    }
    double w_b = 1.0 / between_ratios(s->priority.level, o->base);
    double w_a = 1.0 / (between_ratios(s->priority.level, o->arm) * k * k);

    /* _task */
    Quaternion actual = turn_at(pose + 3), desired = turn_at(wanted + 3);
    memcpy(twist, a[WANTED_TWIST], sizeof twist);
    for (int i = 0; i < 3; i++) away[i] = wanted[i];
    if (complies) {
        Vector turning = turned(exponential(at(s->deviation + 3)), at(twist + 3));
        twist[3] = turning.x, twist[4] = turning.y, twist[5] = turning.z;
        comply(o, s, a[OUTSIDE], twist, modes[2] > 0.5, dt);
        for (int i = 0; i < 3; i++) away[i] = away[i] + s->deviation[i];
        desired = product(exponential(at(s->deviation + 3)), desired);
        for (int i = 0; i < 6; i++) twist[i] = twist[i] + s->velocity[i];
    }
    Vector turn = log_nearest(product(desired, conjugate(actual)), at(s->turn));
    for (int i = 0; i < 3; i++) away[i] -= pose[i];
    s->turn[0] = away[3] = turn.x, s->turn[1] = away[4] = turn.y, s->turn[2] = away[5] = turn.z;
    for (int i = 0; i < 6; i++) task[i] = twist[i] + s->factors[1] * o->gain[i] * away[i];

    /* _step */
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            double sum = 0.0;
            for (int m = 0; m < n; m++) sum += J[wide * i + BASE + m] * J[wide * j + BASE + m];
            G[i][j] = sum;
        }
    double k_i = between(s->priority.level, o->posture);
    for (int i = 0; i < n; i++) second[i] = k_i > 0.0 ? k_i * (postures[i] - q[i]) : 0.0;
    for (int i = 0; k_i > 0.0 && i < 6; i++) {
        double sum = 0.0;
        for (int m = 0; m < n; m++) sum += J[wide * i + BASE + m] * second[m];
        task[i] -= sum;
    }
    share_out(o, J, n, G, w_a, w_b, task, y, arm);
    for (int i = 0; k_i > 0.0 && i < n; i++) arm[i] = second[i] + arm[i];
    double u = J[2], v = J[wide + 2], c = cos(a[BASE_POSE][2]), z = sin(a[BASE_POSE][2]);
    double vx = w_b * y[0], vy = w_b * y[1];
    base[0] = c * vx + z * vy, base[1] = c * vy - z * vx, base[2] = w_b * (u * y[0] + v * y[1] + y[5]);

    /* _send */
    if (!slow_down(o, s, a[FASTEST], arm, n, base)) return RARE;
    for (int i = 0; o->base_held != 0.0 && i < BASE; i++) {
        double old = a[APPLIED_BASE][i], most = dt * o->base_acceleration[i];
        late[i] = base[i] - least_of(most_of(base[i], old - most), old + most);
    }
    if (late[0] != 0.0 || late[1] != 0.0 || late[2] != 0.0) {
        vx = c * late[0] - z * late[1], vy = z * late[0] + c * late[1];
        double missing[6] = {vx + u * late[2], vy + v * late[2], 0.0, 0.0, 0.0, late[2]};
        share_out(o, J, n, G, w_a, 0.0, missing, y, add);
        for (int i = 0; i < n; i++) arm[i] = arm[i] + add[i];
        if (!slow_down(o, s, a[FASTEST], arm, n, NULL)) return RARE;
        for (int i = 0; i < BASE; i++) base[i] = base[i] - late[i];
    }
    if (o->acceleration != 0.0 && dt != 0.0) { /* _eased */
        const double *last = a[APPLIED];
        double most = o->acceleration * dt, share = 0.0;
        if (most == 0.0) return RARE;
        for (int i = 0; i < n; i++) share = most_of(share, fabs(arm[i] - last[i]));
        share = share / most;
        for (int i = 0; share > 1.0 && i < n; i++) arm[i] = last[i] + (arm[i] - last[i]) / share;
    }
    if (!ordinary(arm, n) || !ordinary(base, BASE) || !ordinary(&w, 1) || !ordinary(task, 6) || !ordinary(y, 6))
        return RARE;
    if (!ordinary((const double *)s, COUNT(State) - 4)) return RARE;

    *(State *)a[STATE] = next;
    memcpy(a[POSTURES], postures, 3 * n * sizeof *q);
    memcpy(a[VELOCITY], arm, n * sizeof *q);
    memcpy(a[BASE_TWIST], base, sizeof base);
    a[MANIPULABILITY][0] = w;
    if (complies) memcpy(a[CONTACT], s->contact, sizeof s->contact);
    return DONE;
}

static const Arg args[] = {
    {"q", 0, 1, 0}, {"base_pose", 3, 0, 0}, {"pose", 7, 0, 0}, {"jacobian", 18, 6, 0}, {"desired_pose", 7, 0, 0},
    {"desired_twist", 6, 0, 0}, {"modes", 4, 0, 0}, {"outside", 6, 0, 0}, {"applied velocity", 0, 1, 0},
    {"applied twist", BASE, 0, 0}, {"speed", 1, 0, 0}, {"gain", 1, 0, 0}, {"options", COUNT(Options), 0, 0},
    {"fastest", 0, 1, 0}, {"state", COUNT(State), 0, 1}, {"postures", 0, 3, 1}, {"velocity", 0, 1, 1},
    {"base_twist", BASE, 0, 1}, {"manipulability", 1, 0, 1}, {"contact", 6, 0, 1}, {NULL, 0, 0, 0},
};
const Law kairos_clik = {"kairos-clik", step, args};
