/* control/hand/object_mapping.py, virtual_object.py, sphere.py, extra_finger.py, shared/kinematics.py and
 * symmetric.py, for one extra finger and a similarity: the same order of operations, so the same bits.
 *
 * Python's are: motions that are damped, fingertips nearly on a line, and a sphere on other points than the last. */
#include <string.h>

#include "law.h"
#include "rotation.h"

#define POINTS 5     /* human fingertips */
#define ROW 6        /* of a joint: cos and sin of alpha, a in m; lower, middle, upper in rad */
#define FIRM 1e-3    /* symmetric.py */
#define ROUNDING 1e-12
#define SMALL 1e-17
#define TURNS 30
#define POINT 1e-12  /* virtual_object.py */
#define STEP 1.0
#define TWIST 0.2
#define NEWTON 6
#define INSIDE 1e-11 /* sphere.py */
#define FLAT 1e-14

typedef struct {
    double count, chosen[POINTS];
    double rigid, share, leash, smoothing, damping2, curvature;
    Vector x, y, z, o; /* the finger's base */
} Options;

typedef struct {
    double home[3];                            /* the robotic tip at the last reset */
    double c0[3], from_centre[POINTS][3], a2; /* Similarity */
} Reference;

typedef struct {
    double before[POINTS][3], target[3], velocity[3];
    double corners, support[4]; /* of the sphere: numbers of points */
    double least, greatest, nearest, leashed;
} State;

typedef struct { double xx, xy, xz, yy, yz, zz; } Symmetric;

static double dot(Vector a, Vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static Vector less(Vector a, Vector b) { return (Vector){a.x - b.x, a.y - b.y, a.z - b.z}; }

/* shared/symmetric.py */

static Symmetric gram(const Vector *v, int count) {
    Symmetric M = {0};
    for (int i = 0; i < count; i++) {
        M.xx += v[i].x * v[i].x;
        M.xy += v[i].x * v[i].y;
        M.xz += v[i].x * v[i].z;
        M.yy += v[i].y * v[i].y;
        M.yz += v[i].y * v[i].z;
        M.zz += v[i].z * v[i].z;
    }
    return M;
}

static void products(const Vector *a, const Vector *b, int count, double *M) {
    memset(M, 0, 9 * sizeof *M);
    for (int i = 0; i < count; i++) {
        const double p[3] = {a[i].x, a[i].y, a[i].z}, q[3] = {b[i].x, b[i].y, b[i].z};
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++) M[3 * j + k] += p[j] * q[k];
    }
}

static Vector mean(const Vector *v, int count) {
    double x = 0.0, y = 0.0, z = 0.0;
    for (int i = 0; i < count; i++) x += v[i].x, y += v[i].y, z += v[i].z;
    return (Vector){x / count, y / count, z / count};
}

static Vector times(Symmetric M, Vector v) {
    return (Vector){M.xx * v.x + M.xy * v.y + M.xz * v.z, M.xy * v.x + M.yy * v.y + M.yz * v.z,
                    M.xz * v.x + M.yz * v.y + M.zz * v.z};
}

static int is_above(Symmetric M, double floor) {
    double xx = M.xx - floor, yy = M.yy - floor, zz = M.zz - floor, minor = xx * yy - M.xy * M.xy;
    return xx > 0.0 && minor > ROUNDING * xx * yy &&
           zz * minor > xx * M.yz * M.yz - 2.0 * M.xy * M.xz * M.yz + yy * M.xz * M.xz + ROUNDING * fabs(zz) * xx * yy;
}

/* Returns 0 where Python would divide by zero. */
static int inverse(Symmetric M, Symmetric *found) {
    double a = M.yy * M.zz - M.yz * M.yz, b = M.xz * M.yz - M.xy * M.zz, c = M.xy * M.yz - M.xz * M.yy;
    double det = M.xx * a + M.xy * b + M.xz * c, k = 1.0 / det;
    *found = (Symmetric){a * k, b * k, c * k, (M.xx * M.zz - M.xz * M.xz) * k, (M.xy * M.xz - M.xx * M.yz) * k,
                         (M.xx * M.yy - M.xy * M.xy) * k};
    return det != 0.0;
}

/* The eigenvalues, and the eigenvectors. */
static void eigen(Symmetric M, double *values, Vector *vectors) {
    double a = M.xx, ab = M.xy, ca = M.xz, b = M.yy, bc = M.yz, c = M.zz, other;
    Vector u = {1.0, 0.0, 0.0}, v = {0.0, 1.0, 0.0}, w = {0.0, 0.0, 1.0}, before;
    double small = SMALL * (fabs(a) + fabs(b) + fabs(c));
    for (int turn = 0; turn < TURNS; turn++) {
        if (fabs(ab) <= small && fabs(bc) <= small && fabs(ca) <= small) break;
        if (fabs(ab) > small) {
            double h = (b - a) / (2.0 * ab), t = 1.0 / (fabs(h) + sqrt(h * h + 1.0)), cosine, sine;
            if (h < 0.0) t = -t;
            cosine = 1.0 / sqrt(t * t + 1.0);
            sine = t * cosine;
            a = a - t * ab;
            b = b + t * ab;
            ab = 0.0;
            other = ca;
            ca = cosine * other - sine * bc;
            bc = sine * other + cosine * bc;
            before = u;
            u = (Vector){cosine * before.x - sine * v.x, cosine * before.y - sine * v.y,
                         cosine * before.z - sine * v.z};
            v = (Vector){sine * before.x + cosine * v.x, sine * before.y + cosine * v.y,
                         sine * before.z + cosine * v.z};
        }
        other = a, a = b, b = c, c = other;
        other = ab, ab = bc, bc = ca, ca = other;
        before = u, u = v, v = w, w = before;
    }
    values[0] = a, values[1] = b, values[2] = c;
    vectors[0] = u, vectors[1] = v, vectors[2] = w;
}

static int raised_inverse(Symmetric M, double floor, Symmetric *found) {
    double values[3];
    Vector u[3];
    if (is_above(M, most_of(floor, FIRM * (M.xx + M.yy + M.zz)))) return inverse(M, found);
    eigen(M, values, u);
    memset(found, 0, sizeof *found);
    for (int i = 0; i < 3; i++) {
        double raised = most_of(values[i], floor), k = 1.0 / raised;
        if (raised == 0.0) return 0;
        found->xx += k * u[i].x * u[i].x;
        found->xy += k * u[i].x * u[i].y;
        found->xz += k * u[i].x * u[i].z;
        found->yy += k * u[i].y * u[i].y;
        found->yz += k * u[i].y * u[i].z;
        found->zz += k * u[i].z * u[i].z;
    }
    return 1;
}

/* shared/kinematics.py: `points` (n + 1) and `axes` (n) of the finger. */
static void locate(const Options *o, const double *rows, const double *q, int n, Vector *points, Vector *axes) {
    Vector x = o->x, y = o->y, z = o->z, at = o->o;
    double turn = 0.0;
    points[0] = at;
    for (int j = 0; j < n; j++) {
        const double ca = rows[ROW * j], sa = rows[ROW * j + 1], a = rows[ROW * j + 2];
        axes[j] = z;
        turn += q[j];
        double c = cos(turn), s = sin(turn);
        Vector u = {c * x.x + s * y.x, c * x.y + s * y.y, c * x.z + s * y.z};
        if (a != 0.0) at = (Vector){at.x + a * u.x, at.y + a * u.y, at.z + a * u.z};
        points[j + 1] = at;
        if (sa != 0.0) {
            Vector v = {c * y.x - s * x.x, c * y.y - s * x.y, c * y.z - s * x.z}, before = z;
            z = (Vector){ca * before.x - sa * v.x, ca * before.y - sa * v.y, ca * before.z - sa * v.z};
            x = u;
            y = (Vector){ca * v.x + sa * before.x, ca * v.y + sa * before.y, ca * v.z + sa * before.z};
            turn = 0.0;
        }
    }
}

/* VirtualObject.move, in closed form. Returns 0 where a direction may have to be damped. */
static int move(const Options *o, const Vector *before, const Vector *after, int count, const double *p_a,
                double *moved) {
    Vector mid[POINTS] = {0}, way[POINTS] = {0}, d[POINTS] = {0};
    double T[9], trace, s, size;
    for (int i = 0; i < count; i++) {
        mid[i] = (Vector){0.5 * (before[i].x + after[i].x), 0.5 * (before[i].y + after[i].y),
                          0.5 * (before[i].z + after[i].z)};
        way[i] = less(after[i], before[i]);
    }
    Vector c = mean(mid, count), v = mean(way, count);
    for (int i = 0; i < count; i++) d[i] = less(mid[i], c);
    Symmetric H = gram(d, count), inverted;
    products(d, way, count, T);
    Symmetric M = {H.yy + H.zz, -H.xy, -H.xz, H.xx + H.zz, -H.yz, H.xx + H.yy};
    trace = H.xx + H.yy + H.zz;
    Vector tip = less(at(p_a), c);
    const double x = tip.x, y = tip.y, z = tip.z, k = o->share;
    Symmetric N = {M.xx - k * (y * y + z * z), M.xy + k * x * y, M.xz + k * x * z,
                   M.yy - k * (x * x + z * z), M.yz + k * y * z, M.zz - k * (x * x + y * y)};
    if (!is_above(N, 2.0 * FIRM * trace) || trace == 0.0 || !inverse(M, &inverted)) return 0;
    Vector w = times(inverted, (Vector){T[5] - T[7], T[6] - T[2], T[1] - T[3]});
    s = o->rigid != 0.0 ? 0.0 : (T[0] + T[4] + T[8]) / trace;
    size = sqrt(w.x * w.x + w.y * w.y + w.z * w.z + s * s);
    if (size > STEP) {
        double part = STEP / size;
        w = (Vector){part * w.x, part * w.y, part * w.z};
        s = part * s;
    }
    Vector h = {0.5 * w.x, 0.5 * w.y, 0.5 * w.z};
    double whole = 1.0 - 0.5 * s, h2 = h.x * h.x + h.y * h.y + h.z * h.z;
    Vector u = {v.x + w.y * z - w.z * y + s * x, v.y + w.z * x - w.x * z + s * y, v.z + w.x * y - w.y * x + s * z};
    double along = (h.x * u.x + h.y * u.y + h.z * u.z) / whole, q = 1.0 / (whole * whole + h2);
    moved[0] = c.x + x + q * (whole * u.x + h.y * u.z - h.z * u.y + along * h.x);
    moved[1] = c.y + y + q * (whole * u.y + h.z * u.x - h.x * u.z + along * h.y);
    moved[2] = c.z + z + q * (whole * u.z + h.x * u.y - h.y * u.x + along * h.z);
    return 1;
}

/* Similarity.carry, for the tip at home. Returns 0 where the rotation isn't firm. */
static int carry(const Options *o, const Reference *reference, const Vector *points, int count, double *carried) {
    Vector from[POINTS] = {0}, c1 = mean(points, count);
    double K[9], R[9], scale;
    for (int i = 0; i < count; i++) from[i] = at(reference->from_centre[i]);
    products(points, from, count, K);
    const double a = K[0], b = K[1], c = K[2], d = K[3], e = K[4], f = K[5], g = K[6], h = K[7], i = K[8];
    const double cofactors[9] = {e * i - f * h, f * g - d * i, d * h - e * g, c * h - b * i, a * i - c * g,
                                 b * g - a * h, b * f - c * e, c * d - a * f, a * e - b * d};
    double det = a * cofactors[0] + b * cofactors[1] + c * cofactors[2], C2 = cofactors[0] * cofactors[0];
    for (int j = 1; j < 9; j++) C2 += cofactors[j] * cofactors[j];
    const Vector columns[3] = {{a, d, g}, {b, e, h}, {c, f, i}};
    Symmetric G = gram(columns, 3);
    double K2 = G.xx + G.yy + G.zz, low = (1.0 + TWIST) * (1.0 + TWIST), above = (low - 1.0) * K2;
    if (K2 < POINT * POINT || above * above >= 8.0 * sqrt(low * K2) * det + 4.0 * C2) return 0;
    double trace = sqrt(K2 + 2.0 * sqrt(C2));
    for (int j = 0; j < NEWTON; j++) {
        double gap = trace * trace - K2, slope = 4.0 * trace * gap - 8.0 * det;
        if (slope == 0.0) return 0;
        trace -= (gap * gap - 8.0 * trace * det - 4.0 * C2) / slope;
    }
    double second = 0.5 * (trace * trace - K2), under = trace * second - det, k = 1.0 / under;
    double diagonal = trace * trace - second, xx = diagonal - G.xx, yy = diagonal - G.yy, zz = diagonal - G.zz;
    if (under == 0.0 || reference->a2 == 0.0) return 0;
    for (int j = 0; j < 3; j++) {
        R[j] = k * (xx * K[j] - G.xy * K[3 + j] - G.xz * K[6 + j] + trace * cofactors[j]);
        R[3 + j] = k * (yy * K[3 + j] - G.xy * K[j] - G.yz * K[6 + j] + trace * cofactors[3 + j]);
        R[6 + j] = k * (zz * K[6 + j] - G.xz * K[j] - G.yz * K[3 + j] + trace * cofactors[6 + j]);
    }
    scale = o->rigid != 0.0 || trace == 0.0 ? 1.0 : most_of(trace / reference->a2, 0.0);
    Vector x = less(at(reference->home), at(reference->c0));
    carried[0] = c1.x + scale * dot(at(R), x);
    carried[1] = c1.y + scale * dot(at(R + 3), x);
    carried[2] = c1.z + scale * dot(at(R + 6), x);
    return 1;
}

/* FingerKinematics.follow. Returns 0 where Python would divide by zero. */
static int follow(const Options *o, const double *rows, const Vector *points, const Vector *axes, const double *q,
                  int n, Vector dp, Vector v, double pull, double *dq, double *rates) {
    Vector J[MOST_JOINTS], moving[MOST_JOINTS];
    double chi[MOST_JOINTS], floor = most_of(o->damping2, o->curvature * sqrt(dot(dp, dp)));
    for (int j = 0; j < n; j++) {
        Vector d = less(points[n], points[j]), a = axes[j];
        J[j] = moving[j] = (Vector){a.y * d.z - a.z * d.y, a.z * d.x - a.x * d.z, a.x * d.y - a.y * d.x};
        chi[j] = pull * (rows[ROW * j + 4] - q[j]);
    }
    for (int pass = 0; pass <= n; pass++) { /* each but the last holds a joint */
        Symmetric inverted;
        int again = 0;
        if (!raised_inverse(gram(moving, n), floor, &inverted)) return 0;
        Vector left = dp;
        for (int j = 0; j < n; j++)
            left = (Vector){left.x - J[j].x * chi[j], left.y - J[j].y * chi[j], left.z - J[j].z * chi[j]};
        Vector way = times(inverted, left), rate = times(inverted, v);
        for (int j = 0; j < n; j++) {
            double low = rows[ROW * j + 3] - q[j], high = rows[ROW * j + 5] - q[j];
            dq[j] = chi[j] + dot(moving[j], way);
            if (dq[j] < low || dq[j] > high) {
                chi[j] = dq[j] < low ? low : high;
                moving[j] = (Vector){0.0, 0.0, 0.0};
                again = 1;
            }
        }
        if (again) continue;
        for (int j = 0; j < n; j++) rates[j] = dot(moving[j], rate);
        return 1;
    }
    return 0;
}

/* sphere.py: the sphere on the last support. Returns 0 where another has to be sought. */
static int enclose(const Vector *cloud, int count, const double *support, int corners, double *sphere) {
    Vector p = cloud[(int)support[0]], edges[3], centre = p;
    double w[3] = {0.5, 0.5, 0.5}, det, total = 0.0, least, reach2 = -1.0;
    int others = corners - 1;
    for (int i = 0; i < others; i++) edges[i] = less(cloud[(int)support[i + 1]], p);
    if (others == 2) {
        double A = dot(edges[0], edges[0]), B = dot(edges[0], edges[1]), C = dot(edges[1], edges[1]);
        det = A * C - B * B;
        if (det <= FLAT * A * C || det == 0.0) return 0;
        w[0] = 0.5 * C * (A - B) / det;
        w[1] = 0.5 * A * (C - B) / det;
    } else if (others == 3) {
        double A = dot(edges[0], edges[0]), B = dot(edges[0], edges[1]), C = dot(edges[0], edges[2]);
        double D = dot(edges[1], edges[1]), E = dot(edges[1], edges[2]), F = dot(edges[2], edges[2]);
        double a = D * F - E * E, b = C * E - B * F, c = B * E - C * D, d, e, f;
        det = A * a + B * b + C * c;
        if (det <= FLAT * A * D * F || det == 0.0) return 0;
        d = A * F - C * C, e = B * C - A * E, f = A * D - B * B;
        w[0] = 0.5 * (a * A + b * D + c * F) / det;
        w[1] = 0.5 * (b * A + d * D + e * F) / det;
        w[2] = 0.5 * (c * A + e * D + f * F) / det;
    }
    least = others ? w[0] : 0.0;
    for (int i = 0; i < others; i++) {
        total += w[i];
        least = least_of(least, w[i]);
        centre = (Vector){centre.x + w[i] * edges[i].x, centre.y + w[i] * edges[i].y, centre.z + w[i] * edges[i].z};
    }
    if (!(least >= 0.0 && total <= 1.0)) return 0;
    for (int i = 0; i < count; i++) {
        Vector r = less(cloud[i], centre);
        reach2 = most_of(reach2, dot(r, r));
    }
    Vector r = less(p, centre);
    if (!(reach2 <= dot(r, r) * (1.0 + INSIDE))) return 0;
    sphere[0] = centre.x, sphere[1] = centre.y, sphere[2] = centre.z, sphere[3] = sqrt(reach2);
    return 1;
}

/* Whether the value is the number of one of `count` elements. */
static int is_of(double value, int count) { return value >= 0.0 && value < count; }

static int step(double *const *a, int n, double dt, int flag) {
    const double *q = a[0], *tips = a[1], pull = *a[2], centring = *a[3], *rows = a[5];
    const Options *o = (const Options *)a[4];
    const Reference *reference = (const Reference *)a[6];
    State next = *(const State *)a[7], *s = &next;
    Vector p_h[POINTS], before[POINTS], cloud[POINTS + 1], points[MOST_JOINTS + 1], axes[MOST_JOINTS], tip, ahead;
    double last[3], squares = 0.0, path, share, distance, smoothing, motion[3], sphere[4];
    double dq[MOST_JOINTS], rates[MOST_JOINTS];
    int count, corners;
    (void)flag;
    if (!ordinary(q, n) || !ordinary(tips, 3 * POINTS) || !ordinary(&pull, 1) || !ordinary(&centring, 1)) return RARE;
    if (!ordinary((const double *)s, COUNT(State)) || !ordinary((const double *)reference, COUNT(Reference)))
        return RARE;
    if (!is_of(o->count - 1.0, POINTS) || !is_of(s->corners - 1.0, 4) || dt == 0.0) return RARE;
    count = (int)o->count, corners = (int)s->corners;
    for (int i = 0; i < count; i++)
        if (!is_of(o->chosen[i], POINTS)) return RARE;
    for (int i = 0; i < corners; i++)
        if (!is_of(s->support[i], count + 1)) return RARE;

    locate(o, rows, q, n, points, axes);
    tip = points[n];
    memcpy(last, s->target, sizeof last);
    for (int i = 0; i < count; i++) {
        p_h[i] = at(tips + 3 * (int)o->chosen[i]);
        before[i] = at(s->before[i]);
        Vector way = less(p_h[i], before[i]);
        squares += way.x * way.x;
        squares += way.y * way.y;
        squares += way.z * way.z;
    }
    path = sqrt(squares / count);
    if (!isfinite(path)) return RARE;
    if (path > 0.0) {
        if (!move(o, before, p_h, count, last, s->target)) return RARE;
        if (pull > 0.0) {
            double finite[3], k = 1.0 - exp(-pull * path);
            if (!carry(o, reference, p_h, count, finite)) return RARE;
            for (int i = 0; i < 3; i++) s->target[i] += k * (finite[i] - s->target[i]);
        }
        memcpy(s->before, p_h, count * sizeof *p_h);
    }

    ahead = less(at(s->target), tip); /* _hold_back */
    distance = sqrt(ahead.x * ahead.x + ahead.y * ahead.y + ahead.z * ahead.z);
    if (distance > o->leash) {
        double k = o->leash / distance;
        ahead = (Vector){k * ahead.x, k * ahead.y, k * ahead.z};
        s->target[0] = tip.x + ahead.x;
        s->target[1] = tip.y + ahead.y;
        s->target[2] = tip.z + ahead.z;
        s->leashed += 1.0;
    }
    smoothing = 1.0 - exp(-dt / o->smoothing);
    share = 1.0 - exp(-centring * path);
    for (int i = 0; i < 3; i++) motion[i] = (s->target[i] - last[i]) / dt;
    for (int i = 0; i < 3; i++) s->velocity[i] = s->velocity[i] + smoothing * (motion[i] - s->velocity[i]);
    if (!follow(o, rows, points, axes, q, n, ahead, at(s->velocity), share, dq, rates)) return RARE;

    memcpy(cloud, s->before, count * sizeof *cloud); /* _enclose */
    cloud[count] = tip;
    if (!enclose(cloud, count + 1, s->support, corners, sphere)) return RARE;
    s->least = least_of(s->least, sphere[3]);
    s->greatest = most_of(s->greatest, sphere[3]);
    Vector r = less(tip, at(tips));
    s->nearest = least_of(s->nearest, sqrt(r.x * r.x + r.y * r.y + r.z * r.z));

    if (!ordinary((const double *)s, COUNT(State)) || !ordinary(dq, n) || !ordinary(rates, n)) return RARE;
    *(State *)a[7] = next;
    for (int j = 0; j < n; j++) a[8][j] = q[j] + dq[j];
    memcpy(a[9], rates, n * sizeof *rates);
    memcpy(a[10], sphere, sizeof sphere);
    memcpy(a[11], s->target, sizeof s->target);
    memcpy(a[12], points, (n + 1) * sizeof *points);
    return DONE;
}

static const Arg args[] = {
    {"q", 0, 1, 0}, {"tips", 3 * POINTS, 0, 0}, {"drift_pull", 1, 0, 0}, {"centring", 1, 0, 0},
    {"options", COUNT(Options), 0, 0}, {"rows", 0, ROW, 0}, {"reference", COUNT(Reference), 0, 0},
    {"state", COUNT(State), 0, 1},
    {"command", 0, 1, 1}, {"rate", 0, 1, 1}, {"sphere", 4, 0, 1}, {"target", 3, 0, 1}, {"skeleton", 3, 3, 1},
    {NULL, 0, 0, 0},
};
const Law object_mapping = {"object-mapping", step, args};
