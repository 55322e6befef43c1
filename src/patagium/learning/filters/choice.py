"""Choice of a covariance structure, and of the kernel that learns whole samples with it."""

from __future__ import annotations

from patagium.learning.filters.block_kernel import kernel_for
from patagium.learning.filters.blocks import BLOCKS, WHOLE
from patagium.learning.filters.low_rank import LOW_RANK
from patagium.learning.filters.low_rank_kernel import compiled_low_rank
from patagium.learning.filters.numbers import FilterNumbers
from patagium.learning.filters.structure import Structure
from patagium.learning.settings import LowRank


def structure_and_kernel(numbers: FilterNumbers, compiled: bool) -> tuple[Structure, str | None]:
    """Covariance structure of a filter, and the name of its kernel.

    Args:
        numbers: Numbers of the filter.
        compiled: Whether to compile what can be compiled.

    Returns:
        Structure, and name of the kernel that learns a whole sample; None: NumPy does.
    """
    if numbers.settings.square_root == "cholesky":
        return WHOLE, None
    if isinstance(numbers.structure, LowRank):
        return (compiled_low_rank(numbers) if compiled else None) or LOW_RANK, None
    return BLOCKS, kernel_for(numbers) if compiled else None
