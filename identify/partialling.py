"""Taking out of rows and candidates what a set of columns with priors can explain, whole or fold by fold."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from identify.vectors import Array

FOLDS = 5


class Basis:
    """An orthonormal basis of columns with priors; priors are further equations below the data."""

    def __init__(self, columns: Array, priors: Array):
        self.rows = columns.shape[0]
        lengths = np.linalg.norm(columns, axis=0)
        keep = lengths > 0
        self.columns, self.priors = columns[:, keep], priors[keep]
        augmented = np.concatenate([self.columns, np.diag(1.0 / self.priors)])
        self._folds: dict[int, tuple[tuple[Array, bool], Array]] = {}
        q = scipy.linalg.qr(augmented / np.linalg.norm(augmented, axis=0), mode="economic")[0]
        self.q: Array = np.asarray(q, float)

    def partial(self, y: Array) -> Array:
        """(n + priors, k): what the basis cannot explain of data columns (n, k)."""
        padded = np.concatenate([y, np.zeros((self.q.shape[0] - self.rows, y.shape[1]))])
        left = padded - self.q @ (self.q.T @ padded)
        return left - self.q @ (self.q.T @ left)

    def cross_validated(self, y: Array, candidate: Array, blocks: NDArray[np.intp]) -> tuple[Array, Array]:
        """Residual without and with a candidate, (n,) each; each block is predicted from folds that do not hold it."""
        n = self.rows
        folds = blocks % FOLDS
        data, priors = self.q[:n], self.q[n:]
        after, before = np.zeros(n), np.zeros(n)
        for fold in range(FOLDS):
            test = folds == fold
            factor, b = self._fold(y, folds, fold)
            K = scipy.linalg.cho_solve(factor, data.T @ candidate - data[test].T @ candidate[test])
            r, c = y - data @ b, candidate - data @ K
            r[test], c[test] = 0.0, 0.0
            below_r, below_c = -priors @ b, -priors @ K
            beta = np.linalg.solve(c.T @ c + below_c.T @ below_c, c.T @ r + below_c.T @ below_r)
            before[test] = y[test] - data[test] @ b
            after[test] = before[test] - (candidate[test] - data[test] @ K) @ beta
        return before, after

    def _fold(self, y: Array, folds: NDArray[np.intp], fold: int) -> tuple[tuple[Array, bool], Array]:
        """Factor of the training data's normal matrix and the solution without candidate, kept for all of them.

        In an orthonormal basis the matrix is the identity less the fold's own part, so normal equations are safe.
        """
        if fold not in self._folds:
            test = folds == fold
            part = self.q[: self.rows][test]
            G = np.eye(part.shape[1]) * (1.0 + 1e-12) - part.T @ part
            factor = scipy.linalg.cho_factor(G)
            moments = self.q[: self.rows].T @ y - part.T @ y[test]
            self._folds[fold] = (factor, scipy.linalg.cho_solve(factor, moments))
        return self._folds[fold]
