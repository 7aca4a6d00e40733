/* control/cobot/moca_impedance.py: eqs. 2 to 9. A load that comes or goes is Python's. */
#include <string.h>

#include "chain.h"
#include "rotation.h"
#include "whole_body.h"

#define NEAR 1e-6
#define DAMPING 1e-6
#define SELDOM 10
#define SLOWEST 1.0
#define HELD_BACK 0.1

typedef struct {
    double stiffness[6], ratio, unit_mass;
    double base[2], arm[2], posture[2]; /* of manipulation, locomotion */
    double blend, mass, inertia, base_damping, accelerates, acceleration[3];
    double weight, coriolis, carries; /* weight: the arm's own is compensated here; carries: a load may come */
    double gravity[3], quickest;
} Options;

typedef struct {
    double turn[3], damping[36], age, factors[2];
    Priority priority;
    double load;
    double cycles, held_back, singular, strongest; /* figures: may be infinite */
} State;

/* Equations.damped (shared/spd6.py). Returns 0 where A isn't finite. */
static int damped(double A[6][6], const double *b, double *x, double *independence) {
    Factors f;
    double det = 1.0, diagonal = 1.0;
    factorise(&f, A);
    for (int i = 0; i < 6; i++) det *= f.L[i][i], diagonal *= A[i][i];
    *independence = most_of(det, 0.0) / (diagonal != 0.0 ? diagonal : 1.0);
    if (!isfinite(*independence)) return 0;
    if (*independence < NEAR) {
        double away = 1.0 - *independence / NEAR;
        for (int i = 0; i < 6; i++) A[i][i] *= 1.0 + DAMPING * away * away;
        factorise(&f, A);
    }
    solve(&f, b, x);
    return 1;
}

/* Eigenvalues w and vectors (columns of V) of a symmetric matrix, by Jacobi's rotations. */
static int eigen(double A[6][6], double *w, double V[6][6]) {
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) V[i][j] = i == j;
    for (int sweep = 0; sweep < 60; sweep++) {
        double off = 0.0;
        for (int i = 0; i < 6; i++)
            for (int j = 0; j < i; j++) off += A[i][j] != 0.0;
        if (off == 0.0) {
            for (int i = 0; i < 6; i++) w[i] = A[i][i];
            return 1;
        }
        for (int p = 0; p < 5; p++)
            for (int q = p + 1; q < 6; q++) {
                double apq = A[p][q];
                if (apq == 0.0) continue;
                if (fabs(apq) <= 1e-17 * sqrt(fabs(A[p][p])) * sqrt(fabs(A[q][q]))) {
                    A[p][q] = A[q][p] = 0.0;
                    continue;
                }
                double theta = (A[q][q] - A[p][p]) / (2 * apq);
                double t = copysign(1.0, theta) / (fabs(theta) + sqrt(theta * theta + 1.0));
                double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
                A[p][p] -= t * apq;
                A[q][q] += t * apq;
                A[p][q] = A[q][p] = 0.0;
                for (int k = 0; k < 6; k++) {
                    if (k != p && k != q) {
                        double akp = A[k][p], akq = A[k][q];
                        A[k][p] = A[p][k] = c * akp - s * akq;
                        A[k][q] = A[q][k] = s * akp + c * akq;
                    }
                    double vkp = V[k][p], vkq = V[k][q];
                    V[k][p] = c * vkp - s * vkq;
                    V[k][q] = s * vkp + c * vkq;
                }
            }
    }
    return 0;
}

/* B = M^-1 J_a^T (n x 6) and S = J_a B. */
static void arm_mobility(const double *J, const double *inverse, int n, double B[MOST_JOINTS][6], double S[6][6]) {
    int wide = 3 + n;
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 6; k++) {
            double sum = 0.0;
            for (int j = 0; j < n; j++) sum += inverse[n * i + j] * J[wide * k + 3 + j];
            B[i][k] = sum;
        }
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 6; k++) {
            double sum = 0.0;
            for (int j = 0; j < n; j++) sum += J[wide * i + 3 + j] * B[j][k];
            S[i][k] = sum;
        }
}

/* ModalDamping. Returns 0 where it isn't found. */
static int modal(const Options *o, const double *J, int n, const double *inverse, double *D) {
    double B[MOST_JOINTS][6], S[6][6], A[6][6], V[6][6], w[6], root[6], shapes[6][6];
    arm_mobility(J, inverse, n, B, S);
    add_base(S, J, 3 + n, 1.0 / o->mass, 1.0 / o->inertia);
    for (int i = 0; i < 6; i++) root[i] = sqrt(o->stiffness[i]);
    for (int i = 0; i < 6; i++)
        for (int j = 0; j <= i; j++) {
            A[i][j] = A[j][i] = root[j] * S[i][j] * root[i];
            if (!isfinite(A[i][j])) return 0;
        }
    if (!eigen(A, w, V)) return 0;
    for (int k = 0; k < 6; k++) w[k] = sqrt(most_of(w[k], SLOWEST * SLOWEST));
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 6; k++) shapes[i][k] = V[i][k] * root[i];
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            double sum = 0.0;
            for (int k = 0; k < 6; k++) sum += 2 * o->ratio * shapes[i][k] / w[k] * shapes[j][k];
            D[6 * i + j] = sum;
        }
    return 1;
}

enum { Q, QD, BASE_POSE, POSE, TWIST, JACOBIAN, WANTED_POSE, WANTED_TWIST, MODES, APPLIED, APPLIED_BASE, P_STIFFNESS,
       P_DAMPING, OPTIONS, JOINTS, BODIES, LOADED, ARMATURE, MOVED, STATE, POSTURES, TORQUE, BASE_TWIST, FORCE };

static int step(double *const *a, int n, double dt, int flag) {
    const double *q = a[Q], *qd = a[QD], *J = a[JACOBIAN], *modes = a[MODES], *last = a[LOADED];
    const double *pose = a[POSE], *wanted = a[WANTED_POSE];
    const Options *o = (const Options *)a[OPTIONS];
    State next = *(const State *)a[STATE], *s = &next;
    double inverse[MOST_JOINTS * MOST_JOINTS], B[MOST_JOINTS][6], S[6][6], A[6][6], b[6], y[6], F[6], away[6], slip[6];
    double postures[3 * MOST_JOINTS], *preferred = postures, null[MOST_JOINTS], weights[MOST_JOINTS];
    double still[MOST_JOINTS] = {0}, independence, changed = 0.0;
    int wide = 3 + n, locomotion = modes[3] > 0.5, closed = modes[2] > 0.5;
    Chain chain;
    (void)flag;
    if (!ordinary(q, n) || !ordinary(qd, n) || !ordinary(a[BASE_POSE], 3) || !ordinary(pose, 7)) return RARE;
    if (!ordinary(a[TWIST], 6) || !ordinary(J, 6 * wide) || !ordinary(wanted, 7)) return RARE;
    if (!ordinary(a[WANTED_TWIST], 6) || !ordinary(modes, 4) || !ordinary(a[APPLIED], n)) return RARE;
    if (!ordinary(a[APPLIED_BASE], 3) || !ordinary(a[P_STIFFNESS], 1) || !ordinary(a[P_DAMPING], 1)) return RARE;
    if (!ordinary((const double *)s, COUNT(State) - 4) || !ordinary(a[POSTURES], 3 * n)) return RARE;
    if (!ordinary(a[TORQUE], n)) return RARE; /* of the cycle before, for `held_back` */
    if (o->carries != 0.0 && (closed ? s->load < 1.0 : s->load > 0.0)) return RARE;

    /* _watch */
    s->cycles += 1.0;
    for (int i = 0; i < n; i++) changed = most_of(changed, fabs(a[APPLIED][i] - a[TORQUE][i]));
    s->held_back += changed > HELD_BACK;

    /* Priority.update */
    memcpy(postures, a[POSTURES], 3 * n * sizeof *q);
    prefer(&s->priority, postures, locomotion, q, n, o->blend > 0.0 ? dt / o->blend : 1.0);
    ramp(&s->factors[0], a[P_STIFFNESS][0], o->quickest, o->quickest, dt);
    ramp(&s->factors[1], a[P_DAMPING][0], o->quickest, o->quickest, dt);

    /* _step: M_a^-1, S, F */
    static const double upright[PLACE] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};
    forward(&chain, upright, a[JOINTS], q, n);
    if (!inverse_mass(&chain, a[BODIES], last, a[ARMATURE], n, inverse)) return RARE;
    arm_mobility(J, inverse, n, B, S);
    for (int i = 0; i < 3; i++) away[i] = wanted[i] - pose[i];
    Vector turn = log_nearest(product(turn_at(wanted + 3), conjugate(turn_at(pose + 3))), at(s->turn));
    s->turn[0] = away[3] = turn.x;
    s->turn[1] = away[4] = turn.y;
    s->turn[2] = away[5] = turn.z;
    if (o->unit_mass == 0.0) {
        if (s->age == 0.0) {
            double moved[MOST_JOINTS * MOST_JOINTS];
            if (!inverse_mass(&chain, a[BODIES], last, a[MOVED], n, moved)) return RARE;
            if (!modal(o, J, n, moved, s->damping)) return RARE;
        }
        s->age = s->age + 1.0 >= SELDOM ? 0.0 : s->age + 1.0;
    }
    double k = s->factors[0], d = s->factors[1] * sqrt(k);
    for (int i = 0; i < 6; i++) slip[i] = a[WANTED_TWIST][i] - a[TWIST][i];
    for (int i = 0; i < 6; i++) {
        double sum = 0.0;
        for (int j = 0; j < 6; j++) sum += s->damping[6 * i + j] * slip[j];
        F[i] = k * o->stiffness[i] * away[i] + d * sum;
    }

    /* _posture */
    double K0 = between(s->priority.level, o->posture), D0 = 2 * o->ratio * sqrt(K0);
    for (int i = 0; i < n; i++) null[i] = K0 * (preferred[i] - q[i]) - D0 * qd[i];

    /* WeightedTorque */
    double eta_B = between_ratios(s->priority.level, o->base), eta_A = between_ratios(s->priority.level, o->arm);
    double w_b = 1.0 / (eta_B * eta_B), w_a = 1.0 / (eta_A * eta_A), m = 1.0 / o->mass, j_v = 1.0 / o->inertia;
    double u = J[2], v = J[wide + 2], turning = j_v * (u * F[0] + v * F[1] + F[5]);
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 6; j++) A[i][j] = w_a * S[i][j];
        b[i] = 0.0;
        for (int j = 0; j < 6; j++) b[i] += S[i][j] * F[j];
        for (int j = 0; j < n; j++) b[i] -= null[j] * B[j][i];
    }
    add_base(A, J, wide, w_b * m, w_b * j_v);
    b[0] += m * F[0] + u * turning;
    b[1] += m * F[1] + v * turning;
    b[5] += turning;
    if (!damped(A, b, y, &independence)) return RARE;
    for (int i = 0; i < n; i++) {
        double sum = 0.0;
        for (int j = 0; j < 6; j++) sum += y[j] * J[wide * j + 3 + i];
        null[i] += w_a * sum;
    }
    double tau_v[3] = {w_b * y[0], w_b * y[1], w_b * (u * y[0] + v * y[1] + y[5])};

    /* ArmDynamics.bias; last[BODY]: whether a load hangs there */
    const double *bodies = a[BODIES], none[3] = {0}, *turning_too = o->coriolis != 0.0 ? qd : still;
    int hangs = last[BODY] != 0.0;
    bias(&chain, bodies, last, turning_too, o->weight != 0.0 || hangs ? o->gravity : none, n, weights);
    for (int i = 0; i < n; i++) null[i] += weights[i];
    if (o->weight == 0.0 && hangs) {
        bias(&chain, bodies, bodies + BODY * (n - 1), still, o->gravity, n, weights);
        for (int i = 0; i < n; i++) null[i] -= weights[i];
    }
    s->singular += independence < NEAR;
    s->strongest = most_of(s->strongest, sqrt(F[0] * F[0] + F[1] * F[1] + F[2] * F[2]));
    if (!ordinary(null, n) || !ordinary(F, 6) || !ordinary(tau_v, 3)) return RARE;

    /* _move_base */
    double decay = 1.0 / (1.0 + dt * o->base_damping), yaw = a[BASE_POSE][2], c = cos(yaw), z = sin(yaw);
    double before[3] = {a[APPLIED_BASE][0], a[APPLIED_BASE][1], a[APPLIED_BASE][2]};
    double x = decay * (c * before[0] - z * before[1] + dt / o->mass * tau_v[0]);
    double w = decay * (z * before[0] + c * before[1] + dt / o->mass * tau_v[1]);
    double twist[3] = {c * x + z * w, c * w - z * x, decay * (before[2] + dt / o->inertia * tau_v[2])};
    if (o->accelerates != 0.0)
        for (int i = 0; i < 3; i++) {
            double most = dt * o->acceleration[i], change = twist[i] - before[i];
            if (fabs(change) > most) twist[i] = before[i] + copysign(most, change);
        }

    *(State *)a[STATE] = next;
    memcpy(a[POSTURES], postures, 3 * n * sizeof *q);
    memcpy(a[TORQUE], null, n * sizeof *q);
    memcpy(a[BASE_TWIST], twist, sizeof twist);
    memcpy(a[FORCE], F, sizeof F);
    return DONE;
}

static const Arg args[] = {
    {"q", 0, 1, 0}, {"qd", 0, 1, 0}, {"base_pose", 3, 0, 0}, {"pose", 7, 0, 0}, {"twist", 6, 0, 0},
    {"jacobian", 18, 6, 0}, {"desired_pose", 7, 0, 0}, {"desired_twist", 6, 0, 0}, {"modes", 4, 0, 0},
    {"applied torque", 0, 1, 0}, {"applied twist", 3, 0, 0}, {"stiffness", 1, 0, 0}, {"damping", 1, 0, 0},
    {"options", COUNT(Options), 0, 0}, {"joints", 0, PLACE, 0}, {"bodies", 0, BODY, 0}, {"last body", BODY + 1, 0, 0},
    {"armature", 0, 1, 0}, {"moved armature", 0, 1, 0}, {"state", COUNT(State), 0, 1}, {"postures", 0, 3, 1},
    {"torque", 0, 1, 1}, {"base_twist", 3, 0, 1}, {"force", 6, 0, 1}, {NULL, 0, 0, 0},
};
const Law moca_impedance = {"moca-impedance", step, args};
