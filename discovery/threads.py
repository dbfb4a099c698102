"""Tasks in threads of this process, for what is too large to be sent to others."""

from __future__ import annotations

from joblib import Parallel


def side_by_side(jobs: int) -> Parallel:
    """Return joblib's pool whose results are a generator, in order, wherever other parallel work runs.

    What threads call must leave Python's lock most of the time: compiled kernels and transforms do.

    Parameters
    ----------
    jobs : int
        Threads.
    """
    return Parallel(n_jobs=jobs, prefer="threads", require="sharedmem", return_as="generator")
