/* A chain of n turning joints: kinematics and dynamics with all vectors in the base frame. */
#ifndef SRL_CHAIN_H
#define SRL_CHAIN_H

#include "law.h"

#define PLACE 12 /* a place: rotation matrix by rows, then position, m */
#define BODY 10  /* mass kg, centre of mass m, inertia about it kg m2: xx xy yy xz yz zz; in the joint's frame */

typedef struct {
    double turn[MOST_JOINTS][9], at[MOST_JOINTS][3]; /* of each joint's moved frame; column z of `turn` is its axis */
} Chain;

/* outer = a b, for places. */
void compose(const double *a, const double *b, double *outer);

/* Where the joints are: `base` (PLACE), `joints` (n x PLACE) each in the one before, angles q (n), rad. */
void forward(Chain *chain, const double *base, const double *joints, const double *q, int n);

/* M^-1 (n x n), 1/(kg m2), with `armature` (n), kg m2. Returns 0 where M isn't positive definite. */
int inverse_mass(const Chain *chain, const double *bodies, const double *last, const double *armature, int n,
                 double *inverse);

/* Torques (n) N m against weight and Coriolis forces, for qd (n) rad/s; `gravity` (3) m/s2. The last joint's body is
 * `last`. */
void bias(const Chain *chain, const double *bodies, const double *last, const double *qd, const double *gravity, int n,
          double *torque);

#endif
