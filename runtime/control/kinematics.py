"""Serial chains in standard Denavit-Hartenberg form: forward kinematics and geometric Jacobian."""

from __future__ import annotations

import numpy as np

from runtime.signals import Array


class Chains:
    """k chains of n revolute joints each, computed side by side.

    Row j is T_j = RotZ(q_j) TransX(a_j) RotX(alpha_j), with d = 0.
    """

    def __init__(self, bases: Array, rows: Array) -> None:
        """Args:
        bases: (k, 4, 4), each chain's base in the common frame, m.
        rows: (k, n, 2), alpha (rad) and a (m) of each row.
        """
        k, n = rows.shape[:2]
        self.n = n
        alpha, a = rows[..., 0], rows[..., 1]
        # T_j = C_j cos q_j + S_j sin q_j + K_j, so an update costs no trigonometry of the constant alpha.
        self._C = np.zeros((n, k, 4, 4))
        self._S = np.zeros((n, k, 4, 4))
        self._K = np.zeros((n, k, 4, 4))
        for j in range(n):
            ca, sa = np.cos(alpha[:, j]), np.sin(alpha[:, j])
            self._C[j, :, 0, 0] = self._S[j, :, 1, 0] = 1.0
            self._C[j, :, 1, 1], self._S[j, :, 0, 1] = ca, -ca
            self._C[j, :, 1, 2], self._S[j, :, 0, 2] = -sa, sa
            self._C[j, :, 0, 3] = self._S[j, :, 1, 3] = a[:, j]
            self._K[j, :, 2, 1], self._K[j, :, 2, 2], self._K[j, :, 3, 3] = sa, ca, 1.0
        self.frames = np.empty((n + 1, k, 4, 4))
        """(n + 1, k, 4, 4): the base, then the frame after each row, as `forward` left them."""
        self.frames[0] = bases
        self._J = np.empty((k, 6, n))

    def forward(self, q: Array) -> Array:
        """The tips (k, 3), m, for joint angles q (k, n), rad; a view into `frames`."""
        angles = q.T[:, :, None, None]
        T = np.cos(angles) * self._C + np.sin(angles) * self._S + self._K
        for j in range(self.n):
            np.matmul(self.frames[j], T[j], out=self.frames[j + 1])
        return self.frames[-1, :, :3, 3]

    def jacobian(self) -> Array:
        """(k, 6, n): linear (m/rad) above angular rows of the tips, at the q of the last `forward`.

        Column j is [z x (tip - o); z] with z and o the axis and origin of the frame before row j.
        """
        z = self.frames[:-1, :, :3, 2].transpose(1, 2, 0)
        d = (self.frames[-1, :, :3, 3] - self.frames[:-1, :, :3, 3]).transpose(1, 2, 0)
        J = self._J
        J[:, 0] = z[:, 1] * d[:, 2] - z[:, 2] * d[:, 1]
        J[:, 1] = z[:, 2] * d[:, 0] - z[:, 0] * d[:, 2]
        J[:, 2] = z[:, 0] * d[:, 1] - z[:, 1] * d[:, 0]
        J[:, 3:] = z
        return J
