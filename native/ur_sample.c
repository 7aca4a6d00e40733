/* drivers/ur/sample.py: a message's doubles, big-endian after the recipe's byte, and what the driver's states are of them. */
#include <stdint.h>
#include <string.h>

#include "law.h"
#include "rotation.h"

enum { DOUBLES = 32, WORDS = 36 };                                       /* bytes of the integers */
#define BODY ((int)((1 + 8 * DOUBLES + WORDS + sizeof(double) - 1) / 8)) /* doubles that hold a body */

#define ABSURD 1e12 /* of no quantity here */

static int take(double *const *a, int n, double dt, int flag) {
    const unsigned char *at = (const unsigned char *)a[0] + 1;
    double values[DOUBLES];
    (void)n;
    (void)dt;
    (void)flag;
    for (int i = 0; i < DOUBLES; i++, at += 8) {
        uint64_t bits = 0;
        for (int k = 0; k < 8; k++) bits = bits << 8 | at[k];
        memcpy(&values[i], &bits, sizeof bits);
    }
    for (int i = 0; i < DOUBLES; i++)
        if (!(fabs(values[i]) < ABSURD)) return RARE;
    memcpy(a[1], values, sizeof values);
    return DONE;
}

static int fill(double *const *a, int n, double dt, int flag) {
    const double *values = a[0];
    double *pose = a[5];
    (void)n;
    (void)dt;
    (void)flag;
    if (!ordinary(values, DOUBLES) || !ordinary(pose + 3, 4)) return RARE;
    for (int i = 0; i < 4; i++) memcpy(a[1 + i], values + 1 + 6 * i, 6 * sizeof *values);
    Quaternion q = exponential(at(values + 28)), last = turn_at(pose + 3);
    if (q.w < 0) q = (Quaternion){-q.w, -q.x, -q.y, -q.z};
    if (q.w * last.w + q.x * last.x + q.y * last.y + q.z * last.z < 0) q = (Quaternion){-q.w, -q.x, -q.y, -q.z};
    memcpy(pose, values + 25, 3 * sizeof *values);
    pose[3] = q.w, pose[4] = q.x, pose[5] = q.y, pose[6] = q.z;
    a[6][0] = values[31];
    return DONE;
}

static const Arg take_args[] = {{"body", BODY, 0, 0}, {"values", DOUBLES, 0, 1}, {NULL, 0, 0, 0}};
static const Arg fill_args[] = {
    {"values", DOUBLES, 0, 0}, {"position", 6, 0, 1}, {"velocity", 6, 0, 1}, {"effort", 6, 0, 1},
    {"wrench", 6, 0, 1}, {"pose", 7, 0, 1}, {"speed_scaling", 1, 0, 1}, {NULL, 0, 0, 0},
};
const Law ur_take = {"ur-take", take, take_args};
const Law ur_fill = {"ur-fill", fill, fill_args};
