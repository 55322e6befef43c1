"""From a CasADi expression to a compiled, cached function, and C kernels by hand.

Without a C compiler everything still runs, on CasADi's virtual machine.
"""

from patagium.native.compiler import compiler_name, load_kernel
from patagium.native.function import NativeFunction, named_function
from patagium.native.library import expression_digest, load_functions

__all__ = [
    "NativeFunction",
    "compiler_name",
    "expression_digest",
    "load_functions",
    "load_kernel",
    "named_function",
]
