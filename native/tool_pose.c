/* control/cobot/tool_pose.py */
#include <string.h>

#include "chain.h"

/* w x y z, w not negative, of a rotation matrix. */
static void quaternion_of(const double *R, double *q) {
    double trace = R[0] + R[4] + R[8], t;
    if (trace > 0.0) {
        t = sqrt(trace + 1.0);
        q[0] = 0.5 * t;
        t = 0.5 / t;
        q[1] = (R[7] - R[5]) * t;
        q[2] = (R[2] - R[6]) * t;
        q[3] = (R[3] - R[1]) * t;
    } else {
        int i = R[4] > R[0] ? 1 : 0;
        if (R[8] > R[4 * i]) i = 2;
        int j = (i + 1) % 3, k = (j + 1) % 3;
        t = sqrt(R[4 * i] - R[4 * j] - R[4 * k] + 1.0);
        q[1 + i] = 0.5 * t;
        t = 0.5 / t;
        q[0] = (R[3 * k + j] - R[3 * j + k]) * t;
        q[1 + j] = (R[3 * j + i] + R[3 * i + j]) * t;
        q[1 + k] = (R[3 * k + i] + R[3 * i + k]) * t;
    }
    if (q[0] < 0.0)
        for (int i = 0; i < 4; i++) q[i] = -q[i];
}

static int step(double *const *a, int n, double dt, int flag) {
    const double *q = a[0], *qd = a[1], *base = a[2], *base_twist = a[3], *mount = a[4], *joints = a[5], *tool = a[6];
    double *pose = a[7], *twist = a[8], *jacobian = a[9];
    double c, s, at[PLACE], end[PLACE], last[PLACE], v[3 + MOST_JOINTS];
    int wide = 3 + n;
    Chain chain;
    (void)dt;
    (void)flag;
    if (!ordinary(q, n) || !ordinary(qd, n) || !ordinary(base, 3) || !ordinary(base_twist, 3)) return RARE;
    c = cos(base[2]), s = sin(base[2]);
    double standing[PLACE] = {c, -s, 0, s, c, 0, 0, 0, 1, base[0], base[1], 0};
    compose(standing, mount, at);
    forward(&chain, at, joints, q, n);
    memcpy(last, chain.turn[n - 1], 9 * sizeof *last);
    memcpy(last + 9, chain.at[n - 1], 3 * sizeof *last);
    compose(last, tool, end);
    v[0] = c * base_twist[0] - s * base_twist[1];
    v[1] = s * base_twist[0] + c * base_twist[1];
    v[2] = base_twist[2];
    memcpy(v + 3, qd, n * sizeof *v);
    memcpy(pose, end + 9, 3 * sizeof *pose);
    quaternion_of(end, pose + 3);
    memset(jacobian, 0, 6 * wide * sizeof *jacobian);
    jacobian[0] = jacobian[wide + 1] = jacobian[5 * wide + 2] = 1.0;
    jacobian[2] = -(end[10] - base[1]);
    jacobian[wide + 2] = end[9] - base[0];
    for (int k = 0; k < n; k++) {
        double z[3], r[3];
        for (int i = 0; i < 3; i++) z[i] = chain.turn[k][3 * i + 2], r[i] = end[9 + i] - chain.at[k][i];
        jacobian[3 + k] = z[1] * r[2] - z[2] * r[1];
        jacobian[wide + 3 + k] = z[2] * r[0] - z[0] * r[2];
        jacobian[2 * wide + 3 + k] = z[0] * r[1] - z[1] * r[0];
        for (int i = 0; i < 3; i++) jacobian[(3 + i) * wide + 3 + k] = z[i];
    }
    for (int i = 0; i < 6; i++) {
        double sum = 0.0;
        for (int k = 0; k < wide; k++) sum += jacobian[i * wide + k] * v[k];
        twist[i] = sum;
    }
    return DONE;
}

static const Arg args[] = {
    {"q", 0, 1, 0}, {"qd", 0, 1, 0}, {"base_pose", 3, 0, 0}, {"base_twist", 3, 0, 0},
    {"mount", PLACE, 0, 0}, {"joints", 0, PLACE, 0}, {"tool", PLACE, 0, 0},
    {"pose", 7, 0, 1}, {"twist", 6, 0, 1}, {"jacobian", 18, 6, 1}, {NULL, 0, 0, 0},
};
const Law tool_pose = {"tool-pose", step, args};
