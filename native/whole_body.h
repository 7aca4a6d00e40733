/* What the laws of an arm on a mobile base share: control/shared/spd6.py, priority.py and add_base. */
#ifndef SRL_WHOLE_BODY_H
#define SRL_WHOLE_BODY_H

#include <string.h>

#include "law.h"

/* L D L^T of the lower triangle of A (6 x 6), rows in descending order of the diagonal, as Eigen's. */
typedef struct { double L[6][6]; int swap[6]; } Factors;

static inline void factorise(Factors *f, double A[6][6]) {
    memcpy(f->L, A, sizeof f->L);
    double(*L)[6] = f->L;
    for (int k = 0; k < 6; k++) {
        int big = k;
        for (int i = k + 1; i < 6; i++)
            if (fabs(L[i][i]) > fabs(L[big][big])) big = i;
        f->swap[k] = big;
        if (big != k) {
            double t;
#define SWAP(a, b) (t = (a), (a) = (b), (b) = t)
            for (int j = 0; j < k; j++) SWAP(L[k][j], L[big][j]);
            for (int i = big + 1; i < 6; i++) SWAP(L[i][k], L[i][big]);
            for (int i = k + 1; i < big; i++) SWAP(L[i][k], L[big][i]);
            SWAP(L[k][k], L[big][big]);
#undef SWAP
        }
        double temp[6];
        for (int j = 0; j < k; j++) temp[j] = L[j][j] * L[k][j];
        for (int j = 0; j < k; j++) L[k][k] -= L[k][j] * temp[j];
        for (int i = k + 1; i < 6; i++)
            for (int j = 0; j < k; j++) L[i][k] -= L[i][j] * temp[j];
        if (fabs(L[k][k]) > 0.0)
            for (int i = k + 1; i < 6; i++) L[i][k] /= L[k][k];
    }
}

static inline void solve(const Factors *f, const double *b, double *x) {
    memcpy(x, b, 6 * sizeof *x);
    double t;
    for (int k = 0; k < 6; k++) t = x[k], x[k] = x[f->swap[k]], x[f->swap[k]] = t;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < i; j++) x[i] -= f->L[i][j] * x[j];
    for (int i = 0; i < 6; i++) x[i] = fabs(f->L[i][i]) > DBL_MIN ? x[i] / f->L[i][i] : 0.0;
    for (int i = 5; i >= 0; i--)
        for (int j = i + 1; j < 6; j++) x[i] -= f->L[j][i] * x[j];
    for (int k = 5; k >= 0; k--) t = x[k], x[k] = x[f->swap[k]], x[f->swap[k]] = t;
}

/* Adds J_b diag(linear, linear, turning) J_b^T to the lower triangle of A. */
static inline void add_base(double A[6][6], const double *J, int wide, double linear, double turning) {
    double u = J[2], v = J[wide + 2];
    A[0][0] += linear + turning * u * u;
    A[1][0] += turning * u * v;
    A[1][1] += linear + turning * v * v;
    A[5][0] += turning * u;
    A[5][1] += turning * v;
    A[5][5] += turning;
}

typedef struct { double locomotion, level, fade; } Priority;

/* Priority.update: `postures` (3 x n) are the preferred one, the chosen one and the offset of the old one. `part` of the
 * blend time passes. */
static inline void prefer(Priority *p, double *postures, int locomotion, const double *q, int n, double part) {
    double *preferred = postures, *chosen = postures + n, *offset = postures + 2 * n;
    if (locomotion && p->locomotion == 0.0) {
        for (int i = 0; i < n; i++) chosen[i] = q[i], offset[i] = preferred[i] - q[i];
        p->fade = 1.0;
    }
    p->locomotion = locomotion;
    p->level = locomotion ? least_of(p->level + part, 1.0) : most_of(p->level - part, 0.0);
    if (p->fade > 0.0) {
        p->fade = most_of(p->fade - part, 0.0);
        for (int i = 0; i < n; i++) preferred[i] = offset[i] * p->fade + chosen[i];
    }
}

static inline double between(double level, const double *of) { return of[0] + level * (of[1] - of[0]); }

static inline double between_ratios(double level, const double *of) {
    if (level == 0.0) return of[0];
    if (level == 1.0) return of[1];
    return exp(log(of[0]) + level * (log(of[1]) - log(of[0])));
}

#endif
