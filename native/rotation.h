/* Rotations as in runtime/contracts/rotation.py, in the same order of operations: the same bits. */
#ifndef SRL_ROTATION_H
#define SRL_ROTATION_H

#include <math.h>

#define PI 3.141592653589793

typedef struct { double w, x, y, z; } Quaternion;
typedef struct { double x, y, z; } Vector;

static inline Quaternion product(Quaternion a, Quaternion b) {
    return (Quaternion){
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    };
}

static inline Quaternion conjugate(Quaternion q) { return (Quaternion){q.w, -q.x, -q.y, -q.z}; }

static inline Quaternion normalised(Quaternion q) {
    double size = sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    if (size < 1e-12) return (Quaternion){1.0, 0.0, 0.0, 0.0};
    return (Quaternion){q.w / size, q.x / size, q.y / size, q.z / size};
}

static inline double length(Vector v) { return sqrt(v.x * v.x + v.y * v.y + v.z * v.z); }

static inline Quaternion exponential(Vector v) {
    double angle = length(v), s;
    if (angle < 1e-9) return normalised((Quaternion){1.0, v.x / 2, v.y / 2, v.z / 2});
    s = sin(angle / 2) / angle;
    return (Quaternion){cos(angle / 2), s * v.x, s * v.y, s * v.z};
}

static inline Vector logarithm(Quaternion q) {
    double size, angle;
    if (q.w < 0) q = (Quaternion){-q.w, -q.x, -q.y, -q.z};
    size = sqrt(q.x * q.x + q.y * q.y + q.z * q.z);
    if (size < 1e-9) return (Vector){2 * q.x, 2 * q.y, 2 * q.z};
    angle = 2 * atan2(size, q.w) / size;
    return (Vector){angle * q.x, angle * q.y, angle * q.z};
}

static inline Vector log_nearest(Quaternion q, Vector to) {
    Vector v = logarithm(q);
    double angle = length(v), turns, k;
    if (angle < 1e-9) {
        double size = length(to);
        k = isfinite(size) ? rint(size / (2 * PI)) * 2 * PI : 0.0;
        return k != 0.0 ? (Vector){v.x + k * to.x / size, v.y + k * to.y / size, v.z + k * to.z / size} : v;
    }
    turns = ((v.x * to.x + v.y * to.y + v.z * to.z) / angle - angle) / (2 * PI);
    k = isfinite(turns) ? 1.0 + 2 * PI / angle * rint(turns) : 1.0;
    return (Vector){k * v.x, k * v.y, k * v.z};
}

static inline Vector turned(Quaternion q, Vector v) {
    double tx = 2 * (q.y * v.z - q.z * v.y), ty = 2 * (q.z * v.x - q.x * v.z), tz = 2 * (q.x * v.y - q.y * v.x);
    return (Vector){
        v.x + q.w * tx + q.y * tz - q.z * ty,
        v.y + q.w * ty + q.z * tx - q.x * tz,
        v.z + q.w * tz + q.x * ty - q.y * tx,
    };
}

static inline Vector at(const double *v) { return (Vector){v[0], v[1], v[2]}; }
static inline Quaternion turn_at(const double *v) { return (Quaternion){v[0], v[1], v[2], v[3]}; }

#endif
