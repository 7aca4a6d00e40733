/* control/cobot/admittance.py, virtual_mass.py, energy_tank.py, release.py: the same order of operations, so the
 * same bits. A force that isn't finite and `force_age` are Python's. */
#include <string.h>

#include "law.h"
#include "rotation.h"

typedef struct {
    double sensor_at[3], sensor_turn[4], bias[6], weight, com[3], dead_band[2];
    double mass[6], damping[6];
    double leash, distance, stiffness, angle, rotational_stiffness; /* leash: whether there is one */
    double tank, size, most_brake;
    double release, deceleration[2], settle, onset;
    double draw, draw_time;
    double slowest, longest, quickest;
} Options;

typedef struct {
    double velocity[6], position[3], orientation[4];
    double factors[3]; /* scale, damping, leash */
    double level, brake, emptied;
    double releases[2], draws[2], ahead[3], leashed;
} State;

#define SMALL 1e-2
#define FULL 0.5
#define DEBT 5.0
#define FADING 2.0

static void factors_of(double h, double m, double d, double *f) {
    double x = h * d / m, first, second, e = exp(-x);
    if (x < SMALL) {
        first = 1 - x * (1.0 / 2 - x * (1.0 / 6 - x * (1.0 / 24 - x * (1.0 / 120 - x / 720))));
        second = 1.0 / 2 - x * (1.0 / 6 - x * (1.0 / 24 - x * (1.0 / 120 - x * (1.0 / 720 - x / 5040))));
    } else {
        first = -expm1(-x) / x;
        second = (1 - first) / x;
    }
    f[0] = e;
    f[1] = h / m * first;
    f[2] = h * first;
    f[3] = h * h / m * second;
}

static Vector beyond(Vector v, double band) {
    double size = length(v), k;
    if (size <= band) return (Vector){0.0, 0.0, 0.0};
    k = 1.0 - band / size;
    return (Vector){k * v.x, k * v.y, k * v.z};
}

/* The wrench F, T that acts at r, about the origin of r. */
static void about(Vector F, Vector T, Vector r, double *found) {
    found[0] = F.x;
    found[1] = F.y;
    found[2] = F.z;
    found[3] = T.x + r.y * F.z - r.z * F.y;
    found[4] = T.y + r.z * F.x - r.x * F.z;
    found[5] = T.z + r.x * F.y - r.y * F.x;
}

static double stretched(Vector away, double free, double stiffness, double mass, double *pull) {
    double size = length(away), stretch, k;
    pull[0] = pull[1] = pull[2] = 0.0;
    if (size <= free) return 0.0;
    stretch = (size - free) / size;
    k = -stiffness * stretch;
    pull[0] = k * away.x;
    pull[1] = k * away.y;
    pull[2] = k * away.z;
    return 2 * sqrt(stiffness * mass) * least_of(1.0, 10 * stretch);
}

static double energy(const double *mass, const double *v) {
    double sum = 0.0;
    for (int i = 0; i < 6; i++) sum += mass[i] * (v[i] * v[i]);
    return sum;
}

static void tank_step(const Options *o, State *s, const double *force, const double *moved, const double *mass,
                      double dt) {
    double power = 0.0, moving, level, wanted;
    for (int i = 0; i < 6; i++) power += force[i] * moved[i];
    moving = 0.5 * most_of(energy(mass, moved), energy(mass, s->velocity));
    level = s->level + dt * power;
    s->level = level = least_of(most_of(level, -DEBT * o->size), o->size + moving);
    wanted = o->most_brake * least_of(most_of(1.0 - level / (FULL * o->size), 0.0), 1.0);
    s->brake = most_of(wanted, s->brake * FADING / (FADING + dt));
    s->emptied += level <= 0.0;
}

static double release_rate(const Options *o, double deceleration, double *level, int released, const double *v,
                           double dt) {
    double step = dt / o->onset;
    *level = released ? least_of(*level + step, 1.0) : most_of(*level - step, 0.0);
    if (*level == 0.0) return 0.0;
    return *level * deceleration / most_of(length(at(v)), deceleration * o->settle);
}

static double draw_share(const Options *o, double *left, int led, Vector ahead, double dt) {
    double size = length(ahead), way;
    if (led) {
        *left = size;
        return 0.0;
    }
    way = least_of((1.0 - exp(-dt / o->draw_time)) * size, *left);
    *left -= way;
    return size > 0.0 ? way / size : 0.0;
}

static int step(double *const *a, int n, double dt, int flag) {
    const double *wrench = a[0], *pose = a[1], *twist = a[2], *modes = a[3];
    const double scale = *a[4], damped = *a[5], leash = *a[6];
    const Options *o = (const Options *)a[7];
    State next = *(const State *)a[8], *s = &next;
    double M[6], D[6], force[6] = {0}, hand[6], f[6];
    int leads = modes[0] > 0.5, turns = leads && modes[1] > 0.5, parts;
    (void)n;
    (void)flag;
    if (!ordinary(wrench, 6) || !ordinary(pose, 7) || !ordinary(twist, 6) || !ordinary(modes, 2)) return RARE;
    if (!ordinary(&scale, 1) || !ordinary(&damped, 1) || !ordinary(&leash, 1)) return RARE;
    if (!ordinary((const double *)s, COUNT(State))) return RARE;

    /* _follow_parameters, _scale */
    double rising = o->slowest * least_of(s->factors[1], damped);
    ramp(&s->factors[0], scale, o->quickest, least_of(o->quickest, rising), dt);
    ramp(&s->factors[1], damped, o->quickest, o->quickest, dt);
    ramp(&s->factors[2], leash, o->quickest, o->quickest, dt);
    for (int i = 0; i < 6; i++) M[i] = s->factors[0] * o->mass[i], D[i] = s->factors[1] * o->damping[i];

    /* _hand */
    Quaternion actual = turn_at(pose + 3), turn = product(actual, turn_at(o->sensor_turn));
    for (int i = 0; i < 6; i++) f[i] = wrench[i] - o->bias[i];
    if (o->weight != 0.0) {
        Vector g = turned(conjugate(turn), (Vector){0.0, 0.0, -o->weight}), c = at(o->com);
        f[0] -= g.x;
        f[1] -= g.y;
        f[2] -= g.z;
        f[3] -= c.y * g.z - c.z * g.y;
        f[4] -= c.z * g.x - c.x * g.z;
        f[5] -= c.x * g.y - c.y * g.x;
    }
    Vector F = turned(turn, at(f)), T = turned(turn, at(f + 3)), r = turned(actual, at(o->sensor_at));
    about(F, T, r, hand);

    if (leads) { /* _felt */
        Vector felt = beyond(F, o->dead_band[0]);
        if (turns)
            about(felt, beyond(T, o->dead_band[1]), r, force);
        else
            force[0] = felt.x, force[1] = felt.y, force[2] = felt.z;
    }
    if (o->tank != 0.0) tank_step(o, s, force, twist, M, dt);

    parts = (int)ceil(dt / o->longest);
    for (int part = 0; part < parts; part++) {
        double h = dt / parts, pull[6] = {0}, drag[6] = {0}, all[6], moved[6], used[6];
        int held = 0;
        if (o->leash != 0.0) { /* _held */
            Vector away = {s->position[0] - pose[0], s->position[1] - pose[1], s->position[2] - pose[2]};
            Vector rotated = log_nearest(product(turn_at(s->orientation), conjugate(actual)), at(s->ahead));
            s->ahead[0] = rotated.x;
            s->ahead[1] = rotated.y;
            s->ahead[2] = rotated.z;
            if (leads) {
                double brakes = stretched(away, s->factors[2] * o->distance, o->stiffness, M[0], pull);
                double slows =
                    stretched(rotated, s->factors[2] * o->angle, o->rotational_stiffness, M[3], pull + 3);
                s->leashed += brakes > 0.0;
                held = !(brakes == 0.0 && slows == 0.0);
                for (int i = 0; i < 3; i++) drag[i] = brakes, drag[3 + i] = slows;
            }
        }
        /* _damping */
        double slow = o->tank != 0.0 ? s->brake / M[0] : 0.0, spin = slow;
        if (o->release != 0.0) {
            slow += release_rate(o, o->deceleration[0], &s->releases[0], !leads, s->velocity, h);
            spin += release_rate(o, o->deceleration[1], &s->releases[1], !turns, s->velocity + 3, h);
        }
        int plain = slow == 0.0 && spin == 0.0 && !held;
        for (int i = 0; i < 6; i++) {
            all[i] = plain ? D[i] : D[i] + drag[i] + M[i] * (i < 3 ? slow : spin);
            used[i] = held ? force[i] + pull[i] : force[i];
        }
        /* VirtualMass.step */
        for (int i = 0; i < 6; i++) {
            double k[4], v = s->velocity[i];
            factors_of(h, M[i], all[i], k);
            moved[i] = k[2] * v + k[3] * used[i];
            s->velocity[i] = k[0] * v + k[1] * used[i];
        }
        for (int i = 0; i < 3; i++) s->position[i] += moved[i];
        Quaternion q = normalised(product(exponential(at(moved + 3)), turn_at(s->orientation)));
        memcpy(s->orientation, &q, sizeof q);
    }
    if (o->draw != 0.0) { /* _draw_in */
        Vector ahead = {s->position[0] - pose[0], s->position[1] - pose[1],
                        least_of(s->position[2] - pose[2], 0.0)};
        Vector about_z = {0.0, 0.0, logarithm(product(turn_at(s->orientation), conjugate(actual))).z};
        double back = -draw_share(o, &s->draws[0], leads, ahead, dt);
        double unwind = -draw_share(o, &s->draws[1], turns, about_z, dt);
        if (back != 0.0 || unwind != 0.0) {
            s->position[0] += back * ahead.x;
            s->position[1] += back * ahead.y;
            s->position[2] += back * ahead.z;
            Quaternion q = normalised(
                product(exponential((Vector){0.0, 0.0, unwind * about_z.z}), turn_at(s->orientation)));
            memcpy(s->orientation, &q, sizeof q);
        }
    }
    *(State *)a[8] = next;
    memcpy(a[9], s->position, 3 * sizeof(double));
    memcpy(a[9] + 3, s->orientation, 4 * sizeof(double));
    memcpy(a[10], s->velocity, 6 * sizeof(double));
    memcpy(a[11], hand, sizeof hand);
    memcpy(a[12], force, sizeof force);
    a[13][0] = o->tank != 0.0 ? s->level : 0.0;
    return DONE;
}

static const Arg args[] = {
    {"wrench", 6, 0, 0}, {"pose", 7, 0, 0}, {"twist", 6, 0, 0}, {"modes", 4, 0, 0},
    {"scale", 1, 0, 0}, {"damping", 1, 0, 0}, {"leash", 1, 0, 0},
    {"options", COUNT(Options), 0, 0}, {"state", COUNT(State), 0, 1},
    {"desired pose", 7, 0, 1}, {"desired twist", 6, 0, 1}, {"hand", 6, 0, 1}, {"force", 6, 0, 1}, {"tank", 1, 0, 1},
    {NULL, 0, 0, 0},
};
const Law admittance = {"admittance", step, args};
