"""Triangular factors of matrices with far more rows than columns."""

from __future__ import annotations

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_BLOCK: Numerical[int] = 512  # rows; those of some tens of columns stay in a processor's cache


def triangle(matrix: FloatArray) -> FloatArray:
    """R of A = Q R without Q, (columns, columns); of fewer rows than columns (rows, columns).

    Block by block, then of the blocks' triangles (J. Demmel, L. Grigori, M. Hoemmen and J. Langou,
    Communication-optimal parallel and sequential QR and LU factorizations, SIAM J. Sci. Comput. 34, A206,
    2012): a pass over the whole matrix a column would wait for memory most of the time.
    """
    rows, columns = matrix.shape
    blocks = rows // _BLOCK
    whole = blocks * _BLOCK
    each = np.linalg.qr(matrix[:whole].reshape(blocks, _BLOCK, columns), mode="r")
    return np.asarray(np.linalg.qr(np.concatenate([*each, matrix[whole:]]), mode="r"))
