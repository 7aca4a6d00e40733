"""Linear discriminant analysis with a limit of Mahalanobis' distance beyond which a sample belongs to no class.

All classes share one covariance within them (Fisher 1936; Hastie, Tibshirani and Friedman, The Elements of Statistical
Learning, 4.3), shrunk towards its diagonal, so that a few repetitions suffice. Windows of one movement aren't
independent, and a posterior that takes them so would be far too sure: distances are divided by a temperature (Guo et
al. 2017).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array

_SHRINKAGE: Final = 0.2  # of what lies off the diagonal
_FLOOR: Final = 0.05  # added to the standard deviation of each feature: a suit's own error, 3 degrees
_TEMPERATURES: Final = np.geomspace(1.0, 100.0, 41)


@dataclass(frozen=True)
class Discriminant:
    """k classes in n features.

    Attributes:
        means: (k, n).
        covariance: (n, n), within the classes; positive definite.
        limits: (k,) squared distances beyond which a sample isn't of the class.
        temperature: by which squared distances are divided for the posterior.
    """

    means: Array
    covariance: Array
    limits: Array
    temperature: float

    def whitening(self) -> Array:
        """W (n, n): distances are Euclidean between W x and W mean. Raises numpy.linalg.LinAlgError."""
        found: Array = np.linalg.inv(np.linalg.cholesky(self.covariance))
        return found

    def distances(self, samples: Array) -> Array:
        """(T, k) squared distances of samples (T, n) from the classes' means."""
        W = self.whitening()
        away = (samples @ W.T)[:, None] - self.means @ W.T
        found: Array = np.einsum("tkn,tkn->tk", away, away)
        return found


def fit(samples: Array, classes: NDArray[np.intp], count: int) -> Discriminant:
    """Fits classes 0 to `count` - 1 to samples (T, n); each needs one at least. It has no limits: they are infinite."""
    means = np.array([samples[classes == k].mean(axis=0) for k in range(count)])
    away = samples - means[classes]
    # Each class counts the same, however many samples it has: resting and walking have most.
    weights = 1.0 / (count * np.bincount(classes, minlength=count)[classes])
    within = (away * weights[:, None]).T @ away
    variances = np.diag(np.diag(within))
    covariance = within + _SHRINKAGE * (variances - within) + _FLOOR**2 * np.eye(samples.shape[1])
    return Discriminant(means, 0.5 * (covariance + covariance.T), np.full(count, np.inf), 1.0)


def posterior(distances: Array, temperature: float) -> Array:
    """(..., k): how likely each class is by squared distances (..., k), all being equally likely before."""
    gap = np.exp((distances.min(axis=-1, keepdims=True) - distances) / (2.0 * temperature))
    found: Array = gap / gap.sum(axis=-1, keepdims=True)
    return found


def temperature(distances: Array, classes: NDArray[np.intp]) -> float:
    """The one with which the posterior of held-out samples, distances (T, k), is as sure as it is right."""
    rows = np.arange(len(classes))
    weights = 1.0 / np.bincount(classes)[classes]
    losses = [-weights @ np.log(posterior(distances, t)[rows, classes] + 1e-12) for t in _TEMPERATURES]
    return float(_TEMPERATURES[int(np.argmin(losses))])
