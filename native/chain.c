#include "chain.h"

#include <string.h>

void compose(const double *a, const double *b, double *outer) {
    double made[PLACE];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            made[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
        made[9 + i] = a[3 * i] * b[9] + a[3 * i + 1] * b[10] + a[3 * i + 2] * b[11] + a[9 + i];
    }
    memcpy(outer, made, sizeof made);
}

void forward(Chain *chain, const double *base, const double *joints, const double *q, int n) {
    double place[PLACE];
    memcpy(place, base, sizeof place);
    for (int k = 0; k < n; k++) {
        double c = cos(q[k]), s = sin(q[k]);
        compose(place, joints + PLACE * k, place);
        for (int i = 0; i < 3; i++) {
            double x = place[3 * i], y = place[3 * i + 1];
            place[3 * i] = c * x + s * y;
            place[3 * i + 1] = c * y - s * x;
        }
        memcpy(chain->turn[k], place, sizeof chain->turn[k]);
        memcpy(chain->at[k], place + 9, sizeof chain->at[k]);
    }
}

/* A body about the base's origin: mass, first moment, and inertia xx xy yy xz yz zz. */
typedef struct { double m, h[3], I[6]; } Inertia;

static Inertia inertia_of(const double *turn, const double *at, const double *body) {
    Inertia found;
    double m = body[0], c[3], part[3][3], R[3][3];
    double I[3][3] = {{body[4], body[5], body[7]}, {body[5], body[6], body[8]}, {body[7], body[8], body[9]}};
    for (int i = 0; i < 3; i++)
        c[i] = turn[3 * i] * body[1] + turn[3 * i + 1] * body[2] + turn[3 * i + 2] * body[3] + at[i];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            part[i][j] = turn[3 * i] * I[0][j] + turn[3 * i + 1] * I[1][j] + turn[3 * i + 2] * I[2][j];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            R[i][j] = part[i][0] * turn[3 * j] + part[i][1] * turn[3 * j + 1] + part[i][2] * turn[3 * j + 2];
    found.m = m;
    for (int i = 0; i < 3; i++) found.h[i] = m * c[i];
    found.I[0] = R[0][0] + m * (c[1] * c[1] + c[2] * c[2]);
    found.I[1] = R[1][0] - m * c[0] * c[1];
    found.I[2] = R[1][1] + m * (c[0] * c[0] + c[2] * c[2]);
    found.I[3] = R[2][0] - m * c[0] * c[2];
    found.I[4] = R[2][1] - m * c[1] * c[2];
    found.I[5] = R[2][2] + m * (c[0] * c[0] + c[1] * c[1]);
    return found;
}

static void cross(const double *a, const double *b, double *found) {
    found[0] = a[1] * b[2] - a[2] * b[1];
    found[1] = a[2] * b[0] - a[0] * b[2];
    found[2] = a[0] * b[1] - a[1] * b[0];
}

/* Momentum, linear then angular about the origin, of a motion v (linear, at the origin) and w. */
static void momentum(const Inertia *b, const double *motion, double *found) {
    const double *v = motion, *w = motion + 3;
    double wh[3], hv[3];
    cross(w, b->h, wh);
    cross(b->h, v, hv);
    for (int i = 0; i < 3; i++) found[i] = b->m * v[i] + wh[i];
    found[3] = b->I[0] * w[0] + b->I[1] * w[1] + b->I[3] * w[2] + hv[0];
    found[4] = b->I[1] * w[0] + b->I[2] * w[1] + b->I[4] * w[2] + hv[1];
    found[5] = b->I[3] * w[0] + b->I[4] * w[1] + b->I[5] * w[2] + hv[2];
}

/* A joint's motion for 1 rad/s: the linear velocity at the origin, then the axis. */
static void axis_of(const Chain *chain, int k, double *found) {
    for (int i = 0; i < 3; i++) found[3 + i] = chain->turn[k][3 * i + 2];
    cross(chain->at[k], found + 3, found);
}

static double dot6(const double *a, const double *b) {
    double sum = 0.0;
    for (int i = 0; i < 6; i++) sum += a[i] * b[i];
    return sum;
}

int inverse_mass(const Chain *chain, const double *bodies, const double *last, const double *armature, int n,
                 double *inverse) {
    double L[MOST_JOINTS][MOST_JOINTS], S[MOST_JOINTS][6];
    Inertia all = {0};
    for (int k = 0; k < n; k++) axis_of(chain, k, S[k]);
    for (int k = n - 1; k >= 0; k--) { /* the composite body from joint k on */
        double p[6];
        Inertia own = inertia_of(chain->turn[k], chain->at[k], k == n - 1 ? last : bodies + BODY * k);
        all.m += own.m;
        for (int i = 0; i < 3; i++) all.h[i] += own.h[i];
        for (int i = 0; i < 6; i++) all.I[i] += own.I[i];
        momentum(&all, S[k], p);
        for (int j = 0; j <= k; j++) L[k][j] = dot6(S[j], p);
        L[k][k] += armature[k];
    }
    for (int j = 0; j < n; j++) { /* Cholesky: M = L L^T */
        double d = L[j][j];
        for (int k = 0; k < j; k++) d -= L[j][k] * L[j][k];
        if (!(d > 0.0)) return 0;
        d = L[j][j] = sqrt(d);
        for (int i = j + 1; i < n; i++) {
            double sum = L[i][j];
            for (int k = 0; k < j; k++) sum -= L[i][k] * L[j][k];
            L[i][j] = sum / d;
        }
    }
    for (int j = 0; j < n; j++) { /* L^-1, in place */
        L[j][j] = 1.0 / L[j][j];
        for (int i = j + 1; i < n; i++) {
            double sum = 0.0;
            for (int k = j; k < i; k++) sum -= L[i][k] * L[k][j];
            L[i][j] = sum / L[i][i];
        }
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = i; k < n; k++) sum += L[k][i] * L[k][j];
            inverse[n * i + j] = inverse[n * j + i] = sum;
        }
    return 1;
}

void bias(const Chain *chain, const double *bodies, const double *last, const double *qd, const double *gravity, int n,
          double *torque) {
    double v[6] = {0}, a[6] = {-gravity[0], -gravity[1], -gravity[2], 0, 0, 0};
    double S[MOST_JOINTS][6], f[MOST_JOINTS][6];
    for (int k = 0; k < n; k++) {
        double own[6], part[3], force[6], p[6];
        Inertia b = inertia_of(chain->turn[k], chain->at[k], k == n - 1 ? last : bodies + BODY * k);
        axis_of(chain, k, S[k]);
        for (int i = 0; i < 6; i++) own[i] = S[k][i] * qd[k];
        for (int i = 0; i < 6; i++) v[i] += own[i];
        cross(v + 3, own, part); /* a += v x S qd */
        for (int i = 0; i < 3; i++) a[i] += part[i];
        cross(v, own + 3, part);
        for (int i = 0; i < 3; i++) a[i] += part[i];
        cross(v + 3, own + 3, part);
        for (int i = 0; i < 3; i++) a[3 + i] += part[i];
        momentum(&b, a, force); /* f = I a + v x* I v */
        momentum(&b, v, p);
        cross(v + 3, p, part);
        for (int i = 0; i < 3; i++) force[i] += part[i];
        cross(v + 3, p + 3, part);
        for (int i = 0; i < 3; i++) force[3 + i] += part[i];
        cross(v, p, part);
        for (int i = 0; i < 3; i++) force[3 + i] += part[i];
        memcpy(f[k], force, sizeof force);
    }
    for (int k = n - 1; k >= 0; k--) {
        torque[k] = dot6(S[k], f[k]);
        if (k)
            for (int i = 0; i < 6; i++) f[k - 1][i] += f[k][i];
    }
}
