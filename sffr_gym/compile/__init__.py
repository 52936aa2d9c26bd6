"""The compiler's side of the kernels: numba and what it needs are known in this folder and nowhere else.

``jit``: the decorators of kernels and of functions inlined in them, and the cache of what is compiled; ``workspace``:
named arrays in memory that is made once and handed in; ``lanes``: eight numbers as one, the vector registers' kind of
number; ``linalg``, ``angles``: small linear algebra, and sines and cosines that are refreshed, for each kind.
"""
