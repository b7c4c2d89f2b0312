"""One BLAS thread while Dr.Jit's threads work."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def single_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread inside the block.

    The matrix products here are small and alternate with kernels that use all cores. A BLAS with threads
    of its own keeps them spinning after every product, which costs the kernels up to half of their speed;
    and its last bits depend on its number of threads.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        yield
