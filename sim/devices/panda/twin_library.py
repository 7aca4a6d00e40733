"""The shared object that a simulated Panda gives clients as its model: our kinematics and dynamics, in C.

Clients of protocol 5 load machine code from the robot (protocol sheet franka-fci, section 5.6). Here gcc compiles
it from the runtime's own description of the arm. Its functions use column-major matrices.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Final

from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import PANDA

_done: dict[str, bytes] = {}  # shared objects by their source


class Build:
    """One compilation, which runs in parallel with its caller.

    Attributes:
        shared_object: the compiled bytes, once `poll` is true; None if they can't be made.
    """

    def __init__(self) -> None:
        self.shared_object = _done.get(source())
        self._process: subprocess.Popen[bytes] | None = None
        compiler = shutil.which("gcc")
        if self.shared_object is not None or compiler is None:
            return
        self._folder = Path(tempfile.mkdtemp(prefix="srl-panda-"))
        code, self._made = self._folder / "model.c", self._folder / "model.so"
        code.write_text(source())
        self._process = subprocess.Popen(
            [compiler, "-O2", "-shared", "-fPIC", "-o", str(self._made), str(code), "-lm"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def poll(self) -> bool:
        """Whether the compilation is over; never blocks."""
        process = self._process
        if process is None:
            return True
        if process.poll() is None:
            return False
        self._process = None
        if process.returncode == 0:
            self.shared_object = _done[source()] = self._made.read_bytes()
        shutil.rmtree(self._folder, ignore_errors=True)
        return True

    def close(self) -> None:
        """Cancels the compilation."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
            shutil.rmtree(self._folder, ignore_errors=True)


@cache
def source() -> str:
    """Returns the C program."""
    arm = PANDA
    links = [joint.link for joint in arm.joints]
    tables = [
        _table("PLACE", [joint.placement[:3].ravel() for joint in arm.joints], "[7][12]"),
        _table("FLANGE", [arm.flange[:3].ravel()], "[1][12]"),
        _table("COM", [link.com for link in links], "[7][3]"),
        _table("INERTIA", [link.inertia.ravel() for link in links], "[7][9]"),
        "static const double MASS[7] = {" + ", ".join(repr(link.mass) for link in links) + "};",
    ]
    return "\n".join(["#include <math.h>", "#include <string.h>", *tables, _BODY, *_entries()])


def _table(name: str, rows: list[Array], shape: str) -> str:
    lines = ",\n  ".join("{" + ", ".join(repr(value) for value in row.tolist()) + "}" for row in rows)
    return f"static const double {name}{shape} = {{\n  {lines}}};"


def _entries() -> list[str]:
    """The functions that clients look up: one set for each of nine frames (seven joints, flange, end effector)."""
    lines = []
    for i in range(1, 10):
        tool, given = (", const double *F_T_EE", "F_T_EE") if i == 9 else ("", "0")
        alone = "double *out" if i == 1 else f"const double *q{tool}, double *out"
        q = "ZERO" if i == 1 else "q"  # the first joint's Jacobian doesn't depend on the joint angles
        lines.append(f"void O_T_J{i}(const double *q{tool}, double *out) {{ pose(q, {given}, {i - 1}, out); }}")
        lines.append(f"void O_J_J{i}({alone}) {{ jacobian({q}, {given}, {i - 1}, 0, out); }}")
        lines.append(f"void Ji_J_J{i}({alone}) {{ jacobian({q}, {given}, {i - 1}, 1, out); }}")
    return lines


_BODY: Final = r"""
static const double ZERO[9] = {0};

typedef struct { double R[9][9], p[9][3]; } Frames;  /* seven links, flange, end effector; in the base frame */

static void cross(const double *a, const double *b, double *out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

static void add_cross(const double *a, const double *b, double *out) {
  double c[3];
  cross(a, b, c);
  for (int k = 0; k < 3; k++) out[k] += c[k];
}

static void turn(const double *R, const double *v, double *out) {
  for (int k = 0; k < 3; k++) out[k] = R[3 * k] * v[0] + R[3 * k + 1] * v[1] + R[3 * k + 2] * v[2];
}

static void turn_back(const double *R, const double *v, double *out) {
  for (int k = 0; k < 3; k++) out[k] = R[k] * v[0] + R[k + 3] * v[1] + R[k + 6] * v[2];
}

static void multiply(const double *A, const double *B, double *out) {
  for (int r = 0; r < 3; r++)
    for (int c = 0; c < 3; c++)
      out[3 * r + c] = A[3 * r] * B[c] + A[3 * r + 1] * B[3 + c] + A[3 * r + 2] * B[6 + c];
}

/* A frame fixed at `place` (three rows of four) in frame (R, p). */
static void put(const double *R, const double *p, const double *place, double *R_out, double *p_out) {
  double fixed[9], shift[3], moved[3];
  for (int r = 0; r < 3; r++) {
    for (int c = 0; c < 3; c++) fixed[3 * r + c] = place[4 * r + c];
    shift[r] = place[4 * r + 3];
  }
  turn(R, shift, moved);
  multiply(R, fixed, R_out);
  for (int k = 0; k < 3; k++) p_out[k] = p[k] + moved[k];
}

static void frames(const double *q, const double *F_T_EE, Frames *f) {
  const double unit[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, *R = unit, *p = ZERO;
  for (int i = 0; i < 7; i++) {
    double c = cos(q[i]), s = sin(q[i]), still[9];
    double angle[9] = {c, -s, 0, s, c, 0, 0, 0, 1};
    put(R, p, PLACE[i], still, f->p[i]);
    multiply(still, angle, f->R[i]);
    R = f->R[i];
    p = f->p[i];
  }
  put(R, p, FLANGE[0], f->R[7], f->p[7]);
  if (F_T_EE) {
    double place[12];
    for (int r = 0; r < 3; r++)
      for (int c = 0; c < 4; c++) place[4 * r + c] = F_T_EE[4 * c + r];
    put(f->R[7], f->p[7], place, f->R[8], f->p[8]);
  }
}

static void pose(const double *q, const double *F_T_EE, int which, double *out) {
  Frames f;
  frames(q, F_T_EE, &f);
  for (int r = 0; r < 3; r++) {
    for (int c = 0; c < 3; c++) out[4 * c + r] = f.R[which][3 * r + c];
    out[12 + r] = f.p[which][r];
    out[4 * r + 3] = 0;
  }
  out[15] = 1;
}

static void jacobian(const double *q, const double *F_T_EE, int which, int in_body, double *out) {
  Frames f;
  frames(q, F_T_EE, &f);
  memset(out, 0, 42 * sizeof(double));
  for (int j = 0; j < 7 && j <= which; j++) {
    double axis[3], arm[3], column[6];
    for (int k = 0; k < 3; k++) {
      axis[k] = f.R[j][3 * k + 2];
      arm[k] = f.p[which][k] - f.p[j][k];
      column[3 + k] = axis[k];
    }
    cross(axis, arm, column);
    if (in_body) {
      turn_back(f.R[which], column, out + 6 * j);
      turn_back(f.R[which], column + 3, out + 6 * j + 3);
    } else {
      memcpy(out + 6 * j, column, sizeof column);
    }
  }
}

typedef struct { double mass, com[3], inertia[9]; } Load;  /* in the flange's frame */

/* What a body contributes: force and, about its link's origin, moment. */
static void inertial(const double *R, double mass, const double *com, const double *I, const double *w,
                     const double *dw, const double *a, double *force, double *moment) {
  double c[3], ac[3], inner[3], local[3], spun[3], Iw[3], Idw[3];
  turn(R, com, c);
  memcpy(ac, a, sizeof ac);
  add_cross(dw, c, ac);
  cross(w, c, inner);
  add_cross(w, inner, ac);
  turn_back(R, w, local);
  turn(I, local, spun);
  turn(R, spun, Iw);
  turn_back(R, dw, local);
  turn(I, local, spun);
  turn(R, spun, Idw);
  double f[3] = {mass * ac[0], mass * ac[1], mass * ac[2]};
  for (int k = 0; k < 3; k++) {
    force[k] += f[k];
    moment[k] += Idw[k];
  }
  add_cross(w, Iw, moment);
  add_cross(c, f, moment);
}

/* Recursive Newton-Euler, in base axes; g as the acceleration of free fall. */
static void dynamics(const double *q, const double *dq, const double *ddq, const double *g, const Load *load,
                     double *tau) {
  Frames f;
  double force[7][3], moment[7][3], w[3] = {0}, dw[3] = {0}, a[3] = {-g[0], -g[1], -g[2]}, last[3] = {0};
  frames(q, 0, &f);
  memset(force, 0, sizeof force);
  memset(moment, 0, sizeof moment);
  for (int i = 0; i < 7; i++) {
    double step[3], inner[3], axis[3], spin[3];
    for (int k = 0; k < 3; k++) {
      step[k] = f.p[i][k] - last[k];
      axis[k] = f.R[i][3 * k + 2];
      spin[k] = axis[k] * dq[i];
      last[k] = f.p[i][k];
    }
    add_cross(dw, step, a);
    cross(w, step, inner);
    add_cross(w, inner, a);
    add_cross(w, spin, dw);
    for (int k = 0; k < 3; k++) {
      dw[k] += axis[k] * ddq[i];
      w[k] += spin[k];
    }
    inertial(f.R[i], MASS[i], COM[i], INERTIA[i], w, dw, a, force[i], moment[i]);
    if (i == 6 && load->mass > 0) {
      double com[3], turned[9], I[9], R[9], back[9];
      for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++) {
          R[3 * r + c] = FLANGE[0][4 * r + c];
          back[3 * c + r] = R[3 * r + c];
        }
        com[r] = FLANGE[0][4 * r + 3];
      }
      double moved[3];
      turn(R, load->com, moved);
      for (int k = 0; k < 3; k++) com[k] += moved[k];
      multiply(R, load->inertia, turned);
      multiply(turned, back, I);
      inertial(f.R[i], load->mass, com, I, w, dw, a, force[i], moment[i]);
    }
  }
  for (int i = 6; i >= 0; i--) {
    tau[i] = 0;
    for (int k = 0; k < 3; k++) tau[i] += f.R[i][3 * k + 2] * moment[i][k];
    if (i > 0) {
      double step[3];
      for (int k = 0; k < 3; k++) {
        step[k] = f.p[i][k] - f.p[i - 1][k];
        force[i - 1][k] += force[i][k];
        moment[i - 1][k] += moment[i][k];
      }
      add_cross(step, force[i], moment[i - 1]);
    }
  }
}

static Load carried(const double *I, double mass, const double *com) {
  Load load = {mass, {com[0], com[1], com[2]}, {0}};
  if (I)
    for (int r = 0; r < 3; r++)
      for (int c = 0; c < 3; c++) load.inertia[3 * r + c] = I[3 * c + r];
  return load;
}

void M_NE(const double *q, const double *I, double mass, const double *com, double *out) {
  Load load = carried(I, mass, com);
  for (int j = 0; j < 7; j++) {
    double one[7] = {0};
    one[j] = 1;
    dynamics(q, ZERO, one, ZERO, &load, out + 7 * j);
  }
}

void c_NE(const double *q, const double *dq, const double *I, double mass, const double *com, double *out) {
  Load load = carried(I, mass, com);
  dynamics(q, dq, ZERO, ZERO, &load, out);
}

void g_NE(const double *q, const double *g, double mass, const double *com, double *out) {
  Load load = carried(0, mass, com);
  dynamics(q, ZERO, ZERO, g, &load, out);
}
"""
