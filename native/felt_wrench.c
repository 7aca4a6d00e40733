/* sim/devices/panda/felt.py: what a robot's controller makes of its joints' external torques. */
#include <string.h>

#include "chain.h"

#define ROUNDING 1e-4 /* added to J J^T: near a singularity some forces can't be estimated */

/* Solves S x = b for a symmetric, positive definite S, in place of both. Returns 0 where it isn't. */
static int solve(double S[6][6], double *b) {
    for (int j = 0; j < 6; j++) { /* Cholesky: S = L L^T */
        double d = S[j][j];
        for (int k = 0; k < j; k++) d -= S[j][k] * S[j][k];
        if (!(d > 0.0)) return 0;
        d = S[j][j] = sqrt(d);
        for (int i = j + 1; i < 6; i++) {
            double sum = S[i][j];
            for (int k = 0; k < j; k++) sum -= S[i][k] * S[j][k];
            S[i][j] = sum / d;
        }
    }
    for (int i = 0; i < 6; i++) {
        for (int k = 0; k < i; k++) b[i] -= S[i][k] * b[k];
        b[i] /= S[i][i];
    }
    for (int i = 5; i >= 0; i--) {
        for (int k = i + 1; k < 6; k++) b[i] -= S[k][i] * b[k];
        b[i] /= S[i][i];
    }
    return 1;
}

/* `flag`: whether the desired motion accelerates, for which there are thresholds of its own. */
static int step(double *const *a, int n, double dt, int flag) {
    const double *q = a[0], *torque = a[1], *filter = a[2], *joints = a[3], *mount = a[4], *tool = a[5], *point = a[6];
    const double *thresholds = a[7] + (flag ? 2 * (n + 6) : 0);
    double *external = a[8], *wrench = a[9], *pose = a[10], *touching = a[11];
    static const double base[PLACE] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};
    double last[PLACE], end[PLACE], at[3], felt[MOST_JOINTS], J[6][MOST_JOINTS], S[6][6], found[6];
    Chain chain;
    (void)dt;
    if (!ordinary(q, n) || !ordinary(torque, n) || !ordinary(external, n)) return RARE;
    for (int k = 0; k < n; k++) felt[k] = external[k] + filter[0] * (torque[k] - external[k]);
    forward(&chain, base, joints, q, n);
    memcpy(last, chain.turn[n - 1], 9 * sizeof *last);
    memcpy(last + 9, chain.at[n - 1], 3 * sizeof *last);
    compose(last, mount, end);
    compose(end, tool, end);
    for (int i = 0; i < 3; i++)
        at[i] = end[3 * i] * point[0] + end[3 * i + 1] * point[1] + end[3 * i + 2] * point[2] + end[9 + i];
    for (int k = 0; k < n; k++) {
        double z[3], r[3];
        for (int i = 0; i < 3; i++) z[i] = chain.turn[k][3 * i + 2], r[i] = at[i] - chain.at[k][i];
        J[0][k] = z[1] * r[2] - z[2] * r[1];
        J[1][k] = z[2] * r[0] - z[0] * r[2];
        J[2][k] = z[0] * r[1] - z[1] * r[0];
        for (int i = 0; i < 3; i++) J[3 + i][k] = z[i];
    }
    for (int i = 0; i < 6; i++) {
        found[i] = 0.0;
        for (int k = 0; k < n; k++) found[i] += J[i][k] * felt[k];
        for (int j = 0; j <= i; j++) {
            S[i][j] = i == j ? ROUNDING : 0.0;
            for (int k = 0; k < n; k++) S[i][j] += J[i][k] * J[j][k];
        }
    }
    if (!solve(S, found)) return RARE;
    memcpy(external, felt, n * sizeof *felt);
    memcpy(wrench, found, sizeof found);
    for (int i = 0; i < 3; i++) {
        memcpy(pose + 4 * i, end + 3 * i, 3 * sizeof *pose);
        pose[4 * i + 3] = end[9 + i];
        pose[12 + i] = 0.0;
    }
    pose[15] = 1.0;
    for (int bound = 0; bound < 2; bound++)
        for (int k = 0; k < n + 6; k++)
            touching[bound * (n + 6) + k] = fabs(k < n ? felt[k] : found[k - n]) > thresholds[bound * (n + 6) + k];
    return DONE;
}

static const Arg args[] = {
    {"q", 0, 1, 0}, {"torque", 0, 1, 0}, {"filter", 1, 0, 0}, {"joints", 0, PLACE, 0}, {"mount", PLACE, 0, 0},
    {"tool", PLACE, 0, 0}, {"point", 3, 0, 0}, {"thresholds", 24, 4, 0},
    {"external", 0, 1, 1}, {"wrench", 6, 0, 1}, {"pose", 16, 0, 1}, {"touching", 12, 2, 1}, {NULL, 0, 0, 0},
};
const Law felt_wrench = {"felt-wrench", step, args};
